//! The pose that the joints show.

use glam::DVec2;

use super::median;
use crate::scan::View;
use pirouette_body::{Joint, Keypoints, ReferencePose};

/// Mean angle of the arms below the horizontal, in degrees: below the first it is certainly a T-pose, above the second
/// certainly an A-pose
///
/// The arms of a T-pose hang by up to 10 degrees; those of an A-pose are raised to 30 degrees by some people.
const CERTAIN_DEGREES: [f64; 2] = [14.0, 26.0];

/// Minimum horizontal extent of an arm, as a share of the height of the trunk, to be seen from the front or back
const MIN_EXTENT: f64 = 0.5;

/// Minimum number of arms seen from the front or back
const MIN_ARMS: usize = 4;

/// Returns the pose that the joints certainly show; `None` in between, or where too few arms are seen
pub(super) fn pose_by_joints(views: &[View]) -> Option<ReferencePose> {
    let mut angles: Vec<f64> = views
        .iter()
        .flat_map(|view| arm_angles(&view.keypoints))
        .collect();
    if angles.len() < MIN_ARMS {
        return None;
    }
    let angle = median(&mut angles)?;
    if angle < CERTAIN_DEGREES[0] {
        Some(ReferencePose::T)
    } else if angle > CERTAIN_DEGREES[1] {
        Some(ReferencePose::A)
    } else {
        None
    }
}

/// Returns the angles below the horizontal of the arms that are seen from the front or back, in degrees
fn arm_angles(keypoints: &Keypoints) -> Vec<f64> {
    let at = |joint: Joint| Some(keypoints.found(joint)?.position);
    let trunk = || Some((at(Joint::MidHip)? - at(Joint::Neck)?).length());
    let Some(trunk) = trunk() else {
        return Vec::new();
    };
    let arm = |shoulder, wrist| {
        let arm: DVec2 = at(wrist)? - at(shoulder)?;
        (arm.x.abs() > MIN_EXTENT * trunk).then(|| arm.y.atan2(arm.x.abs()).to_degrees())
    };
    [
        arm(Joint::LeftShoulder, Joint::LeftWrist),
        arm(Joint::RightShoulder, Joint::RightWrist),
    ]
    .into_iter()
    .flatten()
    .collect()
}
