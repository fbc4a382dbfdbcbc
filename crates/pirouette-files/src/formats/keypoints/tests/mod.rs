mod figure;

use std::fmt::Write as _;

use glam::DVec2;
use proptest::prelude::*;

use super::layout::Layout;
use super::*;
use figure::{HEIGHT, WIDTH, at, files, join, openpose, points, relative, rows, triples};

fn parse_keypoints(
    bytes: &[u8],
    width_px: usize,
    height_px: usize,
) -> Result<Detection, KeypointsError> {
    let file = KeypointFile::parse(bytes)?;
    let index = file.match_photos(&["000.jpg"]);
    file.detection(index[0], width_px, height_px)
}

fn parse(text: &str) -> Result<Detection, KeypointsError> {
    parse_keypoints(text.as_bytes(), WIDTH, HEIGHT)
}

#[test]
fn every_format_gives_the_same_person() {
    for (name, text, kind, joint_count) in files() {
        let detection = parse(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(detection.kind, kind, "{name}");
        assert_eq!(detection.people_count, 1, "{name}");
        assert_eq!(detection.keypoints.found_count(), joint_count, "{name}");
        for (joint, keypoint) in detection.keypoints.iter() {
            if keypoint.confidence > 0.0 {
                let error = keypoint.position.distance(at(joint));
                assert!(error < 0.001, "{name}: {joint:?} is off by {error} px");
                let known = [0.6, 0.75, 1.0]
                    .iter()
                    .any(|c| (keypoint.confidence - c).abs() < 1e-9);
                assert!(known, "{name}: {}", keypoint.confidence);
            }
        }
    }
}

#[test]
fn a_written_file_keeps_the_definition_of_the_joints() {
    let text = openpose("pose_keypoints_2d", &points(Layout::Body25));
    let found = parse(&text).unwrap();
    for kind in [KeypointKind::OpenPose, KeypointKind::MediaPipe] {
        let file = crate::scan_folder::keypoint_file(&found.keypoints, kind);
        assert_eq!(parse(&file.to_string()).unwrap().kind, kind);
    }
}

/// Small pseudo-random numbers
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (self.0 >> 33) as usize % limit.max(1)
    }
}

/// Changes, removes or inserts some bytes
fn mutated(text: &str, random: &mut Random) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..=random.below(4) {
        let place = random.below(bytes.len());
        match random.below(5) {
            0 => bytes.truncate(place),
            1 => drop(bytes.drain(place..(place + random.below(60)).min(bytes.len()))),
            2 => bytes.insert(place, b"\n\"[]{},-e9\0\xff"[random.below(12)]),
            3 => {
                let end = (place + random.below(80)).min(bytes.len());
                let copy = bytes[place..end].to_vec();
                bytes.splice(place..place, copy);
            }
            _ => {
                if let Some(byte) = bytes.get_mut(place) {
                    *byte = b"0123456789.-e,:[]{}\"\n n\\"[random.below(24)];
                }
            }
        }
    }
    bytes
}

#[test]
fn mutated_files_give_a_person_or_one_clear_line() {
    let mut random = Random(7);
    for (name, text, ..) in files() {
        for _ in 0..200 {
            let bytes = mutated(&text, &mut random);
            match parse_keypoints(&bytes, WIDTH, HEIGHT) {
                Ok(detection) => {
                    let finite = |(_, k): (Joint, pirouette_body::Keypoint)| {
                        k.position.is_finite() && (0.0..=1.0).contains(&k.confidence)
                    };
                    assert!(detection.keypoints.iter().all(finite), "{name}");
                }
                Err(error) => {
                    let message = error.to_string();
                    assert!(!message.contains(['\n', '\r', '\0']), "{name}: {message}");
                    assert!(message.len() < 600, "{name}: {message}");
                }
            }
        }
    }
}

