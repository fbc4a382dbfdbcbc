//! OpenPose JSON with the BODY_25 model, versions 1.1 to 1.3.
//!
//! Other programs export this format too, so common mistakes (another model, coordinates from 0 to 1, NaN) have
//! messages that name them.

use glam::DVec2;
use serde::Deserialize;
use thiserror::Error;

use pirouette_body::{Joint, Keypoint, Keypoints};

/// Numbers per person: x, y and confidence of every joint
const NUMBERS_PER_PERSON: usize = 3 * Joint::COUNT;

/// Confidences up to this value are clamped to 1
///
/// Peaks of a heat map slightly exceed 1 after smoothing; percentages far exceed it.
const MAX_CONFIDENCE: f64 = 1.2;

/// Maximum distance of coordinates from the photo, in photo sizes; farther ones are rejected
///
/// Models that infer hidden joints place them up to half a photo outside.
const MAX_OUTSIDE_SIZES: f64 = 10.0;

/// Distance from the middle of the photo, in photo diagonals, at which a person's weight is one half
const HALF_WEIGHT_DISTANCE: f64 = 0.25;

/// The person found in one keypoint file
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// Joints of the selected person, in px of the photo; all not found if the file contains no person
    pub keypoints: Keypoints,
    /// Number of people in the file
    pub people_count: usize,
}

/// Why a keypoint file cannot be used
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum KeypointsError {
    #[error("the keypoints are not OpenPose JSON: {0}")]
    Syntax(serde_json::Error),
    #[error(
        "the keypoints contain NaN or Infinity, which JSON forbids ({0}); write joints that were not found as 0, 0, 0"
    )]
    NotFinite(serde_json::Error),
    #[error("person {person} has no `pose_keypoints_2d`")]
    NoPose { person: usize },
    #[error(
        "person {person} has {count} numbers in `pose_keypoints_2d` instead of {NUMBERS_PER_PERSON} (25 joints of x, y, confidence){}",
        model_hint(*count)
    )]
    Count { person: usize, count: usize },
    #[error(
        "{} of person {person} has confidence {confidence}; the range is 0 to 1", joint.name()
    )]
    Confidence {
        person: usize,
        joint: Joint,
        confidence: f64,
    },
    #[error(
        "{} of person {person} lies at ({x}, {y}) px, far outside the photo of {width_px} x {height_px} px", joint.name()
    )]
    FarOutside {
        person: usize,
        joint: Joint,
        x: f64,
        y: f64,
        width_px: usize,
        height_px: usize,
    },
    #[error(
        "all coordinates of person {person} lie between -1 and 1; export pixels (OpenPose: --keypoint_scale 0)"
    )]
    Normalized { person: usize },
}

/// Returns the model that a wrong count of numbers usually means
fn model_hint(count: usize) -> &'static str {
    match count {
        54 => "; 54 numbers indicate the COCO model of OpenPose: export with --model_pose BODY_25",
        45 => "; 45 numbers indicate the MPI model of OpenPose: export with --model_pose BODY_25",
        51 => "; 51 numbers indicate the COCO model with 17 joints: convert them to BODY_25",
        50 => "; 50 numbers indicate BODY_25 without confidences: add one per joint",
        78 => "; 78 numbers indicate the Halpe model with 26 joints: convert them to BODY_25",
        99 | 132 => "; this indicates the MediaPipe model with 33 joints: convert them to BODY_25",
        _ => "",
    }
}

#[derive(Deserialize)]
struct File {
    people: Vec<Person>,
}

#[derive(Deserialize)]
struct Person {
    /// Named `pose_keypoints` up to version 1.1
    #[serde(alias = "pose_keypoints")]
    pose_keypoints_2d: Option<Vec<f64>>,
}

