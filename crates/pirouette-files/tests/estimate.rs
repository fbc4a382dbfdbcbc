//! Scans without keypoints and without a detector.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::collections::BTreeMap;

use pirouette::measure::Measure;
use pirouette::pipeline::{CancelToken, Config, Goal, Method, PipelineError};
use pirouette_files::job::{FinishedJob, JobError, JobOptions, KeypointChoice, run_job};
use pirouette_files::results::ResultOptions;
use pirouette_files::scan_folder::scan_files;
use pirouette_files::source::Source;
use pirouette_synthetic::people::turning_woman;

type Files = BTreeMap<String, Vec<u8>>;

fn run(files: Files, goal: Goal, keypoints: KeypointChoice) -> Result<FinishedJob, JobError> {
    let options = JobOptions {
        keypoints,
        ..JobOptions::default()
    };
    run_job(
        Source::from_files("anna", files).unwrap(),
        &Config::new(goal, Method::Fit),
        &options,
        &CancelToken::default(),
        &mut |_| {},
    )
}

fn without_keypoint_files(mut files: Files) -> Files {
    files.retain(|name, _| !name.ends_with("_keypoints.json"));
    files
}

fn waist(done: &FinishedJob) -> (f64, f64) {
    let measurements = done.report.measurements.as_ref().expect("a measured body");
    let mut all = measurements.iter();
    let (_, waist) = all
        .find(|(measure, _)| *measure == Measure::WaistGirth)
        .expect("a waist");
    (
        waist.value_mm.expect("a value"),
        waist.sd_mm.expect("a deviation"),
    )
}

#[test]
fn a_scan_without_keypoints_is_measured_with_larger_deviations() {
    let files = scan_files(&turning_woman(8).scan).unwrap();
    let given = run(files.clone(), Goal::Measure, KeypointChoice::Best).unwrap();
    let done = run(
        without_keypoint_files(files),
        Goal::Measure,
        KeypointChoice::Best,
    )
    .unwrap();
    assert_eq!(done.report.views.len(), 8);
    let codes: Vec<_> = done.report.warnings.iter().map(|w| w.code()).collect();
    assert!(codes.contains(&"keypoints_estimated"), "{codes:?}");
    let ((exact, small), (estimated, large)) = (waist(&given), waist(&done));
    assert!(large > small, "{large} {small}");
    assert!(
        (estimated - exact).abs() < 3.0 * large,
        "{exact} {estimated} {large}"
    );
    let artifacts = done.artifacts(&ResultOptions::default()).unwrap();
    assert!(artifacts.contains_key("views/000/keypoints.json"));
    let result = String::from_utf8(artifacts["result.json"].clone()).unwrap();
    assert!(result.contains("\"detector\": \"estimate\""), "{result}");
}

#[test]
fn an_estimate_can_be_cancelled() {
    let files = without_keypoint_files(scan_files(&turning_woman(4).scan).unwrap());
    let cancel = CancelToken::default();
    cancel.cancel();
    let done = run_job(
        Source::from_files("anna", files).unwrap(),
        &Config::new(Goal::Measure, Method::Fit),
        &JobOptions::default(),
        &cancel,
        &mut |_| {},
    );
    let error = done.expect_err("a cancelled job");
    assert!(
        matches!(error, JobError::Pipeline(PipelineError::Cancelled)),
        "{error}"
    );
}

#[test]
fn keypoint_files_are_not_read_if_an_estimate_is_requested() {
    let mut files = scan_files(&turning_woman(4).scan).unwrap();
    for (name, bytes) in &mut files {
        if name.ends_with("_keypoints.json") {
            *bytes = b"no keypoints".to_vec();
        }
    }
    let done = run(files.clone(), Goal::Segment, KeypointChoice::Estimate).unwrap();
    assert_eq!(done.report.views.len(), 4);
    let read = run(files, Goal::Segment, KeypointChoice::Best);
    assert!(
        read.is_err(),
        "unreadable files must not become an estimate"
    );
}

#[test]
fn a_photo_of_the_empty_room_is_not_a_view() {
    let mut files = without_keypoint_files(scan_files(&turning_woman(4).scan).unwrap());
    files.remove("scan.json");
    let photo = files["000.jpg"].clone();
    files.insert("Background.jpg".to_owned(), photo);
    // The photo is that of the first view, which does not differ from it.
    let error = run(files.clone(), Goal::Segment, KeypointChoice::Best).unwrap_err();
    assert!(error.to_string().contains("in 1 of 4 photos"), "{error}");
    files.insert("Background.jpg".to_owned(), b"no photo".to_vec());
    let error = run(files, Goal::Segment, KeypointChoice::Best).unwrap_err();
    assert!(error.to_string().contains("Background.jpg"), "{error}");
}

#[test]
fn the_manifest_names_the_photo_of_the_empty_room() {
    let mut files = without_keypoint_files(scan_files(&turning_woman(4).scan).unwrap());
    let manifest = String::from_utf8(files["scan.json"].clone()).unwrap();
    let named = |path: &str| manifest.replacen('{', &format!("{{\"background\": \"{path}\","), 1);
    files.insert("scan.json".to_owned(), named("room.jpg").into_bytes());
    let error = run(files.clone(), Goal::Segment, KeypointChoice::Best).unwrap_err();
    assert!(error.to_string().contains("room.jpg"), "{error}");
    files.insert("scan.json".to_owned(), named("../room.jpg").into_bytes());
    let error = run(files, Goal::Segment, KeypointChoice::Best).unwrap_err();
    assert!(error.to_string().contains("background"), "{error}");
}

#[test]
fn without_any_way_to_keypoints_the_error_names_the_detector() {
    let mut files = without_keypoint_files(scan_files(&turning_woman(3).scan).unwrap());
    files.remove("scan.json");
    let error = run(files, Goal::Measure, KeypointChoice::Best)
        .unwrap_err()
        .to_string();
    assert!(error.contains("at least 4"), "{error}");
    assert!(error.contains("pirouette models install"), "{error}");
}
