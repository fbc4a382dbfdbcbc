//! OpenPose JSON: BODY_25, BODY_25B, COCO and MPI, versions 1.0 to 1.3; also AlphaPose's copies of it.
//!
//! Joints that were found by MediaPipe and written as BODY_25 have its name as `detector`.
//!
//! # Source
//! OpenPose's documentation of its output.

use pirouette::scan::KeypointKind;

use super::points::Person;
use super::tree::Node;
use super::{KeypointsError, Photo, person_error};

/// Keys of the list of people; AlphaPose's older export has `bodies`
const PEOPLE_KEYS: [&str; 2] = ["people", "bodies"];

/// Keys of the points of a person; versions up to 1.0 have no suffix, AlphaPose's older export has `joints`
const POSE_KEYS: [&str; 4] = ["pose_keypoints_2d", "pose_keypoints", "joints", "keypoints"];

/// Name of the detector whose points are not OpenPose's
pub(crate) const MEDIA_PIPE: &str = "mediapipe";

/// Reads the people of one photo; `None` if the value is not of this format
pub(super) fn read(node: &Node) -> Option<Result<Photo, KeypointsError>> {
    let people = node.get(&PEOPLE_KEYS)?;
    let people = people.items()?;
    let read = |(person, entry): (usize, &Node)| {
        let pose = entry
            .get(&POSE_KEYS)
            .ok_or(KeypointsError::NoPose { person })?;
        let scores = entry.get(&["keypoint_scores"]);
        Person::read(pose, scores, None).map_err(person_error(person))
    };
    let people: Result<Vec<Person>, _> = people.iter().enumerate().map(read).collect();
    // Editors of OpenPose figures write the size of their canvas.
    let side = |key: &str| node.get(&[key]).and_then(Node::number);
    let size_px = side("canvas_width").zip(side("canvas_height"));
    let by_mediapipe =
        matches!(node.get(&["detector"]), Some(Node::Text(name)) if name == MEDIA_PIPE);
    Some(people.map(|people| Photo {
        size_px,
        kind: by_mediapipe.then_some(KeypointKind::MediaPipe),
        ..Photo::of(people)
    }))
}