/// Parses a keypoint file for a photo of the given size
///
/// Of several people, selects the one with the highest sum of confidences, weighted by nearness to the middle of the
/// photo.
///
/// # Errors
/// When the bytes are not OpenPose JSON, a person does not have 25 joints, or numbers are out of range.
pub fn parse_keypoints(
    json: &[u8],
    width_px: usize,
    height_px: usize,
) -> Result<Detection, KeypointsError> {
    let file: File = serde_json::from_slice(json).map_err(|error| {
        if contains_not_finite(json) {
            KeypointsError::NotFinite(error)
        } else {
            KeypointsError::Syntax(error)
        }
    })?;
    let mut best: Option<(f64, Keypoints)> = None;
    for (person, entry) in file.people.iter().enumerate() {
        let numbers = entry.pose_keypoints_2d.as_deref();
        let numbers = numbers.ok_or(KeypointsError::NoPose { person })?;
        let keypoints = person_keypoints(person, numbers, width_px, height_px)?;
        let score = prominence(&keypoints, width_px, height_px);
        if best.is_none_or(|(best_score, _)| score > best_score) {
            best = Some((score, keypoints));
        }
    }
    Ok(Detection {
        keypoints: best.map_or_else(Keypoints::default, |(_, keypoints)| keypoints),
        people_count: file.people.len(),
    })
}

/// Returns whether the bytes contain a number that JSON does not support
fn contains_not_finite(json: &[u8]) -> bool {
    let spelled = |word: &[u8]| json.windows(word.len()).any(|w| w == word);
    spelled(b"NaN") || spelled(b"nan") || spelled(b"Infinity")
}

fn person_keypoints(
    person: usize,
    numbers: &[f64],
    width_px: usize,
    height_px: usize,
) -> Result<Keypoints, KeypointsError> {
    if numbers.len() != NUMBERS_PER_PERSON {
        return Err(KeypointsError::Count {
            person,
            count: numbers.len(),
        });
    }
    let size = DVec2::new(width_px as f64, height_px as f64);
    let mut keypoints = Keypoints::default();
    for (joint, triple) in Joint::ALL.into_iter().zip(numbers.chunks_exact(3)) {
        let position = DVec2::new(triple[0], triple[1]);
        let confidence = triple[2];
        if !(0.0..=MAX_CONFIDENCE).contains(&confidence) {
            return Err(KeypointsError::Confidence {
                person,
                joint,
                confidence,
            });
        }
        // A joint that was not found has no position, regardless of its coordinates.
        if confidence <= 0.0 {
            continue;
        }
        let reach = size * MAX_OUTSIDE_SIZES;
        let near = position.cmpge(-reach).all() && position.cmple(size + reach).all();
        if !near {
            return Err(KeypointsError::FarOutside {
                person,
                joint,
                x: position.x,
                y: position.y,
                width_px,
                height_px,
            });
        }
        keypoints.set(
            joint,
            Keypoint {
                position,
                confidence: confidence.min(1.0),
            },
        );
    }
    // Three joints within one pixel of the corner are not a person in either unit.
    let normalized = keypoints
        .iter()
        .filter(|(_, keypoint)| keypoint.confidence > 0.0)
        .all(|(_, keypoint)| keypoint.position.abs().max_element() <= 1.0);
    if normalized && keypoints.found_count() > 2 {
        return Err(KeypointsError::Normalized { person });
    }
    Ok(keypoints)
}

