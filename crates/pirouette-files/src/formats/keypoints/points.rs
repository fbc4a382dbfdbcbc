//! The points of one person in any notation: flat numbers, rows, objects, columns, or joints by name.

use pirouette_body::Joint;

use super::layout::{Layout, MEDIAPIPE_NAMES, joint_of_name, landmark_of_name};
use super::tree::{Node, describe_list, describe_object};
use super::yolo;

/// Number of joints from which an object or list of names is a person
const MIN_NAMED: usize = 5;

/// Keys of the confidence of a point
const CONFIDENCE_KEYS: [&str; 7] = [
    "score",
    "confidence",
    "conf",
    "visibility",
    "visible",
    "v",
    "likelihood",
];

/// A point as given; not finite where the file has none
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) confidence: Option<f64>,
}

impl Point {
    const MISSING: Point = Point {
        x: f64::NAN,
        y: f64::NAN,
        confidence: None,
    };

    /// Returns a point of x, y and optionally a confidence
    pub(super) fn of(numbers: &[f64]) -> Self {
        match *numbers {
            [x, y, ref rest @ ..] => Point {
                x,
                y,
                confidence: rest.first().copied(),
            },
            _ => Point::MISSING,
        }
    }

    /// Returns whether the point has a position; detectors write 0, 0 or a confidence of 0 for what they did not find
    pub(super) fn found(&self) -> bool {
        let positive = self.confidence.is_none_or(|confidence| confidence > 0.0);
        let zero = self.x.abs() + self.y.abs() <= 0.0;
        positive && self.x.is_finite() && self.y.is_finite() && !zero
    }
}

/// The points of one person with their order
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Person {
    pub(super) layout: Layout,
    pub(super) points: Vec<Point>,
}

/// Why a value is not a person
#[derive(Debug, Clone, PartialEq)]
pub(super) enum NotPoints {
    /// It has no points
    Other(String),
    /// A number of points or numbers that no order has
    Count { count: usize, of: &'static str },
}

impl Person {
    /// Reads the points of a person
    ///
    /// `scores` has one confidence per point, and replaces those of the points. `names` are the names of the points if
    /// the file lists them.
    pub(super) fn read(
        points: &Node,
        scores: Option<&Node>,
        names: Option<&[String]>,
    ) -> Result<Self, NotPoints> {
        let (mut list, own_names) = match points {
            Node::Numbers(numbers) => (flat(numbers, names)?, None),
            Node::List(items) => rows(items)?,
            Node::Object(fields) => match yolo::columns(points) {
                Some(columns) => (columns, None),
                None => return Self::of_fields(fields),
            },
            other => return Err(NotPoints::Other(other.describe())),
        };
        if let Some(Node::Numbers(scores)) = scores
            && scores.len() == list.len()
        {
            for (point, &score) in list.iter_mut().zip(scores) {
                point.confidence = Some(score);
            }
        }
        Self::of_points(list, own_names.as_deref().or(names))
    }

    /// Assigns points by their names if there are enough known ones, otherwise by their number
    fn of_points(points: Vec<Point>, names: Option<&[String]>) -> Result<Self, NotPoints> {
        let names = names.filter(|names| names.len() == points.len());
        let named = names.map(|names| names.iter().map(String::as_str).zip(points.iter().copied()));
        if let Some(person) = named.and_then(Self::of_names) {
            return Ok(person);
        }
        let count = points.len();
        let of = "points";
        let layout = Layout::of_count(count).ok_or(NotPoints::Count { count, of })?;
        Ok(Self { layout, points }.without_depths())
    }

    /// Drops the third numbers of landmarks, which are depths, and their visibility, which is no measure of accuracy
    fn without_depths(mut self) -> Self {
        if self.layout == Layout::MediaPipe33 {
            for point in &mut self.points {
                point.confidence = None;
            }
        }
        self
    }

    /// Reads an object with one key per joint
    fn of_fields(fields: &[(String, Node)]) -> Result<Self, NotPoints> {
        let named = fields.iter().filter_map(|(name, value)| {
            let point = match value {
                Node::Numbers(row) => (2..=5).contains(&row.len()).then(|| Point::of(row)),
                value => object_point(value),
            };
            Some((name.as_str(), point?))
        });
        Self::of_names(named).ok_or_else(|| NotPoints::Other(describe_object(fields)))
    }

    fn of_names<'a>(named: impl Iterator<Item = (&'a str, Point)>) -> Option<Self> {
        let mut landmarks = vec![Point::MISSING; MEDIAPIPE_NAMES.len()];
        let mut joints = vec![Point::MISSING; Joint::COUNT];
        let (mut joint_count, mut only_landmarks) = (0, false);
        for (name, point) in named {
            let (landmark, joint) = (landmark_of_name(name), joint_of_name(name));
            if let Some(landmark) = landmark {
                landmarks[landmark] = point;
                only_landmarks |= joint.is_none();
            }
            if let Some(joint) = joint {
                joints[joint as usize] = point;
                joint_count += 1;
            }
        }
        let (layout, points) = if only_landmarks {
            (Layout::MediaPipe33, landmarks)
        } else {
            (Layout::Named, joints)
        };
        (joint_count >= MIN_NAMED).then(|| Self { layout, points }.without_depths())
    }
}

