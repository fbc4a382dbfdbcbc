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
