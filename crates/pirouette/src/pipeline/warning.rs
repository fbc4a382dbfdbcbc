//! Warnings: automatic corrections and rejected views.

use thiserror::Error;

use crate::measure::{Covering, Measure};
use crate::normalize::NormalizeWarning;
use crate::pipeline::{DropReason, Stage};
use crate::scan::Scan;
use crate::skeleton_fit::{
    Skeleton, SkeletonFitError, SkeletonFitWarning, SkeletonView, SwapGroup, TurnFrom,
};
use pirouette_body::Joint;
use pirouette_body::gltf::HullUsed;

/// An automatic correction, a rejected view or an inconsistency; the job continues
#[derive(Debug, Clone, PartialEq, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum Warning {
    #[error("view {view} is rejected ({}): {reason}", stage.name())]
    ViewDropped {
        view: String,
        stage: Stage,
        reason: DropReason,
    },
    #[error(
        "no skeleton fits all views; each photo is segmented with the bones detected in it: {0}"
    )]
    NoSkeleton(SkeletonFitError),
    #[error("avatar: {0}")]
    AvatarClosed(HullUsed),
    #[error("{0}")]
    Skeleton(SkeletonFitWarning),
    #[error(
        "turn angles were found in the photos; by the joints alone, their standard deviations are up to {sd_degrees:.1} degrees"
    )]
    TurnsFound { sd_degrees: f64 },
    #[error(
        "stated turn angles are wrong, and those found in the photos are used: {}; correct angle_deg in scan.json",
        list(views)
    )]
    TurnsWrong { views: Vec<TurnChange> },
    #[error(
        "view {view}: the turn angle is uncertain, as another one explains the keypoints as well; {degrees:.0} degrees are used"
    )]
    TurnUnclear { view: String, degrees: f64 },
    #[error("view {view}: swapped left and right were corrected ({})", limb.name())]
    SidesSwapped { view: String, limb: SwapGroup },
    #[error("view {view}: {} is {residual_px:.0} px from the position predicted by the other joints", joint.name())]
    Outlier {
        view: String,
        joint: Joint,
        residual_px: f64,
    },
    #[error(
        "the keypoints are those of MediaPipe: standard deviations are larger than with keypoints of OpenPose, most of \
         all for shoulder width and back length"
    )]
    KeypointsDetected,
    #[error(
        "keypoints were estimated from the photos without a detector: standard deviations are larger, most of all for \
         shoulder width and arm length; install the pose detector with 'pirouette models install', or provide keypoints"
    )]
    KeypointsEstimated,
    #[error(
        "the body matches the silhouettes with an overlap of {overlap:.3} only: standard deviations are larger; \
         check contact.jpg"
    )]
    LowOverlap { overlap: f64 },
    #[error(
        "the photos are blurred by {blur_mm:.0} mm: standard deviations are larger; focus on the person, in more light"
    )]
    Blurred { blur_mm: f64 },
    #[error(
        "the given masks reach {} mm {} the edges of the photos: standard deviations are larger",
        excess_mm.abs().round(), if *excess_mm > 0.0 { "beyond" } else { "short of" }
    )]
    MasksOffEdges { excess_mm: f64 },
    #[error(
        "the person is small in the photos: a pixel shows {px_mm:.1} mm, and standard deviations are larger; \
         take larger photos, or stand nearer"
    )]
    SmallPerson { px_mm: f64 },
    #[error(
        "the camera seems to be tilted by {pitch_degrees:.1} degrees, or the photos to be cropped at one end: \
         standard deviations are larger; hold the camera level"
    )]
    CameraTilted { pitch_degrees: f64 },
    #[error(
        "the head is higher or lower in {view_count} views than in the others: standard deviations are larger; \
         check that all photos show the same person, before a camera that does not move or zoom"
    )]
    OtherHeights { view_count: usize },
    #[error("arms or hands are outside the photo in {view_count} views")]
    ArmsCutOff { view_count: usize },
    #[error(
        "the body has {mass_kg:.0} kg by its volume, {stated_kg:.0} kg are given: standard deviations are larger; \
         check subject.stature_mm and subject.mass_kg"
    )]
    MassContradicted { stated_kg: f64, mass_kg: f64 },
    #[error(
        "clothes, hair or shoes probably cover {}: measures there are those of the body below as far as the rest shows it, with \
         larger standard deviations; wear tight clothes, tie up long hair, or give subject.clothes; --surface clothed \
         measures what is seen",
        list_parts(parts)
    )]
    Covered { parts: Vec<Covering> },
    #[error(
        "the person wears a skirt or a dress down to {hem_mm:.0} mm above the floor: the measures of the body below it are \
         estimates; wear tight clothes"
    )]
    Skirt { hem_mm: f64 },
    #[error("view {view}: {warning}")]
    Normalize {
        view: String,
        warning: NormalizeWarning,
    },
    #[error(
        "{}: {lines_mm:.0} mm by the outlines, {body_mm:.0} mm by the fitted body; check the silhouettes there",
        measure.name().replace('_', " ")
    )]
    TapesDiffer {
        measure: Measure,
        lines_mm: f64,
        body_mm: f64,
    },
}

