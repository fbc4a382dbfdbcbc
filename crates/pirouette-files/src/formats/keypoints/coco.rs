//! Results and annotations in the format of COCO, and the exports of MMPose, AlphaPose, ViTPose and Detectron2 that are
//! derived from it.
//!
//! # Source
//! COCO's description of its data and result formats; the documentation of the inferencer of MMPose, the output of
//! AlphaPose and the model output of Detectron2.

use std::collections::BTreeMap;

use super::points::{Person, Point};
use super::tree::Node;
use super::{Key, KeypointsError, Photo, key_of_value, person_error};

/// Keys of the points of a person
const POINT_KEYS: [&str; 4] = ["keypoints", "pred_keypoints", "keypoints_2d", "pose"];

/// Keys of one confidence per point
const SCORE_KEYS: [&str; 4] = [
    "keypoint_scores",
    "keypoints_scores",
    "scores",
    "keypoints_conf",
];

/// Returns whether a value is a person, or the people of a photo in arrays
pub(super) fn is_person(node: &Node) -> bool {
    let points = node.get(&POINT_KEYS);
    points.is_some_and(|points| !matches!(points, Node::Text(_) | Node::Number(_)))
}

/// Reads the people of one object: one person, or arrays with one row per person
pub(super) fn people(
    node: &Node,
    first: usize,
    names: Option<&[String]>,
) -> Result<Vec<Person>, KeypointsError> {
    let Some(points) = node.get(&POINT_KEYS) else {
        return Err(KeypointsError::NoPose { person: first });
    };
    if points.is_empty_list() {
        return Ok(vec![]);
    }
    let scores = node.get(&SCORE_KEYS);
    let one = match Person::read(points, scores, names) {
        Ok(person) => return Ok(vec![with_feet(node, person)]),
        Err(error) => error,
    };
    // Arrays of several people: a list of lists of points, or of flat lists of numbers
    let several = points.items().filter(|items| items.iter().all(is_list));
    let Some(items) = several else {
        return Err(person_error(first)(one));
    };
    let rows = scores.and_then(Node::items);
    let read = |(index, item): (usize, &Node)| {
        let scores = rows.and_then(|rows| rows.get(index));
        Person::read(item, scores, names).map_err(person_error(first + index))
    };
    items.iter().enumerate().map(read).collect()
}

fn is_list(node: &Node) -> bool {
    matches!(node, Node::List(_) | Node::Numbers(_))
}

/// Appends the feet that the annotations of COCO-WholeBody list separately
fn with_feet(node: &Node, mut person: Person) -> Person {
    use super::layout::Layout;
    if let Some(Node::Numbers(feet)) = node.get(&["foot_kpts"])
        && feet.len() == 18
        && person.layout == Layout::Coco17
    {
        person.points.extend(feet.chunks_exact(3).map(Point::of));
        person.layout = Layout::WholeBody133;
    }
    person
}

/// Reads a file of annotations: people with the ids of their images, and the list of images
pub(super) fn annotations(node: &Node) -> Option<Result<Vec<Photo>, KeypointsError>> {
    let annotations = node.get(&["annotations"])?.items()?;
    let names = category_names(node);
    let mut photos: BTreeMap<String, Photo> = BTreeMap::new();
    for image in node
        .get(&["images"])
        .and_then(Node::items)
        .unwrap_or_default()
    {
        let Some(id) = image.get(&["id"]).and_then(key_of_value) else {
            continue;
        };
        let side = |key: &str| image.get(&[key]).and_then(Node::number);
        let file = image.get(&["file_name"]).and_then(key_of_value);
        let photo = Photo {
            key: Some(file.unwrap_or_else(|| id.clone())),
            size_px: side("width").zip(side("height")),
            ..Photo::of(vec![])
        };
        photos.insert(id.to_string(), photo);
    }
    for (index, annotation) in annotations.iter().enumerate() {
        let unlabeled = annotation.get(&["num_keypoints"]).and_then(Node::number);
        if unlabeled.is_some_and(|count| count <= 0.0) || !is_person(annotation) {
            continue;
        }
        let people = match people(annotation, index, names.as_deref()) {
            Ok(people) => people,
            Err(error) => return Some(Err(error)),
        };
        let key = annotation.get(&["image_id"]).and_then(key_of_value);
        let id = key.as_ref().map_or_else(String::new, Key::to_string);
        let photo = photos.entry(id).or_insert_with(|| Photo {
            key,
            ..Photo::of(vec![])
        });
        photo.people.extend(people);
    }
    Some(Ok(photos.into_values().collect()))
}

/// Returns the names of the points of the first category
fn category_names(node: &Node) -> Option<Vec<String>> {
    let category = node.get(&["categories"])?.items()?.first()?;
    texts(category.get(&["keypoints"])?)
}

/// Returns the names of the points by the description of the model that MMPose writes
pub(super) fn model_names(node: &Node) -> Option<Vec<String>> {
    match node.get(&["meta_info"])?.get(&["keypoint_id2name"])? {
        Node::Object(fields) => {
            let mut names: Vec<(usize, &Node)> = Vec::new();
            for (index, name) in fields {
                names.push((index.parse().ok()?, name));
            }
            names.sort_by_key(|(index, _)| *index);
            let consecutive = names
                .iter()
                .enumerate()
                .all(|(place, (index, _))| place == *index);
            let names: Option<Vec<String>> =
                names.into_iter().map(|(_, name)| text(name)).collect();
            names.filter(|_| consecutive)
        }
        names => texts(names),
    }
}

fn texts(list: &Node) -> Option<Vec<String>> {
    list.items()?.iter().map(text).collect()
}

fn text(node: &Node) -> Option<String> {
    match node {
        Node::Text(text) => Some(text.clone()),
        _ => None,
    }
}
