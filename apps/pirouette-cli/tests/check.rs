//! `check`: one line per photo, without computing a body; and refused scans.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use common::{Folders, person, pirouette, text};
use pirouette::scan::{Photo, Scan};
use pirouette_files::scan_folder::write_scan;

/// The rendered person, with photos that end above the ankles
fn without_feet() -> Scan {
    let mut scan = person().scan.clone();
    for view in &mut scan.views {
        let (width, height) = (view.photo.width(), view.photo.height() * 4 / 5);
        view.photo = Photo::from_fn(width, height, |x, y| view.photo[(x, y)]);
        view.input_size_px = (width, height);
    }
    scan
}

#[test]
fn every_photo_has_one_line() {
    let folders = Folders::with_views(4);
    let scan = folders.scan();
    let run = pirouette(&["check", text(&scan)]).exits_with(0);
    let lines = run.stdout();
    for view in ["000", "001", "002", "003"] {
        let line = lines.lines().find(|line| line.starts_with(view)).unwrap();
        assert!(line.contains("25"), "{line}");
    }
    assert!(!folders.out().exists());
    let json = pirouette(&["check", text(&scan), "--json"])
        .exits_with(0)
        .json_line();
    assert_eq!(json["views"].as_array().unwrap().len(), 4);
    assert_eq!(json["views"][2]["joints"], 25);
}

#[test]
fn missing_feet_are_found_by_check_and_refused_by_scan() {
    let folders = Folders::empty();
    write_scan(&folders.scan(), &without_feet()).unwrap();
    let scan = folders.scan();
    let run = pirouette(&["check", text(&scan)]).exits_with(1);
    assert!(run.stdout().contains("feet"), "{}", run.stdout());
    assert_eq!(
        run.stderr()
            .lines()
            .filter(|l| l.starts_with("error"))
            .count(),
        1
    );

    let json = pirouette(&["check", text(&scan), "--json"]).exits_with(1);
    assert_eq!(json.stdout().lines().count(), 1);
    let error = json.json_line()["error"].as_str().unwrap().to_owned();
    assert!(error.contains("feet"), "{error}");

    let flags = ["--format", "ply", "-q"];
    let run = folders.run("reconstruct", &flags).exits_with(1);
    assert!(run.stderr().contains("feet"), "{}", run.stderr());
    assert!(!folders.out().join("body.ply").exists());
    let run = folders
        .run("scan", &["--format", "ply", "-q"])
        .exits_with(1);
    let error = run.stderr();
    assert!(
        error.contains("feet") && error.lines().count() == 1,
        "{error}"
    );
    // Pictures show why; no number and no body in mm is left.
    let result = folders.json("result.json");
    assert_eq!(result["refusal"]["code"], "feet_cut_off");
    let out = folders.out();
    assert!(out.join("contact.jpg").exists());
    assert!(!out.join("measurements.json").exists() && !out.join("body.ply").exists());
    pirouette(&["size", text(&out)]).exits_with(1);
}

#[test]
fn a_photo_given_for_all_views_is_one_clear_error() {
    let folders = Folders::with_views(4);
    for view in 1..4 {
        for file in ["png", "jpg"] {
            let from = folders.scan().join(format!("000.{file}"));
            if from.exists() {
                std::fs::copy(&from, folders.scan().join(format!("{view:03}.{file}"))).unwrap();
            }
        }
        let keypoints = folders.scan().join("000_keypoints.json");
        std::fs::copy(
            keypoints,
            folders.scan().join(format!("{view:03}_keypoints.json")),
        )
        .unwrap();
    }
    for command in ["check", "scan"] {
        let run = pirouette(&[command, text(&folders.scan()), "-q"]).exits_with(1);
        let error = run.stderr();
        assert!(error.contains("3 of the 4 photos"), "{error}");
    }
}

#[test]
fn angles_are_found_and_wrong_ones_are_not_used() {
    let folders = Folders::empty();
    let mut stated = person().scan.clone();
    // Neither the order nor any stated angle is right.
    stated.views.rotate_left(3);
    let truth: Vec<f64> = stated
        .views
        .iter()
        .map(|view| view.turn.degrees())
        .collect();
    for view in &mut stated.views {
        view.turn = pirouette_body::TurnAngle::from_degrees(10.0 - 2.0 * view.turn.degrees());
    }
    write_scan(&folders.scan(), &stated).unwrap();
    let scan = folders.scan();
    let check = ["check", text(&scan), "--angles", "unknown", "--json"];
    let json = pirouette(&check).exits_with(0).json_line();
    let views = json["views"].as_array().unwrap();
    assert_eq!(views.len(), truth.len());
    for (view, truth) in views.iter().zip(truth) {
        // Sway turns the person by up to 6 degrees.
        let off = view["angle_deg"].as_f64().unwrap() - truth;
        let off = (off + 180.0).rem_euclid(360.0) - 180.0;
        assert!(off.abs() < 12.0, "{view} {truth}");
    }
    let warnings = json["warnings"].to_string();
    assert!(warnings.contains("turn angles were found"), "{warnings}");
}
