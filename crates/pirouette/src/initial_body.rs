//! Which mannequin a fit starts from: the sex and the build that explain the silhouettes best.

use rayon::prelude::*;

use crate::body_fit::{
    BodyFitOptions, BodyFitPrior, BodyFitView, Outlines, fit_outlines, rigid_residual,
};
use crate::scan::{CameraSetup, Scan};
use crate::skeleton_fit::{
    KeypointView, Skeleton, SkeletonFitError, SkeletonFitOptions, fit_skeleton,
};
use crate::view::SolvedView;
use pirouette_body::Avatar;
use pirouette_body::Pose;
use pirouette_body::Sex;
use pirouette_body::mannequin::{MannequinError, MannequinParameters, coarse_mannequin, mannequin};

/// Why there is no body to start from
#[derive(Debug)]
pub(crate) enum InitialBodyError {
    /// No mannequin of that stature
    Mannequin(MannequinError),
    /// No skeleton with that mannequin
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

/// A body to start a fit from
#[derive(Debug)]
pub(crate) struct Start {
    /// The mannequin with the person's bone lengths
    pub(crate) avatar: Avatar,
    /// Pose that sway goes about
    pub(crate) posture: Pose,
    /// Pose of each view that went through, in their order
    pub(crate) poses: Vec<Pose>,
    /// Whose proportions it has
    pub(crate) figure: InitialMannequin,
}

/// The mannequin that a fit started from
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InitialMannequin {
    /// Whose proportions it has; says nothing for sure about the person
    pub sex: Sex,
    /// Its mass, in kg
    pub mass_kg: f64,
}

/// The views of a fit that starts from some poses
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
            pose,
            stature_mm,
        })
        .collect()
}

/// Tries women and men of the mass that the silhouettes ask for
///
/// The mass follows from the volume of a first rough fit, which hardly depends on where it starts. The sex is that of the
/// mannequin whose unfitted surface, in its best poses, lies nearest to the outlines: on rendered women and men the wrong
/// sex is 10 to 30 % farther off, while after four rounds of fitting the difference is 1 to 4 %. Coarse mannequins give
/// both. Where no mannequin has such a mass, it is one of usual mass.
///
/// # Errors
/// When there is no mannequin of that stature at all.
pub(crate) fn choose_start(
    scan: &Scan,
    skeleton: &Skeleton,
    views: &[SolvedView],
    outlines: &Outlines,
    stature_mm: f64,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> Result<Start, InitialBodyError> {
    let posed = |figure: &Avatar| pose_figure(scan, skeleton, views, figure, stature_mm);
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
    let (avatar, posture, poses) = posed(&chosen)?;
    Ok(Start {
        figure: InitialMannequin {
            sex: parameters.sex,
            mass_kg: parameters
                .mass_kg
                .unwrap_or(chosen.mesh.volume() * KG_PER_CUBIC_MM),
        },
        avatar,
        posture,
        poses,
    })
}

/// Mass of a body over its volume, in kg per mm³
///
/// The built-in mannequin's own: its regressions give 0.966 to 0.980 l per kg over both sexes and all builds.
const KG_PER_CUBIC_MM: f64 = 1.0 / 0.972e6;

/// Bone lengths and poses of another figure, seen by the same cameras
fn pose_figure(
    scan: &Scan,
    skeleton: &Skeleton,
    views: &[SolvedView],
    figure: &Avatar,
    stature_mm: f64,
) -> Result<(Avatar, Pose, Vec<Pose>), SkeletonFitError> {
    let bundle_views: Vec<KeypointView> = views
        .iter()
        .map(|view| KeypointView {
            turn: view.skeleton().turn,
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
    };
    let options = SkeletonFitOptions {
        fix_swaps: false,
        correct_turns: false,
        ..SkeletonFitOptions::default()
    };
    let (posed, views) = fit_skeleton(figure, &bundle_views, &setup, Some(stature_mm), &options)?;
    let poses = views.iter().map(|view| view.pose).collect();
    Ok((posed.avatar, posed.posture, poses))
}