/// Splits a flat list into points: by the number of names, otherwise by the count of numbers
fn flat(numbers: &[f64], names: Option<&[String]>) -> Result<Vec<Point>, NotPoints> {
    let count = numbers.len();
    let of_names = names.and_then(|names| {
        let columns = count / names.len().max(1);
        ((2..=3).contains(&columns) && columns * names.len() == count).then_some(columns)
    });
    let of_count = || Layout::of_flat(count).map(|(_, columns)| columns);
    let columns = of_names.or_else(of_count);
    let of = "numbers";
    let columns = columns.ok_or(NotPoints::Count { count, of })?;
    Ok(numbers.chunks_exact(columns).map(Point::of).collect())
}

/// Reads rows of numbers or objects with x and y, and the names of the points if all have one
fn rows(items: &[Node]) -> Result<(Vec<Point>, Option<Vec<String>>), NotPoints> {
    if items.is_empty() {
        return Err(NotPoints::Other("an empty list".to_owned()));
    }
    let (mut points, mut names) = (Vec::new(), Vec::new());
    for item in items {
        let point = match item {
            Node::Other => Some(Point::MISSING),
            Node::Numbers(row) if (2..=5).contains(&row.len()) => Some(Point::of(row)),
            item => object_point(item),
        };
        let other = || NotPoints::Other(describe_list(items));
        points.push(point.ok_or_else(other)?);
        if let Some(Node::Text(name)) = item.get(&["name", "part", "label"]) {
            names.push(name.clone());
        }
    }
    let wide = |item: &Node| matches!(item, Node::Numbers(row) if row.len() > 3);
    if items.iter().any(wide) && Layout::of_count(items.len()) != Some(Layout::MediaPipe33) {
        return Err(NotPoints::Count {
            count: items.len(),
            of: "rows of more than three numbers",
        });
    }
    let named = !names.is_empty() && names.len() == points.len();
    Ok((points, named.then_some(names)))
}

/// Reads a point from an object with x and y, or with a position that has them
fn object_point(node: &Node) -> Option<Point> {
    let position = node.get(&["position"]).unwrap_or(node);
    let number = |node: &Node, keys: &[&str]| node.get(keys).and_then(Node::number);
    Some(Point {
        x: number(position, &["x"])?,
        y: number(position, &["y"])?,
        confidence: number(node, &CONFIDENCE_KEYS),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(json: &str) -> Result<Person, NotPoints> {
        Person::read(&Node::parse(json.as_bytes()).unwrap(), None, None)
    }

    #[test]
    fn joints_by_name_need_no_order() {
        let json = r#"{"RKnee":[1,2,0.5],"left_hip":{"x":3,"y":4},"LHip2":[9,9],"rightHip":[5,6],
            "left_ankle":[7,8],"nose":[9,1]}"#;
        let person = read(json).unwrap();
        assert_eq!(person.layout, Layout::Named);
        let knee = person.points[Joint::RightKnee as usize];
        assert_eq!((knee.x, knee.y, knee.confidence), (1.0, 2.0, Some(0.5)));
        assert!(!person.points[Joint::LeftKnee as usize].found());
    }

    #[test]
    fn a_name_that_only_mediapipe_has_makes_landmarks() {
        let names = [
            "nose",
            "left_hip",
            "right_hip",
            "left_knee",
            "left_foot_index",
        ];
        let fields: Vec<String> = names
            .iter()
            .map(|n| format!("\"{n}\":{{\"x\":1,\"y\":2}}"))
            .collect();
        assert!(read(&format!("{{{}}}", fields.join(","))).is_err());
        let more = format!(
            "{{{},\"right_knee\":{{\"x\":1,\"y\":2}}}}",
            fields.join(",")
        );
        let person = read(&more).unwrap();
        assert_eq!(person.layout, Layout::MediaPipe33);
        assert!(person.points[31].found() && !person.points[32].found());
    }

    #[test]
    fn unknown_numbers_of_points_are_counted() {
        let count = NotPoints::Count {
            count: 4,
            of: "numbers",
        };
        assert_eq!(read("[1,2,3,4]"), Err(count));
        assert!(matches!(
            read("[[1,2],[3,4]]"),
            Err(NotPoints::Count { count: 2, .. })
        ));
        assert!(matches!(read("{\"a\":1}"), Err(NotPoints::Other(_))));
    }
}
