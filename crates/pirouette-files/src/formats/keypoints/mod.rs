//! Keypoint files of any common detector, recognized by their content.
//!
//! Read are OpenPose (BODY_25, BODY_25B, COCO, MPI), the results and annotations of COCO with 17 or 133 points as written
//! by MMPose, RTMPose, AlphaPose, ViTPose and Detectron2, Halpe with 26 or 136 points, the 33 landmarks of MediaPipe, and
//! YOLO pose models, as JSON or text. A file contains one photo, or all photos with their names or numbers. Coordinates
//! are px of the photo, or relative to its size. The result is always BODY_25 in px; neck and mid hip are midpoints where
//! the detector has none, and points that BODY_25 does not have are dropped.
//!
//! Points without a confidence have 0.6, without nose and eyes where the person is seen from behind. In annotations, 0.6
//! is the confidence of visible points and 0.3 that of hidden ones. Unnormalized scores, which exceed 1.2, are divided by
//! the highest one in the photo.

mod anatomy;
mod coco;
mod layout;
mod mediapipe;
mod openpose;
mod person;
mod photos;
mod points;
mod tree;
mod yolo;

use pirouette::scan::KeypointKind;
use pirouette_body::{Joint, Keypoints};
use thiserror::Error;

use crate::formats::json::{JsonError, to_strict};
use layout::Layout;
pub(crate) use openpose::MEDIA_PIPE;
use photos::{Key, Photo, key_of_value, match_photos};
use points::{NotPoints, Person};
use tree::{Node, list_keys};

/// The person found in one photo
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Detection {
    /// Joints of the selected person, in px of the photo; all not found if the file contains no person
    pub keypoints: Keypoints,
    /// Number of people in the photo
    pub people_count: usize,
    /// Definition of the joints
    pub kind: KeypointKind,
}

/// Why keypoints cannot be used
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum KeypointsError {
    #[error("the file is empty")]
    Empty,
    #[error(
        "{0}; a keypoint file is {{ \"people\": [{{ \"pose_keypoints_2d\": [x, y, confidence, ...] }}] }}"
    )]
    Json(JsonError),
    /// Strict JSON with a value that is out of range, or too many values
    #[error("the keypoints cannot be read: {0}")]
    Value(serde_json::Error),
    #[error("the file is neither JSON nor text in UTF-8")]
    NotText,
    #[error(
        "line {line} is no YOLO pose label: {number_count} values ({found:?}) instead of class, box and 17 points (56 or 39 numbers)"
    )]
    Line {
        line: usize,
        number_count: usize,
        found: String,
    },
    #[error(
        "no keypoints found in {found}; readable are the formats of OpenPose, COCO, MMPose, AlphaPose, Halpe, MediaPipe and YOLO"
    )]
    Unknown { found: String },
    #[error("person {person} has no keypoints")]
    NoPose { person: usize },
    #[error(
        "person {person} has {count} {of}; readable are 15, 18 or 25 points (OpenPose), 17 or 133 (COCO), 26 or 136 (Halpe) and 33 (MediaPipe)"
    )]
    Count {
        person: usize,
        count: usize,
        of: &'static str,
    },
    #[error("the keypoints of person {person} are {found} instead of points with x and y")]
    NotPoints { person: usize, found: String },
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
        "the coordinates could be in the range 0 to 1 or -1 to 1; export pixels (OpenPose: --keypoint_scale 0)"
    )]
    Unit,
    #[error(
        "the landmarks are positions in the room in meters; export the landmarks in the photo (MediaPipe: pose_landmarks)"
    )]
    World,
    #[error(
        "the keypoints are for an image of {file_width} x {file_height} px, but the photo has {width_px} x {height_px} px"
    )]
    OtherSize {
        file_width: f64,
        file_height: f64,
        width_px: usize,
        height_px: usize,
    },
    #[error(
        "shoulders, hips, knees and ankles of person {person} are not one below the other; the {point_count} points are in an unknown order, or the photo is rotated"
    )]
    Order { person: usize, point_count: usize },
    #[error("no keypoints for this photo; the file has those of {keys}")]
    NoPhoto { keys: String },
}

/// A parsed keypoint file: the people of one photo, or of several photos with their names
#[derive(Debug, Clone)]
pub struct KeypointFile {
    photos: Vec<Photo>,
}

