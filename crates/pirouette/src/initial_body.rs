//! Initial mannequin of a fit: the sex and the mass that fit the silhouettes best.

use pirouette_geom::parallel::prelude::*;

use crate::body_fit::{
    BodyFitOptions, BodyFitPrior, BodyFitView, Outlines, fit_outlines, rigid_residual,
};
use crate::scan::{CameraSetup, STATED_TURN_SD_DEGREES, Scan};
use crate::skeleton_fit::{
    FREE_TURN_SIGMA_RADIANS, KeypointView, Skeleton, SkeletonFitError, SkeletonFitOptions,
    TurnFrom, fit_skeleton,
};
use crate::view::SolvedView;
use pirouette_body::mannequin::{MannequinError, MannequinParameters, coarse_mannequin, mannequin};
use pirouette_body::{Avatar, Pose, Sex};

/// Why there is no initial body
#[derive(Debug)]
pub(crate) enum InitialBodyError {
    /// No mannequin of the given stature
    Mannequin(MannequinError),
    /// No skeleton fits with that mannequin
    SkeletonFit(SkeletonFitError),
}

impl From<MannequinError> for InitialBodyError {
    fn from(error: MannequinError) -> Self {
        Self::Mannequin(error)
    }
}

impl From<SkeletonFitError> for InitialBodyError {
    fn from(error: SkeletonFitError) -> Self {
        Self::SkeletonFit(error)
    }
}

/// Initial body of a fit
#[derive(Debug)]
pub(crate) struct Start {
    /// The mannequin with the person's bone lengths
    pub(crate) avatar: Avatar,
    /// Posture: the pose from which the views deviate by sway
    pub(crate) posture: Pose,
    /// Pose of each accepted view, in their order
    pub(crate) poses: Vec<Pose>,
    /// Sex and mass of the mannequin
    pub(crate) mannequin: InitialMannequin,
}

/// Sex and mass of the initial mannequin of a fit
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InitialMannequin {
    /// Sex that determines the proportions; not a reliable estimate of the person's sex
    pub sex: Sex,
    /// Mass, in kg
    pub mass_kg: f64,
}

/// Returns the views of a fit with given initial poses
pub(crate) fn fit_views<'a>(
    views: &'a [SolvedView],
    poses: &[Pose],
    stature_mm: f64,
) -> Vec<BodyFitView<'a>> {
    views
        .iter()
        .zip(poses)
        .map(|(view, &pose)| BodyFitView {
            silhouette: &view.silhouette.soft,
            keypoints: &view.skeleton().keypoints,
            camera: view.skeleton().camera,
            turn: view.skeleton().turn,
            stepped: view.skeleton().turn_from != TurnFrom::Stated,
            tracked: view.skeleton().tracked,
            pose,
            stature_mm,
        })
        .collect()
}

