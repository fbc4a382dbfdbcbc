//! One view of a scan with all that the stages found in it.

use crate::body_fit::FittedView;
use crate::normalize::NormalizedView;
use crate::segment::Silhouette;
use crate::skeleton_fit::SkeletonView;

/// Place of a view in its scan, in the order of [`crate::scan::Scan::views`]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ViewId(pub usize);

/// One view with all that the stages found in it
///
/// It grows from stage to stage. A view that a stage rejects is removed as a whole.
#[derive(Debug)]
pub struct SolvedView {
    /// Its place in the scan
    pub id: ViewId,
    /// The person in the photo
    pub silhouette: Silhouette,
    /// Turn, camera, keypoints and pose; `None` where silhouettes were found without a skeleton
    pub skeleton: Option<SkeletonView>,
    /// Pose of the fitted body
    pub fit: Option<FittedView>,
    /// The person in the reference pose
    pub normalized: Option<NormalizedView>,
}

impl SolvedView {
    /// The view as the skeleton explains it
    ///
    /// # Panics
    /// When there is no skeleton: no stage after the segmentation runs without one.
    pub fn skeleton(&self) -> &SkeletonView {
        let skeleton = self.skeleton.as_ref();
        skeleton.expect("no stage after the segmentation runs without a skeleton")
    }
}
