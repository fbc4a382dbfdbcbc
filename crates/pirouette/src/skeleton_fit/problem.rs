//! Errors and warnings of the fit.

use thiserror::Error;

use super::doubts::CameraParameter;
use super::scales::BoneScale;
use super::{MAX_STATURE_MM, MIN_STATURE_MM, found_turns, start};

/// Assumption or problem of the fit
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum SkeletonFitWarning {
    /// All lengths are in units of the assumed stature
    #[error(
        "the stature is unknown: all lengths assume {assumed_mm:.0} mm; give subject.stature_mm in scan.json"
    )]
    StatureUnknown {
        /// Stature of the avatar, in mm
        assumed_mm: f64,
    },
    /// The field of view was estimated, with little evidence
    #[error(
        "the field of view is unknown: {estimated_degrees:.1} degrees fit best, and standard deviations are larger; \
         give camera.vertical_fov_deg in scan.json"
    )]
    FieldOfViewUnknown {
        /// Vertical field of view in use, in degrees
        estimated_degrees: f64,
    },
    /// The camera's height was estimated
    #[error(
        "the height of the camera is unknown: {estimated_mm:.0} mm fit best; give camera.height_mm in scan.json"
    )]
    CameraHeightUnknown {
        /// Height in use, in mm
        estimated_mm: f64,
    },
    /// A given parameter of the camera is inconsistent with the photos
    #[error(
        "{parameter} cannot be {given:.0}: {found:.0} fits far better and is assumed; correct it in scan.json"
    )]
    CameraContradicted {
        /// The parameter
        parameter: CameraParameter,
        /// Its given value, in the unit of its key
        given: f64,
        /// Its value in use
        found: f64,
    },
    /// The person stands beside the middle of the photos
    #[error(
        "the person stands beside the middle of the photos: a camera turned aside by {yaw_degrees:.1} degrees is assumed, and standard \
         deviations are larger; do not crop the photos, and point the camera at the person"
    )]
    BesideMiddle {
        /// Assumed yaw, in degrees; positive looks to the right of the person
        yaw_degrees: f64,
    },
    /// The person turned in the opposite direction
    #[error(
        "the person turns to the own right: the turn angles were taken with the opposite sign; \
         turn to the left, or reverse the angles"
    )]
    TurnedBackward,
    /// The person turned by half of the given angles
    #[error(
        "the person turned by half of the turn angles only: half of them was assumed; make a complete turn, or correct \
         angle_deg in scan.json"
    )]
    TurnsHalved,
    /// Turn angle 0 is not where the person faces the camera
    #[error(
        "the person faces the camera at another angle than 0: {offset_degrees:.0} degrees were added to all turn angles"
    )]
    TurnsShifted {
        /// Offset added to the angles, in degrees
        offset_degrees: f64,
    },
    /// No photo shows the person in a part of the turn
    #[error(
        "no photo shows the person between the turn angles {from_degrees:.0} and {to_degrees:.0}: what only such photos show \
         has the shape of the mannequin; make a complete turn"
    )]
    TurnsGap {
        /// Turn angle at the start of the gap, in degrees
        from_degrees: f64,
        /// Turn angle at its end, in degrees
        to_degrees: f64,
    },
    /// The view has the mean pose of the others
    #[error("view {view} has no keypoints: it takes the mean pose of the other views")]
    ViewWithoutKeypoints {
        /// Its index
        view: usize,
    },
    /// Bone lengths and camera are inconsistent with the stature
    #[error(
        "the skeleton comes out {solved_mm:.0} mm tall instead of {given_mm:.0} mm: \
         standard deviations are larger; check stature, camera height and field of view"
    )]
    StatureContradicted {
        /// Given or assumed stature, in mm
        given_mm: f64,
        /// Stature of the scaled avatar, in mm
        solved_mm: f64,
    },
    /// A bone length is unusual
    #[error("{} is {factor:.2} times that of the reference avatar: standard deviations are larger; check stature and keypoints", .scale.name())]
    UnusualLength {
        /// The bone length
        scale: BoneScale,
        /// Its factor
        factor: f64,
    },
    /// The fit did not converge
    #[error("the skeleton did not settle: poses may be off")]
    NotConverged,
}

/// Error of [`fit_skeleton`](super::fit_skeleton)
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum SkeletonFitError {
    /// There are no views
    #[error("there are no views")]
    NoViews,
    /// No view has usable keypoints
    #[error("none of the {views} views has usable keypoints")]
    NoKeypoints {
        /// Number of views
        views: usize,
    },
    /// There are too few keypoints for a body
    #[error(
        "the views have {found} usable keypoints in all, {} are needed",
        start::MIN_JOINTS
    )]
    TooFewJoints {
        /// Usable keypoints in all views
        found: usize,
    },
    /// The keypoints do not determine the size of the person in the photo
    #[error(
        "the size of the person cannot be determined in any photo: \
         head or trunk must be visible above hips or legs"
    )]
    NoScale,
    /// Too few views to find their turn angles
    #[error(
        "{found} photos with keypoints are too few to find unknown turn angles, at least {} are needed; \
         provide more photos, or angle_deg in scan.json",
        found_turns::MIN_VIEWS
    )]
    TooFewTurns {
        /// Number of views with keypoints
        found: usize,
    },
    /// The keypoints do not determine the turn angles
    #[error(
        "{unclear} of {unknown} unknown turn angles cannot be found: other angles explain the keypoints as well; \
         check that face and feet have keypoints, or provide angle_deg in scan.json"
    )]
    TurnsUnclear {
        /// Number of views with uncertain turn angles
        unclear: usize,
        /// Number of views with unknown turn angles
        unknown: usize,
    },
    /// All views are from about the same side
    #[error(
        "all photos show the person from about the same side, within {range_degrees:.0} degrees: \
         the person must turn between photos"
    )]
    TurnsAlike {
        /// Range of all turn angles, in degrees
        range_degrees: f64,
    },
    /// The stature is not that of a person
    #[error(
        "a stature of {stature_mm} mm is not that of a person ({MIN_STATURE_MM} to {MAX_STATURE_MM} mm)"
    )]
    StatureImplausible {
        /// The given stature, in mm
        stature_mm: f64,
    },
    /// The avatar is empty, flat or not finite
    #[error("the reference avatar has no usable surface")]
    AvatarUnusable,
}
