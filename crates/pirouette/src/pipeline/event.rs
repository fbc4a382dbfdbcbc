//! What a running job tells, and how it is stopped.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::pipeline::Warning;

/// A part of the job, in the order in which they run
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Stage {
    /// Photos and keypoints are read
    Load,
    /// The reference figure is made or read
    Avatar,
    /// One skeleton is found for all views
    SkeletonFit,
    /// The reference figure is drawn in the person's poses
    Prior,
    /// Photos become silhouettes
    Segment,
    /// One body and its poses are fitted to all silhouettes
    BodyFit,
    /// The fitted body takes the colors of the photos
    Color,
    /// Silhouettes are brought to the reference pose
    Normalize,
    /// Silhouettes become a body
    Carve,
    /// Tapes are laid around the body
    Measure,
    /// Overlays and the contact sheet are drawn
    Pictures,
    /// Results are written
    Write,
}

impl Stage {
    /// Name in files and on the terminal
    pub fn name(self) -> &'static str {
        match self {
            Stage::Load => "load",
            Stage::Avatar => "avatar",
            Stage::SkeletonFit => "skeleton",
            Stage::Prior => "prior",
            Stage::Segment => "segment",
            Stage::BodyFit => "fit",
            Stage::Color => "color",
            Stage::Normalize => "normalize",
            Stage::Carve => "carve",
            Stage::Measure => "measure",
            Stage::Pictures => "pictures",
            Stage::Write => "write",
        }
    }
}

/// What a running job tells
#[derive(Debug, Clone)]
pub enum Event {
    /// A stage begins; it has so many steps, 1 when they are not told apart
    StageStarted {
        /// The stage
        stage: Stage,
        /// Steps to come
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
        /// How long it took
        seconds: f64,
    },
    /// Something was decided without being asked, or a view was lost
    Warning(Warning),
}

/// Asks a running job to stop; copies share the request
#[derive(Debug, Clone, Default)]
pub struct CancelToken {
    cancelled: Arc<AtomicBool>,
}

impl CancelToken {
    /// Asks the job to stop at the next step
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Whether the job was asked to stop
    pub fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}