/// A view with a wrong turn angle
#[derive(Debug, Clone, PartialEq)]
pub struct TurnChange {
    /// Its name
    pub view: String,
    /// The stated angle, in degrees
    pub stated_degrees: f64,
    /// The angle in use, in degrees
    pub found_degrees: f64,
}

fn list(views: &[TurnChange]) -> String {
    let changes = views.iter().map(|change| {
        let (view, stated) = (&change.view, change.stated_degrees);
        format!(
            "view {view} {:.0} instead of {stated:.0} degrees",
            change.found_degrees
        )
    });
    changes.collect::<Vec<String>>().join(", ")
}

/// Lists covered parts with their probabilities
fn list_parts(parts: &[Covering]) -> String {
    let parts = parts.iter().map(|covering| {
        let percent = 100.0 * covering.covered;
        format!("the {} ({percent:.0} %)", covering.part.name())
    });
    parts.collect::<Vec<String>>().join(", ")
}

impl Warning {
    /// Returns the view concerned, if the warning concerns a single view
    pub fn view(&self) -> Option<&str> {
        match self {
            Warning::ViewDropped { view, .. }
            | Warning::TurnUnclear { view, .. }
            | Warning::SidesSwapped { view, .. }
            | Warning::Outlier { view, .. }
            | Warning::Normalize { view, .. } => Some(view),
            Warning::NoSkeleton(_)
            | Warning::AvatarClosed(_)
            | Warning::Skeleton(_)
            | Warning::TurnsFound { .. }
            | Warning::TurnsWrong { .. }
            | Warning::CameraTilted { .. }
            | Warning::KeypointsDetected
            | Warning::KeypointsEstimated
            | Warning::LowOverlap { .. }
            | Warning::Blurred { .. }
            | Warning::MasksOffEdges { .. }
            | Warning::SmallPerson { .. }
            | Warning::OtherHeights { .. }
            | Warning::ArmsCutOff { .. }
            | Warning::MassContradicted { .. }
            | Warning::Covered { .. }
            | Warning::Skirt { .. }
            | Warning::TapesDiffer { .. } => None,
        }
    }

