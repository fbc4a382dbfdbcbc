//! Plausibility of keypoints as a standing person, to detect another order of joints.

use glam::DVec2;
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

/// Ankles with points of their feet
const FEET: [(Joint, Joint); 4] = [
    (Joint::LeftAnkle, Joint::LeftBigToe),
    (Joint::LeftAnkle, Joint::LeftHeel),
    (Joint::RightAnkle, Joint::RightBigToe),
    (Joint::RightAnkle, Joint::RightHeel),
];

/// Maximum distance of the foot from the ankle, as a share of the person's extent; a foot is 15 % of the stature long
const MAX_FOOT_DISTANCE: f64 = 0.2;

/// Ratio of the lengths of a left and a right limb above which they contradict each other
///
/// Seen from the side, the near limb of a standing person is at most a third longer; elbows foreshorten more.
const MAX_LIMB_RATIO: f64 = 3.0;

/// Maximum distance of neck and mid hip from the middle of the shoulders and hips, as a share of the person's extent
const MAX_MIDDLE_DISTANCE: f64 = 0.15;

/// Share of a person's larger extent by which a level must be below the next one to be inverted
///
/// Levels of a person who lies or bends down differ by less.
const MIN_INVERSION: f64 = 0.1;

/// Returns which pairs of adjacent levels, from the head down, are in the wrong order; not where a level is missing
fn inverted_levels(keypoints: &Keypoints) -> [bool; 4] {
    let heights = LEVELS.map(|joints| {
        let found = joints.iter().filter_map(|&joint| keypoints.found(joint));
        let heights: Vec<f64> = found.map(|keypoint| keypoint.position.y).collect();
        (!heights.is_empty()).then(|| heights.iter().sum::<f64>() / heights.len() as f64)
    });
    let margin = MIN_INVERSION * extent(keypoints);
    std::array::from_fn(|pair| {
        let upper_and_lower = heights[pair].zip(heights[pair + 1]);
        upper_and_lower.is_some_and(|(upper, lower)| upper > lower + margin)
    })
}

/// Returns the larger side of the box around the joints
fn extent(keypoints: &Keypoints) -> f64 {
    let found = keypoints
        .iter()
        .filter(|(_, keypoint)| keypoint.confidence > 0.0);
    let positions: Vec<DVec2> = found.map(|(_, keypoint)| keypoint.position).collect();
    let min = positions.iter().copied().reduce(DVec2::min);
    let max = positions.iter().copied().reduce(DVec2::max);
    min.zip(max)
        .map_or(0.0, |(min, max)| (max - min).max_element())
}

/// Returns whether the joints cannot be those of a person: the shoulders are below the hips, or two of the pairs head and
/// shoulders, hips and knees, knees and ankles are inverted
pub(super) fn is_in_other_order(keypoints: &Keypoints) -> bool {
    let inverted = inverted_levels(keypoints);
    inverted[1] || inverted.iter().filter(|&&inverted| inverted).count() >= 2
}

/// Returns the number of contradictions to a standing person: inverted levels, points of the face below the shoulders,
/// unequal limbs, feet apart from their ankles, and a neck or mid hip apart from the middle of the shoulders or hips
pub(super) fn contradictions(keypoints: &Keypoints) -> usize {
    let found = |joint: Joint| keypoints.found(joint).map(|keypoint| keypoint.position);
    let middle = |[left, right]: [Joint; 2]| Some(found(left)?.midpoint(found(right)?));
    let length = |from: Joint, to: Joint| Some(found(from)?.distance(found(to)?));
    let unequal = |&&(from, to): &&(Joint, Joint)| {
        let pair = length(from, to).zip(length(from.mirrored(), to.mirrored()));
        pair.is_some_and(|(a, b)| a.max(b) > MAX_LIMB_RATIO * a.min(b))
    };
    let extent = extent(keypoints);
    let shoulders = middle([Joint::LeftShoulder, Joint::RightShoulder]);
    let low = |&&joint: &&Joint| {
        let pair = found(joint).zip(shoulders);
        pair.is_some_and(|(face, shoulders)| face.y > shoulders.y + MIN_INVERSION * extent)
    };
    let apart = |&&joint: &&Joint| {
        let pair = found(joint).zip(joint.middle_of().and_then(middle));
        pair.is_some_and(|(joint, middle)| joint.distance(middle) > MAX_MIDDLE_DISTANCE * extent)
    };
    let foot = |&&(ankle, foot): &&(Joint, Joint)| {
        let far = |length: f64| length > MAX_FOOT_DISTANCE * extent;
        length(ankle, foot).is_some_and(far)
    };
    let inverted = inverted_levels(keypoints);
    inverted.iter().filter(|&&inverted| inverted).count()
        + LEVELS[0].iter().filter(low).count()
        + LIMBS.iter().filter(unequal).count()
        + FEET.iter().filter(foot).count()
        + Joint::MIDDLES.iter().filter(apart).count()
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
