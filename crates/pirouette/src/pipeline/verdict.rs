//! Judgment of a fitted body before it is measured: refuse, or widen the standard deviations.
//!
//! A mistake in the input leaves a body that does not match the photos. A low overlap of the posed body with the silhouettes
//! reveals most mistakes, whatever their cause.

use glam::DVec2;
use thiserror::Error;

use crate::check::{Border, blur_px, cut_off_views, excess_px, median, other_heights};
use crate::measure::ExtraSd;
use crate::pipeline::{Report, Warning};
use crate::scan::{KeypointSource, Scan, View};
use crate::skeleton_fit::{Skeleton, SkeletonFitWarning};
use pirouette_body::Joint;
use pirouette_geom::parallel::prelude::*;

/// Mean overlap (IoU) of the posed body with the silhouettes below which a body is refused
///
/// Of bodies below 0.95, three of four are 45 mm or more off at some girth; healthy scans reach 0.96.
const MIN_OVERLAP: f64 = 0.94;

/// Overlap below which standard deviations grow, and their share of a value at [`MIN_OVERLAP`]
const GOOD_OVERLAP: f64 = 0.962;
const SHARE_AT_MIN: f64 = 0.05;

/// Share of the views in which a border of the photo may cut off the feet or the head
pub(super) const MAX_CUT_OFF: f64 = 0.3;

/// Share of the views in which the crown may have another height, of at least two
const MAX_OTHER_HEIGHTS: f64 = 0.24;

/// Standard deviation due to a view in which the crown has another height, as a share of a value
///
/// One photo of eight that shows another person changes girths by up to 2 %.
const OTHER_HEIGHT_SHARE: f64 = 0.01;

/// Standard deviation due to a bone of unusual length, as a share of a value
///
/// Healthy scans have none; wrong values of the camera shorten or lengthen bones.
const UNUSUAL_LENGTH_SHARE: f64 = 0.03;

/// Standard deviation due to an unknown field of view, as a share of a value
///
/// Parts of the body nearer to the camera look larger by a factor that depends on its distance.
const UNKNOWN_FOV_SHARE: f64 = 0.006;

/// Median horizontal distance of the keypoints from the fitted body's joints that is refused, in mm
///
/// Healthy scans: below 4 mm.
const MAX_SHIFT_MM: f64 = 14.0;

/// Median distance of the keypoints below the fitted body's joints that is refused, in mm
///
/// Detectors place joints 9 mm above those of the body to 1 mm below. Bodies follow keypoints that are 50 mm too low, to 9
/// to 14 mm; those that are 50 mm too high lose overlap.
const MAX_LOWERED_MM: f64 = 8.5;

/// Distance of given masks from the edges of the photos that is usual, in px
///
/// Silhouettes of rendered people: below 0.4.
const USUAL_EXCESS_PX: f64 = 0.5;

/// Pitch that the usual standard deviations include, in degrees, and the share of a value per degree beyond it
///
/// A camera that is not level looks like a photo that was cropped or padded at one end, but shows the body differently.
const USUAL_PITCH_DEGREES: f64 = 4.0;
const SHARE_PER_PITCH_DEGREE: f64 = 0.006;

/// Pitch above which heights are less certain, in degrees, and their share of a height per degree beyond it
///
/// Estimated pitches of level cameras are below 0.3 degrees. Photos that were padded below or cropped above look pitched by
/// 2.7 to 5 degrees, and the crotch is then 15 to 26 mm too high.
const LEVEL_PITCH_DEGREES: f64 = 1.2;
const HEIGHT_SHARE_PER_PITCH_DEGREE: f64 = 0.003;

/// Blur of photos that the usual standard deviations include, in mm at the person
const USUAL_BLUR_MM: f64 = 2.5;

/// Blur of sharp photos, in px
const SHARP_PX: f64 = 1.6;

/// Size of a pixel at the person that the usual standard deviations include, in mm, and the error of the position of an
/// outline per size beyond it
const USUAL_PX_MM: f64 = 4.5;
const ERROR_PER_PX: f64 = 0.2;

/// Error of the position of an outline per blur beyond the usual one
///
/// Blurred photos of rendered people: girths of 290 to 970 mm are 0 to 24 mm too large at a blur of 6 mm, 23 to 44
/// mm at one of 11 mm.
const ERROR_PER_BLUR: f64 = 0.45;

/// Most likely cause of a body that does not match the silhouettes
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Suspect {
    /// Given masks, which are most silhouettes
    Masks,
    /// Given or detected keypoints, or the turn angles
    Keypoints,
    /// Estimated keypoints, or the turn angles
    Estimate,
    /// The mesh that is measured
    Mesh,
}

