//! Computes targets for the joints of a silhouette, for its deformation.
//!
//! As published, each view is aligned independently: its bones get the directions of the avatar's and keep their own
//! lengths. The shared skeleton of all views improves on this: its targets are consistent in 3D.

use glam::{DVec2, DVec3};

use super::JointPositions;
use pirouette_body::{Avatar, Camera, Joint, Keypoints, PerJoint, Pose, TurnAngle, pose_bones};

/// Bones of the reference view shorter than this share of its trunk (neck to mid hip) are foreshortened: their
/// direction is unreliable
///
/// Shoulders and hips in profile, and arms of the T-pose there, are a few pixels long and have arbitrary directions. At
/// 45 degrees from profile the shoulders are a quarter of the trunk again, feet seen from the front about a fifth.
const MIN_REFERENCE_BONE: f64 = 0.08;

/// The face, which moves as one group at the end of the neck
const HEAD: [Joint; 5] = [
    Joint::Nose,
    Joint::LeftEye,
    Joint::RightEye,
    Joint::LeftEar,
    Joint::RightEar,
];

/// One limb: from the joint nearest to the trunk's middle outward
struct LimbChain {
    joints: [Joint; 3],
    /// Joints that move with the ankle or wrist
    toes: [Joint; 2],
    heel: Joint,
}

const LEGS: [LimbChain; 2] = [
    LimbChain {
        joints: [Joint::LeftHip, Joint::LeftKnee, Joint::LeftAnkle],
        toes: [Joint::LeftBigToe, Joint::LeftSmallToe],
        heel: Joint::LeftHeel,
    },
    LimbChain {
        joints: [Joint::RightHip, Joint::RightKnee, Joint::RightAnkle],
        toes: [Joint::RightBigToe, Joint::RightSmallToe],
        heel: Joint::RightHeel,
    },
];

const ARMS: [[Joint; 3]; 2] = [
    [Joint::LeftShoulder, Joint::LeftElbow, Joint::LeftWrist],
    [Joint::RightShoulder, Joint::RightElbow, Joint::RightWrist],
];

/// Returns the found and finite joints of a photo
pub fn detected_joints(keypoints: &Keypoints) -> JointPositions {
    PerJoint::from_fn(|joint| {
        let position = keypoints.found(joint)?.position;
        position.is_finite().then_some(position)
    })
}

/// Computes the targets of one view from the directions of the reference view's bones
///
/// `detected` are the joints in the photo, `reference` those of the avatar in the reference view, both in px. The
/// middle of the chest is fixed; from there outward along spine, head, shoulders, hips, arms and legs each bone takes
/// the direction that it has in the reference view and keeps its length in the photo. Foreshortened bones of the
/// reference view have no usable direction; they keep the one in the photo, rotated like the preceding bone. A chain
/// ends at its first missing joint: targets beyond are `None`.
///
/// # Source
/// Zwettler et al. 2021, eq. 1, read as `target_child = target_parent + |child - parent| *
/// unit(reference_child - reference_parent)`, with the mid chest half way between neck and mid hip, the toes as one
/// group at the ankle and the face as one group at the neck.
pub fn align(detected: &JointPositions, reference: &PerJoint<DVec2>) -> JointPositions {
    let at = |joint: Joint| detected[joint];
    let middle = |joint: Joint| {
        let [left, right] = joint.middle_of()?;
        Some((at(left)? + at(right)?) / 2.0)
    };
    let [neck, mid_hip] = Joint::MIDDLES.map(|joint| at(joint).or_else(|| middle(joint)));
    let neck_in_reference = reference[Joint::Neck];
    let hip_in_reference = reference[Joint::MidHip];

    let walk = Walk {
        detected,
        reference,
        min_reference_px: MIN_REFERENCE_BONE * neck_in_reference.distance(hip_in_reference),
    };
    let mut targets = PerJoint::splat(None);
    // without one end of the trunk, the other takes the place of the chest
    let (neck, mid_hip) = match (neck, mid_hip) {
        (Some(neck), Some(mid_hip)) => {
            let chest = Place::fixed(
                (neck + mid_hip) / 2.0,
                (neck_in_reference + hip_in_reference) / 2.0,
            );
            (
                Some(walk.follow(&chest, neck, neck_in_reference)),
                Some(walk.follow(&chest, mid_hip, hip_in_reference)),
            )
        }
        (neck, mid_hip) => (
            neck.map(|p| Place::fixed(p, neck_in_reference)),
            mid_hip.map(|p| Place::fixed(p, hip_in_reference)),
        ),
    };
    if let Some(neck) = neck {
        targets[Joint::Neck] = at(Joint::Neck).map(|_| neck.target);
        walk.group(&neck, &HEAD, &[], &mut targets);
        for arm in &ARMS {
            walk.chain(neck, arm, &mut targets);
        }
    }
    if let Some(mid_hip) = mid_hip {
        targets[Joint::MidHip] = at(Joint::MidHip).map(|_| mid_hip.target);
        for leg in &LEGS {
            if let Some(ankle) = walk.chain(mid_hip, &leg.joints, &mut targets) {
                walk.group(&ankle, &leg.toes, &[leg.heel], &mut targets);
            }
        }
    }
    targets
}

