//! The joints that detectors find (BODY_25), the 19 bones that pose a body, and detected keypoints.

use glam::DVec2;

mod per_joint;

pub use per_joint::{PerBone, PerJoint};

/// A joint or face point of OpenPose's BODY_25 model, in its order; left and right are the person's own
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
#[allow(missing_docs, reason = "the names are self-explanatory")]
pub enum Joint {
    Nose,
    Neck,
    RightShoulder,
    RightElbow,
    RightWrist,
    LeftShoulder,
    LeftElbow,
    LeftWrist,
    MidHip,
    RightHip,
    RightKnee,
    RightAnkle,
    LeftHip,
    LeftKnee,
    LeftAnkle,
    RightEye,
    LeftEye,
    RightEar,
    LeftEar,
    LeftBigToe,
    LeftSmallToe,
    LeftHeel,
    RightBigToe,
    RightSmallToe,
    RightHeel,
}

impl Joint {
    /// Number of joints
    pub const COUNT: usize = 25;

    /// Joints defined as the midpoint of two others, see [`Joint::middle_of`]
    pub const MIDDLES: [Joint; 2] = [Joint::Neck, Joint::MidHip];

    /// All joints in BODY_25 order
    pub const ALL: [Joint; Joint::COUNT] = [
        Joint::Nose,
        Joint::Neck,
        Joint::RightShoulder,
        Joint::RightElbow,
        Joint::RightWrist,
        Joint::LeftShoulder,
        Joint::LeftElbow,
        Joint::LeftWrist,
        Joint::MidHip,
        Joint::RightHip,
        Joint::RightKnee,
        Joint::RightAnkle,
        Joint::LeftHip,
        Joint::LeftKnee,
        Joint::LeftAnkle,
        Joint::RightEye,
        Joint::LeftEye,
        Joint::RightEar,
        Joint::LeftEar,
        Joint::LeftBigToe,
        Joint::LeftSmallToe,
        Joint::LeftHeel,
        Joint::RightBigToe,
        Joint::RightSmallToe,
        Joint::RightHeel,
    ];

    /// Returns the name used in files, in snake case
    pub fn name(self) -> &'static str {
        const NAMES: [&str; Joint::COUNT] = [
            "nose",
            "neck",
            "right_shoulder",
            "right_elbow",
            "right_wrist",
            "left_shoulder",
            "left_elbow",
            "left_wrist",
            "mid_hip",
            "right_hip",
            "right_knee",
            "right_ankle",
            "left_hip",
            "left_knee",
            "left_ankle",
            "right_eye",
            "left_eye",
            "right_ear",
            "left_ear",
            "left_big_toe",
            "left_small_toe",
            "left_heel",
            "right_big_toe",
            "right_small_toe",
            "right_heel",
        ];
        NAMES[self as usize]
    }

    /// Returns the same joint of the other side; middle joints map to themselves
    pub fn mirrored(self) -> Joint {
        const MIRROR: [usize; Joint::COUNT] = [
            0, 1, 5, 6, 7, 2, 3, 4, 8, 12, 13, 14, 9, 10, 11, 16, 15, 18, 17, 22, 23, 24, 19, 20,
            21,
        ];
        Joint::ALL[MIRROR[self as usize]]
    }

    /// Returns the two joints, left then right, whose midpoint defines a joint
    ///
    /// The neck is the middle of the shoulders and the mid hip the middle of the hips.
    pub fn middle_of(self) -> Option<[Joint; 2]> {
        match self {
            Joint::Neck => Some([Joint::LeftShoulder, Joint::RightShoulder]),
            Joint::MidHip => Some([Joint::LeftHip, Joint::RightHip]),
            _ => None,
        }
    }

    /// Returns the joints and weights whose sum is a joint: two halves for a midpoint, otherwise the joint itself
    pub fn parts(self) -> impl Iterator<Item = (Joint, f64)> {
        let parts = match self.middle_of() {
            Some([left, right]) => [Some((left, 0.5)), Some((right, 0.5))],
            None => [Some((self, 1.0)), None],
        };
        parts.into_iter().flatten()
    }

    /// Returns the bone that the joint is attached to
    pub fn bone(self) -> Bone {
        match self {
            Joint::Nose | Joint::RightEye | Joint::LeftEye | Joint::RightEar | Joint::LeftEar => {
                Bone::Head
            }
            Joint::Neck => Bone::UpperSpine,
            Joint::RightShoulder => Bone::RightUpperArm,
            Joint::RightElbow => Bone::RightForearm,
            Joint::RightWrist => Bone::RightHand,
            Joint::LeftShoulder => Bone::LeftUpperArm,
            Joint::LeftElbow => Bone::LeftForearm,
            Joint::LeftWrist => Bone::LeftHand,
            Joint::MidHip => Bone::Root,
            Joint::RightHip => Bone::RightThigh,
            Joint::RightKnee => Bone::RightShin,
            Joint::LeftHip => Bone::LeftThigh,
            Joint::LeftKnee => Bone::LeftShin,
            Joint::RightAnkle | Joint::RightBigToe | Joint::RightSmallToe | Joint::RightHeel => {
                Bone::RightFoot
            }
            Joint::LeftAnkle | Joint::LeftBigToe | Joint::LeftSmallToe | Joint::LeftHeel => {
                Bone::LeftFoot
            }
        }
    }
}

