//! Invalid input: a bad view is rejected without affecting the others; errors of folders say how to fix them.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use common::Folders;
use pirouette_files::formats::photo::encode_mask;
use pirouette_geom::Mask;

/// Damages one of four views, scans, and returns the reason for its rejection
#[track_caller]
fn reason_for_rejection(damage: impl FnOnce(&Folders)) -> String {
    let folders = Folders::with_views(4);
    damage(&folders);
    let run = folders.run("scan", &[]).exits_with(0);
    assert!(
        run.stderr().contains("view 001 is rejected"),
        "{}",
        run.stderr()
    );
    let result = folders.json("result.json");
    let views = result["views"].as_array().unwrap();
    let failed: Vec<_> = views.iter().filter(|v| v["status"] == "failed").collect();
    assert_eq!((views.len(), failed.len()), (4, 1), "{result}");
    assert_eq!(failed[0]["name"], "001");
    assert!(!folders.out().join("views/001").exists());
    assert!(folders.out().join("views/003/mask.png").exists());
    assert!(folders.out().join("body.ply").exists());
    failed[0]["reason"].as_str().unwrap().to_owned()
}

#[test]
fn a_view_without_keypoints_is_rejected() {
    let reason = reason_for_rejection(|folders| {
        std::fs::remove_file(folders.path("scan/001_keypoints.json")).unwrap();
        let manifest = std::fs::read_to_string(folders.path("scan/scan.json")).unwrap();
        let without = manifest.replace("\"keypoints\": \"001_keypoints.json\",", "");
        folders.write("scan/scan.json", without);
    });
    assert!(reason.contains("001_keypoints.json"), "{reason}");
}

#[test]
fn a_view_whose_keypoint_file_is_misspelled_is_rejected() {
    let reason = reason_for_rejection(|folders| {
        let from = folders.path("scan/001_keypoints.json");
        std::fs::rename(from, folders.path("scan/001_keypoint.json")).unwrap();
    });
    assert!(reason.contains("no 001_keypoints.json"), "{reason}");
    assert!(reason.contains("name in scan.json"), "{reason}");
}