    /// Returns the stable code of the warning, for programs
    pub fn code(&self) -> &'static str {
        match self {
            Warning::ViewDropped { .. } => "view_dropped",
            Warning::NoSkeleton(_) => "no_skeleton",
            Warning::AvatarClosed(_) => "avatar_closed",
            Warning::Skeleton(warning) => match warning {
                SkeletonFitWarning::StatureUnknown { .. } => "stature_unknown",
                SkeletonFitWarning::FieldOfViewUnknown { .. } => "field_of_view_unknown",
                SkeletonFitWarning::CameraHeightUnknown { .. } => "camera_height_unknown",
                SkeletonFitWarning::CameraContradicted { .. } => "camera_contradicted",
                SkeletonFitWarning::BesideMiddle { .. } => "beside_middle",
                SkeletonFitWarning::TurnedBackward => "turned_backward",
                SkeletonFitWarning::TurnsHalved => "turns_halved",
                SkeletonFitWarning::TurnsShifted { .. } => "turns_shifted",
                SkeletonFitWarning::TurnsGap { .. } => "turns_gap",
                SkeletonFitWarning::ViewWithoutKeypoints { .. } => "view_without_keypoints",
                SkeletonFitWarning::StatureContradicted { .. } => "stature_contradicted",
                SkeletonFitWarning::UnusualLength { .. } => "unusual_length",
                SkeletonFitWarning::NotConverged => "skeleton_not_settled",
            },
            Warning::TurnsFound { .. } => "turns_found",
            Warning::TurnsWrong { .. } => "turns_wrong",
            Warning::TurnUnclear { .. } => "turn_unclear",
            Warning::SidesSwapped { .. } => "sides_swapped",
            Warning::Outlier { .. } => "outlier",
            Warning::KeypointsDetected => "keypoints_detected",
            Warning::KeypointsEstimated => "keypoints_estimated",
            Warning::LowOverlap { .. } => "low_overlap",
            Warning::Blurred { .. } => "blurred",
            Warning::MasksOffEdges { .. } => "masks_off_edges",
            Warning::SmallPerson { .. } => "small_person",
            Warning::CameraTilted { .. } => "camera_tilted",
            Warning::OtherHeights { .. } => "other_heights",
            Warning::ArmsCutOff { .. } => "arms_cut_off",
            Warning::MassContradicted { .. } => "mass_contradicted",
            Warning::Covered { .. } => "covered",
            Warning::Skirt { .. } => "skirt",
            Warning::TapesDiffer { .. } => "tapes_differ",
            Warning::Normalize { warning, .. } => match warning {
                NormalizeWarning::NoHandles => "no_handles",
                NormalizeWarning::FewHandles { .. } => "few_handles",
            },
        }
    }
}

/// Returns whether a warning concerns lengths in mm only
pub(super) fn is_about_scale(warning: SkeletonFitWarning) -> bool {
    matches!(
        warning,
        SkeletonFitWarning::StatureUnknown { .. }
            | SkeletonFitWarning::FieldOfViewUnknown { .. }
            | SkeletonFitWarning::CameraHeightUnknown { .. }
            | SkeletonFitWarning::StatureContradicted { .. }
    )
}

/// Returns the warnings about turn angles that were found
pub(super) fn turn_warnings(
    scan: &Scan,
    skeleton: &Skeleton,
    views: &[SkeletonView],
) -> Vec<Warning> {
    let name = |index: usize| scan.views[index].name.clone();
    let unclear = skeleton
        .unclear_turns
        .iter()
        .map(|&index| Warning::TurnUnclear {
            view: name(index),
            degrees: views[index].turn.wrapped().degrees(),
        });
    let found = views
        .iter()
        .filter(|view| view.turn_from == TurnFrom::Found);
    let sd = found.map(|view| view.turn_sd_radians).reduce(f64::max);
    let found = sd.map(|sd| Warning::TurnsFound {
        sd_degrees: sd.to_degrees(),
    });
    let wrong = skeleton.wrong_turns.iter().map(|wrong| TurnChange {
        view: name(wrong.view),
        stated_degrees: wrong.stated.wrapped().degrees(),
        found_degrees: wrong.found.wrapped().degrees(),
    });
    let views: Vec<TurnChange> = wrong.collect();
    let wrong = (!views.is_empty()).then_some(Warning::TurnsWrong { views });
    unclear.chain(found).chain(wrong).collect()
}
