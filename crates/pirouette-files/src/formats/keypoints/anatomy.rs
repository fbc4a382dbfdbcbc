//! Plausibility of keypoints as a standing person, to detect another order of joints.

use pirouette_body::{Joint, Keypoints};

/// Joints of the levels of a standing person, from the top
const LEVELS: [&[Joint]; 5] = [
    &[
        Joint::Nose,
        Joint::LeftEye,
        Joint::RightEye,
        Joint::LeftEar,
        Joint::RightEar,
    ],
    &[Joint::LeftShoulder, Joint::RightShoulder],
    &[Joint::LeftHip, Joint::RightHip],
    &[Joint::LeftKnee, Joint::RightKnee],
    &[Joint::LeftAnkle, Joint::RightAnkle],
];

/// Left limbs: joints of their ends
const LIMBS: [(Joint, Joint); 4] = [
    (Joint::LeftShoulder, Joint::LeftElbow),
    (Joint::LeftElbow, Joint::LeftWrist),
    (Joint::LeftHip, Joint::LeftKnee),
    (Joint::LeftKnee, Joint::LeftAnkle),
];

/// Ratio of the lengths of a left and a right limb above which they contradict each other
///
/// Seen from the side, the near limb of a standing person is at most a third longer; elbows foreshorten more.
const MAX_LIMB_RATIO: f64 = 3.0;

/// Returns how many pairs of adjacent levels, from the head down, are in the wrong order
///
/// Levels without joints do not count. Without the head, at most 3.
pub(super) fn inverted_levels(keypoints: &Keypoints, with_head: bool) -> usize {
    let levels = &LEVELS[usize::from(!with_head)..];
    let heights: Vec<f64> = levels
        .iter()
        .filter_map(|joints| {
            let found = joints.iter().filter_map(|&joint| keypoints.found(joint));
            let heights: Vec<f64> = found.map(|keypoint| keypoint.position.y).collect();
            (!heights.is_empty()).then(|| heights.iter().sum::<f64>() / heights.len() as f64)
        })
        .collect();
    heights.windows(2).filter(|pair| pair[0] > pair[1]).count()
}

/// Returns the number of contradictions to a standing person: inverted levels and unequal limbs
pub(super) fn contradictions(keypoints: &Keypoints) -> usize {
    let length = |from: Joint, to: Joint| {
        let (from, to) = (keypoints.found(from)?, keypoints.found(to)?);
        Some(from.position.distance(to.position))
    };
    let unequal = |&&(from, to): &&(Joint, Joint)| {
        let pair = length(from, to).zip(length(from.mirrored(), to.mirrored()));
        pair.is_some_and(|(a, b)| a.max(b) > MAX_LIMB_RATIO * a.min(b))
    };
    inverted_levels(keypoints, true) + LIMBS.iter().filter(unequal).count()
}

/// Returns whether the left shoulder and hip are on the left side of the photo
pub(super) fn is_seen_from_behind(keypoints: &Keypoints) -> bool {
    let across = |left: Joint, right: Joint| {
        let pair = keypoints.found(left).zip(keypoints.found(right));
        pair.map_or(0.0, |(left, right)| left.position.x - right.position.x)
    };
    across(Joint::LeftShoulder, Joint::RightShoulder) + across(Joint::LeftHip, Joint::RightHip)
        < 0.0
}
