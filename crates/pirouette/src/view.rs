//! One view of a scan with the results of all stages.

use crate::body_fit::FittedView;
use crate::normalize::NormalizedView;
use crate::scan::View;
use crate::segment::Silhouette;
use crate::skeleton_fit::{SkeletonView, TurnFrom};
use pirouette_body::TurnAngle;

/// Index of a view in [`crate::scan::Scan::views`]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ViewId(pub usize);

/// One view with the results of all stages
///
/// Each stage adds its results. A view that a stage rejects is removed.
#[derive(Debug)]
pub struct SolvedView {
    /// Index in the scan
    pub id: ViewId,
    /// Silhouette of the person in the photo
    pub silhouette: Silhouette,
    /// Turn, camera, keypoints and pose; `None` if silhouettes were computed without a skeleton
    pub skeleton: Option<SkeletonView>,
    /// Pose of the fitted body
    pub fit: Option<FittedView>,
    /// Silhouette of the person in the reference pose
    pub normalized: Option<NormalizedView>,
}

impl SolvedView {
    /// Returns turn, camera, keypoints and pose by the skeleton
    ///
    /// # Panics
    /// Without a skeleton: no stage after the segmentation runs without one.
    pub fn skeleton(&self) -> &SkeletonView {
        let skeleton = self.skeleton.as_ref();
        skeleton.expect("no stage after the segmentation runs without a skeleton")
    }

    /// Returns the turn angle of this view, which is `given` in the scan: as stated there, or as found
    pub fn turn_in_use(&self, given: &View) -> TurnAngle {
        let found = self
            .skeleton
            .filter(|skeleton| skeleton.turn_from != TurnFrom::Stated);
        found.map_or(given.turn, |skeleton| skeleton.turn.wrapped())
    }
}
