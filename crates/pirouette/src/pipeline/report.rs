//! What a job found.

use pirouette_geom::TriMesh;
use thiserror::Error;

use crate::body_fit::FittedBody;
use crate::color::SurfaceColors;
use crate::measure::Measurements;
use crate::normalize::NormalizeError;
use crate::pipeline::{Config, Goal, InitialMannequin, Method, Stage, Warning};
use crate::segment::SegmentError;
use crate::skeleton_fit::Skeleton;
use crate::view::{SolvedView, ViewId};
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
    pub skeleton: Option<Skeleton>,
    /// The body fitted to all views; by [`Method::Fit`] only
    pub fit: Option<FittedBody>,
    /// The mannequin that the fit started from, where the silhouettes chose it
    pub start: Option<InitialMannequin>,
    /// The views that went through, in the order of the scan
    pub views: Vec<SolvedView>,
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

impl Report {
    /// What is known once there are silhouettes
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
            views,
            body: None,
            colors: None,
            hull: None,
            measurements: None,
            dropped: Vec::new(),
            warnings: Vec::new(),
            seconds: Vec::new(),
        }
    }

    /// The avatar with the person's bone lengths: the fitted body where there is one
    pub fn person(&self) -> Option<&Avatar> {
        let fitted = self.fit.as_ref().map(|fit| &fit.avatar);
        fitted.or_else(|| self.skeleton.as_ref().map(|skeleton| &skeleton.avatar))
    }

    /// The avatar in the reference pose that silhouettes are normalized to
    ///
    /// The published method knows the person's proportions from the photo alone.
    pub fn normalization_reference(&self) -> &Avatar {
        match (&self.fit, self.method, &self.skeleton) {
            (Some(fit), _, _) => &fit.avatar,
            (None, Method::Fit, Some(skeleton)) => &skeleton.avatar,
            _ => &self.avatar,
        }
    }

    /// Mean intersection over union of the posed body with the silhouettes; `None` where no body was fitted
    pub fn mean_fit_iou(&self) -> Option<f64> {
        let views = self.views.iter();
        let ious: Vec<f64> = views.filter_map(|view| view.fit?.silhouette_iou).collect();
        (!ious.is_empty()).then(|| ious.iter().sum::<f64>() / ious.len() as f64)
    }
}

/// A view that a stage could not use
#[derive(Debug, Clone, PartialEq)]
pub struct DroppedView {
    /// Its place in the scan
    pub id: ViewId,
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
