//! What a job found.

use pirouette_geom::TriMesh;
use thiserror::Error;

use crate::body_fit::Fit;
use crate::color::SurfaceColors;
use crate::measure::Measurements;
use crate::normalize::{NormalizeError, NormalizedView};
use crate::pipeline::{Goal, Method, Stage, StartFigure, Warning};
use crate::segment::{SegmentError, Silhouette};
use crate::skeleton_fit::Bundle;
use pirouette_body::Avatar;

/// What a job found, up to its goal
#[derive(Debug)]
pub struct Report {
    /// How it was done
    pub method: Method,
    /// How far it went
    pub goal: Goal,
    /// The reference figure, at the stature of the person
    pub avatar: Avatar,
    /// One skeleton for all views; `None` when the keypoints did not suffice and silhouettes were all that was asked for
    pub bundle: Option<Bundle>,
    /// The body fitted to the views that went through, in their order; by [`Method::Fit`] only
    pub fit: Option<Fit>,
    /// The mannequin that the fit started from, where the silhouettes chose it
    pub start: Option<StartFigure>,
    /// The views that went through, in the order of the scan
    pub views: Vec<ViewReport>,
    /// The body in the reference pose, world frame, mm
    pub body: Option<TriMesh>,
    /// Colors of the fitted body, where any photo shows it
    pub colors: Option<SurfaceColors>,
    /// The visual hull of the normalized silhouettes, if it was asked for
    pub hull: Option<TriMesh>,
    /// Measurements of the body
    pub measurements: Option<Measurements>,
    /// The views that did not
    pub dropped: Vec<DroppedView>,
    /// What was decided without being asked
    pub warnings: Vec<Warning>,
    /// How long each stage took, in order
    pub seconds: Vec<(Stage, f64)>,
}

/// What was found in one view
#[derive(Debug)]
pub struct ViewReport {
    /// Its place in the scan, and in the bundle
    pub index: usize,
    /// The person in the photo
    pub silhouette: Silhouette,
    /// The person in the reference pose
    pub normalized: Option<NormalizedView>,
}

/// A view that a stage could not use
#[derive(Debug, Clone, PartialEq)]
pub struct DroppedView {
    /// Its place in the scan
    pub index: usize,
    /// The stage that gave up on it
    pub stage: Stage,
    /// Why
    pub reason: DropReason,
}

/// Why a stage gave up on a view
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DropReason {
    /// No silhouette
    #[error("{0}")]
    Segment(SegmentError),
    /// No silhouette in the reference pose
    #[error("{0}")]
    Normalize(NormalizeError),
    /// The body that explains the other views does not explain it
    #[error(
        "no pose of the body covers its silhouette: they overlap by {iou:.2}, those of the other views by {usual:.2}; \
         check its photo, angle and mask"
    )]
    Contradicts {
        /// Intersection over union of the posed body with the silhouette
        iou: f64,
        /// Median of all views
        usual: f64,
    },
}
