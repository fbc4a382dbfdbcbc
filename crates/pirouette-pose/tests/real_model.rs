//! Tests on a real model: the environment variable `PIROUETTE_POSE_MODEL` names a file `pose_landmark_*.tflite`.

#![allow(clippy::print_stdout, reason = "reports skipped tests")]

use pirouette_pose::{Photo, PoseModel, Region};

/// Reads the model, or reports that the test is skipped.
fn model_bytes(test: &str) -> Option<Vec<u8>> {
    let Some(path) = std::env::var_os("PIROUETTE_POSE_MODEL") else {
        println!("{test}: skipped, PIROUETTE_POSE_MODEL is not set");
        return None;
    };
    Some(std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display())))
}

/// Photo of 300 x 400 px without a person: a gradient
fn gradient() -> Vec<[u8; 3]> {
    (0..300 * 400)
        .map(|i| [(i % 300 / 2) as u8, (i / 300 / 2) as u8, 90])
        .collect()
}

#[test]
fn no_person_is_found_in_a_gradient() {
    let Some(bytes) = model_bytes("no_person_is_found_in_a_gradient") else {
        return;
    };
    let model = PoseModel::parse(&bytes).unwrap();
    let pixels = gradient();
    let photo = Photo::new(300, 400, &pixels).unwrap();
    assert_eq!(model.search(&photo), None);
    let found = model.detect(&photo, &Region::containing(&photo), 1, true);
    assert!(found.presence < 0.5, "presence {}", found.presence);
    assert!(
        found
            .landmarks
            .iter()
            .all(|l| (0.0..=1.0).contains(&l.visibility))
    );
    let mask = found.mask.unwrap();
    assert_eq!(
        (mask.width, mask.height, mask.values.len()),
        (256, 256, 65_536)
    );
    assert!(mask.values.iter().all(|v| (0.0..=1.0).contains(v)));
}

/// Photo of 240 x 300 px of random colors, interpolated between points 24 px apart
fn noise(seed: u64) -> Vec<[u8; 3]> {
    const STEP: usize = 24;
    let value = |x: usize, y: usize, channel: usize| {
        let mut hash = seed ^ (x as u64 + 1000 * y as u64) << 8 ^ (channel as u64) << 40;
        for _ in 0..3 {
            hash = (hash ^ hash >> 31).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        }
        (hash >> 56) as f64
    };
    let pixel = |i: usize| {
        let (x, y) = (i % 240, i / 240);
        let (u, v) = (x % STEP, y % STEP);
        let [u, v] = [u, v].map(|part| part as f64 / STEP as f64);
        let (x, y) = (x / STEP, y / STEP);
        std::array::from_fn(|channel| {
            let row = |y: usize| value(x, y, channel) * (1.0 - u) + value(x + 1, y, channel) * u;
            (row(y) * (1.0 - v) + row(y + 1) * v) as u8
        })
    };
    (0..240 * 300).map(pixel).collect()
}

#[test]
fn no_person_is_found_in_noise() {
    let Some(bytes) = model_bytes("no_person_is_found_in_noise") else {
        return;
    };
    let model = PoseModel::parse(&bytes).unwrap();
    // Without a look at the mirror image, the networks `full` and `heavy` find a person in each.
    for seed in [1, 28] {
        let pixels = noise(seed);
        let photo = Photo::new(240, 300, &pixels).unwrap();
        assert_eq!(model.search(&photo), None, "{seed}");
    }
}

#[test]
fn results_are_equal_in_several_threads() {
    let Some(bytes) = model_bytes("results_are_equal_in_several_threads") else {
        return;
    };
    let model = PoseModel::parse(&bytes).unwrap();
    let pixels = gradient();
    let photo = Photo::new(300, 400, &pixels).unwrap();
    let detect = |want_mask| {
        model
            .detect(&photo, &Region::containing(&photo), 2, want_mask)
            .landmarks
    };
    let [a, b] = std::thread::scope(|scope| {
        [true, false]
            .map(|want_mask| scope.spawn(move || detect(want_mask)))
            .map(|thread| thread.join().unwrap())
    });
    assert_eq!(a, b);
}

#[test]
fn truncated_models_are_rejected() {
    let Some(bytes) = model_bytes("truncated_models_are_rejected") else {
        return;
    };
    for i in 0..200 {
        assert!(PoseModel::parse(&bytes[..bytes.len() * i / 200]).is_err());
    }
}

#[test]
fn changed_models_are_rejected_or_read() {
    let Some(mut bytes) = model_bytes("changed_models_are_rejected_or_read") else {
        return;
    };
    let len = bytes.len();
    // Tables are at both ends of the file, weights between them.
    for i in 0..300 {
        let at = if i % 2 == 0 {
            i * 97
        } else {
            len - 1 - i * 331
        };
        let saved = std::mem::replace(&mut bytes[at], [0xff, 0x7f, 0, 1][i % 4]);
        let _ = PoseModel::parse(&bytes);
        bytes[at] = saved;
    }
}
