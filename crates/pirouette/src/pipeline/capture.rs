//! Checks of a capture without segmentation and fit: what is wrong or doubtful in each photo.

use thiserror::Error;

use crate::check::{Border, blur_px, is_cut_off};
use crate::pipeline::verdict::MAX_CUT_OFF;
use crate::pipeline::warning::{Warning, turn_warnings};
use crate::pipeline::{AvatarSource, PipelineError, make_avatar, render_priors};
use crate::scan::{Photo, Scan, View};
use crate::skeleton_fit::{
    KeypointView, Skeleton, SkeletonFitOptions, SkeletonView, SwapGroup, TurnFrom, fit_skeleton,
};
use pirouette_body::{Joint, TurnAngle};
use pirouette_geom::Mask;
use pirouette_geom::parallel::prelude::*;

/// Joints of a photo below which a finding is reported
const FEW_JOINTS: usize = 12;

/// Mean gray level of the person below which a photo is dark, 0 to 255
const DARK_LEVEL: f64 = 35.0;

/// Blur that is reported, in mm at the person
const MAX_BLUR_MM: f64 = 4.0;

/// Blur of sharp photos, in px; the outline of the avatar is not exactly that of the person
const SHARP_PX: f64 = 2.5;

/// Something wrong or doubtful in one photo
#[derive(Debug, Clone, PartialEq, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum Finding {
    #[error("only {count} joints were found; show the person from head to toe, in good light")]
    FewJoints { count: usize },
    #[error("the feet are outside the photo; step back, or lower the camera")]
    FeetOutside,
    #[error("the head is outside the photo; step back, or raise the camera")]
    HeadOutside,
    #[error("an arm or hand is outside the photo; step back, or stand in the middle")]
    ArmOutside,
    #[error(
        "the photo is blurred by {blur_mm:.0} mm; focus on the person, use more light, hold still"
    )]
    Blurred { blur_mm: f64 },
    #[error("the person is dark (mean gray level {level:.0}); use more light, not from behind")]
    Dark { level: f64 },
    #[error("left and right were swapped ({}); corrected", limb.name())]
    SidesSwapped { limb: SwapGroup },
    #[error("{} is {residual_px:.0} px from the position predicted by the other joints", joint.name())]
    Outlier { joint: Joint, residual_px: f64 },
}

impl Finding {
    /// Returns the stable code of the finding, for programs
    pub fn code(&self) -> &'static str {
        match self {
            Finding::FewJoints { .. } => "few_joints",
            Finding::FeetOutside => "feet_cut_off",
            Finding::HeadOutside => "head_cut_off",
            Finding::ArmOutside => "arms_cut_off",
            Finding::Blurred { .. } => "blurred",
            Finding::Dark { .. } => "dark",
            Finding::SidesSwapped { .. } => "sides_swapped",
            Finding::Outlier { .. } => "outlier",
        }
    }

    /// Returns whether many such photos give no body
    fn is_serious(&self) -> bool {
        matches!(self, Finding::FeetOutside | Finding::HeadOutside)
    }
}

/// A checked capture
#[derive(Debug)]
pub struct Capture {
    /// The skeleton of all views, with its warnings
    pub skeleton: Skeleton,
    /// Turn angle in use of each view of the scan: as stated, or as found
    pub turns: Vec<TurnAngle>,
    /// The views of the skeleton
    views: Vec<SkeletonView>,
    /// Number of joints found in each view of the scan
    pub joint_counts: Vec<usize>,
    /// What is wrong or doubtful in each view of the scan
    pub findings: Vec<Vec<Finding>>,
}

impl Capture {
    /// Returns the warnings about turn angles that were found; `scan` is the one that was checked
    pub fn turn_warnings(&self, scan: &Scan) -> Vec<Warning> {
        turn_warnings(scan, &self.skeleton, &self.views)
    }

