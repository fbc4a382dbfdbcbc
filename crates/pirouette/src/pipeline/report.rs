//! Results of a job.

use pirouette_geom::TriMesh;
use thiserror::Error;

use crate::body_fit::FittedBody;
use crate::color::SurfaceColors;
use crate::measure::Measurements;
use crate::normalize::NormalizeError;
use crate::pipeline::{Config, Goal, InitialMannequin, Method, Refusal, Stage, Warning};
use crate::segment::SegmentError;
use crate::skeleton_fit::Skeleton;
use crate::skirt::{DressedBody, Skirt};
use crate::view::{SolvedView, ViewId};
use pirouette_body::Avatar;

/// Results of a job, up to its goal
#[derive(Debug)]
pub struct Report {
    /// Method used
    pub method: Method,
    /// Goal of the job
    pub goal: Goal,
    /// The reference avatar, at the stature of the person
    pub avatar: Avatar,
    /// One skeleton for all views; `None` when only silhouettes were requested and no skeleton fits the keypoints
    pub skeleton: Option<Skeleton>,
    /// The body fitted to all views; only for [`Method::Fit`]
    pub fit: Option<FittedBody>,
    /// The initial mannequin of the fit, if it was selected by the silhouettes
    pub start: Option<InitialMannequin>,
    /// The skirt or dress that the person wears, if one was found
    pub skirt: Option<Skirt>,
    /// The accepted views, in the order of the scan
    pub views: Vec<SolvedView>,
    /// The body in the reference pose, world frame, mm
    pub body: Option<TriMesh>,
    /// Colors of the fitted body, if any photo shows it
    pub colors: Option<SurfaceColors>,
    /// The fitted body with the skirt that the person wears
    pub dressed: Option<DressedBody>,
    /// The visual hull of the normalized silhouettes, if requested
    pub hull: Option<TriMesh>,
    /// Why the body is not a result: it does not match the photos, or they do not show the complete person
    ///
    /// Then there are no measurements, and the body is only for pictures.
    pub refusal: Option<Refusal>,
    /// Measurements of the body
    pub measurements: Option<Measurements>,
    /// The rejected views
    pub dropped: Vec<DroppedView>,
    /// Automatic corrections and other warnings
    pub warnings: Vec<Warning>,
    /// Duration of each stage, in order
    pub seconds: Vec<(Stage, f64)>,
}

impl Report {
    /// Creates the report after the segmentation
    pub(super) fn new(
        config: &Config,
        avatar: Avatar,
        skeleton: Option<Skeleton>,
        views: Vec<SolvedView>,
    ) -> Self {
        Self {
            method: config.method,
            goal: config.goal,
            avatar,
            skeleton,
            fit: None,
            start: None,
            skirt: None,
            views,
            body: None,
            colors: None,
            dressed: None,
            hull: None,
            refusal: None,
            measurements: None,
            dropped: Vec::new(),
            warnings: Vec::new(),
            seconds: Vec::new(),
        }
    }

    /// Returns the avatar with the person's bone lengths: the fitted body, if there is one
    pub fn person(&self) -> Option<&Avatar> {
        let fitted = self.fit.as_ref().map(|fit| &fit.avatar);
        fitted.or_else(|| self.skeleton.as_ref().map(|skeleton| &skeleton.avatar))
    }

    /// Returns the avatar in the reference pose to which silhouettes are normalized
    ///
    /// The published method obtains the person's proportions from each photo alone, and uses the unfitted avatar.
    pub fn normalization_reference(&self) -> &Avatar {
        match (&self.fit, self.method, &self.skeleton) {
            (Some(fit), _, _) => &fit.avatar,
            (None, Method::Fit, Some(skeleton)) => &skeleton.avatar,
            _ => &self.avatar,
        }
    }

    /// Returns the mean intersection over union of the posed body with the silhouettes; `None` without a fitted body
    pub fn mean_fit_iou(&self) -> Option<f64> {
        let views = self.views.iter();
        let ious: Vec<f64> = views.filter_map(|view| view.fit?.silhouette_iou).collect();
        (!ious.is_empty()).then(|| ious.iter().sum::<f64>() / ious.len() as f64)
    }
}

/// A view that a stage rejected
#[derive(Debug, Clone, PartialEq)]
pub struct DroppedView {
    /// Index in the scan
    pub id: ViewId,
    /// The stage that rejected it
    pub stage: Stage,
    /// Reason for the rejection
    pub reason: DropReason,
}

/// Why a stage rejected a view
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum DropReason {
    /// The segmentation fails
    #[error("{0}")]
    Segment(SegmentError),
    /// The normalization fails
    #[error("{0}")]
    Normalize(NormalizeError),
    /// The view is inconsistent with the others: the body fitted to all views does not fit its silhouette
    #[error(
        "no pose of the body fits its silhouette: the overlap (IoU) is {iou:.2}, that of other views {usual:.2}; \
         check its photo, angle and mask"
    )]
    Contradicts {
        /// Intersection over union of the posed body with the silhouette
        iou: f64,
        /// Median of all views
        usual: f64,
    },
}
