//! The body fit: one surface and one pose per view that explain all silhouettes together.
//!
//! The surface is the avatar in the reference pose with a smooth displacement, and is posed per view. Poses and surface
//! are fitted alternately to the outlines, which the occluding contours of the posed surface must match. Parts without
//! outlines follow the avatar's shape. No statistical body model is used.
//!
//! The common pose of trunk, head and legs in all views is the person's posture and is transferred to the surface; arms
//! are brought to the reference pose. Hollows that no outline shows are those of the avatar.
//!
//! # Source
//! Gall et al., "Motion Capture Using Joint Skeleton Tracking and Surface Estimation", CVPR 2009, for the alternation of
//! poses and surface on contour correspondences; Geman and McClure, "Statistical Methods for Tomographic Image
//! Reconstruction", Bull. ISI 52, 1987, for the robust weights. Here, one surface is shared by all views.

mod matches;
mod mesh_step;
mod occluding_contour;
mod outline;
mod pose_step;
mod shape_step;
mod shared_step;
mod surface;
mod sway;
mod targets;

use glam::{DVec2, DVec3};
use pirouette_geom::Windowed;
use pirouette_geom::coarsen::Blend;
use pirouette_geom::parallel::prelude::*;

use crate::skeleton_fit::{Tracked, keypoint_sigma_px};
use matches::{Outline, match_views};
use pirouette_body::render::SilhouetteMesh;
use pirouette_body::{
    Avatar, Bone, Camera, Joint, Keypoints, NOMINAL_STATURE_PX, PerBone, PerJoint, Pose,
    SkinWeight, TurnAngle, pose_bones,
};
use pose_step::TURN;
use shape_step::ShapeSolver;
use shared_step::{Reshape, SharedStep, arm_shares, step_together};
use surface::Surface;
use sway::TrackedTurns;

pub use mesh_step::fit_to_mesh;
pub use occluding_contour::ContourMesh;
pub use targets::OutlineTargets;

/// Input of the fit from one view
#[derive(Debug, Clone, Copy)]
pub struct BodyFitView<'a> {
    /// Soft silhouette of the person, 1 inside
    pub silhouette: &'a Windowed<f32>,
    /// Detected joints
    pub keypoints: &'a Keypoints,
    /// The camera
    pub camera: Camera,
    /// Turn angle of the person
    pub turn: TurnAngle,
    /// Whether the turn angle is not stated: the person stepped to any angle
    pub stepped: bool,
    /// The frame of a video; `None` if it is a photo
    pub tracked: Option<Tracked>,
    /// Initial pose
    pub pose: Pose,
    /// Height of the person, in mm; determines the size of pixels
    pub stature_mm: f64,
}

impl BodyFitView<'_> {
    /// Returns the height of the person in the photo, in px
    fn stature_px(&self) -> f64 {
        self.camera.focal_px() * self.stature_mm / self.camera.distance_mm
    }

    /// Returns a detected joint with its standard deviation, in px
    fn keypoint(&self, joint: Joint) -> Option<(DVec2, f64)> {
        let found = self.keypoints.found(joint)?;
        let sigma_px = keypoint_sigma_px(found.confidence, self.stature_px());
        Some((found.position, sigma_px))
    }
}

/// Prior shared by all views
#[derive(Debug, Clone, Copy, Default)]
pub struct BodyFitPrior {
    /// The pose that sway is centered at
    pub posture: Pose,
    /// Height of the person, in mm, if known
    pub stature_mm: Option<f64>,
    /// Uncertainty of the camera of the views
    pub camera: CameraSpread,
}

/// Prior standard deviations of the camera; 0 fixes a parameter
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CameraSpread {
    /// Of the distance from the turning axis, in mm
    pub distance_mm: f64,
    /// Of the height above the floor, in mm
    pub height_mm: f64,
    /// Of the pitch
    pub pitch_radians: f64,
}

/// Options of [`fit_body`]
#[derive(Debug, Clone, PartialEq)]
pub struct BodyFitOptions {
    /// Assumes left-right symmetry of the body where outlines do not contradict it
    pub symmetry: bool,
    /// Transfers the mean pose of all views to the surface
    pub transfer_mean_pose: bool,
    /// Constrains soles to the floor, and the crown to the stature
    pub anchors: bool,
    /// Corrects the camera within its prior
    pub camera: bool,
    /// Compares the posed body's silhouettes with those of the photos at the end
    pub overlaps: bool,
    /// The rounds, in order
    pub rounds: Vec<Round>,
}

