//! Orders of joints: which point of a detector's list is which joint.
//!
//! # Source
//! OpenPose's documentation of its output and `poseParameters.cpp`; the dataset descriptions of COCO, COCO-WholeBody and
//! Halpe Full-Body.

use pirouette::scan::KeypointKind;
use pirouette_body::Joint;

/// The order of the points of one person
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Layout {
    /// OpenPose, 25 points
    Body25,
    /// OpenPose's experimental model of 25 points in another order
    Body25B,
    /// OpenPose, 18 points: COCO with a neck
    Coco18,
    /// OpenPose, 15 points: MPI
    Mpi15,
    /// 17 points
    Coco17,
    /// COCO-WholeBody, 133 points
    WholeBody133,
    /// 26 points
    Halpe26,
    /// 136 points
    Halpe136,
    /// 33 points
    MediaPipe33,
    /// The joints of BODY_25 in its order, assigned by name
    Named,
}

const BODY_25B: [(Joint, usize); 23] = joined(
    COCO_17,
    [
        (Joint::LeftBigToe, 19),
        (Joint::LeftSmallToe, 20),
        (Joint::LeftHeel, 21),
        (Joint::RightBigToe, 22),
        (Joint::RightSmallToe, 23),
        (Joint::RightHeel, 24),
    ],
);

const COCO_18: [(Joint, usize); 18] = [
    (Joint::Nose, 0),
    (Joint::Neck, 1),
    (Joint::RightShoulder, 2),
    (Joint::RightElbow, 3),
    (Joint::RightWrist, 4),
    (Joint::LeftShoulder, 5),
    (Joint::LeftElbow, 6),
    (Joint::LeftWrist, 7),
    (Joint::RightHip, 8),
    (Joint::RightKnee, 9),
    (Joint::RightAnkle, 10),
    (Joint::LeftHip, 11),
    (Joint::LeftKnee, 12),
    (Joint::LeftAnkle, 13),
    (Joint::RightEye, 14),
    (Joint::LeftEye, 15),
    (Joint::RightEar, 16),
    (Joint::LeftEar, 17),
];

/// Points 0, 1 and 14 are the top of the head, the upper neck and the chest, which are no joints of BODY_25
const MPI_15: [(Joint, usize); 12] = [
    (Joint::RightShoulder, 2),
    (Joint::RightElbow, 3),
    (Joint::RightWrist, 4),
    (Joint::LeftShoulder, 5),
    (Joint::LeftElbow, 6),
    (Joint::LeftWrist, 7),
    (Joint::RightHip, 8),
    (Joint::RightKnee, 9),
    (Joint::RightAnkle, 10),
    (Joint::LeftHip, 11),
    (Joint::LeftKnee, 12),
    (Joint::LeftAnkle, 13),
];

const COCO_17: [(Joint, usize); 17] = [
    (Joint::Nose, 0),
    (Joint::LeftEye, 1),
    (Joint::RightEye, 2),
    (Joint::LeftEar, 3),
    (Joint::RightEar, 4),
    (Joint::LeftShoulder, 5),
    (Joint::RightShoulder, 6),
    (Joint::LeftElbow, 7),
    (Joint::RightElbow, 8),
    (Joint::LeftWrist, 9),
    (Joint::RightWrist, 10),
    (Joint::LeftHip, 11),
    (Joint::RightHip, 12),
    (Joint::LeftKnee, 13),
    (Joint::RightKnee, 14),
    (Joint::LeftAnkle, 15),
    (Joint::RightAnkle, 16),
];

const WHOLE_BODY: [(Joint, usize); 23] = joined(
    COCO_17,
    [
        (Joint::LeftBigToe, 17),
        (Joint::LeftSmallToe, 18),
        (Joint::LeftHeel, 19),
        (Joint::RightBigToe, 20),
        (Joint::RightSmallToe, 21),
        (Joint::RightHeel, 22),
    ],
);

/// Points 17 to 19 are the top of the head, the neck and the hip; neck and mid hip are computed as midpoints
const HALPE: [(Joint, usize); 23] = joined(
    COCO_17,
    [
        (Joint::LeftBigToe, 20),
        (Joint::RightBigToe, 21),
        (Joint::LeftSmallToe, 22),
        (Joint::RightSmallToe, 23),
        (Joint::LeftHeel, 24),
        (Joint::RightHeel, 25),
    ],
);

const BODY_25: [(Joint, usize); 25] = {
    let mut joints = [(Joint::Nose, 0); 25];
    let mut index = 0;
    while index < 25 {
        joints[index] = (Joint::ALL[index], index);
        index += 1;
    }
    joints
};

/// Appends the feet to the joints of COCO
const fn joined(body: [(Joint, usize); 17], feet: [(Joint, usize); 6]) -> [(Joint, usize); 23] {
    let mut joints = [(Joint::Nose, 0); 23];
    let mut index = 0;
    while index < 23 {
        joints[index] = if index < 17 {
            body[index]
        } else {
            feet[index - 17]
        };
        index += 1;
    }
    joints
}

/// Orders that are recognized by their number of points
const COUNTED: [(Layout, usize); 8] = [
    (Layout::Coco17, 17),
    (Layout::Body25, 25),
    (Layout::Coco18, 18),
    (Layout::Mpi15, 15),
    (Layout::Halpe26, 26),
    (Layout::MediaPipe33, 33),
    (Layout::WholeBody133, 133),
    (Layout::Halpe136, 136),
];

impl Layout {
    /// Returns the order of a list with this number of points; 25 points are BODY_25 until their anatomy is known
    pub(super) fn of_count(count: usize) -> Option<Self> {
        let found = COUNTED.iter().find(|(_, points)| *points == count);
        found.map(|(layout, _)| *layout)
    }

