//! The pose of one view, given the surface: Gauss-Newton on outline and keypoints.

use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};
use glam::DVec3;

use super::matches::{Match, Outline, find_matches};
use super::{Body, FitView};
use crate::camera::Camera;
use crate::pose::{Motion, Pose, PosedBones, SkinWeight, pose_bones};
use crate::skeleton::{Bone, Joint};

const COUNT: usize = Pose::PARAMETER_COUNT;

/// Standard deviation of an outline point, in nominal px
const OUTLINE_SIGMA: f64 = 2.0;

/// Residuals beyond this many nominal px lose weight: the reciprocal of the fourth power in the end
const ROBUST: f64 = 6.0;

/// Share of its weight that an outline point keeps: neighbors err together
const OUTLINE_SHARE: f64 = 0.25;

/// Keypoints farther off than this many standard deviations lose weight
const KEYPOINT_WIDTH: f64 = 3.0;

/// Steps per round
const STEPS: usize = 2;

/// The body in one pose, and what explains the outline
struct Seen {
    posed: PosedBones,
    positions: Vec<DVec3>,
    matches: Vec<Match>,
}

/// Normal equations of one pose
struct Normal {
    matrix: [[f64; COUNT]; COUNT],
    right: [f64; COUNT],
}

impl Normal {
    /// Adds a residual with gradient `row` over the parameters `active`, ascending
    fn add(&mut self, active: &[usize], row: &[f64; COUNT], residual: f64, weight: f64) {
        for (i, &a) in active.iter().enumerate() {
            let scaled = weight * row[a];
            self.right[a] -= scaled * residual;
            for &b in &active[..=i] {
                self.matrix[a][b] += scaled * row[b];
            }
        }
    }
}

/// Bones that move a point, each with the share by which it does: those of its weights and all above
fn shares(weights: impl Iterator<Item = (Bone, f64)>) -> [f64; Bone::COUNT] {
    let mut shares = [0.0; Bone::COUNT];
    for (bone, weight) in weights {
        let mut above = Some(bone);
        while let Some(b) = above {
            shares[b as usize] += weight;
            above = b.parent();
        }
    }
    shares
}

/// Moves the pose of one view closer to its outline and keypoints
///
/// `prior` is the pose that sway goes about. The pose stays as it is when rounding breaks the equations.
pub(super) fn pose_step(
    body: &Body,
    view: &FitView,
    outline: &Outline,
    prior: &Pose,
    pose: &Pose,
    radius: f64,
) -> Pose {
    let mut pose = *pose;
    for _ in 0..STEPS {
        let posed = pose_bones(&body.bone_heads, &pose, view.turn);
        let positions = posed.skin(&body.positions, body.weights);
        let seen = Seen {
            matches: find_matches(&body.surface.rim, &positions, &view.camera, outline, radius),
            posed,
            positions,
        };
        let Some(step) = solve(body, view, outline, prior, &pose, &seen) else {
            break;
        };
        let before = pose.to_parameters();
        pose = Pose::from_parameters(&std::array::from_fn(|i| before[i] + step[i]));
    }
    pose
}