    /// Returns the number of photos that do not show the complete person if they are so many that the scan is refused
    pub fn refused_count(&self) -> Option<usize> {
        let serious = |found: &&Vec<Finding>| found.iter().any(Finding::is_serious);
        let count = self.findings.iter().filter(serious).count();
        (count as f64 > MAX_CUT_OFF * self.findings.len() as f64).then_some(count)
    }
}

/// Checks the photos of a scan by a skeleton that is fitted to their keypoints
///
/// Takes a small part of the time of a scan: nothing is segmented.
///
/// # Errors
/// When the avatar cannot be used, or no skeleton fits.
pub fn check_capture(scan: &Scan, source: &AvatarSource) -> Result<Capture, PipelineError> {
    let (avatar, _) = make_avatar(scan, source)?;
    let views: Vec<KeypointView> = scan.views.iter().map(KeypointView::from).collect();
    let options = SkeletonFitOptions::default();
    let (skeleton, views) = fit_skeleton(&avatar, &views, &scan.camera, scan.stature_mm, &options)?;
    let priors = render_priors(&skeleton.avatar, &views, &|| {});
    let of_view = |index: usize| {
        let photo = &scan.views[index].photo;
        let mut found = Vec::new();
        let count = scan.views[index].keypoints.found_count();
        if count < FEW_JOINTS {
            found.push(Finding::FewJoints { count });
        }
        found.extend(of_photo(photo, &priors[index], &views[index]));
        let swaps = skeleton.swaps.iter().filter(|(view, _)| *view == index);
        found.extend(swaps.map(|&(_, limb)| Finding::SidesSwapped { limb }));
        let outliers = skeleton
            .outliers
            .iter()
            .filter(|outlier| outlier.view == index);
        found.extend(outliers.map(|outlier| Finding::Outlier {
            joint: outlier.joint,
            residual_px: outlier.residual_px,
        }));
        found
    };
    let findings = (0..scan.views.len()).into_par_iter().map(of_view).collect();
    let joint_counts = scan.views.iter().map(|view| view.keypoints.found_count());
    let turn = |(given, view): (&View, &SkeletonView)| match view.turn_from {
        TurnFrom::Stated => given.turn,
        TurnFrom::Corrected | TurnFrom::Found => view.turn.wrapped(),
    };
    Ok(Capture {
        turns: scan.views.iter().zip(&views).map(turn).collect(),
        joint_counts: joint_counts.collect(),
        findings,
        views,
        skeleton,
    })
}

/// Checks one photo; `prior` is the silhouette of the posed avatar
fn of_photo(photo: &Photo, prior: &Mask, view: &SkeletonView) -> Vec<Finding> {
    let mut found = Vec::new();
    let borders = [
        (Border::Bottom, Finding::FeetOutside),
        (Border::Top, Finding::HeadOutside),
        (Border::Side, Finding::ArmOutside),
    ];
    let cut_off = borders
        .into_iter()
        .filter(|(border, _)| is_cut_off(prior, *border));
    found.extend(cut_off.map(|(_, finding)| finding));
    let px_mm = view.camera.distance_mm / view.camera.focal_px();
    if let Some(blur) = blur_px(photo, prior).filter(|&px| px > SHARP_PX) {
        let blur_mm = blur * px_mm;
        if blur_mm > MAX_BLUR_MM {
            found.push(Finding::Blurred { blur_mm });
        }
    }
    if let Some(level) = mean_level(photo, prior).filter(|&level| level < DARK_LEVEL) {
        found.push(Finding::Dark { level });
    }
    found
}

/// Returns the mean gray level inside a mask
fn mean_level(photo: &Photo, mask: &Mask) -> Option<f64> {
    if !photo.same_size(mask) {
        return None;
    }
    let (mut sum, mut count) = (0u64, 0u64);
    for (color, &inside) in photo.as_slice().iter().zip(mask.as_slice()) {
        if inside {
            sum += color.iter().map(|&v| u64::from(v)).sum::<u64>();
            count += 3;
        }
    }
    (count > 0).then(|| sum as f64 / count as f64)
}
