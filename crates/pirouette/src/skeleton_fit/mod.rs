//! One skeleton for all views: camera distance, bone lengths and the pose of each view from keypoints.
//!
//! The fit explains the detected joints of all photos by one body, the avatar with stretched bones, in slightly
//! different poses in front of one camera. Unknowns are 60 numbers per view (rotations of 19 bones and a shift) and,
//! shared by all views, nine bone lengths, the positions of the points of face and feet, and the unknown parameters
//! of the camera. Solved by Gauss-Newton with analytic derivatives and a robust loss; the poses are eliminated view
//! by view (Schur complement), so that the cost grows linearly with the number of views. The reference pose is a
//! sufficient start for people who try to hold it.
//!
//! Swaps of left and right by the detector are detected and fixed, other outliers are reported. The poses of hidden
//! limbs are determined by the priors and therefore unreliable. The surface is only stretched along the bones, so its
//! girths are not fitted.

mod doubts;
mod found_turns;
mod model;
mod problem;
mod scales;
mod solve;
mod start;
mod swaps;
#[cfg(test)]
mod tests;
mod turn_start;
mod turns;

use glam::DVec3;

use crate::detect::detected_positions;
use crate::scan::{CameraSetup, KeypointKind, STATED_TURN_SD_DEGREES, View};
use doubts::find_contradicted;
use model::{DETECTED_OFFSET_SIGMA_MM, OFFSET_SIGMA_MM, Problem, Shared, Unknowns, room_joints};
use pirouette_body::{
    Avatar, Bone, Camera, Joint, Keypoints, PerJoint, Pose, PosedBones, TurnAngle, pose_bones,
};
use scales::Frame;
use solve::{Solution, solve};

pub use doubts::CameraParameter;
pub use problem::{SkeletonFitError, SkeletonFitWarning};
pub use scales::{BoneScale, BoneScales, rescale_avatar};
pub(crate) use start::{
    FREE_TURN_SIGMA_RADIANS, USUAL_VERTICAL_FOV_DEGREES, keypoint_sigma_px, usual_camera_height_mm,
};
pub use swaps::SwapGroup;
pub use turn_start::estimate_turns;
pub use turns::TurnCorrection;
pub(crate) use turns::{REPORTED as REPORTED_TURN_SIGMAS, are_wrong};

/// Input of the fit from one photo
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeypointView {
    /// Turn angle of the person as stated; of no meaning if unknown
    pub turn: TurnAngle,
    /// Prior standard deviation of the person's turn around that angle, sway included; infinite if the angle is unknown
    pub turn_sd_radians: f64,
    /// Time in the video, in s, whose course of the turn gave the angle; `None` if it is a photo
    pub time_s: Option<f64>,
    /// Detected joints, in px of the photo
    pub keypoints: Keypoints,
    /// Definition of the joints by their detector
    pub keypoint_kind: KeypointKind,
    /// Width of the photo in px
    pub width_px: usize,
    /// Height of the photo in px
    pub height_px: usize,
}

impl From<&View> for KeypointView {
    /// Copies the input of a view
    fn from(view: &View) -> Self {
        Self {
            turn: view.turn,
            turn_sd_radians: view.turn_sd_radians,
            time_s: view.time_s,
            keypoints: view.keypoints,
            keypoint_kind: view.keypoint_kind,
            width_px: view.photo.width(),
            height_px: view.photo.height(),
        }
    }
}

/// Options of [`fit_skeleton`]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkeletonFitOptions {
    /// Maximum number of Gauss-Newton rounds; usually six to ten are needed
    pub rounds: usize,
    /// Fixes swaps of left and right by the detector
    pub fix_swaps: bool,
    /// Prior standard deviation of an unknown camera pitch around level; 0 fixes it at level
    pub pitch_sigma_radians: f64,
    /// Corrects turn angles that run in the wrong direction or do not start at the front
    pub correct_turns: bool,
    /// Replaces given parameters of the camera that the keypoints clearly contradict
    pub check_camera: bool,
    /// Allows a posture: arms and thighs that differ from the reference pose in all views
    ///
    /// Used only if the keypoints clearly support it; otherwise, and if disabled, all rotations are sway, which the
    /// priors keep small.
    pub free_posture: bool,
}

impl Default for SkeletonFitOptions {
    fn default() -> Self {
        Self {
            rounds: 25,
            fix_swaps: true,
            correct_turns: true,
            check_camera: true,
            pitch_sigma_radians: 2.0_f64.to_radians(),
            free_posture: true,
        }
    }
}