impl Suspect {
    fn advice(self) -> &'static str {
        match self {
            Suspect::Masks => {
                "check that the masks show the person in white, and belong to these photos"
            }
            Suspect::Mesh => {
                "check that the mesh shows one person, upright in A-pose, T-pose or with hanging arms"
            }
            Suspect::Keypoints => {
                "check that the keypoints belong to these photos (order, size, rotation), and the turn angles"
            }
            Suspect::Estimate => {
                "check the turn angles, or install the pose detector with 'pirouette models install', since the estimated \
                 joints may be wrong"
            }
        }
    }
}

/// Why a job has no body and no measurements
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum Refusal {
    /// The body does not match the silhouettes
    #[error(
        "no body and no measurements: the body matches the silhouettes with an overlap of only {overlap:.2}; {}; see contact.jpg",
        suspect.advice()
    )]
    NoMatch {
        /// Mean intersection over union of the posed body with the silhouettes
        overlap: f64,
        /// The most likely cause
        suspect: Suspect,
    },
    /// The keypoints lie beside the person
    #[error(
        "no body and no measurements: the keypoints lie {} the body's joints in the photos; \
         check that they belong to these photos (crop, size)",
        describe_shift(*shift_px)
    )]
    KeypointsShifted {
        /// Median shift to the right and down, in px
        shift_px: DVec2,
    },
    /// The photos do not show the feet
    #[error(
        "no body and no measurements: the feet are outside the photo in {view_count} views; show the person from head to toe"
    )]
    FeetCutOff {
        /// Number of these views
        view_count: usize,
    },
    /// The photos do not show the head
    #[error(
        "no body and no measurements: the head is outside the photo in {view_count} views; show the person from head to toe"
    )]
    HeadCutOff {
        /// Number of these views
        view_count: usize,
    },
    /// The photos show people of different heights, or the camera was moved
    #[error(
        "no body and no measurements: the head is higher or lower in {view_count} views than in the others; \
         check that all photos show the same person, before a camera that does not move or zoom"
    )]
    OtherHeights {
        /// Number of these views
        view_count: usize,
    },
}

impl Refusal {
    /// Returns the stable code of the reason, for programs
    pub fn code(&self) -> &'static str {
        match self {
            Refusal::NoMatch { .. } => "no_match",
            Refusal::KeypointsShifted { .. } => "keypoints_shifted",
            Refusal::FeetCutOff { .. } => "feet_cut_off",
            Refusal::HeadCutOff { .. } => "head_cut_off",
            Refusal::OtherHeights { .. } => "other_heights",
        }
    }
}

/// Describes the larger part of a shift, in px to the right and down
fn describe_shift(shift_px: DVec2) -> String {
    let (along, direction) = if shift_px.x.abs() >= shift_px.y.abs() {
        (shift_px.x, ["left of", "right of"])
    } else {
        (shift_px.y, ["above", "below"])
    };
    format!(
        "{:.0} px {}",
        along.abs(),
        direction[usize::from(along > 0.0)]
    )
}

/// Returns why the body must be refused, if there is a reason
pub(super) fn judge(scan: &Scan, report: &Report) -> Option<Refusal> {
    let count = report.views.len();
    let masks = || report.views.iter().map(|view| &view.silhouette.mask);
    let cut_off = |border| {
        let view_count = cut_off_views(masks(), border);
        (view_count as f64 > MAX_CUT_OFF * count as f64).then_some(view_count)
    };
    if let Some(view_count) = cut_off(Border::Bottom) {
        return Some(Refusal::FeetCutOff { view_count });
    }
    if let Some(view_count) = cut_off(Border::Top) {
        return Some(Refusal::HeadCutOff { view_count });
    }
    let view_count = other_heights(masks()).len();
    if view_count > 1 && view_count as f64 > MAX_OTHER_HEIGHTS * count as f64 {
        return Some(Refusal::OtherHeights { view_count });
    }
    let shift_px = keypoint_shift_px(scan, report);
    if let (Some(shift_px), Some(px_mm)) = (shift_px, px_mm(report))
        && (shift_px.x.abs() * px_mm > MAX_SHIFT_MM || shift_px.y * px_mm > MAX_LOWERED_MM)
    {
        return Some(Refusal::KeypointsShifted { shift_px });
    }
    let overlap = report.mean_fit_iou()?;
    let most = |of: &dyn Fn(&View) -> bool| {
        let found = report
            .views
            .iter()
            .filter(|view| of(&scan.views[view.id.0]));
        2 * found.count() > count
    };
    let suspect = if scan.surface.is_some() {
        Suspect::Mesh
    } else if most(&|view| view.mask.is_some()) {
        Suspect::Masks
    } else if most(&|view| view.keypoints_from == KeypointSource::Estimate) {
        Suspect::Estimate
    } else {
        Suspect::Keypoints
    };
    (overlap < MIN_OVERLAP).then_some(Refusal::NoMatch { overlap, suspect })
}