/// A bone of the posable body; parents come before their children
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
#[allow(missing_docs, reason = "the names are self-explanatory")]
pub enum Bone {
    Root,
    LowerSpine,
    UpperSpine,
    Neck,
    Head,
    LeftClavicle,
    LeftUpperArm,
    LeftForearm,
    LeftHand,
    LeftThigh,
    LeftShin,
    LeftFoot,
    RightClavicle,
    RightUpperArm,
    RightForearm,
    RightHand,
    RightThigh,
    RightShin,
    RightFoot,
}

impl Bone {
    /// Number of bones
    pub const COUNT: usize = 19;

    /// All bones, parents first
    pub const ALL: [Bone; Bone::COUNT] = [
        Bone::Root,
        Bone::LowerSpine,
        Bone::UpperSpine,
        Bone::Neck,
        Bone::Head,
        Bone::LeftClavicle,
        Bone::LeftUpperArm,
        Bone::LeftForearm,
        Bone::LeftHand,
        Bone::LeftThigh,
        Bone::LeftShin,
        Bone::LeftFoot,
        Bone::RightClavicle,
        Bone::RightUpperArm,
        Bone::RightForearm,
        Bone::RightHand,
        Bone::RightThigh,
        Bone::RightShin,
        Bone::RightFoot,
    ];

    /// Returns the name used in files, in snake case
    pub fn name(self) -> &'static str {
        const NAMES: [&str; Bone::COUNT] = [
            "root",
            "lower_spine",
            "upper_spine",
            "neck",
            "head",
            "left_clavicle",
            "left_upper_arm",
            "left_forearm",
            "left_hand",
            "left_thigh",
            "left_shin",
            "left_foot",
            "right_clavicle",
            "right_upper_arm",
            "right_forearm",
            "right_hand",
            "right_thigh",
            "right_shin",
            "right_foot",
        ];
        NAMES[self as usize]
    }

    /// Returns the bone that this one is attached to, `None` for the root
    pub fn parent(self) -> Option<Bone> {
        use Bone::*;
        Some(match self {
            Root => return None,
            LowerSpine | LeftThigh | RightThigh => Root,
            UpperSpine => LowerSpine,
            Neck | LeftClavicle | RightClavicle => UpperSpine,
            Head => Neck,
            LeftUpperArm => LeftClavicle,
            LeftForearm => LeftUpperArm,
            LeftHand => LeftForearm,
            LeftShin => LeftThigh,
            LeftFoot => LeftShin,
            RightUpperArm => RightClavicle,
            RightForearm => RightUpperArm,
            RightHand => RightForearm,
            RightShin => RightThigh,
            RightFoot => RightShin,
        })
    }

    /// Returns the same bone of the other side; middle bones map to themselves
    pub fn mirrored(self) -> Bone {
        let index = self as usize;
        match index {
            0..=4 => self,
            5..=11 => Bone::ALL[index + 7],
            _ => Bone::ALL[index - 7],
        }
    }

    /// Returns whether this bone is `ancestor` or one of its direct or indirect descendants
    pub fn descends_from(self, ancestor: Bone) -> bool {
        let mut bone = Some(self);
        while let Some(b) = bone {
            if b == ancestor {
                return true;
            }
            bone = b.parent();
        }
        false
    }
}