/// Origin of the turn angle of a view
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TurnFrom {
    /// Stated, and consistent with the keypoints
    Stated,
    /// Found, because the keypoints contradict the stated angles of the scan
    Corrected,
    /// Found, because it is unknown
    Found,
}

/// A frame of a video, by its place in the track of the turn
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracked {
    /// Time in the video, in s
    pub time_s: f64,
    /// Turn angle by the track
    pub turn: TurnAngle,
}

/// One view of the solution
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkeletonView {
    /// Turn angle that the pose is relative to: as given, changed by [`Skeleton::turn_correction`], or found
    pub turn: TurnAngle,
    /// Standard deviation of the person's turn in this view
    pub turn_sd_radians: f64,
    /// Origin of the turn angle
    pub turn_from: TurnFrom,
    /// The frame of a video; `None` if it is a photo
    pub tracked: Option<Tracked>,
    /// The camera; the cameras of all views differ only in the size of the photo
    pub camera: Camera,
    /// Keypoints, with swaps of left and right fixed
    pub keypoints: Keypoints,
    /// Pose: posture and sway combined
    pub pose: Pose,
}

/// One body for all views
#[derive(Debug, Clone)]
pub struct Skeleton {
    /// The avatar with the person's bone lengths and stature, on the floor, in the reference pose
    pub avatar: Avatar,
    /// The camera of the first view; those of the others differ only in the size of the photo
    pub camera: Camera,
    /// Correction of the given turn angles
    pub turn_correction: TurnCorrection,
    /// Views with wrong turn angles: those stated, or with the correction of all, and those found
    pub wrong_turns: Vec<WrongTurn>,
    /// Views whose unknown turn angles are uncertain: another turn explains the keypoints nearly as well
    pub unclear_turns: Vec<usize>,
    /// Posture: the common rotation of arms and thighs in all views, relative to the reference pose
    ///
    /// Zero unless the keypoints clearly support it.
    pub posture: Pose,
    /// Bone lengths relative to the avatar at equal stature
    pub scales: BoneScales,
    /// Limbs with swapped left and right, and their views
    pub swaps: Vec<(usize, SwapGroup)>,
    /// Keypoints that no plausible pose explains
    pub outliers: Vec<Outlier>,
    /// Root mean square distance of predicted and detected joints without outliers, in px
    pub rms_px: f64,
    /// Assumptions and problems
    pub warnings: Vec<SkeletonFitWarning>,
}

/// A stated turn angle that the keypoints contradict
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WrongTurn {
    /// Its view
    pub view: usize,
    /// The stated angle, with [`Skeleton::turn_correction`]
    pub stated: TurnAngle,
    /// The angle by the keypoints
    pub found: TurnAngle,
}

/// A keypoint that no plausible pose explains
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outlier {
    /// Its view
    pub view: usize,
    /// Its joint
    pub joint: Joint,
    /// Distance of the detected from the predicted joint, in px
    pub residual_px: f64,
}

/// Range of human statures, in mm; values outside suggest a wrong unit
const MIN_STATURE_MM: f64 = 400.0;
const MAX_STATURE_MM: f64 = 2600.0;

/// Relative difference of the scaled avatar's stature from the given one that causes a warning
const STATURE_TOLERANCE: f64 = 0.01;

/// Logarithm of a bone length that is reported as unusual: four prior standard deviations
const UNUSUAL_LOG_SCALE: f64 = 0.24;

/// Keypoints with a residual above this many standard deviations are outliers
const OUTLIER_SIGMAS: f64 = 5.0;

/// Maximum number of searches for swaps, each followed by a new solution
const FIX_ROUNDS: usize = 3;

/// Log-likelihood gain required for a posture
///
/// 1.5 per unknown, of which there are 18. Rendered people in the reference pose gain 2 to 11, a real person with
/// straighter arms gained 129. An unneeded posture lets hidden arms drift: silhouettes of the posed avatar lose
/// 0.0015 IoU.
const CLEAR_POSTURE_GAIN: f64 = 27.0;

/// Rounds that suffice to estimate the gain of a posture
const POSTURE_TRIAL_ROUNDS: usize = 3;

