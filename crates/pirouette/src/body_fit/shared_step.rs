//! Poses of all views together with shared unknowns: the camera, and the coarse size of the surface.
//!
//! A camera slightly nearer, lower or tilted gives nearly the same images as a wider or lifted body at other positions.
//! The soles on the floor and the crown at the stature separate them. Solved alternately with the surface, both would
//! drift; therefore width and lift of the surface are unknowns together with the camera, and the poses are eliminated
//! view by view (Schur complement).

use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};
use glam::DVec3;
use pirouette_geom::parallel::prelude::*;

use super::matches::{Match, Outline};
use super::pose_step::{ALL, Equations, POSE, STEPS, TURN, equations};
use super::sway::{TrackedTurns, pose_priors};
use super::{Body, BodyFitView, CameraSpread};
use pirouette_body::{Bone, Camera, Pose, SkinWeight};

/// Number of unknowns shared by all views
pub(super) const SHARED: usize = 5;

/// Prior standard deviation of the relative change in width
const WIDTH_SIGMA: f64 = 0.05;

/// Prior standard deviation of the lift of the body's middle, in mm
const LIFT_SIGMA_MM: f64 = 20.0;

/// Changes of the shared unknowns
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct SharedStep {
    /// Relative change of width and depth of the body
    pub(super) width: f64,
    /// Lift of its middle, in mm; soles and crown are not moved
    pub(super) lift_mm: f64,
    pub(super) distance_mm: f64,
    pub(super) height_mm: f64,
    pub(super) pitch_radians: f64,
}

impl SharedStep {
    fn from_array([width, lift_mm, distance_mm, height_mm, pitch_radians]: [f64; SHARED]) -> Self {
        Self {
            width,
            lift_mm,
            distance_mm,
            height_mm,
            pitch_radians,
        }
    }

    /// Returns the camera after this step
    pub(super) fn moved(&self, camera: &Camera) -> Camera {
        Camera {
            distance_mm: camera.distance_mm + self.distance_mm,
            height_mm: camera.height_mm + self.height_mm,
            pitch_radians: camera.pitch_radians + self.pitch_radians,
            ..*camera
        }
    }

    /// Returns a point of the reference pose after this step
    pub(super) fn reshaped(&self, point: DVec3, rates: [DVec3; 2]) -> DVec3 {
        point + rates[0] * self.width + rates[1] * self.lift_mm
    }
}

/// Response of the points of an avatar in the reference pose to width and lift
#[derive(Debug, Clone, Copy)]
pub(super) struct Reshape {
    pub(super) stature_mm: f64,
    /// Heads of the left and the right upper arm
    pub(super) shoulders: [DVec3; 2],
}

/// Returns the total skinning weights of the left and of the right arm
pub(super) fn arm_shares(weight: &SkinWeight) -> [f64; 2] {
    [Bone::LeftUpperArm, Bone::RightUpperArm].map(|arm| weight.below(arm))
}

impl Reshape {
    /// Returns the derivatives of a point of the reference pose by width and lift
    ///
    /// A wider or lifted trunk moves the arms rigidly: stretched arms would differ from the angle of the reference
    /// pose. The lift is that of a string fixed at floor and crown.
    pub(super) fn rates(&self, point: DVec3, arms: [f64; 2]) -> [DVec3; 2] {
        let flat = DVec3::new(1.0, 0.0, 1.0);
        let mut wider = point * flat * (1.0 - arms[0] - arms[1]);
        for (shoulder, share) in self.shoulders.into_iter().zip(arms) {
            wider += shoulder * flat * share;
        }
        let lift = |height: f64| {
            let up = (height / self.stature_mm).clamp(0.0, 1.0);
            4.0 * up * (1.0 - up)
        };
        let mut lifted = lift(point.y) * (1.0 - arms[0] - arms[1]);
        for (shoulder, share) in self.shoulders.into_iter().zip(arms) {
            lifted += lift(shoulder.y) * share;
        }
        [wider, DVec3::Y * lifted]
    }
}

/// Returns the derivatives of a room point, as seen by the camera, by distance, height and pitch of the camera
pub(super) fn camera_rates(point: DVec3, camera: &Camera) -> [DVec3; 3] {
    [
        DVec3::NEG_Z,
        DVec3::NEG_Y,
        camera.right().cross(point - camera.center()),
    ]
}

/// The poses of all views and the shared unknowns after a step
#[derive(Debug)]
pub(super) struct PoseUpdate {
    pub(super) poses: Vec<Pose>,
    /// Standard deviation of the turn of each pose
    pub(super) turn_sds: Vec<f64>,
    pub(super) shared: SharedStep,
}