/// A joint in the photo, in the reference view, and its target
#[derive(Debug, Clone, Copy)]
struct Place {
    detected: DVec2,
    reference: DVec2,
    target: DVec2,
    /// Rotation of the bone that ends here: cosine and sine
    turn: DVec2,
}

impl Place {
    fn fixed(detected: DVec2, reference: DVec2) -> Self {
        Self {
            detected,
            reference,
            target: detected,
            turn: DVec2::X,
        }
    }
}

struct Walk<'a> {
    detected: &'a JointPositions,
    reference: &'a PerJoint<DVec2>,
    min_reference_px: f64,
}

impl Walk<'_> {
    /// Returns the next joint outward
    fn follow(&self, parent: &Place, detected: DVec2, reference: DVec2) -> Place {
        let bone = detected - parent.detected;
        let wanted = reference - parent.reference;
        let usable = wanted.length() >= self.min_reference_px;
        let turn = match (bone.try_normalize(), wanted.try_normalize()) {
            (Some(from), Some(to)) if usable => {
                DVec2::new(from.dot(to), from.perp_dot(to)).normalize_or(DVec2::X)
            }
            _ => parent.turn,
        };
        Place {
            detected,
            reference,
            target: parent.target + turn.rotate(bone),
            turn,
        }
    }

    /// Walks along joints until one is missing; returns the last joint found
    fn chain(&self, root: Place, joints: &[Joint], targets: &mut JointPositions) -> Option<Place> {
        let mut place = root;
        for &joint in joints {
            let detected = self.detected[joint]?;
            place = self.follow(&place, detected, self.reference[joint]);
            targets[joint] = Some(place.target);
        }
        Some(place)
    }

    /// Rotates a group of joints so that their centroid gets the direction it has in the reference view
    ///
    /// `followers` rotate with them without affecting the centroid.
    fn group(
        &self,
        parent: &Place,
        joints: &[Joint],
        followers: &[Joint],
        targets: &mut JointPositions,
    ) {
        let (mut count, mut detected, mut reference) = (0.0, DVec2::ZERO, DVec2::ZERO);
        for &joint in joints {
            if let Some(p) = self.detected[joint] {
                count += 1.0;
                detected += p;
                reference += self.reference[joint];
            }
        }
        if count == 0.0 {
            return;
        }
        let turn = self
            .follow(parent, detected / count, reference / count)
            .turn;
        for &joint in joints.iter().chain(followers) {
            targets[joint] =
                self.detected[joint].map(|p| parent.target + turn.rotate(p - parent.detected));
        }
    }
}

/// The joints of one skeleton in two poses, projected by one camera
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkeletonJoints {
    /// In the pose of the photo, in px
    pub photo: PerJoint<DVec2>,
    /// In the reference pose, turned like the view and standing on the turning axis, in px
    pub reference: PerJoint<DVec2>,
}

/// Projects the shared skeleton as posed in a view, and in the reference pose
///
/// `avatar` has the person's bone lengths. All joints are known, including hidden ones.
pub fn shared_skeleton_joints(
    avatar: &Avatar,
    pose: &Pose,
    turn: TurnAngle,
    camera: &Camera,
) -> SkeletonJoints {
    let project = |pose: &Pose| {
        let posed = pose_bones(&avatar.bone_heads, pose, turn);
        let mut room = posed.keypoints(&avatar.keypoints);
        room.set_middles(DVec3::midpoint);
        room.map(|point| camera.project(point))
    };
    SkeletonJoints {
        photo: project(pose),
        reference: project(&Pose::default()),
    }
}