/// Selects the initial mannequin by mass and sex
///
/// The mass follows from the volume of a first rough fit, which hardly depends on its initial body. The sex is that of
/// the mannequin whose unfitted surface, in its best poses, is nearest to the outlines: on rendered women and men, the
/// residual of the wrong sex is 10 to 30 % larger, but only 1 to 4 % after four rounds of fitting. Both steps use
/// coarse mannequins. If no mannequin of that mass exists, one of average mass is returned.
///
/// # Errors
/// When there is no mannequin of the given stature.
pub(crate) fn choose_start(
    scan: &Scan,
    skeleton: &Skeleton,
    views: &[SolvedView],
    outlines: &Outlines,
    stature_mm: f64,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> Result<Start, InitialBodyError> {
    let posed = |avatar: &Avatar| pose_avatar(scan, skeleton, views, avatar, stature_mm);
    let of = |sex, mass_kg| MannequinParameters {
        sex,
        mass_kg,
        stature_mm: Some(stature_mm),
        pose: scan.pose,
        ..MannequinParameters::default()
    };
    let (avatar, posture, poses) = posed(&coarse_mannequin(&of(Sex::Neutral, None))?)?;
    let (rough, _) = fit_outlines(
        &avatar,
        &fit_views(views, &poses, stature_mm),
        outlines,
        &BodyFitPrior {
            posture,
            stature_mm: Some(stature_mm),
            ..BodyFitPrior::default()
        },
        &BodyFitOptions::trial(),
        cancelled,
    );
    let mass_kg = rough.avatar.mesh.volume() * KG_PER_CUBIC_MM;
    let mut residuals: Vec<(f64, Sex)> = [Sex::Female, Sex::Male, Sex::Neutral]
        .into_par_iter()
        .filter_map(|sex| {
            let (avatar, posture, poses) =
                posed(&coarse_mannequin(&of(sex, Some(mass_kg))).ok()?).ok()?;
            let views = fit_views(views, &poses, stature_mm);
            Some((rigid_residual(&avatar, &posture, &views, outlines), sex))
        })
        .collect();
    residuals.sort_by(|a, b| a.0.total_cmp(&b.0));
    let nearest = residuals.iter().map(|(_, sex)| of(*sex, Some(mass_kg)));
    let made = nearest.map(|parameters| mannequin(&parameters).map(|made| (made, parameters)));
    let (chosen, parameters) = match made.flatten().next() {
        Some(found) => found,
        None => {
            let usual = of(Sex::Neutral, None);
            (mannequin(&usual)?, usual)
        }
    };
    let initial = InitialMannequin {
        sex: parameters.sex,
        mass_kg: parameters
            .mass_kg
            .unwrap_or(chosen.mesh.volume() * KG_PER_CUBIC_MM),
    };
    let (avatar, posture, poses) = posed(&chosen)?;
    Ok(Start {
        avatar,
        posture,
        poses,
        mannequin: initial,
    })
}

/// Returns the initial body with a known mannequin
///
/// # Errors
/// When there is no mannequin of the given stature.
pub(crate) fn start_as(
    scan: &Scan,
    skeleton: &Skeleton,
    views: &[SolvedView],
    initial: InitialMannequin,
    stature_mm: f64,
) -> Result<Start, InitialBodyError> {
    let avatar = mannequin(&MannequinParameters {
        sex: initial.sex,
        mass_kg: Some(initial.mass_kg),
        stature_mm: Some(stature_mm),
        pose: scan.pose,
        ..MannequinParameters::default()
    })?;
    let (avatar, posture, poses) = pose_avatar(scan, skeleton, views, &avatar, stature_mm)?;
    Ok(Start {
        avatar,
        posture,
        poses,
        mannequin: initial,
    })
}

/// Mass of a body over its volume, in kg per mm³
///
/// That of the built-in mannequin: its regressions give 0.966 to 0.980 l per kg over both sexes and all builds.
const KG_PER_CUBIC_MM: f64 = 1.0 / 0.972e6;

/// Fits bone lengths and poses of another avatar, with fixed cameras
fn pose_avatar(
    scan: &Scan,
    skeleton: &Skeleton,
    views: &[SolvedView],
    avatar: &Avatar,
    stature_mm: f64,
) -> Result<(Avatar, Pose, Vec<Pose>), SkeletonFitError> {
    let bundle_views: Vec<KeypointView> = views
        .iter()
        .map(|view| KeypointView {
            turn: view.skeleton().turn,
            turn_sd_radians: match view.skeleton().turn_from {
                TurnFrom::Stated => STATED_TURN_SD_DEGREES.to_radians(),
                TurnFrom::Corrected | TurnFrom::Found => FREE_TURN_SIGMA_RADIANS,
            },
            keypoints: view.skeleton().keypoints,
            ..KeypointView::from(&scan.views[view.id.0])
        })
        .collect();
    let camera = &skeleton.camera;
    let setup = CameraSetup {
        vertical_fov_radians: Some(camera.vertical_fov_radians),
        height_mm: Some(camera.height_mm),
        distance_mm: Some(camera.distance_mm),
        pitch_radians: Some(camera.pitch_radians),
        yaw_radians: Some(camera.yaw_radians),
        distortion: camera.distortion,
    };
    let options = SkeletonFitOptions {
        fix_swaps: false,
        correct_turns: false,
        check_camera: false,
        ..SkeletonFitOptions::default()
    };
    let (posed, views) = fit_skeleton(avatar, &bundle_views, &setup, Some(stature_mm), &options)?;
    let pairs = views.iter().zip(&bundle_views);
    let poses = pairs.map(|(view, given)| view.pose.about_turn(view.turn, given.turn));
    let poses = poses.collect();
    Ok((posed.avatar, posed.posture, poses))
}