#[test]
fn a_view_without_a_detected_person_is_rejected() {
    let reason = reason_for_rejection(|folders| {
        folders.write("scan/001_keypoints.json", r#"{"version":1.3,"people":[]}"#);
    });
    assert!(reason.contains("contains no person"), "{reason}");
}

#[test]
fn a_black_photo_is_rejected() {
    let reason = reason_for_rejection(|folders| {
        let black = pirouette::scan::Photo::filled(200, 250, [0; 3]);
        let jpeg = pirouette_files::formats::photo::encode_jpeg(&black, 90).unwrap();
        folders.write("scan/001.jpg", jpeg);
    });
    assert!(reason.contains("no contrast"), "{reason}");
}

#[test]
fn a_truncated_jpeg_is_rejected() {
    let reason = reason_for_rejection(|folders| {
        let bytes = std::fs::read(folders.path("scan/001.jpg")).unwrap();
        folders.write("scan/001.jpg", &bytes[..bytes.len() * 2 / 3]);
    });
    assert!(reason.contains("is truncated"), "{reason}");
}

#[test]
fn a_keypoint_file_with_nan_is_rejected() {
    let reason = reason_for_rejection(|folders| {
        let numbers = vec!["NaN"; 75].join(",");
        let file = format!("{{\"people\":[{{\"pose_keypoints_2d\":[{numbers}]}}]}}");
        folders.write("scan/001_keypoints.json", file);
    });
    assert!(reason.contains("NaN"), "{reason}");
}

#[test]
fn given_keypoints_that_cannot_be_used_are_one_line() {
    let folders = Folders::with_views(2);
    let path = folders.write("given.json", "[[1, 2, 3]]");
    let nowhere = folders.path("nowhere");
    for (path, part) in [(&path, "given.json: "), (&nowhere, "cannot read ")] {
        let flags = ["--keypoints", common::text(path)];
        let error = folders.run("segment", &flags).exits_with(1).stderr();
        assert_eq!(error.lines().count(), 1, "{error}");
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn a_photo_of_one_pixel_is_rejected() {
    let reason = reason_for_rejection(|folders| {
        let pixel = pirouette::scan::Photo::filled(1, 1, [90; 3]);
        let png = pirouette_files::formats::photo::encode_photo_png(&pixel).unwrap();
        folders.write("scan/001.jpg", png);
    });
    assert!(reason.contains("1 x 1 px"), "{reason}");
}

#[test]
fn an_unknown_key_in_the_manifest_is_named() {
    let folders = Folders::with_views(3);
    folders.write(
        "scan/scan.json",
        "{\n  \"pose\": \"a\",\n  \"hight_mm\": 1700\n}",
    );
    let run = folders.run("scan", &[]).exits_with(1);
    let error = run.stderr();
    assert_eq!(error.lines().count(), 1, "{error}");
    assert!(
        error.contains("scan.json") && error.contains("hight_mm"),
        "{error}"
    );
    assert!(error.contains("line 3"), "{error}");
    assert!(!folders.out().exists());
}

#[test]
fn two_views_suffice_for_a_body_fit_but_not_for_carving() {
    let folders = Folders::with_views(2);
    let run = folders
        .run("scan", &["--method", "three-step"])
        .exits_with(1);
    let error = run.stderr();
    assert!(
        error.contains("2 usable views") && error.contains("at least 3"),
        "{error}"
    );
    assert!(!folders.out().exists());
    folders.run("scan", &[]).exits_with(0);
    assert!(folders.out().join("body.ply").exists());
    let one = Folders::with_views(1);
    let error = one.run("scan", &[]).exits_with(1).stderr();
    assert!(error.contains("at least 2"), "{error}");
}

#[test]
fn a_view_inconsistent_with_the_others_is_rejected() {
    let folders = Folders::with_views(5);
    // The silhouette of a box instead of the person
    let mask = Mask::from_fn(200, 250, |x, y| {
        (60..140).contains(&x) && (30..220).contains(&y)
    });
    folders.write("scan/002_mask.png", encode_mask(&mask).unwrap());
    let manifest = std::fs::read_to_string(folders.path("scan/scan.json")).unwrap();
    let mut manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    manifest["views"][2]["mask"] = "002_mask.png".into();
    folders.write("scan/scan.json", manifest.to_string());
    let run = folders.run("scan", &[]).exits_with(0);
    let warnings = run.stderr();
    assert!(
        warnings.contains("view 002 is rejected (fit)"),
        "{warnings}"
    );
    assert!(
        warnings.contains("no pose of the body fits its silhouette"),
        "{warnings}"
    );
}

#[test]
fn two_usable_views_are_too_few_and_the_rejected_one_is_named() {
    let folders = Folders::with_views(3);
    folders.write("scan/002.jpg", b"no photo");
    let run = folders.run("scan", &[]).exits_with(1);
    let error = run.stderr();
    assert!(error.contains("view 002 is rejected"), "{error}");
    assert!(error.contains("2 usable views"), "{error}");
}

#[test]
fn an_unusable_folder_is_named() {
    let folders = Folders::empty();
    let run = folders.run("scan", &[]).exits_with(1);
    assert!(run.stderr().contains("no photos in"), "{}", run.stderr());
    let run = common::pirouette(&["scan", "nowhere/at/all"]).exits_with(1);
    assert!(run.stderr().contains("nowhere/at/all"), "{}", run.stderr());
}

#[test]
fn an_invalid_or_damaged_zip_file_is_one_clear_error() {
    let folders = Folders::with_views(3);
    let complete = std::fs::read(folders.zip()).unwrap();
    for (bytes, expected) in [
        (&complete[..complete.len() / 2], "damaged zip file"),
        (&b"no zip"[..], "neither a folder nor a zip file"),
    ] {
        let file = folders.write("anna.zip", bytes);
        let error = common::pirouette(&["scan", common::text(&file)])
            .exits_with(1)
            .stderr();
        assert_eq!(error.lines().count(), 1, "{error}");
        assert!(
            error.contains(expected) && error.contains("anna.zip"),
            "{error}"
        );
    }
}

#[test]
fn paths_outside_the_scan_folder_are_rejected() {
    let folders = Folders::with_views(3);
    std::fs::copy(folders.path("scan/001.jpg"), folders.path("outside.jpg")).unwrap();
    let manifest = std::fs::read_to_string(folders.path("scan/scan.json")).unwrap();
    let absolute = folders.path("outside.jpg");
    for path in ["../outside.jpg", common::text(&absolute)] {
        let leaving = manifest.replace("\"001.jpg\"", &format!("{path:?}"));
        assert_ne!(leaving, manifest);
        folders.write("scan/scan.json", leaving);
        let error = folders.run("scan", &[]).exits_with(1).stderr();
        assert_eq!(error.lines().count(), 1, "{error}");
        assert!(error.contains("views[1].image"), "{error}");
        assert!(error.contains("outside.jpg"), "{error}");
    }
    assert!(!folders.out().exists());
}

#[cfg(unix)]
#[test]
fn links_to_outside_the_scan_folder_are_rejected() {
    let folders = Folders::with_views(3);
    let photo = folders.path("scan/001.jpg");
    std::fs::rename(&photo, folders.path("outside.jpg")).unwrap();
    std::os::unix::fs::symlink(folders.path("outside.jpg"), photo).unwrap();
    let error = folders.run("scan", &[]).exits_with(1).stderr();
    assert_eq!(error.lines().count(), 1, "{error}");
    assert!(
        error.contains("001.jpg points outside") && error.contains("copy the file"),
        "{error}"
    );
    assert!(!folders.out().exists());
}

#[cfg(unix)]
#[test]
fn an_unreadable_folder_is_named() {
    use std::os::unix::fs::PermissionsExt;

    let folders = Folders::with_views(3);
    let set = |mode| {
        let rights = std::fs::Permissions::from_mode(mode);
        std::fs::set_permissions(folders.scan(), rights).unwrap();
    };
    set(0o000);
    // Permissions do not bind the superuser.
    let denied = std::fs::read_dir(folders.scan()).is_err();
    let run = folders.run("scan", &["--quiet"]);
    set(0o755);
    if denied {
        let error = run.exits_with(1).stderr();
        assert_eq!(error.lines().count(), 1, "{error}");
        assert!(error.contains("cannot read"), "{error}");
        assert!(error.contains(common::text(&folders.scan())), "{error}");
        assert!(!folders.out().exists());
    }
}

#[test]
fn an_invalid_avatar_file_is_named() {
    let folders = Folders::with_views(3);
    let file = folders.write("avatar.glb", b"not an avatar");
    let run = folders
        .run("scan", &["--avatar", common::text(&file)])
        .exits_with(1);
    assert!(run.stderr().contains("avatar.glb"), "{}", run.stderr());
}
