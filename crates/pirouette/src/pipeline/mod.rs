//! The complete job: stages in order, events, cancellation.
//!
//! [`run`] is pure computation over a scan in memory; `pirouette-files` writes the reports. A view that a stage
//! rejects is dropped with a warning as long as enough views remain. Photos are never copied.

mod capture;
mod event;
mod fit_job;
mod job;
mod report;
mod stages;
mod verdict;
mod warning;

use thiserror::Error;

use crate::body_fit::BodyFitOptions;
use crate::carve::CarveError;
use crate::initial_body::InitialBodyError;
use crate::measure::Surface;
use crate::scan::{Scan, StatedClothes};
use crate::segment::SegmentOptions;
use crate::skeleton_fit::SkeletonFitError;
use job::Job;
use pirouette_body::Sex;
use pirouette_body::gltf::LoadAvatarError;
use pirouette_body::mannequin::MannequinError;

pub use crate::initial_body::InitialMannequin;
pub use capture::{Capture, Finding, check_capture};
pub use event::{CancelToken, Event, Stage};
pub use report::{DropReason, DroppedView, Report};
pub use stages::{
    Normalizer, carve_views, make_avatar, normalized_outlines, photographed_outlines, render_priors,
};
pub use verdict::{Refusal, Suspect};
pub use warning::{TurnChange, Warning};

/// Method that transforms views to the reference pose
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Fits one body to all views
    #[default]
    Fit,
    /// The published method, view by view: limb alignment (eq. 1), registration, refinement
    ThreeStep,
}

/// Last result that a job computes
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Goal {
    /// Silhouettes
    Segment,
    /// Silhouettes in the reference pose
    Normalize,
    /// The body
    Reconstruct,
    /// The measurements of the body
    #[default]
    Measure,
}

impl Goal {
    /// Returns the minimum number of usable views
    ///
    /// Silhouettes are computed for single views. Two remaining views of many indicate a defect of the scan, but a body
    /// fit accepts a scan of two views.
    pub fn min_view_count(self) -> usize {
        match self {
            Goal::Segment | Goal::Normalize => 1,
            Goal::Reconstruct | Goal::Measure => 3,
        }
    }
}

/// Source of the reference avatar
#[derive(Debug, Clone, PartialEq)]
pub enum AvatarSource {
    /// The built-in mannequin
    Mannequin {
        /// Sex that determines the proportions
        sex: Sex,
        /// Body mass, in kg; the average for the stature if `None`
        mass_kg: Option<f64>,
    },
    /// A skinned glTF or VRM file
    File {
        /// Name in messages
        name: String,
        /// Content of the file
        bytes: Vec<u8>,
    },
}

/// Configuration of a job
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Last result to compute
    pub goal: Goal,
    /// Method that transforms views to the reference pose
    pub method: Method,
    /// The reference avatar
    pub avatar: AvatarSource,
    /// Whether to register each view to the reference by a rigid motion (eq. 2 to 4)
    pub register: bool,
    /// Whether to refine arms and legs against the reference (eq. 5 to 7)
    pub refine: bool,
    /// Whether to carve the visual hull in addition to the fitted body
    pub hull: bool,
    /// The surface whose measures are reported
    pub surface: Surface,
    /// Clothes that the person wears, instead of those that the scan states
    pub clothes: Option<StatedClothes>,
    /// Options of the segmentation; photos of several cameras are always segmented separately
    pub segment: SegmentOptions,
    /// Options of the body fit
    pub fit: BodyFitOptions,
}

impl Config {
    /// Returns the default configuration of a method: registration and refinement for `ThreeStep` only
    pub fn new(goal: Goal, method: Method) -> Self {
        let published = method == Method::ThreeStep;
        Self {
            goal,
            method,
            avatar: AvatarSource::Mannequin {
                sex: Sex::Neutral,
                mass_kg: None,
            },
            register: published,
            refine: published,
            hull: false,
            surface: Surface::default(),
            clothes: None,
            segment: SegmentOptions::default(),
            fit: BodyFitOptions::default(),
        }
    }
}

/// Why a job has no result
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// Too few usable views
    #[error(
        "{left} usable {} too few, at least {needed} are needed; provide more photos, or fix the rejected views",
        if *left == 1 { "view is" } else { "views are" }
    )]
    TooFewViews {
        /// Number of usable views
        left: usize,
        /// Number of views that the goal needs
        needed: usize,
    },
    /// No mannequin of the given stature
    #[error("cannot build the reference avatar")]
    Mannequin(#[from] MannequinError),
    /// The given avatar cannot be used
    #[error("cannot use {name} as the reference avatar")]
    Avatar {
        /// Name of the avatar
        name: String,
        /// Cause
        source: LoadAvatarError,
    },
    /// No skeleton fits
    #[error("no skeleton fits the keypoints")]
    SkeletonFit(#[from] SkeletonFitError),
    /// Carving fails
    #[error("cannot carve the body")]
    Carve(#[from] CarveError),
    /// Cancellation was requested
    #[error("cancelled")]
    Cancelled,
}

impl From<InitialBodyError> for PipelineError {
    fn from(error: InitialBodyError) -> Self {
        match error {
            InitialBodyError::Mannequin(error) => error.into(),
            InitialBodyError::SkeletonFit(error) => error.into(),
        }
    }
}

/// Runs the stages on a loaded scan, up to the goal of `config`
///
/// `on_event` receives progress and warnings; calls are serialized but may come from any thread.
///
/// # Errors
/// When too few views remain, the reference avatar cannot be used, no skeleton fits, or the job was cancelled.
pub fn run(
    scan: &Scan,
    config: &Config,
    cancel: &CancelToken,
    on_event: &mut (dyn FnMut(Event) + Send),
) -> Result<Report, PipelineError> {
    let mut job = Job::new(scan, config, cancel, on_event);
    job.check_left(scan.views.len())?;
    let avatar = job.make_avatar()?;
    let (skeleton, skeleton_views) = job.fit_skeleton(&avatar)?.unzip();
    let priors = job.render_priors(skeleton.as_ref(), skeleton_views.as_deref())?;
    let views = job.segment(skeleton_views.as_deref(), &priors)?;
    drop(priors);
    let mut report = Report::new(config, avatar, skeleton, views);
    find_body(&mut job, &mut report)?;
    Ok(job.finish(report))
}

/// Runs the stages that need a skeleton, up to the goal
fn find_body(job: &mut Job, report: &mut Report) -> Result<(), PipelineError> {
    let goal = report.goal;
    if goal < Goal::Normalize || report.skeleton.is_none() {
        return Ok(());
    }
    if report.method == Method::Fit {
        job.fit_body(report)?;
    }
    if report.fit.is_some() && goal >= Goal::Reconstruct {
        job.color(report)?;
    }
    job.normalize(report)?;
    if goal < Goal::Reconstruct {
        return Ok(());
    }
    let normalized_outlines = job.carve(report)?;
    report.refusal = verdict::judge(job.scan(), report);
    if goal < Goal::Measure || report.refusal.is_some() {
        return Ok(());
    }
    job.measure(report, normalized_outlines)
}
