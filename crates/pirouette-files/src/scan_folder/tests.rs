use pirouette_geom::Mask;

use super::find::natural_order;
use super::*;
use std::fs;

use crate::formats::photo;
use crate::formats::photo::encode_photo_png;
use crate::source::SourceError;
use pirouette::scan::{KeypointKind, KeypointSource, Looseness, Photo, StatedClothes, Subject};
use pirouette_body::{Joint, Keypoint, Keypoints, Sex};

struct TestFolder(tempfile::TempDir);

impl TestFolder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> &Self {
        let path = self.0.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
        self
    }

    fn photo(&self, name: &str, width: usize, height: usize) -> &Self {
        let photo = Photo::from_fn(width, height, |x, y| [x as u8, y as u8, 7]);
        self.write(name, photo::encode_photo_png(&photo).unwrap())
    }

    fn keypoints(&self, name: &str) -> &Self {
        self.write(name, keypoint_file(&[0.5]))
    }

    fn load(&self) -> Result<LoadedScan, ScanError> {
        load_scan(self.0.path(), &LoadOptions::default())
    }
}

fn keypoint_file(confidences: &[f64]) -> String {
    let person = |confidence: &f64| {
        let joints: Vec<String> = (0..25)
            .map(|j| format!("{},{j},{confidence}", 10 + j))
            .collect();
        format!("{{\"pose_keypoints_2d\":[{}]}}", joints.join(","))
    };
    let people: Vec<String> = confidences.iter().map(person).collect();
    format!("{{\"people\":[{}]}}", people.join(","))
}

#[test]
fn photos_without_a_manifest_are_a_uniform_turn_in_name_order() {
    let folder = TestFolder::new();
    folder
        .photo("10.png", 40, 50)
        .photo("2.png", 40, 50)
        .photo("1.png", 40, 50);
    folder
        .photo("2_mask.png", 40, 50)
        .photo("contact.jpg", 90, 50);
    folder.photo("11.png", 40, 50).write("notes.txt", "");
    folder
        .keypoints("1_keypoints.json")
        .keypoints("keypoints/2_keypoints.json");
    folder
        .keypoints("10_keypoints.json")
        .keypoints("11_keypoints.json");
    let loaded = folder.load().unwrap();
    let views = &loaded.scan.views;
    let names: Vec<&str> = views.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["1", "2", "10", "11"]);
    assert!((views[3].turn.degrees() - 270.0).abs() < 1e-9);
    assert!(loaded.failed.is_empty());
    let ignored =
        ["2_mask.png", "contact.jpg"].map(|file| ScanWarning::ImageIgnored { file: file.into() });
    assert_eq!(loaded.warnings, ignored);
}

#[test]
fn a_failing_view_is_reported_with_its_name_and_angle() {
    let folder = TestFolder::new();
    for name in ["0", "1", "2", "3", "4", "5"] {
        folder.photo(&format!("{name}.png"), 40, 50);
        folder.keypoints(&format!("{name}_keypoints.json"));
    }
    folder.photo("1.png", 1, 1);
    folder.write("2_keypoints.json", keypoint_file(&[]));
    folder.write("3_keypoints.json", keypoint_file(&[f64::NAN]));
    fs::remove_file(folder.0.path().join("4_keypoints.json")).unwrap();
    let loaded = folder.load().unwrap();
    assert_eq!(loaded.scan.views.len(), 2);
    assert!((loaded.scan.views[1].turn.degrees() - 300.0).abs() < 1e-9);
    let reasons: Vec<String> = loaded.failed.iter().map(|f| f.reason.to_string()).collect();
    assert!(reasons[0].contains("1 x 1 px"), "{reasons:?}");
    assert!(reasons[1].contains("contains no person"), "{reasons:?}");
    assert!(reasons[2].contains("NaN"), "{reasons:?}");
    assert!(reasons[3].contains("4_keypoints.json"), "{reasons:?}");
    let turn = loaded.failed[3].turn.unwrap();
    assert!((turn.degrees() - 240.0).abs() < 1e-9);
}