/// One round: poses, then the surface
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Round {
    /// Number of vertices whose displacements are solved for; more give finer detail and take more time
    pub coarse_count: usize,
    /// Search radius for outline points, in nominal px
    pub radius: f64,
    /// Weight of the bending energy
    pub smoothness: f64,
    /// Surface residuals beyond this lose weight, in nominal px
    pub robust: f64,
}

/// Coarse vertices of the first rounds, which are too stiff for more, and of all others
const FIRST_COUNT: usize = 1000;
const COUNT: usize = 2000;

/// First rounds, in which turns that were found in a video hardly change
///
/// The outline of a view from the side hardly depends on the turn: a surface that is not yet the person's turns it by
/// degrees, and is then fitted to the wrong view.
const HELD_ROUNDS: usize = 2;

/// Rounds of a trial
const TRIAL_ROUNDS: usize = 4;

impl Default for BodyFitOptions {
    fn default() -> Self {
        // A wide start, because bodies far from the avatar (large busts, bellies) would otherwise come out too small.
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
    /// Returns these options with a third of the rounds: sufficient for the outline of a prior
    pub fn rough(&self) -> Self {
        let mut options = Self {
            overlaps: false,
            ..self.clone()
        };
        options.rounds.truncate(self.rounds.len() / 3);
        options
    }

    /// Returns options with the first rounds only: sufficient to compare initial bodies
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
    /// Root mean square distance of occluding contours and outlines in the last round, in nominal px
    pub residual_px: f64,
}

/// One view of the result
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedView {
    /// Pose of the body
    pub pose: Pose,
    /// Standard deviation of the turn of the pose, by its normal equations
    pub turn_sd_radians: f64,
    /// The camera, corrected within its prior
    pub camera: Camera,
    /// Intersection over union of the posed body's silhouette with that of the photo; `None` if disabled by the
    /// options
    pub silhouette_iou: Option<f64>,
}

/// The surface during the fit
#[derive(Debug, Clone)]
struct Body<'a> {
    contour_mesh: &'a ContourMesh,
    weights: &'a [SkinWeight],
    /// Total skinning weights of the left and of the right arm, per vertex
    arms: Vec<[f64; 2]>,
    /// The undisplaced surface
    rest: Vec<DVec3>,
    positions: Vec<DVec3>,
    bone_heads: PerBone<DVec3>,
    keypoints: PerJoint<DVec3>,
}

