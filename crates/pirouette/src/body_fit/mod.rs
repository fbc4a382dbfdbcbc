//! The body fit: one surface and one pose per view that explain all silhouettes together.
//!
//! The surface is the avatar in the reference pose, displaced smoothly; a view shows it in that view's pose. Poses and
//! surface are fitted in turn to the outlines: where the surface ends in a photo, the person must end. What no outline
//! tells is filled by the avatar's own shape. No statistics of bodies are used.
//!
//! What all views have in common in the poses of trunk, head and legs is the person's posture, not sway, and goes
//! into the surface; arms are brought to the reference pose. Hollows that no outline shows stay as the avatar has them.

mod matches;
mod occluding_contour;
mod outline;
mod pose_step;
mod shape_step;
mod shared_step;
mod surface;
mod targets;

use glam::{DVec2, DVec3};
use pirouette_geom::Windowed;
use pirouette_geom::coarsen::Blend;
use rayon::prelude::*;

use crate::skeleton_fit::keypoint_sigma_px;
use matches::{Outline, match_views};
use pirouette_body::Avatar;
use pirouette_body::Camera;
use pirouette_body::TurnAngle;
use pirouette_body::render::SilhouetteMesh;
use pirouette_body::{Bone, Joint, Keypoints, PerBone, PerJoint};
use pirouette_body::{NOMINAL_STATURE_PX, Pose, SkinWeight, pose_bones};
use shape_step::ShapeSolver;
use shared_step::{Reshape, SharedStep, arm_shares, step_together};
use surface::Surface;

pub use occluding_contour::ContourMesh;
pub use targets::OutlineTargets;

/// One view to fit
#[derive(Debug, Clone, Copy)]
pub struct BodyFitView<'a> {
    /// Soft silhouette of the person, 1 inside
    pub silhouette: &'a Windowed<f32>,
    /// Detected joints
    pub keypoints: &'a Keypoints,
    /// The camera that saw it
    pub camera: Camera,
    /// How far the person had turned
    pub turn: TurnAngle,
    /// Where the pose starts
    pub pose: Pose,
    /// Height of the person, in mm: tells how large pixels are
    pub stature_mm: f64,
}

impl BodyFitView<'_> {
    /// How tall the person is in the photo, in px
    fn stature_px(&self) -> f64 {
        self.camera.focal_px() * self.stature_mm / self.camera.distance_mm
    }

    /// A detected joint with its standard deviation, in px
    fn keypoint(&self, joint: Joint) -> Option<(DVec2, f64)> {
        let found = self.keypoints.found(joint)?;
        let sigma_px = keypoint_sigma_px(found.confidence, self.stature_px());
        Some((found.position, sigma_px))
    }
}

/// What is known beforehand of all views together
#[derive(Debug, Clone, Copy, Default)]
pub struct BodyFitPrior {
    /// The pose that sway goes about
    pub posture: Pose,
    /// Height of the person, in mm, if it is known
    pub stature_mm: Option<f64>,
    /// How far the camera of the views may be off
    pub camera: CameraSpread,
}

/// Standard deviations of what a camera is taken for; 0 holds it
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CameraSpread {
    /// Of the distance from the turning axis, in mm
    pub distance_mm: f64,
    /// Of the height above the floor, in mm
    pub height_mm: f64,
    /// Of the pitch
    pub pitch_radians: f64,
}

/// How the fit is done
#[derive(Debug, Clone, PartialEq)]
pub struct BodyFitOptions {
    /// Whether left and right of the body are taken to be alike where outlines do not say otherwise
    pub symmetry: bool,
    /// Whether the mean pose of all views goes into the surface
    pub transfer_mean_pose: bool,
    /// Whether soles are held on the floor, and the crown at the stature
    pub anchors: bool,
    /// Whether the camera is corrected, as far as its prior allows
    pub camera: bool,
    /// Whether the posed body's silhouettes are held against those of the photos in the end
    pub overlaps: bool,
    /// The rounds, in order
    pub rounds: Vec<Round>,
}

/// One round: poses, then the surface
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Round {
    /// Vertices whose displacements are solved for; more show finer detail and cost time
    pub coarse_count: usize,
    /// Outline points are searched within this distance, in nominal px
    pub radius: f64,
    /// Weight of the bending energy
    pub smoothness: f64,
    /// Residuals of the surface beyond this lose weight, in nominal px
    pub robust: f64,
}

/// Coarse vertices of the first rounds, which are too stiff for more, and of all others
const FIRST_COUNT: usize = 1000;
const COUNT: usize = 2000;

/// Rounds of a trial
const TRIAL_ROUNDS: usize = 4;