/// Improves all poses, the camera and the size of the surface to match outlines and keypoints
///
/// `views` hold the current camera, `start` is the camera at which `spread` is centered. Parameters without spread are
/// constant; without any spread, the surface is constant, too. `matches` are the same in all steps.
pub(super) fn step_together(
    body: &Body,
    views: &[BodyFitView],
    (outlines, matches): (&[Outline], &[Vec<Match>]),
    (posture, poses): (&Pose, &[Pose]),
    (start, spread): (Option<&Camera>, &CameraSpread),
    tracked_turns: TrackedTurns,
) -> PoseUpdate {
    let mut poses = poses.to_vec();
    let mut total = [0.0; SHARED];
    let sigmas = sigmas(spread);
    let mut turn_sds = vec![Pose::prior_sigmas()[TURN]; views.len()];
    for _ in 0..STEPS {
        let shared = SharedStep::from_array(total);
        let priors = pose_priors(views, posture, &poses, tracked_turns);
        let equations: Vec<Option<Equations>> = (0..views.len())
            .into_par_iter()
            .map(|i| {
                let view = BodyFitView {
                    camera: shared.moved(&views[i].camera),
                    ..views[i]
                };
                let seen = (&outlines[i], &matches[i][..]);
                equations(body, &view, seen, &priors[i], &poses[i], &shared)
            })
            .collect();
        let eliminated: Vec<Option<Eliminated>> = equations
            .par_iter()
            .map(|e| Eliminated::new(e.as_ref()?))
            .collect();
        let step = match start {
            Some(camera) => {
                let now = views
                    .first()
                    .map_or(*camera, |view| shared.moved(&view.camera));
                let off = [
                    total[0],
                    total[1],
                    now.distance_mm - camera.distance_mm,
                    now.height_mm - camera.height_mm,
                    now.pitch_radians - camera.pitch_radians,
                ];
                solve_shared(&eliminated, &sigmas, &off)
            }
            None => [0.0; SHARED],
        };
        for (((sd, solved), prior), view) in
            turn_sds.iter_mut().zip(&eliminated).zip(&priors).zip(views)
        {
            *sd = match solved {
                Some(solved) if view.tracked.is_some() => prior.tracked_turn_sd(solved.turn_sd),
                Some(solved) => solved.turn_sd,
                None => *sd,
            };
        }
        for (total, step) in total.iter_mut().zip(step) {
            *total += step;
        }
        for (pose, view) in poses.iter_mut().zip(&eliminated) {
            if let Some(moved) = view.as_ref().and_then(|view| view.pose_after(pose, &step)) {
                *pose = moved;
            }
        }
    }
    PoseUpdate {
        poses,
        turn_sds,
        shared: SharedStep::from_array(total),
    }
}

fn sigmas(spread: &CameraSpread) -> [f64; SHARED] {
    let free = *spread != CameraSpread::default();
    [
        if free { WIDTH_SIGMA } else { 0.0 },
        if free { LIFT_SIGMA_MM } else { 0.0 },
        spread.distance_mm,
        spread.height_mm,
        spread.pitch_radians,
    ]
}

/// One view with its pose eliminated, as a function of the shared unknowns
struct Eliminated {
    /// Pose step for zero shared unknowns, then the reduction by each of them, then the covariances of the turn
    answers: Mat<f64>,
    matrix: [[f64; SHARED]; SHARED],
    right: [f64; SHARED],
    /// Standard deviation of the turn of the pose
    turn_sd: f64,
}

impl Eliminated {
    fn new(equations: &Equations) -> Option<Self> {
        let (matrix, right) = (&equations.matrix, &equations.right);
        let own = Mat::<f64>::from_fn(POSE, POSE, |i, j| matrix[i.max(j)][i.min(j)]);
        let factor = Llt::new(own.as_ref(), Side::Lower).ok()?;
        let mut answers = Mat::<f64>::from_fn(POSE, 2 + SHARED, |i, j| match j {
            0 => right[i],
            1..=SHARED => matrix[POSE + j - 1][i],
            _ => f64::from(u8::from(i == TURN)),
        });
        factor.solve_in_place(answers.as_mut());
        let across = |s: usize, column: usize| -> f64 {
            (0..POSE)
                .map(|i| matrix[POSE + s][i] * answers[(i, column)])
                .sum()
        };
        Some(Self {
            matrix: std::array::from_fn(|s| {
                std::array::from_fn(|t| matrix[POSE + s.max(t)][POSE + s.min(t)] - across(s, 1 + t))
            }),
            right: std::array::from_fn(|s| right[POSE + s] - across(s, 0)),
            turn_sd: answers[(TURN, 1 + SHARED)].sqrt(),
            answers,
        })
    }

    fn pose_after(&self, pose: &Pose, shared: &[f64; SHARED]) -> Option<Pose> {
        let before = pose.to_parameters();
        let after: [f64; POSE] = std::array::from_fn(|i| {
            let taken: f64 = (0..SHARED)
                .map(|s| self.answers[(i, 1 + s)] * shared[s])
                .sum();
            before[i] + self.answers[(i, 0)] - taken
        });
        after
            .iter()
            .all(|x| x.is_finite())
            .then(|| Pose::from_parameters(&after))
    }
}

/// Solves for the shared step; zero where the prior has no spread, or when the equations cannot be solved
fn solve_shared(
    views: &[Option<Eliminated>],
    sigmas: &[f64; SHARED],
    off: &[f64; SHARED],
) -> [f64; SHARED] {
    let free: Vec<usize> = (0..SHARED).filter(|&s| sigmas[s] > 0.0).collect();
    let mut step = [0.0; SHARED];
    if free.is_empty() {
        return step;
    }
    // In units of the prior standard deviations, for similar magnitudes.
    let matrix = Mat::<f64>::from_fn(free.len(), free.len(), |i, j| {
        let (s, t) = (free[i], free[j]);
        let seen: f64 = views.iter().flatten().map(|view| view.matrix[s][t]).sum();
        seen * sigmas[s] * sigmas[t] + if i == j { 1.0 } else { 0.0 }
    });
    let mut right = Mat::<f64>::from_fn(free.len(), 1, |i, _| {
        let s = free[i];
        let seen: f64 = views.iter().flatten().map(|view| view.right[s]).sum();
        seen * sigmas[s] - off[s] / sigmas[s]
    });
    let Ok(factor) = Llt::new(matrix.as_ref(), Side::Lower) else {
        return step;
    };
    factor.solve_in_place(right.as_mut());
    if (0..free.len()).all(|i| right[(i, 0)].is_finite()) {
        for (i, &s) in free.iter().enumerate() {
            step[s] = right[(i, 0)] * sigmas[s];
        }
    }
    step
}

const _: () = assert!(ALL == POSE + SHARED);