fn solve(
    body: &Body,
    view: &FitView,
    outline: &Outline,
    prior: &Pose,
    pose: &Pose,
    seen: &Seen,
) -> Option<[f64; COUNT]> {
    let camera = view.camera.projector();
    let motions: [Motion; COUNT] = std::array::from_fn(|parameter| seen.posed.motion(parameter));
    let mut normal = Normal {
        matrix: [[0.0; COUNT]; COUNT],
        right: [0.0; COUNT],
    };
    let mut row = [0.0; COUNT];
    let mut active = Vec::with_capacity(COUNT);
    for m in &seen.matches {
        let point = seen.positions[m.vertex as usize];
        let (residual, gradient) = m.residual(&camera, point, outline);
        let weight: &SkinWeight = &body.weights[m.vertex as usize];
        let shares = shares(weight.iter());
        fill_row(&motions, &shares, gradient, point, &mut row, &mut active);
        let robust = 1.0 / (1.0 + (residual / ROBUST).powi(2));
        let weight = OUTLINE_SHARE * m.weight * robust * robust / OUTLINE_SIGMA.powi(2);
        normal.add(&active, &row, residual, weight);
    }
    add_keypoints(body, view, &seen.posed, &motions, &mut normal);
    let (sigmas, at) = (Pose::prior_sigmas(), pose.to_parameters());
    let center = prior.to_parameters();
    for i in 0..COUNT {
        let weight = sigmas[i].powi(-2);
        normal.matrix[i][i] += weight;
        normal.right[i] -= weight * (at[i] - center[i]);
    }
    let matrix = Mat::<f64>::from_fn(COUNT, COUNT, |i, j| normal.matrix[i.max(j)][i.min(j)]);
    let mut right = Mat::<f64>::from_fn(COUNT, 1, |i, _| normal.right[i]);
    let factor = Llt::new(matrix.as_ref(), Side::Lower).ok()?;
    factor.solve_in_place(right.as_mut());
    let step: [f64; COUNT] = std::array::from_fn(|i| right[(i, 0)]);
    step.iter().all(|x| x.is_finite()).then_some(step)
}

/// Derivatives of `gradient . point` by the parameters that move the point
fn fill_row(
    motions: &[Motion; COUNT],
    shares: &[f64; Bone::COUNT],
    gradient: DVec3,
    point: DVec3,
    row: &mut [f64; COUNT],
    active: &mut Vec<usize>,
) {
    active.clear();
    for (b, &share) in shares.iter().enumerate() {
        if share > 0.0 {
            for p in 3 * b..3 * b + 3 {
                row[p] = share * gradient.dot(motions[p].velocity(point));
                active.push(p);
            }
        }
    }
    for p in 3 * Bone::COUNT..COUNT {
        row[p] = gradient.dot(motions[p].velocity(point));
        active.push(p);
    }
}

fn add_keypoints(
    body: &Body,
    view: &FitView,
    posed: &PosedBones,
    motions: &[Motion; COUNT],
    normal: &mut Normal,
) {
    let camera: &Camera = &view.camera;
    let mut row = [0.0; COUNT];
    let mut active = Vec::with_capacity(COUNT);
    for joint in Joint::ALL {
        let Some((seen, sigma_px)) = view.keypoint(joint) else {
            continue;
        };
        let (point, shares) = body.room_joint(posed, joint);
        let residual = camera.project(point) - seen;
        let scaled = residual / sigma_px;
        let robust = 1.0 / (1.0 + scaled.abs().max_element().powi(2) / KEYPOINT_WIDTH.powi(2));
        let weight = robust / (sigma_px * sigma_px);
        let gradients = camera.project_gradients(point);
        for (gradient, residual) in gradients.into_iter().zip(residual.to_array()) {
            fill_row(motions, &shares, gradient, point, &mut row, &mut active);
            normal.add(&active, &row, residual, weight);
        }
    }
}

impl Body<'_> {
    /// A keypoint of the posed body in the room, and by which share each bone moves it
    fn room_joint(&self, posed: &PosedBones, joint: Joint) -> (DVec3, [f64; Bone::COUNT]) {
        let carry = |j: Joint| posed.carry(j.bone(), self.keypoints[j as usize]);
        let middle = |left: Joint, right: Joint| {
            let point = (carry(left) + carry(right)) / 2.0;
            (
                point,
                shares([(left.bone(), 0.5), (right.bone(), 0.5)].into_iter()),
            )
        };
        match joint {
            Joint::Neck => middle(Joint::LeftShoulder, Joint::RightShoulder),
            Joint::MidHip => middle(Joint::LeftHip, Joint::RightHip),
            _ => (carry(joint), shares(std::iter::once((joint.bone(), 1.0)))),
        }
    }
}