/// Returns the median shift of the keypoints from the joints of the fitted body, in px
///
/// Horizontal offsets of a detector from the joints cancel over left and right, front and back. Estimated keypoints come
/// from these photos.
fn keypoint_shift_px(scan: &Scan, report: &Report) -> Option<DVec2> {
    let fit = report.fit.as_ref()?;
    let shifts: Vec<DVec2> = report
        .views
        .iter()
        .filter(|view| scan.views[view.id.0].keypoints_from != KeypointSource::Estimate)
        .filter_map(|view| Some((view.fit?, view.skeleton.as_ref()?)))
        .flat_map(|(fitted, skeleton)| {
            let posed = fit.avatar.posed(&fitted.pose, skeleton.turn).bones;
            let joints = posed.keypoints(&fit.avatar.keypoints);
            let shift = move |joint: Joint| {
                let seen = skeleton.keypoints.found(joint)?.position;
                Some(seen - fitted.camera.project(joints[joint]))
            };
            Joint::ALL.into_iter().filter_map(shift).collect::<Vec<_>>()
        })
        .collect();
    let middle = |of: fn(&DVec2) -> f64| median(&mut shifts.iter().map(of).collect::<Vec<_>>());
    Some(DVec2::new(
        middle(|shift| shift.x)?,
        middle(|shift| shift.y)?,
    ))
}

/// What makes the measurements of a job less accurate than usual
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Doubts {
    /// Mean overlap of the body with the silhouettes, if it is low
    overlap: Option<f64>,
    /// Blur of the photos, in mm at the person, if it is large
    blur_mm: Option<f64>,
    /// Size of a pixel at the person, in mm, if it is large
    px_mm: Option<f64>,
    /// Yaw of the camera, if the person stands beside the middle of the photos
    yaw_radians: f64,
    /// Distance by which given masks reach beyond the edges of the photos, in mm at the person, if it is large
    excess_mm: Option<f64>,
    /// Estimated pitch of the camera; 0 if it was given
    pitch_degrees: f64,
    /// Standard deviation, as a share of a value, due to a skeleton that contradicts the stature or human proportions
    skeleton_share: f64,
    /// Whether the field of view was estimated
    unknown_fov: bool,
    /// Number of views in which the photo's border cuts off an arm
    cut_arms: usize,
    /// Number of views in which the crown has another height
    other_heights: usize,
}

impl Doubts {
    pub(super) fn of(scan: &Scan, report: &Report) -> Self {
        let overlap = report.mean_fit_iou().filter(|&iou| iou < GOOD_OVERLAP);
        let masks = || report.views.iter().map(|view| &view.silhouette.mask);
        let skeleton = report.skeleton.as_ref();
        let free = skeleton.filter(|_| scan.camera.pitch_radians.is_none());
        let pitch_radians = free.map_or(0.0, |skeleton| skeleton.camera.pitch_radians);
        Self {
            overlap,
            blur_mm: blur_mm(scan, report).filter(|&blur| blur > USUAL_BLUR_MM),
            px_mm: px_mm(report).filter(|&size| size > USUAL_PX_MM),
            excess_mm: excess_mm(scan, report),
            pitch_degrees: pitch_radians.to_degrees(),
            yaw_radians: skeleton.map_or(0.0, |skeleton| skeleton.camera.yaw_radians),
            skeleton_share: skeleton.map_or(0.0, skeleton_share),
            unknown_fov: scan.camera.vertical_fov_radians.is_none(),
            cut_arms: cut_off_views(masks(), Border::Side),
            other_heights: other_heights(masks()).len(),
        }
    }

