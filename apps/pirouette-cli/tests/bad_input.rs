//! Input as people really have it: a bad view never takes the others down, bad folders say what to do.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use common::Folders;
use pirouette_files::formats::photo::encode_mask;
use pirouette_geom::Mask;

/// Spoils one of four views, scans, and hands back why that view was left out
#[track_caller]
fn reason_for_leaving_out(spoil: impl FnOnce(&Folders)) -> String {
    let folders = Folders::with_views(4);
    spoil(&folders);
    let run = folders.run("scan", &[]).exits_with(0);
    assert!(
        run.stderr().contains("view 001 is left out"),
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
fn a_view_without_keypoints_is_left_out() {
    let reason = reason_for_leaving_out(|folders| {
        std::fs::remove_file(folders.path("scan/001_keypoints.json")).unwrap();
        let manifest = std::fs::read_to_string(folders.path("scan/scan.json")).unwrap();
        let without = manifest.replace("\"keypoints\": \"001_keypoints.json\",", "");
        folders.write("scan/scan.json", without);
    });
    assert!(reason.contains("001_keypoints.json"), "{reason}");
}

#[test]
fn a_view_whose_keypoint_file_is_misspelled_is_left_out() {
    let reason = reason_for_leaving_out(|folders| {
        let from = folders.path("scan/001_keypoints.json");
        std::fs::rename(from, folders.path("scan/001_keypoint.json")).unwrap();
    });
    assert!(reason.contains("no 001_keypoints.json"), "{reason}");
    assert!(reason.contains("name in scan.json"), "{reason}");
}

#[test]
fn a_view_where_nobody_was_found_is_left_out() {
    let reason = reason_for_leaving_out(|folders| {
        folders.write("scan/001_keypoints.json", r#"{"version":1.3,"people":[]}"#);
    });
    assert!(reason.contains("nobody"), "{reason}");
}

#[test]
fn a_black_photo_is_left_out() {
    let reason = reason_for_leaving_out(|folders| {
        let black = pirouette::scan::Photo::filled(200, 250, [0; 3]);
        let jpeg = pirouette_files::formats::photo::encode_jpeg(&black, 90).unwrap();
        folders.write("scan/001.jpg", jpeg);
    });
    assert!(reason.contains("no contrast"), "{reason}");
}

#[test]
fn a_truncated_jpeg_is_left_out() {
    let reason = reason_for_leaving_out(|folders| {
        let bytes = std::fs::read(folders.path("scan/001.jpg")).unwrap();
        folders.write("scan/001.jpg", &bytes[..bytes.len() * 2 / 3]);
    });
    assert!(reason.contains("is truncated"), "{reason}");
}

#[test]
fn a_keypoint_file_with_nan_is_left_out() {
    let reason = reason_for_leaving_out(|folders| {
        let numbers = vec!["NaN"; 75].join(",");
        let file = format!("{{\"people\":[{{\"pose_keypoints_2d\":[{numbers}]}}]}}");
        folders.write("scan/001_keypoints.json", file);
    });
    assert!(reason.contains("NaN"), "{reason}");
}

#[test]
fn a_photo_of_one_pixel_is_left_out() {
    let reason = reason_for_leaving_out(|folders| {
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
fn two_views_do_for_a_body_fit_and_are_too_few_to_carve() {
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
fn a_view_that_contradicts_the_others_is_left_out() {
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
    let told = run.stderr();
    assert!(told.contains("view 002 is left out (fit)"), "{told}");
    assert!(
        told.contains("no pose of the body covers its silhouette"),
        "{told}"
    );
}

#[test]
fn two_views_left_are_too_few_and_the_lost_one_is_named() {
    let folders = Folders::with_views(3);
    folders.write("scan/002.jpg", b"no photo");
    let run = folders.run("scan", &[]).exits_with(1);
    let error = run.stderr();
    assert!(error.contains("view 002 is left out"), "{error}");
    assert!(error.contains("2 usable views"), "{error}");
}

#[test]
fn a_folder_that_is_none_is_named() {
    let folders = Folders::empty();
    let run = folders.run("scan", &[]).exits_with(1);
    assert!(run.stderr().contains("no photos in"), "{}", run.stderr());
    let run = common::pirouette(&["scan", "nowhere/at/all"]).exits_with(1);
    assert!(run.stderr().contains("nowhere/at/all"), "{}", run.stderr());
}

#[test]
fn a_zip_file_that_is_none_or_damaged_is_one_clear_error() {
    let folders = Folders::with_views(3);
    let whole = std::fs::read(folders.zip()).unwrap();
    for (bytes, expected) in [
        (&whole[..whole.len() / 2], "damaged zip file"),
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
fn paths_may_not_leave_the_scan_folder() {
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
fn links_may_not_leave_the_scan_folder() {
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
fn a_folder_without_the_right_to_read_is_named() {
    use std::os::unix::fs::PermissionsExt;

    let folders = Folders::with_views(3);
    let set = |mode| {
        let rights = std::fs::Permissions::from_mode(mode);
        std::fs::set_permissions(folders.scan(), rights).unwrap();
    };
    set(0o000);
    // Rights do not bind the superuser.
    let refused = std::fs::read_dir(folders.scan()).is_err();
    let run = folders.run("scan", &["--quiet"]);
    set(0o755);
    if refused {
        let error = run.exits_with(1).stderr();
        assert_eq!(error.lines().count(), 1, "{error}");
        assert!(error.contains("cannot read"), "{error}");
        assert!(error.contains(common::text(&folders.scan())), "{error}");
        assert!(!folders.out().exists());
    }
}

#[test]
fn an_avatar_that_is_none_is_named() {
    let folders = Folders::with_views(3);
    let file = folders.write("figure.glb", b"not a figure");
    let run = folders
        .run("scan", &["--avatar", common::text(&file)])
        .exits_with(1);
    assert!(run.stderr().contains("figure.glb"), "{}", run.stderr());
}
