//! `pirouette keypoints`: the pose detector alone.
//!
//! Tests that need the network read the environment variable `PIROUETTE_POSE_MODEL`, which `.ci/run` sets.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use common::{Folders, network, pirouette, text};

#[cfg(not(feature = "embed-pose-model"))]
#[test]
fn without_a_network_the_one_message_names_the_remedy() {
    let folders = Folders::with_views(1);
    let error = folders.run("keypoints", &[]).exits_with(1).stderr();
    assert_eq!(error.lines().count(), 1, "{error}");
    for remedy in ["pirouette models install", "--pose-model"] {
        assert!(error.contains(remedy), "{error}");
    }
    assert!(!folders.out().exists());
}

#[test]
fn files_of_a_folder_are_found_by_a_scan_of_it() {
    let Some([flag, model]) = network("files_of_a_folder_are_found_by_a_scan_of_it") else {
        return;
    };
    let folders = Folders::with_views(3);
    // Existing keypoint files are not read, and an unusable photo does not affect the others.
    folders.write("scan/000_keypoints.json", "damaged");
    folders.write("scan/002.jpg", "no photo");
    let out = folders.path("scan/keypoints");
    let scan = folders.scan();
    let run = pirouette(&[
        "keypoints",
        text(&scan),
        "-o",
        text(&out),
        "--json",
        &flag,
        &model,
    ]);
    let run = run.exits_with(0);
    let line = run.json_line();
    assert!(
        run.stderr().contains("warning: view 002"),
        "{}",
        run.stderr()
    );
    let status = |index: usize| line["photos"][index]["status"].as_str().unwrap().to_owned();
    assert_eq!([status(0), status(1), status(2)], ["ok", "ok", "failed"]);
    let mut names: Vec<String> = std::fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(
        names,
        [
            "000_keypoints.json",
            "000_rendered.jpg",
            "001_keypoints.json",
            "001_rendered.jpg"
        ]
    );
    // Pictures next to the photos are not photos, and the keypoint files there are used.
    for name in ["000_keypoints.json", "000_rendered.jpg", "001_rendered.jpg"] {
        std::fs::copy(out.join(name), folders.path("scan").join(name)).unwrap();
    }
    for name in ["scan.json", "002.jpg", "001_keypoints.json"] {
        std::fs::remove_file(folders.path("scan").join(name)).unwrap();
    }
    folders.run("segment", &[]).exits_with(0);
    let result = folders.json("result.json");
    assert_eq!(result["views"].as_array().unwrap().len(), 2);
    assert!(result["detector"].is_null(), "the files are used: {result}");
}

#[test]
fn single_photos_have_the_keypoints_of_their_folder() {
    let Some([flag, model]) = network("single_photos_have_the_keypoints_of_their_folder") else {
        return;
    };
    let folders = Folders::with_views(1);
    let zip = folders.zip();
    // The name of a mask, but given as a photo
    let photo = folders.path("scan/one_mask.jpg");
    std::fs::copy(folders.path("scan/000.jpg"), &photo).unwrap();
    let out = folders.out();
    let run = pirouette(&[
        "keypoints",
        text(&photo),
        text(&zip),
        "-o",
        text(&out),
        &flag,
        &model,
    ]);
    run.exits_with(0);
    let alone = folders.json("one_mask_keypoints.json");
    assert_eq!(alone, folders.json("000_keypoints.json"));
    assert_eq!(
        alone["people"][0]["pose_keypoints_2d"]
            .as_array()
            .unwrap()
            .len(),
        75
    );

    let twice = [
        "keypoints",
        text(&photo),
        text(&photo),
        "-o",
        text(&out),
        &flag,
        &model,
    ];
    let error = pirouette(&twice).exits_with(1).stderr();
    assert!(error.contains("a second photo named one_mask"), "{error}");
    let missing = ["keypoints", "nowhere.jpg", "-o", text(&out), &flag, &model];
    let error = pirouette(&missing).exits_with(1).stderr();
    assert!(error.contains("cannot read nowhere.jpg"), "{error}");
}

#[test]
fn photos_without_a_person_are_a_failure_without_files() {
    let Some([flag, model]) = network("photos_without_a_person_are_a_failure_without_files") else {
        return;
    };
    let folders = Folders::empty();
    let photo =
        pirouette::scan::Photo::from_fn(300, 400, |x, y| [(x / 2) as u8, (y / 2) as u8, 90]);
    let jpeg = pirouette_files::formats::photo::encode_jpeg(&photo, 90).unwrap();
    folders.write("scan/empty.jpg", jpeg);
    let run = folders.run("keypoints", &[&flag, &model]).exits_with(1);
    let error = run.stderr();
    assert!(
        error.contains("no person was detected in empty.jpg"),
        "{error}"
    );
    assert!(
        error.contains("error: no keypoints were detected"),
        "{error}"
    );
    assert!(!folders.out().exists());
}

#[test]
fn the_person_who_turns_is_found_beside_a_helper_who_stands_still() {
    let test = "the_person_who_turns_is_found_beside_a_helper_who_stands_still";
    let Some([flag, model]) = network(test) else {
        return;
    };
    let views = &common::person().scan.views;
    let helper = &views[0].photo;
    let width = helper.width();
    // The first photo shows the same picture twice, so on one of the sides the helper is found first.
    let warned = [true, false].map(|helper_is_left| {
        let folders = Folders::empty();
        for (index, view) in views.iter().enumerate() {
            let [left, right] = if helper_is_left {
                [helper, &view.photo]
            } else {
                [&view.photo, helper]
            };
            let photo = pirouette::scan::Photo::from_fn(2 * width, helper.height(), |x, y| {
                let (photo, x) = if x < width {
                    (left, x)
                } else {
                    (right, x - width)
                };
                photo.row(y)[x]
            });
            let jpeg = pirouette_files::formats::photo::encode_jpeg(&photo, 90).unwrap();
            folders.write(&format!("scan/{index:03}.jpg"), jpeg);
        }
        let run = folders.run("keypoints", &[&flag, &model]).exits_with(0);
        for index in 0..views.len() {
            let keypoints = folders.json(&format!("{index:03}_keypoints.json"));
            let neck_x = keypoints["people"][0]["pose_keypoints_2d"][3]
                .as_f64()
                .unwrap();
            assert_eq!(
                neck_x > width as f64,
                helper_is_left,
                "photo {index}: neck at {neck_x}"
            );
        }
        run.stderr().contains("second person")
    });
    assert!(warned.contains(&true), "{warned:?}");
}