    /// Returns the warnings that state them; those of yaw, field of view, stature and proportions are the skeleton's
    pub(super) fn warnings(&self) -> Vec<Warning> {
        let Self {
            overlap,
            blur_mm,
            px_mm,
            excess_mm,
            pitch_degrees,
            cut_arms,
            other_heights,
            ..
        } = *self;
        let tilted = pitch_degrees.abs() > USUAL_PITCH_DEGREES;
        let cut_off = (cut_arms > 0).then_some(Warning::ArmsCutOff {
            view_count: cut_arms,
        });
        [
            overlap.map(|overlap| Warning::LowOverlap { overlap }),
            blur_mm.map(|blur_mm| Warning::Blurred { blur_mm }),
            excess_mm.map(|excess_mm| Warning::MasksOffEdges { excess_mm }),
            px_mm.map(|px_mm| Warning::SmallPerson { px_mm }),
            tilted.then_some(Warning::CameraTilted { pitch_degrees }),
            cut_off,
            (other_heights > 0).then_some(Warning::OtherHeights {
                view_count: other_heights,
            }),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    /// Returns the additional standard deviation of the measurements
    pub(super) fn extra_sd(&self) -> ExtraSd {
        let low = self.overlap.map_or(0.0, |overlap| {
            (GOOD_OVERLAP - overlap) / (GOOD_OVERLAP - MIN_OVERLAP) * SHARE_AT_MIN
        });
        // A photo cropped at one side is stretched less than that of a camera turned aside.
        let stretch = 0.5 * (self.yaw_radians.cos().powi(-2) - 1.0);
        let perspective = if self.unknown_fov {
            UNKNOWN_FOV_SHARE
        } else {
            0.0
        };
        let beyond = |usual_degrees: f64| f64::max(self.pitch_degrees.abs() - usual_degrees, 0.0);
        let tilt = SHARE_PER_PITCH_DEGREE * beyond(USUAL_PITCH_DEGREES);
        let blur_mm = self.blur_mm.map_or(0.0, |blur| {
            ERROR_PER_BLUR * (blur * blur - USUAL_BLUR_MM * USUAL_BLUR_MM).sqrt()
        });
        let pixel_mm = self
            .px_mm
            .map_or(0.0, |size| ERROR_PER_PX * (size - USUAL_PX_MM));
        ExtraSd {
            share: low
                .hypot(stretch)
                .hypot(perspective)
                .hypot(tilt)
                .hypot(OTHER_HEIGHT_SHARE * self.other_heights as f64)
                .hypot(self.skeleton_share),
            length_share: HEIGHT_SHARE_PER_PITCH_DEGREE * beyond(LEVEL_PITCH_DEGREES),
            outline_mm: blur_mm.hypot(pixel_mm).hypot(self.excess_mm.unwrap_or(0.0)),
        }
    }
}

/// Returns how far a skeleton contradicts the stature or human proportions, as a share of a length
fn skeleton_share(skeleton: &Skeleton) -> f64 {
    let share = |warning: &SkeletonFitWarning| match *warning {
        SkeletonFitWarning::StatureContradicted {
            given_mm,
            solved_mm,
        } => (solved_mm / given_mm - 1.0).abs(),
        SkeletonFitWarning::UnusualLength { .. } => UNUSUAL_LENGTH_SHARE,
        _ => 0.0,
    };
    skeleton.warnings.iter().map(share).fold(0.0, f64::max)
}

/// Returns the median blur of the photos, in mm at the person
fn blur_mm(scan: &Scan, report: &Report) -> Option<f64> {
    let blur = |view: &crate::view::SolvedView| {
        let photo = &scan.views[view.id.0].photo;
        // The outline of a given mask need not lie on edges of the photo.
        let found = view.silhouette.seeds.is_some();
        let px = found.then(|| blur_px(photo, &view.silhouette.mask))??;
        Some(if px > SHARP_PX {
            px * px_mm(report)?
        } else {
            0.0
        })
    };
    let mut blurs: Vec<f64> = report.views.par_iter().filter_map(blur).collect();
    median(&mut blurs)
}

/// Returns the size of a pixel at the turning axis, in mm
fn px_mm(report: &Report) -> Option<f64> {
    let camera = &report.skeleton.as_ref()?.camera;
    Some(camera.distance_mm / camera.focal_px())
}

/// Returns the median distance of given masks from the edges of the photos, in mm at the person, if it is large
fn excess_mm(scan: &Scan, report: &Report) -> Option<f64> {
    let excess = |view: &crate::view::SolvedView| {
        let scan = &scan.views[view.id.0];
        excess_px(&scan.photo, scan.mask.as_ref()?)
    };
    let mut all: Vec<f64> = report.views.par_iter().filter_map(excess).collect();
    let excess = median(&mut all).filter(|excess| excess.abs() > USUAL_EXCESS_PX)?;
    Some(excess * px_mm(report)?)
}