proptest! {
    #[test]
    fn no_bytes_panic(bytes: Vec<u8>) {
        let _ = parse_keypoints(&bytes, WIDTH, HEIGHT);
    }

    #[test]
    fn no_text_of_json_panics(text in "[\\[\\]{},:0-9.\"xyk \n-]{0,80}") {
        let _ = parse_keypoints(text.as_bytes(), WIDTH, HEIGHT);
    }
}

#[track_caller]
fn rejected(text: &str) -> String {
    parse(text).unwrap_err().to_string()
}

#[test]
fn a_person_in_openpose_px_is_read_as_given() {
    let mut numbers = points(Layout::Body25);
    numbers[4] = DVec2::ZERO;
    let keypoints = parse(&openpose("pose_keypoints_2d", &numbers))
        .unwrap()
        .keypoints;
    assert_eq!(keypoints.found(Joint::RightWrist), None);
    assert_eq!(keypoints.found_count(), 24);
    let confidence = openpose("pose_keypoints_2d", &numbers).replacen("0.75", "1.1", 1);
    let nose = parse(&confidence).unwrap().keypoints.get(Joint::Nose);
    assert!((nose.confidence - 1.0).abs() < 1e-12);
}

#[test]
fn files_without_people_are_valid() {
    for text in [
        "{\"people\": []}",
        "[]",
        "{\"landmarks\": []}",
        "{\"pose_landmarks\": null}",
        "{\"instance_info\": []}",
    ] {
        let detection = parse(text).unwrap();
        assert_eq!(
            (detection.people_count, detection.keypoints.found_count()),
            (0, 0),
            "{text}"
        );
    }
}

#[test]
fn the_most_confident_person_near_the_middle_is_selected() {
    let person = |dx: f64, confidence: f64| {
        let moved: Vec<DVec2> = points(Layout::Coco17)
            .iter()
            .map(|&p| p + DVec2::new(dx, 0.0))
            .collect();
        format!("{{\"keypoints\": [{}]}}", triples(&moved, confidence))
    };
    let text = format!(
        "[{}, {}, {}]",
        person(-250.0, 0.9),
        person(5.0, 0.8),
        person(0.0, 0.3)
    );
    let detection = parse(&text).unwrap();
    assert_eq!(detection.people_count, 3);
    let nose = detection.keypoints.get(Joint::Nose).position;
    assert!((nose - at(Joint::Nose) - DVec2::new(5.0, 0.0)).length() < 1e-6);
}

#[test]
fn twenty_five_points_in_doubt_are_body_25() {
    // A line of points, and a figure of which only the face was found
    let line: Vec<DVec2> = (0..25)
        .map(|i| DVec2::new(50.0 + f64::from(i), 100.0))
        .collect();
    let nose = parse(&openpose("pose_keypoints_2d", &line))
        .unwrap()
        .keypoints
        .get(Joint::MidHip);
    assert!((nose.position.x - 58.0).abs() < 1e-9);
    // Seen from the side and mirrored, with joints that were not found
    for layout in [Layout::Body25, Layout::Body25B] {
        let head: &[usize] = if layout == Layout::Body25B {
            &[17, 18]
        } else {
            &[1, 8]
        };
        for missing in [&[][..], head, &[0, 9, 20, 24]] {
            for (width, mirror) in [(0.1, 1.0), (1.0, 1.0), (1.0, -1.0), (0.2, -1.0)] {
                let middle = DVec2::new(200.0, 0.0);
                let view = |p: &DVec2| (*p - middle) * DVec2::new(width * mirror, 1.0) + middle;
                let mut seen: Vec<DVec2> = points(layout).iter().map(view).collect();
                for &index in missing {
                    seen[index] = DVec2::ZERO;
                }
                let text = openpose("pose_keypoints_2d", &seen);
                let knee = parse(&text)
                    .unwrap()
                    .keypoints
                    .get(Joint::LeftKnee)
                    .position;
                let error = (knee - view(&at(Joint::LeftKnee))).length();
                assert!(error < 1e-3, "{layout:?} {missing:?} {width} {mirror}");
            }
        }
    }
}