/// Fits one skeleton, one pose per view and the camera to the keypoints of all views
///
/// `avatar` may have any stature; it is scaled to the given one. Without a given stature, its own is assumed, and all
/// lengths of the result depend on it. Joints may be missing; a view without keypoints takes the mean pose of the
/// others. Unknown parameters of `camera` are estimated. If most views have detected keypoints, the avatar's keypoints are
/// moved to where the detector places them: see [`crate::detect`].
///
/// # Errors
/// When there are too few keypoints for a body, none determines its size, or stature or avatar are unusable.
///
/// # Source
/// Robust loss: Cauchy's, by iterated reweighting, Holland and Welsch 1977. Elimination of the poses: Triggs et
/// al. 2000, "Bundle adjustment: a modern synthesis", section 6.
pub fn fit_skeleton(
    avatar: &Avatar,
    views: &[KeypointView],
    camera: &CameraSetup,
    stature_mm: Option<f64>,
    options: &SkeletonFitOptions,
) -> Result<(Skeleton, Vec<SkeletonView>), SkeletonFitError> {
    if views.is_empty() {
        return Err(SkeletonFitError::NoViews);
    }
    let mut warnings = Vec::new();
    let own_stature_mm = avatar.stature_mm();
    if !(own_stature_mm.is_finite() && own_stature_mm > 0.0) {
        return Err(SkeletonFitError::AvatarUnusable);
    }
    if stature_mm.is_none() {
        warnings.push(SkeletonFitWarning::StatureUnknown {
            assumed_mm: own_stature_mm,
        });
    }
    let stature_mm = stature_mm.unwrap_or(own_stature_mm);
    if !(MIN_STATURE_MM..=MAX_STATURE_MM).contains(&stature_mm) {
        return Err(SkeletonFitError::StatureImplausible { stature_mm });
    }
    let mut avatar = avatar.clone().scaled(stature_mm / own_stature_mm);
    let of_detector = |view: &&KeypointView| view.keypoint_kind == KeypointKind::MediaPipe;
    let detected = 2 * views.iter().filter(of_detector).count() > views.len();
    if detected {
        avatar.keypoints = detected_positions(&avatar);
    }
    let frame = Frame::new(&avatar).ok_or(SkeletonFitError::AvatarUnusable)?;
    let start = start::prepare(&avatar, views, camera, options, &mut warnings)?;
    let mut problem = Problem {
        frame,
        stature_mm,
        camera: start.camera,
        offset_sigma_mm: match detected {
            true => DETECTED_OFFSET_SIGMA_MM,
            false => OFFSET_SIGMA_MM,
        },
        seen_distance_mm: start.seen_distance_mm,
        free_posture: false,
        views: start.views,
    };

    let free: Vec<bool> = views
        .iter()
        .map(|view| view.turn_sd_radians.is_infinite())
        .collect();
    let mut swaps = Vec::new();
    let mut unclear_turns = Vec::new();
    let (mut solution, mut turn_correction) = if free.contains(&true) {
        let found = found_turns::find_turns(
            &mut problem,
            &free,
            &estimate_turns(&avatar, views),
            options.rounds,
        );
        found_turns::check_found(&problem, &found, &free)?;
        swaps.extend(found.swapped.iter().map(|&view| (view, SwapGroup::Body)));
        unclear_turns = found.unclear;
        (found.solution, TurnCorrection::default())
    } else if options.correct_turns {
        turns::solve_turns(&mut problem, options.rounds)
    } else {
        let solution = solve(&problem, problem.start(), options.rounds);
        (solution, TurnCorrection::default())
    };
    if turn_correction.reversed {
        warnings.push(SkeletonFitWarning::TurnedBackward);
    }
    if turn_correction.halved {
        warnings.push(SkeletonFitWarning::TurnsHalved);
    }
    if turn_correction.swapped {
        swaps.extend((0..views.len()).map(|view| (view, SwapGroup::Body)));
    }
    let check = || find_contradicted(&problem, &solution, camera, options);
    if let Some(found) = options.check_camera.then(check).flatten() {
        warnings.push(SkeletonFitWarning::CameraContradicted {
            parameter: found.parameter,
            given: found.given,
            found: found.found,
        });
        (problem, solution) = (found.problem, found.solution);
    }
    fix_all_swaps(&mut problem, &mut solution, &mut swaps, options);
    if options.free_posture {
        problem.free_posture = true;
        let trial = solve(&problem, solution.unknowns.clone(), POSTURE_TRIAL_ROUNDS);
        if trial.cost < solution.cost - CLEAR_POSTURE_GAIN {
            solution = solve(&problem, trial.unknowns, options.rounds);
            fix_all_swaps(&mut problem, &mut solution, &mut swaps, options);
        } else {
            problem.free_posture = false;
        }
    }
    let mut wrong_turns = Vec::new();
    let mut free = free;
    if free.contains(&true) {
        solution = found_turns::solve_free(&mut problem, solution.unknowns, &free, options.rounds);
        turn_correction.offset = found_turns::fix_zero(&mut problem, &mut solution.unknowns, &free);
    } else if options.correct_turns
        // Those of a video are not stated.
        && views.iter().all(|view| view.time_s.is_none())
        && let Some(found) = turns::solve_without_stated(&problem, &solution, detected, options.rounds)
    {
        wrong_turns = turns::wrong_turns(views, &found.0, &mut turn_correction);
        (problem, solution) = found;
        free.fill(true);
    }
    // Later stages expect turns near those of the poses.
    for (index, view) in views.iter().enumerate() {
        if !free[index]
            && (view.time_s.is_some()
                || view.turn_sd_radians > (STATED_TURN_SD_DEGREES + 0.1).to_radians())
        {
            problem.views[index].center_turn(&mut solution.unknowns.poses[index], 0.0);
            free[index] = true;
        }
    }
    warnings.extend(turn_correction.shift_warning());
    if free.contains(&true) {
        let turns: Vec<TurnAngle> = problem.views.iter().map(|view| view.turn).collect();
        warnings.extend(found_turns::check_spread(&turns)?);
    }
    if !solution.converged {
        warnings.push(SkeletonFitWarning::NotConverged);
    }
    let mut keypoints: Vec<Keypoints> = views.iter().map(|view| view.keypoints).collect();
    for &(view, limb) in &swaps {
        limb.swap(&mut keypoints[view]);
    }
    Ok(assemble(
        &avatar,
        &problem,
        &solution.unknowns,
        Corrections {
            keypoints,
            swaps,
            turn_correction,
            wrong_turns,
            unclear_turns,
            free_turns: free,
        },
        warnings,
    ))
}