impl Default for BodyFitOptions {
    fn default() -> Self {
        // A wide start, because bodies far from the avatar (large busts, bellies) would else come out too small.
        let rounds = [
            (FIRST_COUNT, 60.0, 15.0, 12.0),
            (FIRST_COUNT, 60.0, 5.0, 12.0),
            (FIRST_COUNT, 50.0, 2.5, 10.0),
            (FIRST_COUNT, 40.0, 1.5, 8.0),
            (COUNT, 40.0, 1.0, 8.0),
            (COUNT, 30.0, 0.5, 6.0),
            (COUNT, 25.0, 0.5, 5.0),
            (COUNT, 20.0, 0.5, 5.0),
            (COUNT, 15.0, 0.5, 4.0),
            (COUNT, 12.0, 0.5, 4.0),
            (COUNT, 10.0, 0.5, 3.0),
            (COUNT, 10.0, 0.5, 3.0),
        ];
        Self {
            symmetry: true,
            transfer_mean_pose: true,
            anchors: true,
            camera: true,
            overlaps: true,
            rounds: rounds
                .map(|(coarse_count, radius, smoothness, robust)| Round {
                    coarse_count,
                    radius,
                    smoothness,
                    robust,
                })
                .to_vec(),
        }
    }
}

impl BodyFitOptions {
    /// The first rounds only: enough to compare bodies to start from
    pub fn trial() -> Self {
        let mut options = Self {
            overlaps: false,
            ..Self::default()
        };
        options.rounds.truncate(TRIAL_ROUNDS);
        options
    }
}

/// One body for all views
#[derive(Debug, Clone)]
pub struct FittedBody {
    /// The fitted body in the reference pose, world frame, mm
    pub avatar: Avatar,
    /// How far rim and outlines were apart in the last round (root mean square), in nominal px
    pub residual_px: f64,
}

/// A view as the fitted body explains it
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedView {
    /// Pose of the body
    pub pose: Pose,
    /// The camera, corrected as far as its prior allows
    pub camera: Camera,
    /// Intersection over union of the posed body's silhouette with that of the photo; `None` where the options leave
    /// it out
    pub silhouette_iou: Option<f64>,
}

/// The surface while it is fitted
#[derive(Debug, Clone)]
struct Body<'a> {
    rim: &'a ContourMesh,
    weights: &'a [SkinWeight],
    /// By which share each vertex hangs on the left and on the right arm
    arms: Vec<[f64; 2]>,
    /// The undisplaced surface
    rest: Vec<DVec3>,
    positions: Vec<DVec3>,
    bone_heads: PerBone<DVec3>,
    keypoints: PerJoint<DVec3>,
}

impl<'a> Body<'a> {
    fn new(avatar: &'a Avatar, rim: &'a ContourMesh) -> Self {
        Self {
            rim,
            weights: &avatar.weights,
            arms: avatar.weights.iter().map(arm_shares).collect(),
            rest: avatar.mesh.positions.clone(),
            positions: avatar.mesh.positions.clone(),
            bone_heads: avatar.bone_heads,
            keypoints: avatar.keypoints,
        }
    }

    /// Displaces each vertex by its blend of the displacements of coarse vertices
    fn displace(&mut self, blends: &[Blend], displacements: &[DVec3]) {
        let blends = blends.iter().zip(&self.rest);
        for (position, (blend, rest)) in self.positions.iter_mut().zip(blends) {
            *position = *rest + blend.of(displacements);
        }
    }

    fn reshape_frame(&self, stature_mm: f64) -> Reshape {
        Reshape {
            stature_mm,
            shoulders: [Bone::LeftUpperArm, Bone::RightUpperArm].map(|arm| self.bone_heads[arm]),
        }
    }

    /// Makes the whole figure wider, and lifts its middle
    fn reshape(&mut self, step: &SharedStep, stature_mm: f64) {
        let frame = self.reshape_frame(stature_mm);
        let move_point = |p: &mut DVec3, arms| *p = step.reshaped(*p, frame.rates(*p, arms));
        for ((p, rest), &arms) in self
            .positions
            .iter_mut()
            .zip(&mut self.rest)
            .zip(&self.arms)
        {
            move_point(p, arms);
            move_point(rest, arms);
        }
        for (bone, head) in self.bone_heads.pairs_mut() {
            move_point(head, arm_shares(&SkinWeight::rigid(bone)));
        }
        for (joint, point) in self.keypoints.pairs_mut() {
            move_point(point, arm_shares(&SkinWeight::rigid(joint.bone())));
        }
    }

    /// Brings the reference pose into another pose
    fn repose(&mut self, pose: &Pose) {
        let posed = pose_bones(&self.bone_heads, pose, TurnAngle::default());
        self.rest = posed.skin(&self.rest, self.weights);
        self.positions = posed.skin(&self.positions, self.weights);
        self.bone_heads = posed.heads();
        self.keypoints = posed.keypoints(&self.keypoints);
    }
}

