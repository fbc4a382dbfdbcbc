//! Equations of one view's pose for a given surface: Gauss-Newton on outline and keypoints.

use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};
use glam::DVec3;

use super::matches::{Match, Outline};
use super::shared_step::{SHARED, SharedStep, arm_shares, camera_rates};
use super::sway::PosePrior;
use super::{Body, BodyFitView};
use pirouette_body::{
    Bone, Camera, Joint, Motion, PerBone, Pose, PosedBones, SkinWeight, pose_bones,
};

/// Unknowns of one pose
pub(super) const POSE: usize = Pose::PARAMETER_COUNT;

/// Index of the turn of the root among them
pub(super) const TURN: usize = Pose::first_parameter(Bone::Root) + 1;

/// Unknowns of one pose and those shared by all views
pub(super) const ALL: usize = POSE + SHARED;

/// Standard deviation of an outline point, in nominal px
const OUTLINE_SIGMA: f64 = 2.0;

/// Residuals beyond this many nominal px lose weight, asymptotically by the reciprocal of the fourth power
const ROBUST: f64 = 6.0;

/// Fraction of its weight that an outline point keeps: errors of neighbors are correlated
const OUTLINE_SHARE: f64 = 0.25;

/// Keypoints with a residual above this many standard deviations lose weight
const KEYPOINT_WIDTH: f64 = 3.0;

/// Steps per round
pub(super) const STEPS: usize = 2;

/// Returns the bones in the pose of one view, for the body reshaped by `shared`
fn posed_bones(body: &Body, view: &BodyFitView, pose: &Pose, shared: &SharedStep) -> PosedBones {
    let frame = body.reshape_frame(view.stature_mm);
    let heads = PerBone::from_fn(|bone| {
        let head = body.bone_heads[bone];
        let arms = arm_shares(&SkinWeight::rigid(bone));
        shared.reshaped(head, frame.rates(head, arms))
    });
    pose_bones(&heads, pose, view.turn)
}

/// Normal equations of one pose and the shared unknowns, lower triangle
pub(super) struct Equations {
    pub(super) matrix: [[f64; ALL]; ALL],
    pub(super) right: [f64; ALL],
}

impl Equations {
    fn zero() -> Self {
        Self {
            matrix: [[0.0; ALL]; ALL],
            right: [0.0; ALL],
        }
    }

    /// Adds a residual with gradient `row` over the parameters `active`, ascending
    fn add(&mut self, active: &[usize], row: &[f64; ALL], residual: f64, weight: f64) {
        for (i, &a) in active.iter().enumerate() {
            let scaled = weight * row[a];
            self.right[a] -= scaled * residual;
            for &b in &active[..=i] {
                self.matrix[a][b] += scaled * row[b];
            }
        }
    }
}

/// Returns the total weights by which bones move a point: those of its skinning weights and all ancestors
fn shares(weights: impl Iterator<Item = (Bone, f64)>) -> PerBone<f64> {
    let mut shares = PerBone::splat(0.0);
    for (bone, weight) in weights {
        let mut above = Some(bone);
        while let Some(b) = above {
            shares[b] += weight;
            above = b.parent();
        }
    }
    shares
}

/// Returns the equations of one view at the current pose and shared unknowns, including the prior of the pose
///
/// `matches` are those of the outline. `None` when the equations cannot be solved.
pub(super) fn equations(
    body: &Body,
    view: &BodyFitView,
    (outline, matches): (&Outline, &[Match]),
    prior: &PosePrior,
    pose: &Pose,
    shared: &SharedStep,
) -> Option<Equations> {
    let camera = view.camera.projector();
    let frame = body.reshape_frame(view.stature_mm);
    let posed = posed_bones(body, view, pose, shared);
    let motions: [Motion; POSE] = std::array::from_fn(|parameter| posed.motion(parameter));
    let mut equations = Equations::zero();
    let mut row = [0.0; ALL];
    let mut active = Vec::with_capacity(ALL);
    for m in matches {
        let v = m.vertex as usize;
        let weight: &SkinWeight = &body.weights[v];
        let blend = posed.blend(weight);
        let rates = frame.rates(body.positions[v], body.arms[v]);
        let point = blend.transform_point3(shared.reshaped(body.positions[v], rates));
        let (residual, gradient) = m.residual(&camera, point, outline);
        let shares = shares(weight.iter());
        fill_row(&motions, &shares, gradient, point, &mut row, &mut active);
        let rates = rates.map(|rate| blend.matrix3 * rate);
        fill_shared(view, gradient, point, rates, &mut row, &mut active);
        let robust = 1.0 / (1.0 + (residual / ROBUST).powi(2));
        let weight = OUTLINE_SHARE * m.weight * robust * robust / OUTLINE_SIGMA.powi(2);
        equations.add(&active, &row, residual, weight);
    }
    add_keypoints(body, view, &posed, &motions, shared, &mut equations);
    for (i, at) in pose.to_parameters().into_iter().enumerate() {
        equations.matrix[i][i] += prior.weights[i];
        equations.right[i] -= prior.weights[i] * (at - prior.center[i]);
    }
    equations
        .right
        .iter()
        .all(|x| x.is_finite())
        .then_some(equations)
}

/// A point of the posed surface and its signed distance from a known surface
pub(super) struct SurfaceMatch<'a> {
    pub(super) weight: &'a SkinWeight,
    /// In the room, in mm
    pub(super) point: DVec3,
    /// Unit normal of the known surface
    pub(super) normal: DVec3,
    pub(super) off_mm: f64,
}

