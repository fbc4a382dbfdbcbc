//! Outputs of the networks compared with those of TFLite for the same input tensor.
//!
//! `tests/vectors/make.py` made the expected values, with one thread of ai-edge-litert 2.3. The environment variable
//! `PIROUETTE_POSE_MODEL` names the file of a network; all networks in the same folder are tested.

#![allow(
    clippy::print_stdout,
    reason = "reports skipped tests and the differences"
)]

use super::Runner;
use crate::kernels::elementwise::logistic;
use crate::{Photo, PoseModel, Region};
use std::collections::BTreeMap;

/// Largest accepted difference of landmarks, in px of the network, and of their logits
///
/// Measured: 2.4e-4 with `lite`, 6.5e-4 with `full`, 7.0e-4 with `heavy`; 1.1e-4 after refinement by the heat maps.
const LANDMARK_TOLERANCE: f32 = 1e-3;

/// Largest accepted difference of logits of the heat maps and of probabilities of the mask
const MAP_TOLERANCE: f32 = 1e-3;

/// Values of one input by what they are
type Expected = BTreeMap<String, Vec<f32>>;

const INPUTS: [(&str, &[u8]); 2] = [
    ("a", include_bytes!("../../tests/vectors/a.png")),
    ("b", include_bytes!("../../tests/vectors/b.png")),
];

const VECTORS: [(&str, &str); 3] = [
    ("lite", include_str!("../../tests/vectors/lite.txt")),
    ("full", include_str!("../../tests/vectors/full.txt")),
    ("heavy", include_str!("../../tests/vectors/heavy.txt")),
];

fn parse(text: &str, input: &str) -> Expected {
    let lines = text.lines().map(|line| line.split(' '));
    lines
        .filter_map(|mut words| {
            let is_input = words.next() == Some(input);
            let key = words.next()?.to_owned();
            is_input.then(|| (key, words.map(|word| word.parse().unwrap()).collect()))
        })
        .collect()
}

fn largest_difference(found: impl IntoIterator<Item = f32>, expected: &[f32]) -> f32 {
    let found: Vec<f32> = found.into_iter().collect();
    assert_eq!(found.len(), expected.len());
    let differences = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, |a, b| if b <= a { a } else { b })
}

/// Samples every 16th column and row
fn every_16(values: &[f32], width: usize, channels: usize) -> impl Iterator<Item = f32> {
    let rows = values.chunks_exact(width * channels).step_by(16);
    rows.flat_map(move |row| row.chunks_exact(channels).step_by(16).flatten().copied())
}

#[test]
fn outputs_are_those_of_tflite() {
    let Some(named) = std::env::var_os("PIROUETTE_POSE_MODEL") else {
        println!("skipped, PIROUETTE_POSE_MODEL is not set");
        return;
    };
    let folder = std::path::Path::new(&named).parent().unwrap();
    for (network, text) in VECTORS {
        let Ok(bytes) = std::fs::read(folder.join(format!("pose_landmark_{network}.tflite")))
        else {
            println!("{network}: skipped, not in {}", folder.display());
            continue;
        };
        let model = PoseModel::parse(&bytes).unwrap();
        for (input, png) in INPUTS {
            let image = image::load_from_memory(png).unwrap().to_rgb8();
            let pixels = image.as_raw().as_chunks().0;
            let photo = Photo::new(model.side, model.side, pixels).unwrap();
            // Samples of this region are the pixels themselves.
            let side = model.side as f64;
            let region = Region::new([side / 2.0; 2], side, 0.0).unwrap();
            let mut runner = Runner::new(&model, photo, true);
            let detection = runner.run(&region);
            let expected = parse(text, input);
            let landmarks = runner.output(0).iter().copied();
            let heat = every_16(
                runner.output(2),
                model.heat_shape.width,
                model.heat_shape.channels,
            );
            // Where logits exceed 100, they differ by more, but probabilities are 0 or 1.
            let mask = every_16(runner.output(3), model.mask_shape.width, 1).map(logistic);
            let expected_mask: Vec<f32> = expected["mask_every_16"]
                .iter()
                .map(|&v| logistic(v))
                .collect();
            let positions = detection.landmarks.iter().flat_map(|l| l.position);
            let differences = [
                largest_difference(landmarks, &expected["landmarks"]),
                largest_difference(positions.map(|v| v as f32), &expected["positions"]),
                largest_difference([detection.presence as f32], &expected["presence"]),
                largest_difference(heat, &expected["heat_every_16"]),
                largest_difference(mask, &expected_mask),
            ];
            println!(
                "{network} {input}: {}",
                differences.map(|d| format!("{d:.1e}")).join(" ")
            );
            let [landmarks, positions, presence, heat, mask] = differences;
            assert!(
                landmarks <= LANDMARK_TOLERANCE,
                "{network} {input}: {landmarks}"
            );
            assert!(
                positions <= LANDMARK_TOLERANCE,
                "{network} {input}: {positions}"
            );
            assert!(presence <= 1e-5, "{network} {input}: {presence}");
            assert!(
                heat.max(mask) <= MAP_TOLERANCE,
                "{network} {input}: {heat} {mask}"
            );
        }
    }
}