#[test]
fn confidences_are_flags_probabilities_or_scores() {
    let coco = points(Layout::Coco17);
    let with = |confidence: fn(usize) -> f64| {
        let numbers = coco
            .iter()
            .enumerate()
            .flat_map(|(i, p)| [p.x, p.y, confidence(i)]);
        parse(&format!("[{{\"keypoints\": [{}]}}]", join(numbers)))
    };
    let nose_and_eye = |confidence: fn(usize) -> f64| {
        let keypoints = with(confidence).unwrap().keypoints;
        [Joint::Nose, Joint::LeftEye]
            .map(|j| (keypoints.get(j).confidence * 1000.0).round() / 1000.0)
    };
    assert_eq!(nose_and_eye(|i| if i == 0 { 1.0 } else { 2.0 }), [0.3, 0.6]);
    assert_eq!(nose_and_eye(|i| if i == 0 { 0.0 } else { 2.0 }), [0.0, 0.6]);
    assert_eq!(nose_and_eye(|_| 1.0), [0.6, 0.6]);
    assert_eq!(
        nose_and_eye(|i| if i == 0 { 1.15 } else { 0.5 }),
        [1.0, 0.5]
    );
    assert_eq!(
        nose_and_eye(|i| if i == 0 { 2.0 } else { 8.0 }),
        [0.25, 1.0]
    );
    assert_eq!(
        nose_and_eye(|i| if i == 0 { -0.1 } else { 0.5 }),
        [0.0, 0.5]
    );
    let percent = with(|_| 87.5).unwrap_err().to_string();
    assert!(
        percent.contains("nose of person 0 has confidence 87.5"),
        "{percent}"
    );
    let negative =
        openpose("pose_keypoints_2d", &points(Layout::Body25)).replacen("0.75", "-0.5", 1);
    assert!(matches!(
        parse(&negative),
        Err(KeypointsError::Confidence { .. })
    ));
}

#[test]
fn an_invented_face_is_omitted() {
    let mirror = |p: &DVec2| DVec2::new(WIDTH as f64 - p.x, p.y);
    let face = [Joint::Nose, Joint::LeftEye, Joint::RightEye];
    let found = |text: &str| {
        let keypoints = parse(text).unwrap().keypoints;
        face.iter()
            .filter(|&&joint| keypoints.found(joint).is_some())
            .count()
    };
    let behind = |layout: Layout| points(layout).iter().map(mirror).collect::<Vec<DVec2>>();
    assert_eq!(found(&rows(&behind(Layout::MediaPipe33))), 0);
    assert_eq!(found(&rows(&behind(Layout::Coco17))), 0);
    assert_eq!(
        found(&format!("[{}]", triples(&behind(Layout::Coco17), 0.75))),
        3
    );
    assert_eq!(found(&rows(&points(Layout::Coco17))), 3);
}

#[test]
fn several_photos_are_selected_by_name_or_number() {
    let person = |key: &str, dx: f64| {
        let moved: Vec<DVec2> = points(Layout::Coco17)
            .iter()
            .map(|&p| p + DVec2::new(dx, 0.0))
            .collect();
        format!(
            "{{\"image_id\": {key}, \"keypoints\": [{}]}}",
            triples(&moved, 0.75)
        )
    };
    let text = format!(
        "[{}, {}, {}]",
        person("\"b.jpg\"", 1.0),
        person("\"a.jpg\"", 2.0),
        person("\"b.jpg\"", 90.0)
    );
    let file = KeypointFile::parse(text.as_bytes()).unwrap();
    let matched = file.match_photos(&["a.jpg", "b.jpg", "c.jpg"]);
    let of = |index: usize| file.detection(matched[index], WIDTH, HEIGHT);
    let nose = |index: usize| of(index).unwrap().keypoints.get(Joint::Nose).position.x;
    assert!((nose(0) - 203.0).abs() < 1e-6 && (nose(1) - 202.0).abs() < 1e-6);
    assert_eq!(of(1).unwrap().people_count, 2);
    let message = of(2).unwrap_err().to_string();
    assert!(
        message.ends_with("the file has those of \"b.jpg\", \"a.jpg\""),
        "{message}"
    );
    let frames = format!("[{}, {}]", person("0", 1.0), person("30", 2.0));
    let file = KeypointFile::parse(frames.as_bytes()).unwrap();
    assert_eq!(
        file.match_photos(&["f30.jpg", "f00.jpg"]),
        [Some(1), Some(0)]
    );
    let nested = "{\"predictions\": [[], []]}";
    let file = KeypointFile::parse(nested.as_bytes()).unwrap();
    assert_eq!(file.match_photos(&["1.jpg", "2.jpg"]), [Some(0), Some(1)]);
}