/// Standard deviation of the distance of a vertex from a known surface, in mm, with the correlation of its neighbors
const SURFACE_SIGMA_MM: f64 = 20.0;

/// Factor on the prior standard deviations of a pose before a known surface
const SURFACE_FREEDOM: f64 = 3.0;

/// Returns the pose that brings points of the surface nearer to a known surface; `None` when the equations cannot be solved
///
/// Residuals beyond `robust_mm` lose weight. The prior is centered at `start`.
pub(super) fn step_to_surface(
    posed: &PosedBones,
    pose: &Pose,
    start: &Pose,
    matches: &[SurfaceMatch],
    robust_mm: f64,
) -> Option<Pose> {
    let motions: [Motion; POSE] = std::array::from_fn(|parameter| posed.motion(parameter));
    let mut equations = Equations::zero();
    let mut row = [0.0; ALL];
    let mut active = Vec::with_capacity(ALL);
    for m in matches {
        let shares = shares(m.weight.iter());
        fill_row(&motions, &shares, m.normal, m.point, &mut row, &mut active);
        let robust = 1.0 / (1.0 + (m.off_mm / robust_mm).powi(2));
        let weight = (robust / SURFACE_SIGMA_MM).powi(2);
        equations.add(&active, &row, m.off_mm, weight);
    }
    let now = pose.to_parameters();
    let deviations = now.into_iter().zip(start.to_parameters());
    for (i, ((at, center), sigma)) in deviations.zip(Pose::prior_sigmas()).enumerate() {
        let weight = (SURFACE_FREEDOM * sigma).powi(-2);
        equations.matrix[i][i] += weight;
        equations.right[i] -= weight * (at - center);
    }
    let matrix = &equations.matrix;
    let own = Mat::<f64>::from_fn(POSE, POSE, |i, j| matrix[i.max(j)][i.min(j)]);
    let mut step = Mat::<f64>::from_fn(POSE, 1, |i, _| equations.right[i]);
    Llt::new(own.as_ref(), Side::Lower)
        .ok()?
        .solve_in_place(step.as_mut());
    let after: [f64; POSE] = std::array::from_fn(|i| now[i] + step[(i, 0)]);
    let finite = after.iter().all(|x| x.is_finite());
    finite.then(|| Pose::from_parameters(&after))
}

/// Writes the derivatives of `gradient . point` by the parameters of the pose that move the point
fn fill_row(
    motions: &[Motion; POSE],
    shares: &PerBone<f64>,
    gradient: DVec3,
    point: DVec3,
    row: &mut [f64; ALL],
    active: &mut Vec<usize>,
) {
    active.clear();
    for (bone, &share) in shares.pairs() {
        if share > 0.0 {
            let first = Pose::first_parameter(bone);
            for p in first..first + 3 {
                row[p] = share * gradient.dot(motions[p].velocity(point));
                active.push(p);
            }
        }
    }
    for p in 3 * Bone::COUNT..POSE {
        row[p] = gradient.dot(motions[p].velocity(point));
        active.push(p);
    }
}

/// Writes the derivatives by the shared unknowns; `reshaped` are those of the point in the room by width and lift
fn fill_shared(
    view: &BodyFitView,
    gradient: DVec3,
    point: DVec3,
    reshaped: [DVec3; 2],
    row: &mut [f64; ALL],
    active: &mut Vec<usize>,
) {
    let rates = reshaped
        .into_iter()
        .chain(camera_rates(point, &view.camera));
    for (s, rate) in rates.enumerate() {
        row[POSE + s] = gradient.dot(rate);
        active.push(POSE + s);
    }
}

fn add_keypoints(
    body: &Body,
    view: &BodyFitView,
    posed: &PosedBones,
    motions: &[Motion; POSE],
    shared: &SharedStep,
    equations: &mut Equations,
) {
    let camera: &Camera = &view.camera;
    let frame = body.reshape_frame(view.stature_mm);
    let mut row = [0.0; ALL];
    let mut active = Vec::with_capacity(ALL);
    for joint in Joint::ALL {
        let Some((seen, sigma_px)) = view.keypoint(joint) else {
            continue;
        };
        let (mut point, mut rates) = (DVec3::ZERO, [DVec3::ZERO; 2]);
        for (part, share) in joint.parts() {
            let arms = arm_shares(&SkinWeight::rigid(part.bone()));
            let reference = body.keypoints[part];
            let reshaped = frame.rates(reference, arms);
            let reference = shared.reshaped(reference, reshaped);
            point += posed.carry(part.bone(), reference) * share;
            let rotation = posed.transforms[part.bone()].matrix3;
            for (sum, rate) in rates.iter_mut().zip(reshaped) {
                *sum += rotation * rate * share;
            }
        }
        let shares = shares(joint.parts().map(|(part, share)| (part.bone(), share)));
        let residual = camera.project(point) - seen;
        let scaled = residual / sigma_px;
        let robust = 1.0 / (1.0 + scaled.abs().max_element().powi(2) / KEYPOINT_WIDTH.powi(2));
        let weight = robust / (sigma_px * sigma_px);
        let gradients = camera.project_gradients(point);
        for (gradient, residual) in gradients.into_iter().zip(residual.to_array()) {
            fill_row(motions, &shares, gradient, point, &mut row, &mut active);
            fill_shared(view, gradient, point, rates, &mut row, &mut active);
            equations.add(&active, &row, residual, weight);
        }
    }
}