#[test]
fn a_given_mask_replaces_keypoints_and_must_have_the_size_of_the_photo() {
    let folder = TestFolder::new();
    let mask = |width: usize| photo::encode_mask(&Mask::filled(width, 50, true)).unwrap();
    folder
        .photo("0.png", 40, 50)
        .photo("1.png", 40, 50)
        .photo("2.png", 40, 50);
    folder
        .write("0_mask.png", mask(40))
        .write("1_mask.png", mask(41));
    folder.write(
        "2_mask.png",
        photo::encode_mask(&Mask::filled(40, 50, false)).unwrap(),
    );
    folder.write(
        "scan.json",
        r#"{ "views": [ { "image": "0.png", "mask": "0_mask.png" },
                        { "image": "1.png", "mask": "1_mask.png" },
                        { "image": "2.png", "mask": "2_mask.png" } ] }"#,
    );
    let loaded = folder.load().unwrap();
    let mask = loaded.scan.views[0].mask.as_ref().unwrap();
    assert_eq!(mask.area(), 2000);
    assert!(matches!(
        loaded.failed[0].reason,
        ViewError::MaskSize { .. }
    ));
    assert!(matches!(
        loaded.failed[1].reason,
        ViewError::EmptyMask { .. }
    ));
}

/// Results in the format of COCO: one person per photo, whose nose is at the given x
fn common_file(photos: &[(&str, usize)]) -> String {
    let person = |(name, x): &(&str, usize)| {
        let joints: Vec<String> = (0..17)
            .map(|j| format!("{},{},0.5", x + j % 2, 10 + j))
            .collect();
        format!(
            "{{\"image_id\":\"{name}\",\"keypoints\":[{}]}}",
            joints.join(",")
        )
    };
    let people: Vec<String> = photos.iter().map(person).collect();
    format!("[{}]", people.join(","))
}

fn nose_x(loaded: &LoadedScan, view: usize) -> f64 {
    loaded.scan.views[view]
        .keypoints
        .get(Joint::Nose)
        .position
        .x
}

#[test]
fn keypoint_files_are_found_by_name_next_to_the_photo_and_in_folders() {
    let files = [
        "0_keypoints.json",
        "keypoints/0_keypoints.json",
        "0.json",
        "keypoints/0.json",
        "keypoints/0.txt",
        "labels/0.txt",
        "keypoints.json",
        "alphapose-results.json",
    ];
    for (index, name) in files.into_iter().enumerate() {
        let folder = TestFolder::new();
        folder.photo("0.png", 40, 50);
        for (later, name) in files.into_iter().enumerate().skip(index) {
            folder.write(name, common_file(&[("0.png", 20 + later)]));
        }
        let loaded = folder.load().unwrap();
        assert!(
            (nose_x(&loaded, 0) - (20 + index) as f64).abs() < 1e-9,
            "{name}"
        );
        assert_eq!(loaded.scan.views[0].keypoint_kind, KeypointKind::Coco);
    }
}

#[test]
fn one_file_contains_the_keypoints_of_all_photos() {
    let folder = TestFolder::new();
    for name in ["0.png", "1.png", "2.png"] {
        folder.photo(name, 40, 50);
    }
    folder.write(
        "keypoints.json",
        common_file(&[("2.jpg", 12), ("0.jpg", 10)]),
    );
    let loaded = folder.load().unwrap();
    assert!((nose_x(&loaded, 0) - 10.0).abs() < 1e-9);
    assert!((nose_x(&loaded, 1) - 12.0).abs() < 1e-9);
    let reason = loaded.failed[0].reason.to_string();
    let expected =
        "keypoints.json: no keypoints for this photo; the file has those of \"2.jpg\", \"0.jpg\"";
    assert_eq!(reason, expected);
    // A manifest may name it, too; other files are unchanged.
    folder.write(
        "scan.json",
        r#"{ "views": [ { "image": "0.png", "keypoints": "all.json" },
                        { "image": "1.png", "keypoints": "1_keypoints.json" },
                        { "image": "2.png", "keypoints": "all.json" } ] }"#,
    );
    folder.keypoints("1_keypoints.json");
    folder.write("all.json", common_file(&[("0.png", 15), ("2.png", 17)]));
    let loaded = folder.load().unwrap();
    assert!((nose_x(&loaded, 2) - 17.0).abs() < 1e-9);
    let kinds: Vec<KeypointKind> = loaded.scan.views.iter().map(|v| v.keypoint_kind).collect();
    assert_eq!(
        kinds,
        [
            KeypointKind::Coco,
            KeypointKind::OpenPose,
            KeypointKind::Coco
        ]
    );
    folder.write("all.json", "{");
    assert!(matches!(folder.load(), Err(ScanError::Keypoints { .. })));
}

