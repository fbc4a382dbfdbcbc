//! Measures the time of passes of the network, for a comparison in alternating runs.
//!
//! `cargo run --release -p pirouette-pose --example time_passes -- MODEL.tflite`
//!
//! For each line of standard input, `mask N` or `landmarks N`, runs N passes on one thread, with or without the mask, and
//! prints the milliseconds per pass. `benches/peers/pose.py` alternates it with TFLite.

#![allow(clippy::print_stdout, reason = "prints its results")]

use pirouette_pose::{Photo, PoseModel, Region};
use std::error::Error;
use std::io::BufRead;
use std::time::Instant;

/// Width and height of the photo: that of the input, so that sampling is a small part
const SIDE: usize = 256;

fn main() -> Result<(), Box<dyn Error>> {
    let model = std::env::args()
        .nth(1)
        .ok_or("usage: time_passes MODEL.tflite")?;
    let model = PoseModel::parse(&std::fs::read(model)?)?;
    let pixels: Vec<[u8; 3]> = (0..SIDE * SIDE)
        .map(|i| [(i % SIDE) as u8, (i / SIDE) as u8, (i * 7 % 251) as u8])
        .collect();
    let photo = Photo::new(SIDE, SIDE, &pixels)?;
    let region = Region::containing(&photo);
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let (what, count) = line.split_once(' ').ok_or("expected `mask N`")?;
        let (want_mask, count) = (what == "mask", count.parse::<u32>()?);
        let start = Instant::now();
        for _ in 0..count {
            std::hint::black_box(model.detect(&photo, &region, 1, want_mask));
        }
        println!(
            "{:.4}",
            start.elapsed().as_secs_f64() * 1e3 / f64::from(count)
        );
    }
    Ok(())
}
