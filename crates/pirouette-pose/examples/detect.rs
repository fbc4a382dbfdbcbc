//! Prints the landmarks of the person in each photo.
//!
//! `cargo run --release -p pirouette-pose --example detect -- MODEL.tflite PHOTO...`
//!
//! Per photo one line with the name, the presence and the region, then one line per landmark: x, y and depth in px,
//! visibility, presence.

#![allow(clippy::print_stdout, reason = "prints its results")]

use pirouette_pose::{Photo, PoseModel};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let model = arguments
        .next()
        .ok_or("usage: detect MODEL.tflite PHOTO...")?;
    let model = PoseModel::parse(&std::fs::read(&model).map_err(|e| format!("{model}: {e}"))?)?;
    for path in arguments {
        let image = image::open(&path)
            .map_err(|e| format!("{path}: {e}"))?
            .to_rgb8();
        let photo = Photo::new(
            image.width() as usize,
            image.height() as usize,
            image.as_raw().as_chunks().0,
        )?;
        let Some(region) = model.search(&photo) else {
            println!("{path}: no person found");
            continue;
        };
        let found = model.detect(&photo, &region, 2, false);
        println!(
            "{path}: presence {:.4}, region {:?}",
            found.presence, found.region
        );
        for landmark in &found.landmarks {
            let [x, y] = landmark.position;
            println!(
                "{x:.3} {y:.3} {:.3} {:.4} {:.4}",
                landmark.depth, landmark.visibility, landmark.presence
            );
        }
    }
    Ok(())
}