/// Whether a bone's mean rotation over all views is the person's posture
///
/// Arms and hands are held as the reference pose says, feet stand on the floor, and the root's lean belongs to
/// the camera as much as to the person.
fn carries_posture(bone: Bone) -> bool {
    use Bone::*;
    matches!(
        bone,
        LowerSpine
            | UpperSpine
            | Neck
            | Head
            | LeftClavicle
            | RightClavicle
            | LeftThigh
            | RightThigh
            | LeftShin
            | RightShin
    )
}

/// Fits one body to all views
///
/// `avatar` has the person's bone lengths, in the reference pose. `cancelled` is asked between rounds; the fit so far
/// comes back.
pub fn fit_body(
    avatar: &Avatar,
    views: &[BodyFitView],
    prior: &BodyFitPrior,
    options: &BodyFitOptions,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> (FittedBody, Vec<FittedView>) {
    let outlines = Outlines::trace(views);
    fit_outlines(avatar, views, &outlines, prior, options, cancelled)
}

/// The same with outlines that are known
pub(crate) fn fit_outlines(
    avatar: &Avatar,
    views: &[BodyFitView],
    Outlines(outlines): &Outlines,
    prior: &BodyFitPrior,
    options: &BodyFitOptions,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> (FittedBody, Vec<FittedView>) {
    let mut counts: Vec<usize> = options.rounds.iter().map(|r| r.coarse_count).collect();
    counts.sort_unstable_by(|a, b| b.cmp(a));
    counts.dedup();
    let (rim, levels) = rayon::join(
        || ContourMesh::new(&avatar.mesh.triangles, avatar.mesh.positions.len()),
        || Surface::levels(avatar, &counts),
    );
    let mut body = Body::new(avatar, &rim);
    let mut poses: Vec<Pose> = views.iter().map(|view| view.pose).collect();
    let start = views.first().map(|view| view.camera);
    let spread = if options.camera {
        prior.camera
    } else {
        CameraSpread::default()
    };
    let mut views = views.to_vec();
    let mut posture = prior.posture;
    let mut residual_px = f64::INFINITY;
    let mut transferred = Pose::default();
    let analyze = |(&count, level)| {
        let solver = ShapeSolver::new(level, &body, prior.stature_mm, options)?;
        Some((count, solver))
    };
    let mut solvers: Vec<(usize, ShapeSolver)> =
        counts.par_iter().zip(&levels).filter_map(analyze).collect();
    for (index, round) in options.rounds.iter().enumerate() {
        if cancelled() {
            break;
        }
        let mut solvers = solvers.iter_mut();
        let Some((_, solver)) = solvers.find(|(count, _)| *count == round.coarse_count) else {
            break;
        };
        let matches = match_views(&body, &views, outlines, &poses, round.radius);
        let together = step_together(
            &body,
            &views,
            (outlines, &matches),
            (&posture, &poses),
            (start.as_ref(), &spread),
        );
        poses = together.poses;
        if together.shared != SharedStep::default() {
            for view in &mut views {
                view.camera = together.shared.moved(&view.camera);
            }
            body.reshape(&together.shared, views[0].stature_mm);
        }
        let seen = (&outlines[..], &matches[..]);
        let Some(off) = solver.step(&mut body, &views, seen, &poses, round, options) else {
            break;
        };
        residual_px = off;
        if options.transfer_mean_pose && index + 2 < options.rounds.len() {
            transfer_mean_pose(&mut body, &mut poses, &mut posture, &mut transferred);
        }
    }
    let shift = body
        .positions
        .iter()
        .zip(&avatar.mesh.positions)
        .map(|(p, rest)| *p - *rest)
        .sum::<DVec3>()
        / body.positions.len().max(1) as f64;
    let shift = DVec3::new(shift.x, 0.0, shift.z);
    let mut fitted = avatar.clone();
    fitted.mesh.positions = body.positions.iter().map(|p| *p - shift).collect();
    fitted.bone_heads = body.bone_heads.map(|p| p - shift);
    fitted.keypoints = body.keypoints.map(|p| p - shift);
    for (pose, view) in poses.iter_mut().zip(&views) {
        // The root turns about the origin, so that the same room points come from the shifted body.
        let turned = pose_bones(&body.bone_heads, pose, view.turn);
        pose.shift_mm = turned.carry(Bone::Root, shift);
    }
    let ious = if options.overlaps {
        overlaps(&fitted, &views, &poses)
    } else {
        vec![None; views.len()]
    };
    let parts = views.iter().zip(poses).zip(ious);
    let fitted_views = parts
        .map(|((view, pose), silhouette_iou)| FittedView {
            pose,
            camera: view.camera,
            silhouette_iou,
        })
        .collect();
    let body = FittedBody {
        avatar: fitted,
        residual_px,
    };
    (body, fitted_views)
}

/// Intersection over union of the posed body's silhouette with that of the photo, for each view
fn overlaps(fitted: &Avatar, views: &[BodyFitView], poses: &[Pose]) -> Vec<Option<f64>> {
    let mesh = SilhouetteMesh::new(&fitted.mesh.triangles);
    views
        .par_iter()
        .zip(poses)
        .map(|(view, pose)| {
            let positions = fitted.posed(pose, view.turn).positions;
            let coverage = mesh.silhouette(&positions, &view.camera);
            let mask = view.silhouette.whole().threshold(0.5);
            Some(coverage.threshold(0.5).iou(&mask))
        })
        .collect()
}

/// How far the undeformed avatar is off the outlines in its best poses (root mean square), in nominal px
///
/// Arguments as of [`fit_body`]; as wide as its first round.
pub(crate) fn rigid_residual(
    avatar: &Avatar,
    posture: &Pose,
    views: &[BodyFitView],
    Outlines(outlines): &Outlines,
) -> f64 {
    let Some(round) = BodyFitOptions::default().rounds.first().copied() else {
        return f64::INFINITY;
    };
    let rim = ContourMesh::new(&avatar.mesh.triangles, avatar.mesh.positions.len());
    let body = Body::new(avatar, &rim);
    let poses: Vec<Pose> = views.iter().map(|view| view.pose).collect();
    let find = |poses: &[Pose]| match_views(&body, views, outlines, poses, round.radius);
    let matches = find(&poses);
    let poses = step_together(
        &body,
        views,
        (outlines, &matches),
        (posture, &poses),
        (None, &CameraSpread::default()),
    )
    .poses;
    let matches = find(&poses);
    let rows = shape_step::rows(&body, views, (outlines, &matches), &poses, &round);
    shape_step::residual(&rows, &round)
}

/// Outlines of the silhouettes of all views, as they are fitted
///
/// They follow from silhouettes, cameras and stature, not from poses: several fits can share them.
#[derive(Debug, Clone)]
pub(crate) struct Outlines(Vec<Outline>);

impl Outlines {
    pub(crate) fn trace(views: &[BodyFitView]) -> Self {
        let trace = |view: &BodyFitView| {
            Outline::new(view.silhouette, view.stature_px() / NOMINAL_STATURE_PX)
        };
        Self(views.par_iter().map(trace).collect())
    }
}

/// Standard deviation of a person's own posture from the figure's, over that of one view's pose from the posture
///
/// Rendered scans and random people, mean surface error with 8 views: 2.99 and 2.65 mm when the mean of the poses
/// counts in full, 2.93 and 2.61 mm with 1.0, 2.92 and 2.70 mm with 0.7. It matters most for few views: of 32 people
/// in four views three are more than 7 mm off without it, and one with it.
const POSTURE_SPREAD: f64 = 1.0;

/// Takes what all poses share, alike on both sides, out of them and into the surface
///
/// The mean of a few swaying views is lopsided by chance: 2.5 degrees of sway of a thigh leave 0.9 degrees over eight views,
/// which is 12 mm at the foot. So the lopsided part stays in the poses (surface error of three rendered scans: 2.35 mm;
/// with it 2.71 mm). The body of a person who always stands lopsided comes out upright. What is alike on both sides is in
/// part chance, too: the figure's own posture counts as much as `POSTURE_SPREAD` says. `transferred` is what went into
/// the surface so far.
fn transfer_mean_pose(
    body: &mut Body,
    poses: &mut [Pose],
    posture: &mut Pose,
    transferred: &mut Pose,
) {
    let count = poses.len().max(1) as f64;
    let sum = |bone: Bone| {
        let rotations = poses.iter().map(|pose| pose.rotations[bone]);
        rotations.sum::<DVec3>()
    };
    // Seen in a mirror (x to -x), a rotation keeps its part about x and reverses the others.
    let flip = DVec3::new(1.0, -1.0, -1.0);
    let prior = POSTURE_SPREAD.powi(-2);
    let mut shared = Pose::default();
    for bone in Bone::ALL.into_iter().filter(|&bone| carries_posture(bone)) {
        let (found, seen) = if bone == bone.mirrored() {
            ((sum(bone) + sum(bone) * flip) / 2.0, count)
        } else {
            (sum(bone) + sum(bone.mirrored()) * flip, 2.0 * count)
        };
        shared.rotations[bone] = (found - transferred.rotations[bone] * prior) / (seen + prior);
        transferred.rotations[bone] += shared.rotations[bone];
        posture.rotations[bone] = DVec3::ZERO;
    }
    for pose in poses.iter_mut() {
        for (rotation, shared) in pose.rotations.iter_mut().zip(shared.rotations) {
            *rotation -= shared;
        }
    }
    body.repose(&shared);
}

#[cfg(test)]
mod tests;