/// Fixes swaps and solves again, until no swaps are found
fn fix_all_swaps(
    problem: &mut Problem,
    solution: &mut Solution,
    swaps: &mut Vec<(usize, SwapGroup)>,
    options: &SkeletonFitOptions,
) {
    for _ in 0..if options.fix_swaps { FIX_ROUNDS } else { 0 } {
        let shared = problem.shared(&solution.unknowns.shared);
        let mut unknowns = solution.unknowns.clone();
        let fixed = swaps::fix_swaps(problem, &shared, &mut unknowns);
        if fixed.is_empty() {
            break;
        }
        swaps.extend(fixed);
        *solution = solve(problem, unknowns, options.rounds);
    }
}

/// Corrections applied to the input
struct Corrections {
    keypoints: Vec<Keypoints>,
    swaps: Vec<(usize, SwapGroup)>,
    turn_correction: TurnCorrection,
    wrong_turns: Vec<WrongTurn>,
    unclear_turns: Vec<usize>,
    free_turns: Vec<bool>,
}

/// Assembles the result from the solution
fn assemble(
    avatar: &Avatar,
    problem: &Problem,
    unknowns: &Unknowns,
    corrections: Corrections,
    mut warnings: Vec<SkeletonFitWarning>,
) -> (Skeleton, Vec<SkeletonView>) {
    let shared = problem.shared(&unknowns.shared);
    let mut outliers = Vec::new();
    let (mut sum, mut count) = (0.0, 0usize);
    for (index, (view, pose)) in problem.views.iter().zip(&unknowns.poses).enumerate() {
        let Some(residuals) = problem.residuals(view, &shared, pose) else {
            continue;
        };
        for joint in Joint::ALL {
            let observed = view.observed[joint];
            let (Some(residual), Some(observed)) = (residuals[joint], observed) else {
                continue;
            };
            let residual_px = residual.length() * observed.sigma_px;
            if residual.length() > OUTLIER_SIGMAS {
                outliers.push(Outlier {
                    view: index,
                    joint,
                    residual_px,
                });
            } else {
                sum += residual_px * residual_px;
                count += 1;
            }
        }
    }

    let mut scaled = rescale_avatar(avatar, &shared.scales);
    for (point, offset) in scaled.keypoints.iter_mut().zip(shared.keypoint_offsets()) {
        *point += offset;
    }
    let solved_mm = scaled.stature_mm();
    if (solved_mm / problem.stature_mm - 1.0).abs() > STATURE_TOLERANCE {
        warnings.push(SkeletonFitWarning::StatureContradicted {
            given_mm: problem.stature_mm,
            solved_mm,
        });
    }
    for scale in BoneScale::ALL {
        if shared.scales.logs[scale as usize].abs() > UNUSUAL_LOG_SCALE {
            warnings.push(SkeletonFitWarning::UnusualLength {
                scale,
                factor: shared.scales.factor(scale),
            });
        }
    }
    let camera = shared.camera_of(&problem.views[0]);
    if problem.camera.log_focal_sigma > 0.0 {
        warnings.push(SkeletonFitWarning::FieldOfViewUnknown {
            estimated_degrees: camera.vertical_fov_radians.to_degrees(),
        });
    }
    let contradicted = warnings
        .iter()
        .any(|w| matches!(w, SkeletonFitWarning::CameraContradicted { .. }));
    if problem.camera.height_mm.1 > 0.0 && !contradicted {
        warnings.push(SkeletonFitWarning::CameraHeightUnknown {
            estimated_mm: camera.height_mm,
        });
    }
    let poses = final_poses(problem, &shared, unknowns);
    let sds = found_turns::turn_sds(problem, unknowns, &corrections.free_turns);
    let turn_from = |free: bool| match (free, corrections.wrong_turns.is_empty()) {
        (false, _) => TurnFrom::Stated,
        (true, true) => TurnFrom::Found,
        (true, false) => TurnFrom::Corrected,
    };
    let turns = sds.into_iter().zip(&corrections.free_turns);
    let parts = problem.views.iter().zip(corrections.keypoints).zip(poses);
    let views = parts
        .zip(turns)
        .map(
            |(((view, keypoints), pose), (turn_sd_radians, &free))| SkeletonView {
                turn: view.turn,
                turn_sd_radians,
                turn_from: turn_from(free),
                tracked: view.tracked,
                camera: shared.camera_of(view),
                keypoints,
                pose,
            },
        )
        .collect();
    let skeleton = Skeleton {
        avatar: scaled,
        camera,
        posture: shared.posture,
        turn_correction: corrections.turn_correction,
        wrong_turns: corrections.wrong_turns,
        unclear_turns: corrections.unclear_turns,
        scales: shared.scales,
        swaps: corrections.swaps,
        outliers,
        rms_px: if count > 0 {
            (sum / count as f64).sqrt()
        } else {
            0.0
        },
        warnings,
    };
    (skeleton, views)
}