#[test]
fn given_keypoints_replace_those_in_the_scan() {
    let folder = TestFolder::new();
    folder.photo("0.png", 40, 50).photo("1.png", 40, 50);
    folder
        .keypoints("0_keypoints.json")
        .keypoints("1_keypoints.json");
    let given = TestFolder::new();
    let load = |path: &Path| {
        let keypoints = GivenKeypoints::open(path).unwrap();
        let options = LoadOptions {
            keypoints: Some(&keypoints),
            ..LoadOptions::default()
        };
        load_scan(folder.0.path(), &options)
    };
    given.write("all.json", common_file(&[("0", 30), ("1", 31)]));
    let loaded = load(&given.0.path().join("all.json")).unwrap();
    assert!((nose_x(&loaded, 1) - 31.0).abs() < 1e-9);
    given.write("0_000000000000_keypoints.json", keypoint_file(&[0.5]));
    let loaded = load(given.0.path()).unwrap();
    assert!((nose_x(&loaded, 0) - 10.0).abs() < 1e-9);
    let reason = loaded.failed[0].reason.to_string();
    assert!(
        reason.contains("none of 1_keypoints.json, 1.json, 1.txt in "),
        "{reason}"
    );
    let nowhere = GivenKeypoints::open(&given.0.path().join("nowhere"));
    assert!(matches!(nowhere, Err(ScanError::Read { .. })));
}

#[test]
fn large_photos_are_shrunk_with_their_keypoints() {
    let folder = TestFolder::new();
    folder.photo("0.png", 80, 100).keypoints("0_keypoints.json");
    let small = LoadOptions {
        max_side_px: 50,
        ..LoadOptions::default()
    };
    let loaded = load_scan(folder.0.path(), &small).unwrap();
    let view = &loaded.scan.views[0];
    assert_eq!((view.photo.width(), view.photo.height()), (40, 50));
    assert_eq!(view.input_size_px, (80, 100));
    let nose = view.keypoints.get(Joint::Nose).position;
    assert!((nose.x - 5.0).abs() < 1e-9);
    // The full-size photo is available as long as its file is unchanged.
    let full = loaded.full_size_photo(0).unwrap();
    assert_eq!((full.width(), full.height()), (80, 100));
    assert_eq!(full[(3, 60)], [3, 60, 7]);
    assert!(loaded.full_size_photo(1).is_none());
    folder.photo("0.png", 81, 100);
    assert!(loaded.full_size_photo(0).is_none());
    folder.write("0.png", "gone");
    assert!(loaded.full_size_photo(0).is_none());
}

#[test]
fn photos_of_another_shape_are_rejected_if_others_are_more_frequent() {
    let folder = TestFolder::new();
    for (name, width, height) in [("0", 50, 40), ("1", 40, 50), ("2", 80, 100)] {
        folder.photo(&format!("{name}.png"), width, height);
        folder.keypoints(&format!("{name}_keypoints.json"));
    }
    let loaded = folder.load().unwrap();
    assert_eq!(loaded.failed[0].view, "0");
    assert!(matches!(
        loaded.failed[0].reason,
        ViewError::OtherShape { .. }
    ));
    let each = LoadOptions {
        one_shape: false,
        ..LoadOptions::default()
    };
    let loaded = load_scan(folder.0.path(), &each).unwrap();
    assert_eq!(loaded.scan.views.len(), 3);
}

#[test]
fn several_people_cause_a_warning() {
    let folder = TestFolder::new();
    folder
        .photo("0.png", 40, 50)
        .write("0_keypoints.json", keypoint_file(&[0.3, 0.9]));
    let loaded = folder.load().unwrap();
    assert_eq!(loaded.warnings[0].code(), "several_people");
    let nose = loaded.scan.views[0].keypoints.get(Joint::Nose);
    assert!((nose.confidence - 0.9).abs() < 1e-12);
}