impl<'a> Body<'a> {
    fn new(avatar: &'a Avatar, contour_mesh: &'a ContourMesh) -> Self {
        Self {
            contour_mesh,
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

    /// Widens the complete body, and lifts its middle
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

    /// Moves the reference pose to another pose
    fn repose(&mut self, pose: &Pose) {
        let posed = pose_bones(&self.bone_heads, pose, TurnAngle::default());
        self.rest = posed.skin(&self.rest, self.weights);
        self.positions = posed.skin(&self.positions, self.weights);
        self.bone_heads = posed.heads();
        self.keypoints = posed.keypoints(&self.keypoints);
    }
}

/// Whether a bone's mean rotation over all views belongs to the person's posture
///
/// Arms and hands are held according to the reference pose, feet stand on the floor, and the root's lean cannot be
/// separated from the camera's pitch.
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
/// `avatar` has the person's bone lengths, in the reference pose. `cancelled` is queried between rounds; when it
/// returns true, the current fit is returned.
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

/// Like [`fit_body`], with given outlines
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
    let (contour_mesh, levels) = pirouette_geom::parallel::join(
        || ContourMesh::new(&avatar.mesh.triangles, avatar.mesh.positions.len()),
        || Surface::levels(avatar, &counts),
    );
    let mut body = Body::new(avatar, &contour_mesh);
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
    let mut turn_sds = vec![Pose::prior_sigmas()[TURN]; views.len()];
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
            if index < HELD_ROUNDS {
                TrackedTurns::Held
            } else {
                TrackedTurns::Continuous
            },
        );
        poses = together.poses;
        turn_sds = together.turn_sds;
        if together.shared != SharedStep::default() {
            for view in &mut views {
                view.camera = together.shared.moved(&view.camera);
            }
            body.reshape(&together.shared, views[0].stature_mm);
        }
        let seen = (&outlines[..], &matches[..]);
        let rows = shape_step::rows(&body, &views, seen, &poses, round);
        let Some(off) = solver.step(&mut body, &rows, round, options) else {
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
    // The soles are constrained to the floor, but not exactly.
    let floor = body.positions.iter().map(|p| p.y).reduce(f64::min);
    let shift = DVec3::new(shift.x, floor.unwrap_or(0.0), shift.z);
    let mut fitted = avatar.clone();
    fitted.mesh.positions = body.positions.iter().map(|p| *p - shift).collect();
    fitted.bone_heads = body.bone_heads.map(|p| p - shift);
    fitted.keypoints = body.keypoints.map(|p| p - shift);
    for (pose, view) in poses.iter_mut().zip(&views) {
        // The root rotates about the origin, so that the shifted body gives the same room points.
        let turned = pose_bones(&body.bone_heads, pose, view.turn);
        pose.shift_mm = turned.carry(Bone::Root, shift);
    }
    let ious = if options.overlaps {
        overlaps(&fitted, &views, &poses)
    } else {
        vec![None; views.len()]
    };
    let parts = views.iter().zip(poses).zip(ious).zip(turn_sds);
    let fitted_views = parts
        .map(
            |(((view, pose), silhouette_iou), turn_sd_radians)| FittedView {
                pose,
                turn_sd_radians,
                camera: view.camera,
                silhouette_iou,
            },
        )
        .collect();
    let body = FittedBody {
        avatar: fitted,
        residual_px,
    };
    (body, fitted_views)
}

/// Computes the intersection over union of the posed body's silhouette with that of the photo, for each view
pub(crate) fn overlaps(fitted: &Avatar, views: &[BodyFitView], poses: &[Pose]) -> Vec<Option<f64>> {
    let mesh = SilhouetteMesh::new(&fitted.mesh.triangles);
    views
        .par_iter()
        .zip(poses)
        .map(|(view, pose)| {
            let positions = fitted.posed(pose, view.turn).positions;
            let coverage = mesh.silhouette(&positions, &view.camera);
            let mask = view.silhouette.to_grid().threshold(0.5);
            Some(coverage.threshold(0.5).iou(&mask))
        })
        .collect()
}

/// Returns the root mean square distance of the undeformed avatar from the outlines in its best poses, in nominal px
///
/// Arguments as of [`fit_body`]; uses the search radius of its first round.
pub(crate) fn rigid_residual(
    avatar: &Avatar,
    posture: &Pose,
    views: &[BodyFitView],
    Outlines(outlines): &Outlines,
) -> f64 {
    let Some(round) = BodyFitOptions::default().rounds.first().copied() else {
        return f64::INFINITY;
    };
    let contour_mesh = ContourMesh::new(&avatar.mesh.triangles, avatar.mesh.positions.len());
    let body = Body::new(avatar, &contour_mesh);
    let poses: Vec<Pose> = views.iter().map(|view| view.pose).collect();
    let find = |poses: &[Pose]| match_views(&body, views, outlines, poses, round.radius);
    let matches = find(&poses);
    let poses = step_together(
        &body,
        views,
        (outlines, &matches),
        (posture, &poses),
        (None, &CameraSpread::default()),
        TrackedTurns::Continuous,
    )
    .poses;
    let matches = find(&poses);
    let rows = shape_step::rows(&body, views, (outlines, &matches), &poses, &round);
    shape_step::residual(&rows, &round)
}

/// Outlines of the silhouettes of all views
///
/// They depend on silhouettes, cameras and stature, not on poses, so several fits can share them.
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

/// Standard deviation of a posture around the avatar's, relative to that of one view's pose around the posture
///
/// Rendered scans and random people, mean surface error with 8 views: 2.99 and 2.65 mm with the full mean of the
/// poses, 2.93 and 2.61 mm with 1.0, 2.92 and 2.70 mm with 0.7. It matters most for few views: of 32 people in four
/// views, three are off by more than 7 mm without it, and one with it.
const POSTURE_SPREAD: f64 = 1.0;

/// Transfers the symmetric part of the mean pose to the surface
///
/// The mean of a few swaying views is asymmetric by chance: 2.5 degrees of sway of a thigh leave 0.9 degrees over
/// eight views, which is 12 mm at the foot. The asymmetric part therefore remains in the poses (surface error of three
/// rendered scans: 2.35 mm; with it 2.71 mm); bodies of people who always stand asymmetrically come out upright. The
/// symmetric part is partly random, too: `POSTURE_SPREAD` gives the weight of the avatar's posture. `transferred` is
/// the part already in the surface.
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
    // A reflection (x to -x) keeps a rotation's component about x and negates the others.
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
