//! Computes the silhouettes of a scan by calling one stage directly, and writes them as PNG.
//!
//! ```text
//! cargo run --release -p pirouette-files --example segment -- photos/anna masks
//! ```

#![allow(clippy::print_stdout, reason = "the example prints its results")]

use std::error::Error;
use std::path::PathBuf;

use pirouette::segment::{SegmentOptions, SegmentView, segment};
use pirouette_files::formats::photo::encode_mask;
use pirouette_files::scan_folder::{LoadOptions, load_scan};
use pirouette_files::sink::write_atomic;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [folder, out] = &arguments[..] else {
        return Err("usage: segment SCAN_FOLDER MASK_FOLDER".into());
    };
    let loaded = load_scan(folder, &LoadOptions::default())?;
    // Without the silhouette of a posed avatar as prior, the seeds are capsules around the bones.
    let views = loaded.scan.views.iter().map(|view| SegmentView {
        photo: &view.photo,
        keypoints: &view.keypoints,
        prior: None,
        mask: view.mask.as_ref(),
        person_odds: view.person_odds.as_ref(),
    });
    let views: Vec<SegmentView> = views.collect();
    let found = segment(&views, None, &SegmentOptions::default(), &|| false);
    std::fs::create_dir_all(out)?;
    for (view, silhouette) in loaded.scan.views.iter().zip(found) {
        match silhouette {
            Ok(silhouette) => {
                let file = out.join(format!("{}.png", view.name));
                write_atomic(&file, &encode_mask(&silhouette.mask)?)?;
                println!("{}", file.display());
            }
            Err(error) => println!("view {}: {error}", view.name),
        }
    }
    Ok(())
}
