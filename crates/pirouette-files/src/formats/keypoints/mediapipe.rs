//! MediaPipe's pose landmarker: 33 landmarks, as lists or objects, normalized or in px.
//!
//! Only x and y are used, as for the landmarks that are detected here.
//!
//! # Source
//! MediaPipe's documentation of the pose landmarker.

use super::points::Person;
use super::tree::Node;
use super::{KeypointsError, Photo, person_error};

/// Keys of landmarks in a photo
const LANDMARK_KEYS: [&str; 6] = [
    "pose_landmarks",
    "poseLandmarks",
    "landmarks",
    "landmark",
    "normalized_landmarks",
    "normalizedLandmarks",
];

/// Keys of landmarks in the room, in meters
const WORLD_KEYS: [&str; 4] = [
    "pose_world_landmarks",
    "poseWorldLandmarks",
    "world_landmarks",
    "worldLandmarks",
];

/// Reads the people of one photo; `None` if the value is not of this format
pub(super) fn read(node: &Node) -> Option<Result<Photo, KeypointsError>> {
    let Some(landmarks) = node.get(&LANDMARK_KEYS) else {
        return node.get(&WORLD_KEYS).map(|_| Err(KeypointsError::World));
    };
    Some(people(landmarks).map(Photo::of))
}

fn people(landmarks: &Node) -> Result<Vec<Person>, KeypointsError> {
    // No person: null or an empty list
    if matches!(landmarks, Node::Other) || landmarks.is_empty_list() {
        return Ok(vec![]);
    }
    if let Some(nested) = landmarks.get(&LANDMARK_KEYS) {
        return people(nested);
    }
    let one = Person::read(landmarks, None, None);
    let Some(items) = landmarks.items().filter(|_| one.is_err()) else {
        return one.map(|person| vec![person]).map_err(person_error(0));
    };
    // One list per person
    let lists = items
        .iter()
        .all(|item| item.items().is_some() || item.get(&LANDMARK_KEYS).is_some());
    if !lists {
        return one.map(|person| vec![person]).map_err(person_error(0));
    }
    let read = |(person, item): (usize, &Node)| {
        let item = item.get(&LANDMARK_KEYS).unwrap_or(item);
        Person::read(item, None, None).map_err(person_error(person))
    };
    items.iter().enumerate().map(read).collect()
}