#[test]
fn errors_of_the_folder_name_the_file() {
    let folder = TestFolder::new();
    assert!(matches!(folder.load(), Err(ScanError::NoPhotos { .. })));
    let nowhere = load_scan(&folder.0.path().join("nowhere"), &LoadOptions::default());
    let neither = SourceError::Neither.to_string();
    assert!(nowhere.unwrap_err().to_string().ends_with(&neither));
    folder.photo("0.png", 40, 50).photo("0.jpg", 40, 50);
    assert!(matches!(folder.load(), Err(ScanError::SameName { .. })));
    folder.write("scan.json", r#"{ "view": [] }"#);
    let message = folder.load().unwrap_err().to_string();
    assert!(
        message.contains("scan.json") && message.contains("`view`"),
        "{message}"
    );
}

#[cfg(unix)]
#[test]
fn links_may_not_point_outside() {
    let outside = TestFolder::new();
    outside.photo("secret.png", 40, 50).keypoints("secret.json");
    let folder = TestFolder::new();
    folder
        .photo("real.png", 40, 50)
        .keypoints("real_keypoints.json");
    let link = |from: &str, to: &Path| {
        std::os::unix::fs::symlink(to, folder.0.path().join(from)).unwrap();
    };
    link("inside.png", &folder.0.path().join("real.png"));
    link(
        "inside_keypoints.json",
        &folder.0.path().join("real_keypoints.json"),
    );
    assert_eq!(folder.load().unwrap().scan.views.len(), 2);
    link("zero.png", &outside.0.path().join("secret.png"));
    assert!(matches!(folder.load(), Err(ScanError::LinkLeaves { .. })));
    fs::remove_file(folder.0.path().join("zero.png")).unwrap();
    fs::remove_file(folder.0.path().join("real_keypoints.json")).unwrap();
    link("real_keypoints.json", &outside.0.path().join("secret.json"));
    assert!(matches!(folder.load(), Err(ScanError::LinkLeaves { .. })));
}

#[test]
fn photos_in_one_folder_are_found_with_their_manifest() {
    let folder = TestFolder::new();
    for name in ["0", "1"] {
        folder.photo(&format!("photos/{name}.png"), 40, 50);
        folder.keypoints(&format!("photos/{name}_keypoints.json"));
    }
    // Neither metadata of other systems nor results are photos.
    folder
        .write("photos/._0.png", "mac")
        .write("photos/Thumbs.db", "");
    folder
        .write("__MACOSX/0.png", "mac")
        .photo("views/mask.png", 40, 50);
    let loaded = folder.load().unwrap();
    assert_eq!(loaded.scan.views.len(), 2);
    assert_eq!(loaded.photo_file(1), "photos/1.png");
    assert_eq!(loaded.warnings[0].code(), "photos_in_folder");
    folder.write(
        "photos/scan.json",
        r#"{ "subject": { "stature_mm": 1700 }, "views": [ { "image": "1.png" } ] }"#,
    );
    let loaded = folder.load().unwrap();
    assert_eq!(loaded.scan.stature_mm, Some(1700.0));
    assert_eq!(loaded.photo_file(0), "photos/1.png");
    assert!(loaded.failed.is_empty());
    fs::remove_file(folder.0.path().join("photos/scan.json")).unwrap();
    folder.photo("more/2.png", 40, 50);
    let message = folder.load().unwrap_err().to_string();
    assert!(
        message.contains("more") && message.contains("photos"),
        "{message}"
    );
}

#[test]
fn photos_that_cannot_be_read_keep_their_turn_angles() {
    let folder = TestFolder::new();
    folder.write("0.heic", "\0\0\0\u{18}ftypheic");
    let message = folder.load().unwrap_err().to_string();
    assert!(
        message.contains("0.heic") && message.contains("JPEG"),
        "{message}"
    );
    for name in ["1", "2", "3"] {
        folder.photo(&format!("{name}.png"), 40, 50);
        folder.keypoints(&format!("{name}_keypoints.json"));
    }
    folder.write("3.HEIC", "the same photo");
    let loaded = folder.load().unwrap();
    assert_eq!(loaded.failed.len(), 1);
    assert!(loaded.failed[0].reason.to_string().contains("HEIC"));
    assert!((loaded.scan.views[0].turn.degrees() - 90.0).abs() < 1e-9);
}

#[test]
fn pictures_of_results_are_not_photos() {
    let folder = TestFolder::new();
    folder.photo("0.png", 40, 50).keypoints("0_keypoints.json");
    let results = ["contact.jpg", "mask.png", "normalized.png", "overlay.jpg"];
    for name in results.iter().chain(&["residuals.jpg", "tapes.jpg"]) {
        folder.photo(name, 40, 50);
    }
    folder
        .write("result.json", "{}")
        .write("measurements.json", "{}");
    let loaded = folder.load().unwrap();
    assert_eq!(loaded.scan.views.len(), 1);
    assert_eq!(loaded.warnings.len(), 6);
}

#[test]
fn keypoint_files_are_found_by_the_name_of_the_photo() {
    let folder = TestFolder::new();
    for name in ["IMG_1", "IMG_2", "IMG_3"] {
        folder.photo(&format!("{name}.png"), 40, 50);
    }
    folder
        .keypoints("img_1.json")
        .keypoints("openpose/IMG_2.png_keypoints.json")
        .keypoints("IMG_3_pose.json");
    let loaded = folder.load().unwrap();
    assert_eq!(loaded.scan.views.len(), 3, "{:?}", loaded.failed);
    let first = "IMG_3_pose.json";
    let codes: Vec<&str> = loaded.warnings.iter().map(ScanWarning::code).collect();
    assert_eq!(codes, ["keypoint_files_found"]);
    fs::remove_file(folder.0.path().join(first)).unwrap();
    folder.keypoints("pose_of_3.json");
    let loaded = folder.load().unwrap();
    assert_eq!(loaded.failed.len(), 1);
    let message = loaded.warnings[1].to_string();
    assert!(
        message.contains("pose_of_3.json") && message.contains("\"keypoints\""),
        "{message}"
    );
    folder.keypoints("a/IMG_3.json").keypoints("b/IMG_3.json");
    let loaded = folder.load().unwrap();
    assert_eq!(loaded.warnings[0].code(), "keypoint_file_unclear");
    assert_eq!(loaded.warnings[0].view(), Some("IMG_3"));
}

#[test]
fn keypoint_files_of_other_encodings_are_read() {
    let folder = TestFolder::new();
    let text = keypoint_file(&[0.5]);
    let wide: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    folder
        .photo("0.png", 40, 50)
        .photo("1.png", 40, 50)
        .write("0_keypoints.json", [&b"\xff\xfe"[..], &wide].concat())
        .write("1_keypoints.json", text.replace("]}", ",]}"));
    assert_eq!(folder.load().unwrap().scan.views.len(), 2);
    folder.write("1_keypoints.json", text.replace("10,0", "10 0"));
    let reason = folder.load().unwrap().failed[0].reason.to_string();
    assert!(
        reason.contains("line 1, column 37") && reason.contains("confidence, ..."),
        "{reason}"
    );
}

#[test]
fn digits_in_names_compare_as_numbers() {
    let mut names = vec!["b1", "a10", "a2", "a02", "a", "10", "9", "x1y2", "x1y10"];
    names.sort_by(|a, b| natural_order(a, b));
    assert_eq!(
        names,
        ["9", "10", "a", "a02", "a2", "a10", "b1", "x1y2", "x1y10"]
    );
}

#[test]
fn a_written_scan_reads_back_unchanged() {
    let mut keypoints = Keypoints::default();
    for (index, joint) in Joint::ALL.into_iter().enumerate() {
        keypoints.set(
            joint,
            pirouette_body::Keypoint {
                position: glam::DVec2::new(10.5 + index as f64, 20.25),
                confidence: 0.75,
            },
        );
    }
    let view = View {
        name: "left".into(),
        photo: Photo::from_fn(40, 50, |x, y| [4 * x as u8, 4 * y as u8, 7]),
        input_size_px: (40, 50),
        turn: TurnAngle::from_degrees(30.0),
        turn_sd_radians: 12.0_f64.to_radians(),
        time_s: Some(4.2),
        keypoints,
        keypoints_from: KeypointSource::Given,
        keypoint_kind: KeypointKind::default(),
        mask: Some(Mask::from_vec(
            40,
            50,
            (0..2000).map(|i| i % 3 == 0).collect(),
        )),
        person_odds: None,
    };
    let scan = Scan {
        pose: pirouette_body::ReferencePose::T,
        stature_mm: Some(1700.0),
        stature_from: StatureFrom::default(),
        mm_per_px: None,
        subject: Subject {
            sex: Some(Sex::Female),
            mass_kg: Some(61.5),
            age_years: Some(30.0),
            stature_sd_mm: Some(4.0),
            sole_mm: Some(22.0),
            clothes: Some(StatedClothes {
                top: Looseness::Loose,
                bottom: Looseness::Tight,
            }),
        },
        camera: CameraSetup {
            vertical_fov_radians: Some(0.75),
            pitch_radians: Some(0.125),
            ..CameraSetup::default()
        },
        views: vec![view],
        background: Some(Background {
            photo: Photo::from_fn(40, 50, |x, y| [x as u8, y as u8, 7]),
            known: Mask::from_fn(40, 50, |x, y| x + y > 20),
        }),
        unusable_view_count: 0,
        surface: None,
    };
    let folder = TestFolder::new();
    write_scan(folder.0.path(), &scan).unwrap();
    let read = folder.load().unwrap().scan;
    assert_eq!(read.pose, scan.pose);
    assert_eq!(read.stature_mm, scan.stature_mm);
    assert_eq!(read.subject, scan.subject);
    let fov = read.camera.vertical_fov_radians.unwrap();
    assert!((fov - 0.75).abs() < 1e-12);
    assert_eq!(read.camera.height_mm, None);
    let (given, background) = (scan.background.as_ref().unwrap(), read.background.unwrap());
    assert_eq!(background.known, given.known);
    assert_eq!(background.photo, given.photo);
    let (before, after) = (&scan.views[0], &read.views[0]);
    assert_eq!(after.keypoints, before.keypoints);
    assert_eq!(after.time_s, Some(4.2));
    assert_eq!(after.mask, before.mask);
    assert_eq!(after.name, before.name);
    assert!((after.turn.degrees() - 30.0).abs() < 1e-9);
    assert!((after.turn_sd_radians.to_degrees() - 12.0).abs() < 1e-9);
    let mut usual = scan.clone();
    usual.views[0].turn_sd_radians = tracked_turn_sd_radians(usual.views[0].turn);
    write_scan(folder.0.path(), &usual).unwrap();
    let read = folder.load().unwrap().scan;
    assert!((read.views[0].turn_sd_radians - usual.views[0].turn_sd_radians).abs() < 1e-9);
    let mut unknown = scan;
    unknown.views[0].turn_sd_radians = f64::INFINITY;
    write_scan(folder.0.path(), &unknown).unwrap();
    assert!(!folder.load().unwrap().scan.views[0].turn_is_stated());
}

#[test]
fn a_photo_of_the_room_that_does_not_fit_is_named_and_not_used() {
    let folder = TestFolder::new();
    folder
        .photo("000.png", 80, 100)
        .keypoints("000_keypoints.json");
    for (name, bytes, expected) in [
        ("background.jpg", b"no photo".to_vec(), "background.jpg"),
        (
            "background.png",
            encode_photo_png(&Photo::filled(300, 200, [9; 3])).unwrap(),
            "300x200",
        ),
    ] {
        folder.write(name, bytes);
        let loaded = folder.load().unwrap();
        assert!(loaded.scan.background.is_none());
        let warning = loaded
            .warnings
            .iter()
            .find(|w| w.code() == "background_unusable");
        let text = warning.unwrap().to_string();
        assert!(text.contains(expected), "{text}");
        std::fs::remove_file(folder.0.path().join(name)).unwrap();
    }
}

#[test]
fn keypoints_of_a_shrunk_photo_are_those_of_the_input() {
    let mut keypoints = Keypoints::default();
    let at = |x, y| Keypoint {
        position: glam::DVec2::new(x, y),
        confidence: 0.5,
    };
    keypoints.set(Joint::Nose, at(10.0, 20.0));
    let view = View {
        name: "000".into(),
        photo: Photo::filled(40, 50, [0; 3]),
        input_size_px: (80, 150),
        turn: TurnAngle::default(),
        turn_sd_radians: f64::INFINITY,
        time_s: None,
        keypoints,
        keypoints_from: KeypointSource::BlazePose,
        keypoint_kind: KeypointKind::MediaPipe,
        mask: None,
        person_odds: None,
    };
    assert_eq!(
        keypoints_in_input(&view, &view.keypoints).get(Joint::Nose),
        at(20.0, 60.0)
    );
}