impl KeypointFile {
    /// Parses a file in any readable format
    ///
    /// # Errors
    /// When the format is unknown, or the number of points of a person fits no known detector.
    pub fn parse(bytes: &[u8]) -> Result<Self, KeypointsError> {
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let start = bytes.iter().find(|byte| !byte.is_ascii_whitespace());
        let photos = match start {
            None => return Err(KeypointsError::Empty),
            Some(b'0'..=b'9') => {
                let Ok(text) = std::str::from_utf8(bytes) else {
                    return Err(KeypointsError::NotText);
                };
                vec![Photo::of(yolo::text_people(text)?)]
            }
            Some(_) => {
                let strict = to_strict(bytes).map_err(json_error)?;
                let node = Node::parse(&strict).map_err(KeypointsError::Value)?;
                read_photos(&node, None)?
            }
        };
        Ok(Self { photos })
    }

    /// Returns the index of the content for each of the photos that the file is used for, for [`KeypointFile::detection`]
    ///
    /// A file with one photo fits one photo, whatever its name. Several photos fit by their names, or by their numbers;
    /// `None` where there is no content, or it is ambiguous.
    pub fn match_photos(&self, photos: &[&str]) -> Vec<Option<usize>> {
        let keys: Vec<Option<Key>> = self.photos.iter().map(|photo| photo.key.clone()).collect();
        match_photos(&keys, photos)
    }

    /// Selects the person in a photo of the given size
    ///
    /// Of several people, selects the one with the highest sum of confidences, weighted by nearness to the middle of the
    /// photo. `index` is one of [`KeypointFile::match_photos`].
    ///
    /// # Errors
    /// When there is no such content, numbers are out of range, or the points are not in the order of a known detector.
    pub fn detection(
        &self,
        index: Option<usize>,
        width_px: usize,
        height_px: usize,
    ) -> Result<Detection, KeypointsError> {
        let photo = index.and_then(|index| self.photos.get(index));
        let photo = photo.ok_or_else(|| self.no_photo())?;
        person::detection(photo, width_px, height_px)
    }

    /// Returns the error for a photo without content
    fn no_photo(&self) -> KeypointsError {
        let keys: Vec<String> = self
            .photos
            .iter()
            .filter_map(|p| Some(p.key.as_ref()?.to_string()))
            .collect();
        let keys = if keys.is_empty() {
            format!("{} photos without names", self.photos.len())
        } else {
            list_keys(keys.iter().map(String::as_str))
        };
        KeypointsError::NoPhoto { keys }
    }
}

fn json_error(error: JsonError) -> KeypointsError {
    match error {
        JsonError::Empty => KeypointsError::Empty,
        error => KeypointsError::Json(error),
    }
}

/// Returns the conversion of problems of a person's points
fn person_error(person: usize) -> impl Fn(NotPoints) -> KeypointsError {
    move |problem| match problem {
        NotPoints::Count { count, of } => KeypointsError::Count { person, count, of },
        NotPoints::Other(found) => KeypointsError::NotPoints { person, found },
    }
}

/// Keys whose value contains the people or photos of results
const WRAPPER_KEYS: [&str; 8] = [
    "instance_info",
    "instances",
    "predictions",
    "pred_instances",
    "results",
    "frames",
    "detections",
    "poses",
];

/// Keys that name a photo
const PHOTO_KEYS: [&str; 13] = [
    "image_id",
    "image_name",
    "image_path",
    "img_path",
    "img_name",
    "image",
    "file_name",
    "filename",
    "path",
    "frame_id",
    "frame_index",
    "frame_idx",
    "frame",
];

/// Reads all photos of a value; `names` are those of the points, if the file lists them
fn read_photos(node: &Node, names: Option<&[String]>) -> Result<Vec<Photo>, KeypointsError> {
    match node {
        Node::Object(fields) => read_object(node, fields, names),
        Node::List(items) => read_list(node, items, names),
        Node::Numbers(_) => Ok(vec![Photo::of(vec![one_person(node, names)?])]),
        other => Err(unknown(other)),
    }
}

fn unknown(node: &Node) -> KeypointsError {
    KeypointsError::Unknown {
        found: node.describe(),
    }
}

fn one_person(node: &Node, names: Option<&[String]>) -> Result<Person, KeypointsError> {
    Person::read(node, None, names).map_err(|problem| match problem {
        NotPoints::Other(_) => unknown(node),
        count => person_error(0)(count),
    })
}

/// Returns the name or number of the photo that an object states
fn key_of_object(node: &Node) -> Option<Key> {
    node.get(&PHOTO_KEYS).and_then(key_of_value)
}

