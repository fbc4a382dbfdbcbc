//! Checks of a scan before any stage: what is certainly wrong is corrected with a warning, or refused.
//!
//! A mistake in the input that the stages cannot notice gives a body that looks right and is wrong: a photo given eight
//! times, a pose stated wrongly, joints that were not found but have a confidence.

mod distortion;
mod duplicates;
mod pose;
mod silhouettes;

use glam::DVec2;
use thiserror::Error;

use crate::scan::{Scan, View};
use pirouette_body::{Joint, Keypoint, Keypoints, ReferencePose};

pub(crate) use silhouettes::{
    Border, blur_px, cut_off_views, excess_px, is_cut_off, other_heights,
};

/// Minimum number of different photos of a body
const MIN_PHOTOS: usize = 3;

/// Why a scan cannot be used
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CheckError {
    /// Too few photos differ
    #[error(
        "{} of the {photo_count} photos show the same moment as {first}: \
         the person must turn between photos; check that different photos were copied",
        photo_count - different_count
    )]
    SamePhotos {
        /// Number of photos
        photo_count: usize,
        /// Number of photos that differ from each other
        different_count: usize,
        /// Name of the view that the others repeat
        first: String,
    },
}

/// A correction of a scan
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum CheckWarning {
    /// The joints show another pose than the stated one
    #[error(
        "the joints show {} instead of the stated pose: {} is assumed; correct `pose` in scan.json",
        pose_name(*found), pose_name(*found)
    )]
    OtherPose {
        /// The pose by the joints
        found: ReferencePose,
    },
    /// The lens bends straight edges of the room
    #[error(
        "the lens bends straight edges of the room: a distortion of {percent:.0} % at half the height of the photos is \
         corrected; use a lens that is not wide-angle, at a larger distance"
    )]
    LensDistorted {
        /// Shift of the photo's upper edge by the lens, in percent of half the height; negative if outward
        percent: f64,
    },
}

impl CheckWarning {
    /// Returns the stable code of the warning, for programs
    pub fn code(&self) -> &'static str {
        match self {
            CheckWarning::OtherPose { .. } => "other_pose",
            CheckWarning::LensDistorted { .. } => "lens_distorted",
        }
    }
}

fn pose_name(pose: ReferencePose) -> &'static str {
    match pose {
        ReferencePose::A => "an A-pose",
        ReferencePose::T => "a T-pose",
    }
}

/// What [`check_scan`] found
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Checked {
    /// Corrections of the scan
    pub warnings: Vec<CheckWarning>,
    /// Views that repeat the photo of an earlier view at another angle, and that view; to be left out
    pub repeats: Vec<(usize, usize)>,
}

/// Checks a scan and corrects what is certainly wrong
///
/// Joints at the corner of the photo are not found, whatever their confidence: detectors write 0, 0 for them. A pose
/// that the joints contradict is replaced. The distortion of the lens is found by the edges of the room. Views with
/// repeated photos are reported, not removed.
///
/// # Errors
/// When fewer than three different photos are left of three or more.
pub fn check_scan(scan: &mut Scan) -> Result<Checked, CheckError> {
    for view in &mut scan.views {
        drop_corner_joints(view);
    }
    let repeats = duplicates::find_repeats(&scan.views);
    let different_count = scan.views.len() - repeats.len();
    if let (Some(&(_, first)), true) = (repeats.first(), different_count < MIN_PHOTOS) {
        return Err(CheckError::SamePhotos {
            photo_count: scan.views.len(),
            different_count,
            first: scan.views[first].name.clone(),
        });
    }
    let mut warnings = Vec::new();
    if let Some(found) = pose::pose_by_joints(&scan.views).filter(|found| *found != scan.pose) {
        scan.pose = found;
        warnings.push(CheckWarning::OtherPose { found });
    }
    if let Some(coefficient) = distortion::find_distortion(&scan.views) {
        scan.camera.distortion = coefficient;
        warnings.push(CheckWarning::LensDistorted {
            percent: 100.0 * coefficient,
        });
    }
    Ok(Checked { warnings, repeats })
}

/// Marks joints at the corner of the photo as not found
fn drop_corner_joints(view: &mut View) {
    for joint in Joint::ALL {
        let Keypoint {
            position,
            confidence,
        } = view.keypoints.get(joint);
        if confidence > 0.0 && position == DVec2::ZERO {
            view.keypoints.set(joint, Keypoint::default());
        }
    }
}

/// Returns the median, the upper one of an even number of values
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Returns the found joints' bounding box, in px
fn joint_box(keypoints: &Keypoints) -> Option<(DVec2, DVec2)> {
    let found = Joint::ALL.iter().filter_map(|&j| keypoints.found(j));
    found
        .map(|k| (k.position, k.position))
        .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}
