//! Events and cancellation of a running job.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::pipeline::Warning;

/// Stages of a job, in the order in which they run
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Stage {
    /// Reads photos and keypoints
    Load,
    /// Detects keypoints in photos without a keypoint file
    Detect,
    /// Builds or reads the reference avatar
    Avatar,
    /// Fits one skeleton to the keypoints of all views
    SkeletonFit,
    /// Renders the avatar in the person's poses
    Prior,
    /// Segments the photos into silhouettes
    Segment,
    /// Fits one body and its poses to all silhouettes
    BodyFit,
    /// Samples the colors of the fitted body in the photos
    Color,
    /// Transforms the silhouettes to the reference pose
    Normalize,
    /// Carves the visual hull of the silhouettes
    Carve,
    /// Measures the body
    Measure,
}

impl Stage {
    /// Returns the name used in files and messages
    pub fn name(self) -> &'static str {
        match self {
            Stage::Load => "load",
            Stage::Detect => "detect",
            Stage::Avatar => "avatar",
            Stage::SkeletonFit => "skeleton",
            Stage::Prior => "prior",
            Stage::Segment => "segment",
            Stage::BodyFit => "fit",
            Stage::Color => "color",
            Stage::Normalize => "normalize",
            Stage::Carve => "carve",
            Stage::Measure => "measure",
        }
    }
}

/// Progress and warnings of a running job
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Event {
    /// A stage starts
    StageStarted {
        /// The stage
        stage: Stage,
        /// Number of steps; 1 when steps are not reported separately
        step_count: usize,
    },
    /// One step of the running stage is done
    StepDone {
        /// The stage
        stage: Stage,
    },
    /// A stage is done
    StageDone {
        /// The stage
        stage: Stage,
        /// Duration, in seconds
        seconds: f64,
    },
    /// An automatic correction, a rejected view or an inconsistency
    Warning(Warning),
}

/// Requests cancellation of a running job; clones share the request
#[derive(Debug, Clone, Default)]
pub struct CancelToken {
    cancelled: Arc<AtomicBool>,
}

impl CancelToken {
    /// Requests cancellation at the next step
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Returns whether cancellation was requested
    pub fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}