#[cfg(test)]
pub(in crate::normalize) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A stick figure of 400 px with arms slightly out, as in a reference view
    pub(in crate::normalize) fn standing() -> PerJoint<DVec2> {
        let right = |joint: Joint| match joint {
            Joint::Nose => (0.0, 60.0),
            Joint::Neck => (0.0, 105.0),
            Joint::RightShoulder => (-40.0, 108.0),
            Joint::RightElbow => (-78.0, 175.0),
            Joint::RightWrist => (-110.0, 232.0),
            Joint::MidHip => (0.0, 245.0),
            Joint::RightHip => (-22.0, 248.0),
            Joint::RightKnee => (-30.0, 340.0),
            Joint::RightAnkle => (-37.0, 432.0),
            Joint::RightEye => (-8.0, 52.0),
            Joint::RightEar => (-18.0, 56.0),
            Joint::RightBigToe => (-42.0, 456.0),
            Joint::RightSmallToe => (-52.0, 454.0),
            Joint::RightHeel => (-34.0, 440.0),
            _ => (f64::NAN, f64::NAN),
        };
        PerJoint::from_fn(|joint| {
            let (x, y) = right(joint);
            if x.is_finite() {
                DVec2::new(200.0 + x, y)
            } else {
                let (x, y) = right(joint.mirrored());
                DVec2::new(200.0 - x, y)
            }
        })
    }

    fn all(joints: PerJoint<DVec2>) -> JointPositions {
        joints.map(Some)
    }

    fn farthest(a: &JointPositions, b: &JointPositions) -> f64 {
        a.iter()
            .zip(b)
            .map(|(a, b)| match (a, b) {
                (Some(a), Some(b)) => a.distance(*b),
                (None, None) => 0.0,
                _ => f64::INFINITY,
            })
            .fold(0.0, f64::max)
    }

    #[test]
    fn a_view_in_the_pose_of_the_reference_is_unchanged() {
        let shifted = standing().map(|p| p * 1.1 + DVec2::new(30.0, -12.0));
        let aligned = align(&all(shifted), &standing());
        assert!(farthest(&aligned, &all(shifted)) < 1e-9);
    }

    #[test]
    fn a_bent_arm_takes_the_direction_of_the_reference_and_keeps_its_length() {
        let mut bent = standing();
        let shoulder = bent[Joint::LeftShoulder];
        bent[Joint::LeftElbow] = shoulder + DVec2::new(20.0, 90.0);
        bent[Joint::LeftWrist] = shoulder + DVec2::new(-15.0, 160.0);
        let aligned = align(&all(bent), &standing());
        for (parent, child) in [
            (Joint::LeftShoulder, Joint::LeftElbow),
            (Joint::LeftElbow, Joint::LeftWrist),
        ] {
            let bone = |joints: &PerJoint<DVec2>| joints[child] - joints[parent];
            let moved = aligned[child].unwrap() - aligned[parent].unwrap();
            assert!((moved.length() - bone(&bent).length()).abs() < 1e-9);
            assert!(moved.perp_dot(bone(&standing())).abs() < 1e-6);
            assert!(moved.dot(bone(&standing())) > 0.0);
        }
        let still = aligned[Joint::RightWrist].unwrap();
        assert!(still.distance(bent[Joint::RightWrist]) < 1e-9);
    }

    #[test]
    fn a_leaning_trunk_turns_about_the_mid_chest() {
        let chest = DVec2::new(200.0, 175.0);
        let lean = DVec2::from_angle(0.2);
        let leaning = standing().map(|p| chest + lean.rotate(p - chest));
        let aligned = align(&all(leaning), &standing());
        assert!(farthest(&aligned, &all(standing())) < 1e-9);
    }

    #[test]
    fn chains_end_at_missing_joints() {
        let mut detected = all(standing());
        for joint in [Joint::LeftElbow, Joint::RightAnkle, Joint::Neck] {
            detected[joint] = None;
        }
        let aligned = align(&detected, &standing());
        for missing in [
            Joint::LeftElbow,
            Joint::LeftWrist,
            Joint::RightAnkle,
            Joint::RightBigToe,
            Joint::RightHeel,
            Joint::Neck,
        ] {
            assert_eq!(aligned[missing], None, "{missing:?}");
        }
        // the neck is interpolated between the shoulders
        assert!(aligned[Joint::RightWrist].is_some());
        assert!(aligned[Joint::Nose].is_some());
        let nothing = align(&PerJoint::splat(None), &standing());
        assert_eq!(nothing, PerJoint::splat(None));
    }

    #[test]
    fn foreshortened_bones_keep_their_direction() {
        let mut profile = standing();
        for joint in [Joint::LeftShoulder, Joint::RightShoulder] {
            profile[joint] = profile[Joint::Neck] + DVec2::new(1.0, -2.0);
        }
        let aligned = align(&all(standing()), &profile);
        for joint in [Joint::LeftShoulder, Joint::RightShoulder] {
            let shoulder = aligned[joint].unwrap();
            assert!(shoulder.distance(standing()[joint]) < 1e-9);
        }
    }

    proptest! {
        #[test]
        fn targets_stay_finite_and_move_with_the_photo(
            noise in prop::collection::vec(-300.0..300.0f64, 2 * Joint::COUNT),
            missing in prop::collection::vec(any::<bool>(), Joint::COUNT),
            shift in prop::array::uniform2(-99.0..99.0f64),
        ) {
            let shift = DVec2::from_array(shift);
            let detected = PerJoint::from_fn(|joint| {
                let i = joint as usize;
                (!missing[i]).then(|| standing()[joint] + DVec2::new(noise[2 * i], noise[2 * i + 1]))
            });
            let aligned = align(&detected, &standing());
            let shifted = align(&detected.map(|p| p.map(|p| p + shift)), &standing());
            prop_assert!(farthest(&aligned.map(|p| p.map(|p| p + shift)), &shifted) < 1e-6);
            for (target, detected) in aligned.iter().zip(&detected) {
                prop_assert!(target.is_none() || detected.is_some());
                prop_assert!(target.is_none_or(|p| p.is_finite()));
            }
        }
    }
}
