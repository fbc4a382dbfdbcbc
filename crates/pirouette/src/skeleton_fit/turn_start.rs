//! Estimates of unknown turn angles from the keypoints of each view alone.

use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};
use glam::DVec3;

use super::KeypointView;
use super::start::{MIN_RISE_PER_STATURE, keypoint_sigma_px, scale_of_view, usable};
use crate::scan::KeypointKind;
use pirouette_body::{Avatar, Joint, Keypoint, NOMINAL_STATURE_PX, PerJoint, TurnAngle};

/// Pairs of joints that are beside each other, left first
const BESIDE: [[Joint; 2]; 2] = [
    [Joint::LeftShoulder, Joint::RightShoulder],
    [Joint::LeftHip, Joint::RightHip],
];

/// Pairs of points of which the first is in front of the second
const IN_FRONT: [[Joint; 2]; 6] = [
    [Joint::Nose, Joint::LeftEar],
    [Joint::Nose, Joint::RightEar],
    [Joint::LeftBigToe, Joint::LeftHeel],
    [Joint::RightBigToe, Joint::RightHeel],
    [Joint::LeftBigToe, Joint::LeftAnkle],
    [Joint::RightBigToe, Joint::RightAnkle],
];

/// Factors of the avatar's widths that persons may have
const WIDTH_FACTORS: [f64; 2] = [0.75, 1.3];

/// Minimum number of views whose widest one shows the person's width
const MIN_VIEWS_OF_WIDTH: usize = 4;

/// Minimum confidence, 0 to 1, of a nose and eyes that are certainly seen
const FACE_CONFIDENCE: f64 = 0.7;

/// Estimates the turn of each view from the distances of its keypoints along the photo's rows
///
/// Without perspective, left and right shoulder and hip are apart by their width times the cosine of the turn; nose and ears, and
/// toes and heels, by their depth times its sine, and each view is a linear system of both. The person's widths are the
/// largest ones of all views. `None` for views without usable points. The skeleton fit starts there.
pub fn estimate_turns(avatar: &Avatar, views: &[KeypointView]) -> Vec<Option<TurnAngle>> {
    let stature_mm = avatar.stature_mm();
    let scaled: Vec<Option<Scaled>> = views
        .iter()
        .map(|view| {
            let (width, height) = (view.width_px as f64, view.height_px as f64);
            let joints = PerJoint::from_fn(|joint| usable(&view.keypoints, joint, width, height));
            let px_per_mm = scale_of_view(avatar, &joints, MIN_RISE_PER_STATURE * stature_mm)?;
            Some(Scaled { joints, px_per_mm })
        })
        .collect();
    let factors = BESIDE.map(|pair| {
        let width = offset(avatar, pair).x;
        let seen = scaled.iter().flatten().filter_map(|view| view.apart(pair));
        let seen: Vec<f64> = seen.map(|(apart_mm, _)| (apart_mm / width).abs()).collect();
        let widest = seen.iter().copied().fold(0.0, f64::max);
        match seen.len() < MIN_VIEWS_OF_WIDTH {
            true => 1.0,
            false => widest.clamp(WIDTH_FACTORS[0], WIDTH_FACTORS[1]),
        }
    });
    scaled
        .iter()
        .map(|view| turn_of(avatar, view.as_ref()?, factors))
        .collect()
}

/// Keypoints of one view, and its scale
struct Scaled {
    joints: PerJoint<Option<Keypoint>>,
    px_per_mm: f64,
}

impl Scaled {
    /// Returns how far the first of two joints is to the right of the second, and its standard deviation, in mm
    fn apart(&self, [a, b]: [Joint; 2]) -> Option<(f64, f64)> {
        let (a, b) = (self.joints[a]?, self.joints[b]?);
        let sigma = |point: Keypoint| keypoint_sigma_px(point.confidence, NOMINAL_STATURE_PX);
        let apart_mm = (a.position.x - b.position.x) / self.px_per_mm;
        Some((apart_mm, sigma(a).hypot(sigma(b))))
    }
}

/// Returns the offset of the first of two joints from the second, in the reference pose
fn offset(avatar: &Avatar, [a, b]: [Joint; 2]) -> DVec3 {
    avatar.keypoints[a] - avatar.keypoints[b]
}

/// Solves for the turn of one view by least squares
fn turn_of(avatar: &Avatar, view: &Scaled, factors: [f64; 2]) -> Option<TurnAngle> {
    let beside = BESIDE
        .iter()
        .zip(factors)
        .map(|(pair, factor)| (*pair, factor));
    let in_front = IN_FRONT.iter().map(|pair| (*pair, 1.0));
    let (mut matrix, mut right) = (Mat::<f64>::zeros(2, 2), Mat::<f64>::zeros(2, 1));
    for (pair, factor) in beside.chain(in_front) {
        let Some((apart_mm, sigma)) = view.apart(pair) else {
            continue;
        };
        let offset = offset(avatar, pair);
        // Of cosine and sine
        let row = [offset.x * factor, offset.z];
        for i in 0..2 {
            right[(i, 0)] += row[i] * apart_mm / (sigma * sigma);
            for j in 0..2 {
                matrix[(i, j)] += row[i] * row[j] / (sigma * sigma);
            }
        }
    }
    for i in 0..2 {
        matrix[(i, i)] += 1.0;
    }
    Llt::new(matrix.as_ref(), Side::Lower)
        .ok()?
        .solve_in_place(right.as_mut());
    let (cosine, sine) = (right[(0, 0)], right[(1, 0)]);
    (cosine.hypot(sine) > 1e-3).then(|| TurnAngle::from_radians(sine.atan2(cosine)))
}

/// Returns for each view whether the face certainly is seen or certainly is not; `None` where that is unknown
///
/// MediaPipe finds a face in every photo, and detectors without confidences do not distinguish these.
pub(super) fn faces_seen(views: &[KeypointView]) -> Vec<Option<bool>> {
    const FACE: [Joint; 3] = [Joint::Nose, Joint::LeftEye, Joint::RightEye];
    let count = |view: &KeypointView, least: f64| {
        let found = FACE.iter().filter_map(|&joint| view.keypoints.found(joint));
        found.filter(|point| point.confidence > least).count()
    };
    let any = views.iter().any(|view| count(view, FACE_CONFIDENCE) >= 2);
    let seen = |view: &KeypointView| {
        if !any || view.keypoint_kind == KeypointKind::MediaPipe {
            return None;
        }
        match (count(view, FACE_CONFIDENCE), count(view, 0.0)) {
            (2.., _) => Some(true),
            (_, 0) if view.keypoints.found(Joint::Neck).is_some() => Some(false),
            _ => None,
        }
    };
    views.iter().map(seen).collect()
}