#[test]
fn what_does_not_fit_is_reported_with_what_was_found() {
    for (text, part) in [
        ("", "the file is empty"),
        ("{\"people\": [{}]}", "person 0 has no keypoints"),
        ("{\"people\": 3}", "an object with \"people\""),
        (
            "{\"people\": [{\"pose_keypoints_2d\": [1, 2, 3, 4]}]}",
            "has 4 numbers; readable are",
        ),
        (
            "{\"people\": [{\"pose_keypoints_2d\": [1, null]}]}",
            "instead of points with x and y",
        ),
        (
            "{\"a\": {\"b\": {\"c\": 1}}}",
            "no keypoints found in an object with \"a\"",
        ),
        ("[{\"boxes\": [1, 2]}]", "an object with \"boxes\""),
        (
            "{\"people\": [{\"pose_keypoints_2d\": [NaN]}]}",
            "line 1, column 36: `NaN` is not a number",
        ),
        ("{\"poseWorldLandmarks\": []}", "positions in the room"),
        (
            "0 0.5 0.5 0.2 0.9\n",
            "line 1 is no YOLO pose label: 5 values",
        ),
        ("{\"landmarks\": [{\"x\": 1, \"y\": 2}]}", "has 1 points"),
    ] {
        let message = rejected(text);
        assert!(message.contains(part), "{text}: {message}");
    }
    assert!(parse_keypoints(&[0xff, 0xfe, 0], WIDTH, HEIGHT).is_err());
    let far =
        openpose("pose_keypoints_2d", &points(Layout::Body25)).replacen("201.000000", "1e300", 1);
    assert!(matches!(
        parse(&far),
        Err(KeypointsError::FarOutside { .. })
    ));
}

#[test]
fn doubtful_units_sizes_and_orders_are_rejected() {
    let body = points(Layout::Body25);
    let shifted: Vec<DVec2> = relative(&body)
        .iter()
        .map(|&p| p - DVec2::new(0.0, 0.1))
        .collect();
    assert!(rejected(&openpose("pose_keypoints_2d", &shifted)).contains("0 to 1 or -1 to 1"));
    let hip = at(Joint::MidHip);
    let room: Vec<DVec2> = points(Layout::MediaPipe33)
        .iter()
        .map(|&p| (p - hip) / 300.0)
        .collect();
    assert!(rejected(&rows(&room)).contains("in meters"));
    let mut text = openpose("pose_keypoints_2d", &body);
    let _ = text.pop();
    let _ = write!(text, ", \"canvas_width\": 512, \"canvas_height\": 512}}");
    assert!(rejected(&text).contains("512 x 512 px, but the photo has 400 x 600 px"));
    // Human3.6M also has 17 points, from the pelvis outward
    let order = [
        Joint::MidHip,
        Joint::RightHip,
        Joint::RightKnee,
        Joint::RightAnkle,
        Joint::LeftHip,
        Joint::LeftKnee,
        Joint::LeftAnkle,
        Joint::MidHip,
        Joint::Neck,
        Joint::Nose,
        Joint::Nose,
        Joint::LeftShoulder,
        Joint::LeftElbow,
        Joint::LeftWrist,
        Joint::RightShoulder,
        Joint::RightElbow,
        Joint::RightWrist,
    ];
    assert!(rejected(&rows(&order.map(at))).contains("the 17 points are in an unknown order"));
}
