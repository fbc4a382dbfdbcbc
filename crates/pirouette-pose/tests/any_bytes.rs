//! Damaged and hostile models are rejected or run, without panics and without much memory.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod tiny_model;

use pirouette_pose::{ModelError, Photo, PoseModel};
use proptest::prelude::*;
use tiny_model::{Builder, tiny_model};

/// Parses bytes and, if they are accepted, searches and detects in a small photo.
fn exercise(bytes: &[u8]) -> Result<(), ModelError> {
    let model = PoseModel::parse(bytes)?;
    let pixels: Vec<[u8; 3]> = (0..60).map(|i| [i * 4, 255 - i * 4, i]).collect();
    let photo = Photo::new(10, 6, &pixels).unwrap();
    let region = model
        .search(&photo)
        .unwrap_or(pirouette_pose::Region::containing(&photo));
    let with_mask = model.detect(&photo, &region, 2, true);
    let without = model.detect(&photo, &region, 2, false);
    for (a, b) in with_mask.landmarks.iter().zip(&without.landmarks) {
        assert!(
            a.visibility.to_bits() == b.visibility.to_bits()
                && a.depth.to_bits() == b.depth.to_bits()
        );
    }
    assert!(with_mask.mask.is_some() && without.mask.is_none());
    Ok(())
}

/// Largest memory of this process so far, in MB, where the system reports it
fn peak_memory_mb() -> Option<usize> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    Some(line.trim().trim_end_matches(" kB").parse::<usize>().ok()? / 1024)
}

#[test]
fn the_tiny_model_is_accepted() {
    assert_eq!(exercise(&tiny_model()), Ok(()));
}

#[test]
fn every_truncated_model_is_rejected() {
    let bytes = tiny_model();
    for len in (0..bytes.len()).rev() {
        assert!(
            PoseModel::parse(&bytes[..len]).is_err(),
            "{len} of {} bytes",
            bytes.len()
        );
    }
}

#[test]
fn every_changed_byte_gives_a_model_or_an_error() {
    let bytes = tiny_model();
    // Weights are at the end.
    let structure_len = bytes.len() - 4000;
    let (mut accepted, mut rejected) = (0, 0);
    for place in 0..structure_len {
        for value in [0, 127, 255, bytes[place] ^ 4] {
            let mut changed = bytes.clone();
            changed[place] = value;
            match exercise(&changed) {
                Ok(()) => accepted += 1,
                Err(error) => {
                    assert!(!error.to_string().is_empty());
                    rejected += 1;
                }
            }
        }
    }
    assert!(
        accepted > 1000 && rejected > 1000,
        "{accepted} accepted, {rejected} rejected"
    );
    if let Some(peak) = peak_memory_mb() {
        assert!(peak < 400, "{peak} MB");
    }
}

#[test]
fn shared_weights_cannot_multiply_memory() {
    let mut b = Builder {
        buffers: vec![vec![]],
        ..Builder::default()
    };
    let input = b.tensor(&[1, 1, 1, 512], 0, 0);
    let (weights, bias) = (b.halves(&[512, 1, 1, 512]), b.halves(&[512]));
    let mut last = input;
    for _ in 0..5000 {
        last = b.operator(1, &[last, weights, bias], &[1, 1, 1, 512], vec![]);
    }
    let error = PoseModel::parse(&b.write(&[input], &[last])).unwrap_err();
    assert!(matches!(error, ModelError::TooLarge { .. }), "{error}");
}

#[test]
fn errors_name_the_operator() {
    let mut b = Builder {
        buffers: vec![vec![]],
        ..Builder::default()
    };
    let input = b.tensor(&[1, 8, 8, 3], 0, 0);
    let output = b.convolution(input, &[2, 3, 3, 4], &[1, 8, 8, 2], 0, 1);
    let error = PoseModel::parse(&b.write(&[input], &[output])).unwrap_err();
    assert_eq!(
        error.to_string(),
        "operator 2 of the model: the weights must have shape [0, 0, 0, 3] (0: any size), found [2, 3, 3, 4]"
    );
    assert_eq!(
        PoseModel::parse(b"RIFF").unwrap_err(),
        ModelError::NotTflite
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    #[test]
    fn several_changed_words_give_a_model_or_an_error(
        changes in prop::collection::vec((any::<prop::sample::Index>(), prop::sample::select(
            vec![0u32, 1, 2, 3, 7, 8, 9, 39, 64, 195, 255, 256, 65_535, 1 << 20, i32::MAX as u32, u32::MAX - 1, u32::MAX])), 1..5),
    ) {
        let mut bytes = tiny_model();
        let words = (bytes.len() - 4000) / 4;
        for (place, value) in changes {
            let at = 4 * place.index(words);
            bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        }
        let _ = exercise(&bytes);
    }

    #[test]
    fn random_bytes_are_rejected(tail in prop::collection::vec(any::<u8>(), 0..200)) {
        let bytes = [&[8u8, 0, 0, 0], &b"TFL3"[..], &tail].concat();
        prop_assert!(PoseModel::parse(&bytes).is_err());
    }
}