/// Sum of confidences, reduced with the person's distance from the middle of the photo
fn prominence(keypoints: &Keypoints, width_px: usize, height_px: usize) -> f64 {
    let size = DVec2::new(width_px as f64, height_px as f64);
    let (mut sum, mut center) = (0.0, DVec2::ZERO);
    for (_, keypoint) in keypoints.iter() {
        sum += keypoint.confidence;
        center += keypoint.position * keypoint.confidence;
    }
    if sum <= 0.0 {
        return 0.0;
    }
    let distance = (center / sum - size / 2.0).length() / size.length();
    sum / (1.0 + (distance / HALF_WEIGHT_DISTANCE).powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(at: impl Fn(usize) -> [f64; 3]) -> String {
        let all: Vec<String> = (0..Joint::COUNT)
            .flat_map(&at)
            .map(|n| n.to_string())
            .collect();
        all.join(",")
    }

    fn person_at(x: f64, confidence: f64) -> String {
        let numbers = numbers(|joint| [x + joint as f64, 100.0, confidence]);
        format!("{{\"pose_keypoints_2d\":[{numbers}]}}")
    }

    fn file(people: &[String]) -> String {
        format!("{{\"version\":1.3,\"people\":[{}]}}", people.join(","))
    }

    fn parse(json: &str) -> Result<Detection, KeypointsError> {
        parse_keypoints(json.as_bytes(), 400, 300)
    }

    #[test]
    fn joints_come_in_body_25_order() {
        let detection = parse(&file(&[person_at(200.0, 0.5)])).unwrap();
        let knee = detection.keypoints.get(Joint::LeftKnee);
        assert_eq!(knee.position, DVec2::new(213.0, 100.0));
        assert!((knee.confidence - 0.5).abs() < 1e-12);
        assert_eq!(detection.people_count, 1);
    }

    #[test]
    fn the_key_of_version_1_1_is_accepted() {
        let json = file(&[person_at(200.0, 0.5)]).replace("pose_keypoints_2d", "pose_keypoints");
        assert_eq!(parse(&json).unwrap().keypoints.found_count(), 25);
    }

    #[test]
    fn missing_joints_are_not_found() {
        let numbers = numbers(|joint| {
            if joint == 4 {
                [0.0; 3]
            } else {
                [50.0, 60.0, 0.9]
            }
        });
        let json = file(&[format!("{{\"pose_keypoints_2d\":[{numbers}]}}")]);
        let keypoints = parse(&json).unwrap().keypoints;
        assert_eq!(keypoints.found(Joint::RightWrist), None);
        assert_eq!(keypoints.found_count(), 24);
    }

    #[test]
    fn a_file_without_people_is_valid() {
        let detection = parse(&file(&[])).unwrap();
        assert_eq!(detection.people_count, 0);
        assert_eq!(detection.keypoints.found_count(), 0);
    }

    #[test]
    fn the_most_confident_person_near_the_middle_is_selected() {
        let people = [
            person_at(5.0, 0.9),
            person_at(190.0, 0.8),
            person_at(200.0, 0.3),
        ];
        let detection = parse(&file(&people)).unwrap();
        assert_eq!(detection.people_count, 3);
        let nose = detection.keypoints.get(Joint::Nose);
        assert!((nose.position.x - 190.0).abs() < 1e-9);
    }

    #[test]
    fn other_models_are_reported_by_name() {
        let json = file(&[format!(
            "{{\"pose_keypoints_2d\":[{}]}}",
            vec!["1"; 54].join(",")
        )]);
        let message = parse(&json).unwrap_err().to_string();
        assert!(message.contains("54 numbers"), "{message}");
        assert!(message.contains("COCO"), "{message}");
    }

    #[test]
    fn invalid_numbers_are_typed_errors() {
        let good = file(&[person_at(200.0, 0.5)]);
        let nan = good.replacen("0.5", "NaN", 1);
        assert!(matches!(parse(&nan), Err(KeypointsError::NotFinite(_))));
        let null = good.replacen("0.5", "null", 1);
        assert!(matches!(parse(&null), Err(KeypointsError::Syntax(_))));
        let huge = good.replacen("100", "1e300", 1);
        assert!(matches!(
            parse(&huge),
            Err(KeypointsError::FarOutside { .. })
        ));
        let negative = good.replacen("0.5", "-0.5", 1);
        assert!(matches!(
            parse(&negative),
            Err(KeypointsError::Confidence { .. })
        ));
        let without = file(&["{}".to_owned()]);
        assert!(matches!(
            parse(&without),
            Err(KeypointsError::NoPose { person: 0 })
        ));
        for bytes in [&b""[..], b"[]", b"{\"people\":3}", &[0xff, 0xfe, 0]] {
            assert!(parse_keypoints(bytes, 400, 300).is_err());
        }
    }

    #[test]
    fn coordinates_from_0_to_1_are_reported() {
        let numbers = numbers(|joint| [joint as f64 / 25.0, 0.5, 0.9]);
        let json = file(&[format!("{{\"pose_keypoints_2d\":[{numbers}]}}")]);
        assert!(matches!(
            parse(&json),
            Err(KeypointsError::Normalized { .. })
        ));
    }
}
