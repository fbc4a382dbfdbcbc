//! Detection of left and right swapped by the detector, by the gain in likelihood.

use pirouette_geom::parallel::prelude::*;

use super::model::{POSE_COUNT, Problem, Shared, Unknowns, ViewData};
use super::solve::{ROBUST_WIDTH, solve_view};
use pirouette_body::{Bone, Joint, Keypoints};

/// Joints whose left and right are swapped together
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum SwapGroup {
    /// All joints, as if the back were the front
    Body,
    /// Shoulders, elbows, wrists
    Arms,
    /// Elbows, wrists
    Forearms,
    /// Hips, knees, ankles, feet
    Legs,
    /// Knees, ankles, feet
    Shins,
    /// Ankles, feet
    Feet,
    /// Eyes, ears
    Face,
}

impl SwapGroup {
    const ALL: [SwapGroup; 7] = [
        SwapGroup::Body,
        SwapGroup::Arms,
        SwapGroup::Forearms,
        SwapGroup::Legs,
        SwapGroup::Shins,
        SwapGroup::Feet,
        SwapGroup::Face,
    ];

    /// Returns the name in files, in snake case
    pub fn name(self) -> &'static str {
        match self {
            SwapGroup::Body => "body",
            SwapGroup::Arms => "arms",
            SwapGroup::Forearms => "forearms",
            SwapGroup::Legs => "legs",
            SwapGroup::Shins => "shins",
            SwapGroup::Feet => "feet",
            SwapGroup::Face => "face",
        }
    }

    /// Returns the left joints; each is swapped with its mirrored joint
    fn left_joints(self) -> &'static [Joint] {
        const BODY: [Joint; 11] = [
            Joint::LeftShoulder,
            Joint::LeftElbow,
            Joint::LeftWrist,
            Joint::LeftHip,
            Joint::LeftKnee,
            Joint::LeftAnkle,
            Joint::LeftBigToe,
            Joint::LeftSmallToe,
            Joint::LeftHeel,
            Joint::LeftEye,
            Joint::LeftEar,
        ];
        match self {
            SwapGroup::Body => &BODY,
            SwapGroup::Arms => &BODY[..3],
            SwapGroup::Forearms => &BODY[1..3],
            SwapGroup::Legs => &BODY[3..9],
            SwapGroup::Shins => &BODY[4..9],
            SwapGroup::Feet => &BODY[5..9],
            SwapGroup::Face => &BODY[9..],
        }
    }

    /// Swaps left and right of this group
    pub fn swap(self, keypoints: &mut Keypoints) {
        for &left in self.left_joints() {
            let right = left.mirrored();
            let (l, r) = (keypoints.get(left), keypoints.get(right));
            keypoints.set(left, r);
            keypoints.set(right, l);
        }
    }

    pub(super) fn swap_observed(self, view: &mut ViewData) {
        for &left in self.left_joints() {
            view.observed.swap(left, left.mirrored());
        }
    }
}

/// Residual of a joint, in standard deviations, above which a view is searched for swaps
const SUSPICIOUS_RESIDUAL: f64 = 5.0;

/// Rotation of a bone, in prior standard deviations, above which a view is searched for swaps
///
/// An arm can also bend to the position of a swapped one, and leave no residual.
const SUSPICIOUS_ROTATION: f64 = 2.5;

/// Log-likelihood gain required for a swap
///
/// A swap moves at least four coordinates; this is far beyond the gain from noise, and far below the hundreds gained
/// by fixing an arm in a front view.
pub(super) const CLEAR_GAIN: f64 = 12.0;

/// Rounds of the pose for each swap that is tried
const TRIAL_ROUNDS: usize = 8;

/// Maximum number of swaps per view
const MAX_SWAPS_PER_VIEW: usize = 3;

/// Fixes swaps in the problem's views; returns them, and leaves the views' poses near their new solution
pub(super) fn fix_swaps(
    problem: &mut Problem,
    shared: &Shared,
    unknowns: &mut Unknowns,
) -> Vec<(usize, SwapGroup)> {
    let given: &Problem = problem;
    let solved: Vec<_> = given
        .views
        .par_iter()
        .zip(&unknowns.poses)
        .map(|(view, pose)| fix_view(given, view, shared, pose))
        .collect();
    let mut swaps = Vec::new();
    for (index, (limbs, pose)) in solved.into_iter().enumerate() {
        unknowns.poses[index] = pose;
        for limb in limbs {
            limb.swap_observed(&mut problem.views[index]);
            swaps.push((index, limb));
        }
    }
    swaps
}

/// Returns the swaps of one view, and its pose after fixing them
fn fix_view(
    problem: &Problem,
    view: &ViewData,
    shared: &Shared,
    pose: &[f64; POSE_COUNT],
) -> (Vec<SwapGroup>, [f64; POSE_COUNT]) {
    let (mut view, mut pose) = (view.clone(), *pose);
    let mut limbs = Vec::new();
    while limbs.len() < MAX_SWAPS_PER_VIEW {
        let Some((limb, fixed_pose)) = best_swap(problem, &view, shared, &pose) else {
            break;
        };
        limb.swap_observed(&mut view);
        pose = fixed_pose;
        limbs.push(limb);
    }
    (limbs, pose)
}

/// Returns the limbs with large residuals or rotations
fn suspicious_limbs(
    problem: &Problem,
    view: &ViewData,
    shared: &Shared,
    pose: &[f64; POSE_COUNT],
) -> Vec<SwapGroup> {
    let Some(residuals) = problem.residuals(view, shared, pose) else {
        return Vec::new();
    };
    let wrong = |joint: Joint| {
        let bone = joint.bone() as usize;
        let residual = residuals[joint].map_or(0.0, |r| r.length());
        let bend = pose[3 * bone..3 * bone + 3]
            .iter()
            .fold(0.0, |most: f64, x| most.max(x.abs()));
        residual > SUSPICIOUS_RESIDUAL || bend > SUSPICIOUS_ROTATION
    };
    SwapGroup::ALL
        .into_iter()
        .filter(|limb| {
            limb.left_joints()
                .iter()
                .any(|&joint| wrong(joint) || wrong(joint.mirrored()))
        })
        .collect()
}

/// Returns the swap that explains the view best, with its pose, if the gain is sufficient
fn best_swap(
    problem: &Problem,
    view: &ViewData,
    shared: &Shared,
    pose: &[f64; POSE_COUNT],
) -> Option<(SwapGroup, [f64; POSE_COUNT])> {
    let limbs = suspicious_limbs(problem, view, shared, pose);
    if limbs.is_empty() {
        return None;
    }
    let straight = straightened(pose);
    let solve = |view: &ViewData| solve_view(problem, view, shared, &straight, TRIAL_ROUNDS);
    let here = problem.view_cost(view, shared, pose, ROBUST_WIDTH);
    let as_detected = solve(view).1.min(here);
    let tried = limbs.into_iter().map(|limb| {
        let mut swapped = view.clone();
        limb.swap_observed(&mut swapped);
        let (pose, cost) = solve(&swapped);
        (limb, pose, cost)
    });
    let (limb, pose, cost) = tried.min_by(|a, b| a.2.total_cmp(&b.2))?;
    (cost < as_detected - CLEAR_GAIN).then_some((limb, pose))
}

/// Returns the same root pose with all joints at rest
fn straightened(pose: &[f64; POSE_COUNT]) -> [f64; POSE_COUNT] {
    let mut straight = *pose;
    straight[3..3 * Bone::COUNT].fill(0.0);
    straight
}
