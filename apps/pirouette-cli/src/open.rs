//! Opens what a command scans: a folder of photos, a zip file, or a video.

use std::path::Path;

use anyhow::{Result, bail};
use pirouette::pipeline::CancelToken;
use pirouette::pose::PoseModel;
use pirouette_files::scan_folder::open_source;
use pirouette_files::source::Source;
use pirouette_files::video::{VideoFile, VideoOptions, VideoScan, scan_of_video};

use crate::progress::Progress;

/// Opens a scan; of a video, sharp frames spread evenly over the turn are taken
pub fn open_scan(
    scan: &Path,
    model: Option<&PoseModel>,
    options: &VideoOptions,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<Source> {
    let Some(file) = VideoFile::find(scan) else {
        return Ok(open_source(scan)?);
    };
    let Some(model) = model else {
        bail!(
            "{}: the turn in a video is found by the pose detector, which is not installed: run 'pirouette models install'",
            file.video.display()
        );
    };
    let found = scan_of_video(&file, model, options, cancel, &mut |share| {
        progress.share("video", share);
    })?;
    report(&found, progress);
    Ok(found.source)
}

/// Says what was found
fn report(found: &VideoScan, progress: &Progress) {
    let choice = &found.extracted.choice;
    let turned_deg = choice.turned_radians.to_degrees();
    progress.print_line(&format!(
        "video: a turn by {turned_deg:.0} degrees, {} views from {:.1} s to {:.1} s",
        choice.frames.len(),
        choice.frames.first().map_or(0.0, |frame| frame.time_s),
        choice.frames.last().map_or(0.0, |frame| frame.time_s),
    ));
}