/// A joint seen in a photo
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Keypoint {
    /// Photo coordinates, in px
    pub position: DVec2,
    /// Confidence of the detector, 0 to 1; 0 means not found
    pub confidence: f64,
}

/// All joints of one person in one photo
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Keypoints {
    points: PerJoint<Keypoint>,
}

impl Keypoints {
    /// Keypoints below this confidence (0 to 1) count as not found
    ///
    /// OpenPose itself drops peaks below 0.05.
    pub const MIN_CONFIDENCE: f64 = 0.05;

    /// One keypoint per joint
    pub fn new(points: PerJoint<Keypoint>) -> Self {
        Self { points }
    }

    /// Returns the joint as detected, regardless of its confidence
    pub fn get(&self, joint: Joint) -> Keypoint {
        self.points[joint]
    }

    /// Replaces one joint
    pub fn set(&mut self, joint: Joint, keypoint: Keypoint) {
        self.points[joint] = keypoint;
    }

    /// Returns the joint if it was found
    pub fn found(&self, joint: Joint) -> Option<Keypoint> {
        let keypoint = self.get(joint);
        (keypoint.confidence > Self::MIN_CONFIDENCE).then_some(keypoint)
    }

    /// Returns the number of joints found
    pub fn found_count(&self) -> usize {
        Joint::ALL
            .iter()
            .filter(|&&j| self.found(j).is_some())
            .count()
    }

    /// Iterates over all joints with their keypoints
    pub fn iter(&self) -> impl Iterator<Item = (Joint, Keypoint)> + '_ {
        Joint::ALL.iter().map(|&j| (j, self.get(j)))
    }
}

impl FromIterator<(Joint, Keypoint)> for Keypoints {
    /// Collects the joints that were found; the others are not found
    fn from_iter<T: IntoIterator<Item = (Joint, Keypoint)>>(points: T) -> Self {
        let mut keypoints = Self::default();
        for (joint, keypoint) in points {
            keypoints.set(joint, keypoint);
        }
        keypoints
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parents_come_before_children() {
        for bone in Bone::ALL {
            if let Some(parent) = bone.parent() {
                assert!(parent < bone);
                assert_eq!(bone.mirrored().parent(), Some(parent.mirrored()));
            }
            assert!(bone.descends_from(Bone::Root));
        }
        assert!(!Bone::LeftHand.descends_from(Bone::RightClavicle));
    }

    #[test]
    fn middles_lie_between_a_joint_and_its_mirror() {
        for joint in Joint::ALL {
            let middle = joint.middle_of();
            assert_eq!(middle.is_some(), Joint::MIDDLES.contains(&joint));
            assert!(middle.is_none_or(|[left, right]| left.mirrored() == right));
            let shares: f64 = joint.parts().map(|(_, share)| share).sum();
            assert!((shares - 1.0).abs() < f64::EPSILON);
        }
        let mut points = PerJoint::splat(0.0_f64);
        points[Joint::LeftHip] = 3.0;
        points[Joint::RightHip] = -1.0;
        points.set_middles(|left, right| (left + right) / 2.0);
        assert!((points[Joint::MidHip] - 1.0).abs() < f64::EPSILON);
        assert_eq!(points.iter().filter(|&&p| p != 0.0).count(), 3);
    }

    #[test]
    fn mirroring_twice_is_the_identity_and_mirroring_swaps_names() {
        for joint in Joint::ALL {
            assert_eq!(joint.mirrored().mirrored(), joint);
            assert_eq!(joint.mirrored().bone(), joint.bone().mirrored());
            let swapped = match joint.name().split_once('_') {
                Some(("left", rest)) => format!("right_{rest}"),
                Some(("right", rest)) => format!("left_{rest}"),
                _ => joint.name().to_owned(),
            };
            assert_eq!(joint.mirrored().name(), swapped);
        }
    }
}