fn read_object(
    node: &Node,
    fields: &[(String, Node)],
    names: Option<&[String]>,
) -> Result<Vec<Photo>, KeypointsError> {
    if let Some(photo) = openpose::read(node).or_else(|| mediapipe::read(node)) {
        let key = key_of_object(node);
        return Ok(vec![Photo { key, ..photo? }]);
    }
    if let Some(photos) = coco::annotations(node) {
        return photos;
    }
    if coco::is_person(node) {
        let people = coco::people(node, 0, names)?;
        let key = key_of_object(node);
        return Ok(vec![Photo {
            key,
            ..Photo::of(people)
        }]);
    }
    if let Some(inner) = node.get(&WRAPPER_KEYS) {
        let of_model = coco::model_names(node);
        let mut photos = read_photos(inner, of_model.as_deref().or(names))?;
        if let [photo] = &mut photos[..]
            && photo.key.is_none()
        {
            photo.key = key_of_object(node);
        }
        return Ok(photos);
    }
    if let Ok(person) = Person::read(node, None, None) {
        return Ok(vec![Photo::of(vec![person])]);
    }
    read_by_key(node, fields, names)
}

/// Reads an object whose keys are photos
fn read_by_key(
    node: &Node,
    fields: &[(String, Node)],
    names: Option<&[String]>,
) -> Result<Vec<Photo>, KeypointsError> {
    let mut photos = Vec::new();
    for (key, value) in fields {
        let readable = match value {
            Node::Numbers(numbers) => Layout::of_flat(numbers.len()).is_some(),
            value => matches!(value, Node::Object(_) | Node::List(_)),
        };
        if !readable {
            continue;
        }
        let mut read = read_photos(value, names).map_err(|error| match error {
            // The keys of the outer object show what the file is.
            KeypointsError::Unknown { .. } => unknown(node),
            error => error,
        })?;
        match (read.pop(), read.is_empty()) {
            (Some(photo), true) => {
                let key = Some(Key::Name(key.clone()));
                photos.push(Photo { key, ..photo });
            }
            _ => return Err(unknown(node)),
        }
    }
    if photos.is_empty() {
        return Err(unknown(node));
    }
    Ok(photos)
}

fn read_list(
    node: &Node,
    items: &[Node],
    names: Option<&[String]>,
) -> Result<Vec<Photo>, KeypointsError> {
    if items.is_empty() {
        return Ok(vec![Photo::of(vec![])]);
    }
    if let Ok(person) = Person::read(node, None, names) {
        return Ok(vec![Photo::of(vec![person])]);
    }
    if items.iter().all(|item| matches!(item, Node::Object(_))) {
        return read_objects(items, names);
    }
    // One list of points per person
    let people: Result<Vec<Person>, _> = items
        .iter()
        .map(|item| Person::read(item, None, names))
        .collect();
    match people {
        Ok(people) => Ok(vec![Photo::of(people)]),
        Err(count @ NotPoints::Count { .. }) => Err(person_error(0)(count)),
        Err(NotPoints::Other(_)) => read_nested(node, items, names),
    }
}

/// Reads a list with the people of one photo each
fn read_nested(
    node: &Node,
    items: &[Node],
    names: Option<&[String]>,
) -> Result<Vec<Photo>, KeypointsError> {
    let mut photos = Vec::new();
    for item in items {
        let Node::List(_) = item else {
            return Err(unknown(node));
        };
        photos.extend(read_photos(item, names)?);
    }
    number_photos(&mut photos);
    Ok(photos)
}

/// Numbers several photos without keys
fn number_photos(photos: &mut [Photo]) {
    if photos.len() > 1 && photos.iter().all(|photo| photo.key.is_none()) {
        for (index, photo) in photos.iter_mut().enumerate() {
            photo.key = Some(Key::Number(index as i64));
        }
    }
}

/// Reads a list of people, or of photos; those with the same key belong together
fn read_objects(items: &[Node], names: Option<&[String]>) -> Result<Vec<Photo>, KeypointsError> {
    let mut photos: Vec<Photo> = Vec::new();
    let mut places: std::collections::BTreeMap<String, usize> = std::collections::BTreeMap::new();
    let mut photo_count = 0;
    for (index, item) in items.iter().enumerate() {
        let read = if coco::is_person(item) {
            let people = coco::people(item, index, names)?;
            let key = key_of_object(item);
            vec![Photo {
                key,
                ..Photo::of(people)
            }]
        } else {
            photo_count += 1;
            read_object(item, fields_of(item), names)?
        };
        for photo in read {
            // Photos without a key stay separate; people without one belong to one photo.
            let place = match &photo.key {
                Some(key) => format!("key {key}"),
                None => format!("photo {photo_count}"),
            };
            match places.get(&place).and_then(|&place| photos.get_mut(place)) {
                Some(same) => same.people.extend(photo.people),
                None => {
                    places.insert(place, photos.len());
                    photos.push(photo);
                }
            }
        }
    }
    number_photos(&mut photos);
    Ok(photos)
}

fn fields_of(node: &Node) -> &[(String, Node)] {
    match node {
        Node::Object(fields) => fields,
        _ => &[],
    }
}

#[cfg(test)]
mod tests;