/// Returns the poses of all views; a view without keypoints takes the mean rotations of the others, on the axis
fn final_poses(problem: &Problem, shared: &Shared, unknowns: &Unknowns) -> Vec<Pose> {
    let seen: Vec<bool> = problem
        .views
        .iter()
        .map(|view| view.observed_count() > 0)
        .collect();
    let mut poses: Vec<Pose> = unknowns
        .poses
        .iter()
        .zip(&problem.views)
        .map(|(pose, view)| shared.pose(view, pose))
        .collect();
    let count = seen.iter().filter(|&&seen| seen).count().max(1) as f64;
    let mut mean = Pose::default();
    for (pose, _) in poses.iter().zip(&seen).filter(|&(_, &seen)| seen) {
        for bone in Bone::ALL.into_iter().filter(|&bone| bone != Bone::Root) {
            mean.rotations[bone] += pose.rotations[bone] / count;
        }
    }
    for (pose, _) in poses.iter_mut().zip(&seen).filter(|&(_, &seen)| !seen) {
        *pose = mean;
    }
    poses
}

impl SkeletonView {
    /// Returns the bones of the avatar in this view's pose, in the room
    pub fn posed(&self, avatar: &Avatar) -> PosedBones {
        pose_bones(&avatar.bone_heads, &self.pose, self.turn)
    }

    /// Returns the avatar's joints in this view's pose in the room, in mm
    pub fn joints(&self, avatar: &Avatar) -> PerJoint<DVec3> {
        room_joints(&self.posed(avatar), &avatar.keypoints)
    }

    /// Replaces the camera by one with another distance, height, pitch and field of view
    pub(crate) fn with_camera(self, better: &Camera) -> Self {
        Self {
            camera: better.with_size_of(&self.camera),
            ..self
        }
    }
}