    /// Returns the order of a flat list of numbers, and the numbers per point
    ///
    /// Points have x, y and optionally a confidence; those of MediaPipe also z and up to two confidences. No two orders
    /// have the same count of numbers.
    pub(super) fn of_flat(numbers: usize) -> Option<(Self, usize)> {
        COUNTED.iter().find_map(|&(layout, points)| {
            let columns = numbers / points;
            let known = layout.columns().contains(&columns) && columns * points == numbers;
            known.then_some((layout, columns))
        })
    }

    /// Returns the number of points
    pub(super) fn point_count(self) -> usize {
        let found = COUNTED.iter().find(|(layout, _)| *layout == self);
        found.map_or(Joint::COUNT, |(_, points)| *points)
    }

    /// Returns the permitted numbers per point
    pub(super) fn columns(self) -> std::ops::RangeInclusive<usize> {
        if self == Layout::MediaPipe33 {
            2..=5
        } else {
            2..=3
        }
    }

    /// Returns the joints with their index in the list of points; empty for MediaPipe, which is converted as detected
    pub(super) fn joints(self) -> &'static [(Joint, usize)] {
        match self {
            Layout::Body25 | Layout::Named => &BODY_25,
            Layout::Body25B => &BODY_25B,
            Layout::Coco18 => &COCO_18,
            Layout::Mpi15 => &MPI_15,
            Layout::Coco17 => &COCO_17,
            Layout::WholeBody133 => &WHOLE_BODY,
            Layout::Halpe26 | Layout::Halpe136 => &HALPE,
            Layout::MediaPipe33 => &[],
        }
    }

    /// Returns the definition of the joints
    pub(super) fn kind(self) -> KeypointKind {
        match self {
            Layout::Body25 | Layout::Body25B | Layout::Coco18 | Layout::Mpi15 => {
                KeypointKind::OpenPose
            }
            Layout::MediaPipe33 => KeypointKind::MediaPipe,
            _ => KeypointKind::Coco,
        }
    }
}

/// Returns the joint of BODY_25 that has a name in any common spelling, such as `left_knee`, `LKnee` or `leftKnee`
///
/// Names of other points, and of necks and hips, which are defined differently by datasets, are `None`.
pub(super) fn joint_of_name(name: &str) -> Option<Joint> {
    let plain = plain(name);
    let spelled = |joint: &&Joint| {
        let name = joint.name().replace('_', "");
        let short = |side: &str| Some(name.strip_prefix(side)?.to_owned());
        let left = short("left").map(|rest| format!("l{rest}"));
        let right = short("right").map(|rest| format!("r{rest}"));
        plain == name || left.or(right).is_some_and(|short| plain == short)
    };
    let joint = Joint::ALL.iter().find(spelled).copied();
    joint.filter(|joint| !Joint::MIDDLES.contains(joint))
}

/// Returns the index of a landmark of MediaPipe by its name, in any common spelling
pub(super) fn landmark_of_name(name: &str) -> Option<usize> {
    let plain = plain(name);
    let named = |landmark: &str| plain == landmark.replace('_', "");
    MEDIAPIPE_NAMES.iter().position(|landmark| named(landmark))
}

/// Removes separators and capitals from a name
fn plain(name: &str) -> String {
    let letters = name.chars().filter(|c| c.is_ascii_alphanumeric());
    letters.map(|c| c.to_ascii_lowercase()).collect()
}

/// Names of MediaPipe's landmarks in their order
pub(super) const MEDIAPIPE_NAMES: [&str; 33] = [
    "nose",
    "left_eye_inner",
    "left_eye",
    "left_eye_outer",
    "right_eye_inner",
    "right_eye",
    "right_eye_outer",
    "left_ear",
    "right_ear",
    "mouth_left",
    "mouth_right",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_pinky",
    "right_pinky",
    "left_index",
    "right_index",
    "left_thumb",
    "right_thumb",
    "left_hip",
    "right_hip",
    "left_knee",
    "right_knee",
    "left_ankle",
    "right_ankle",
    "left_heel",
    "right_heel",
    "left_foot_index",
    "right_foot_index",
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_of_numbers_are_unambiguous() {
        let mut seen = Vec::new();
        for (layout, points) in COUNTED {
            for columns in layout.columns() {
                assert_eq!(Layout::of_flat(points * columns), Some((layout, columns)));
                assert!(!seen.contains(&(points * columns)));
                seen.push(points * columns);
            }
        }
        assert_eq!(Layout::of_flat(0), None);
        assert_eq!(Layout::of_flat(20), None);
    }

    #[test]
    fn names_are_recognized_in_any_spelling() {
        for name in ["left_knee", "LKnee", "leftKnee", "Left Knee", "LEFT-KNEE"] {
            assert_eq!(joint_of_name(name), Some(Joint::LeftKnee), "{name}");
        }
        assert_eq!(joint_of_name("neck"), None);
        assert_eq!(joint_of_name("left_shin"), None);
        assert_eq!(landmark_of_name("LEFT_FOOT_INDEX"), Some(31));
        assert_eq!(landmark_of_name("leftBigToe"), None);
    }

    #[test]
    fn each_order_assigns_each_joint_once() {
        for (layout, points) in COUNTED.into_iter().chain([(Layout::Body25B, 25)]) {
            let mut joints: Vec<Joint> = layout.joints().iter().map(|j| j.0).collect();
            assert!(layout.joints().iter().all(|j| j.1 < points));
            joints.sort();
            joints.dedup();
            assert_eq!(joints.len(), layout.joints().len());
        }
    }
}
