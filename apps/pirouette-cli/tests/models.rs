//! The pose detector: its networks, and scans of photos without keypoint files.
//!
//! Tests that need the network read the environment variable `PIROUETTE_POSE_MODEL`, which `.ci/run` sets.

mod common;

use common::{Folders, pirouette, text};

#[cfg(not(feature = "embed-pose-model"))]
#[test]
fn without_a_network_the_list_names_the_command_that_installs_one() {
    let run = pirouette(&["models", "list"]);
    let run = run.exits_with(0);
    let out = run.stdout();
    for name in [
        "lite",
        "full",
        "heavy",
        "not installed",
        "pirouette models install",
    ] {
        assert!(out.contains(name), "{name}: {out}");
    }
}

#[cfg(feature = "embed-pose-model")]
#[test]
fn an_embedded_network_is_listed_and_used() {
    let run = pirouette(&["models", "list", "--json"]).exits_with(0);
    let line = run.json_line();
    assert!(line["embedded"].is_string(), "{line}");
    assert_eq!(line["used"], "the embedded network");
    let folders = Folders::with_views(1);
    only_photos(&folders);
    folders.run("keypoints", &[]).exits_with(0);
    // A network that is named has precedence.
    let file = folders.write("network.tflite", b"\x1c\0\0\0TFL3 damaged");
    let run = folders.run("keypoints", &["--pose-model", text(&file)]);
    assert!(run.exits_with(1).stderr().contains("network.tflite"));
}

#[test]
fn a_file_that_is_no_package_is_not_installed() {
    let folders = Folders::empty();
    let file = folders.write("package.tgz", b"no package");
    let run = pirouette(&["models", "install", "lite", "--from", text(&file)]);
    let run = run.exits_with(1);
    let error = run.stderr();
    assert!(
        error.contains("does not contain pose_landmark_lite.tflite"),
        "{error}"
    );
}

#[cfg(not(feature = "embed-pose-model"))]
#[test]
fn photos_alone_without_a_network_name_the_remedy() {
    let folders = Folders::with_views(3);
    only_photos(&folders);
    let run = folders.run("scan", &[]);
    let run = run.exits_with(1);
    assert!(
        run.stderr().contains("pirouette models install"),
        "{}",
        run.stderr()
    );
}

#[test]
fn a_damaged_network_is_an_error_that_names_it() {
    let folders = Folders::with_views(3);
    let file = folders.write("network.tflite", b"\x1c\0\0\0TFL3 damaged");
    let run = folders.run("scan", &["--pose-model", text(&file)]);
    let run = run.exits_with(1);
    assert!(run.stderr().contains("network.tflite"), "{}", run.stderr());
}

#[test]
fn photos_alone_are_scanned_and_their_keypoints_written() {
    let Some(model) = std::env::var_os("PIROUETTE_POSE_MODEL") else {
        eprintln!("skipped: PIROUETTE_POSE_MODEL names no network");
        return;
    };
    let folders = Folders::with_views(4);
    only_photos(&folders);
    std::fs::write(
        folders.path("scan/scan.json"),
        r#"{ "subject": { "stature_mm": 1650 } }"#,
    )
    .unwrap();
    let run = folders.run("scan", &["--pose-model", model.to_str().unwrap()]);
    run.exits_with(0);
    let result = folders.json("result.json");
    assert_eq!(result["detector"], "blazepose");
    assert!(result["seconds"]["detect"].is_number());
    let points = folders.json("views/001/keypoints.json");
    let numbers = points["people"][0]["pose_keypoints_2d"].as_array().unwrap();
    assert_eq!(numbers.len(), 75);
    let waist = folders.json("measurements.json")["measurements_mm"]["waist_girth"]
        .as_f64()
        .unwrap();
    assert!((500.0..1000.0).contains(&waist), "{waist}");
}

/// Removes keypoint files and the manifest
fn only_photos(folders: &Folders) {
    for entry in std::fs::read_dir(folders.scan()).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path
            .extension()
            .is_some_and(|extension| extension == "json")
        {
            std::fs::remove_file(path).expect("a file");
        }
    }
}
