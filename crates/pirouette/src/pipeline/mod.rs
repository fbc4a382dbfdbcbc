//! The complete job: stages in order, events, cancellation.
//!
//! [`run`] is pure computation over a scan in memory; reports are written by `pirouette-files`. A view that a
//! stage cannot use is dropped with a warning while enough are left. Photos are never copied.

mod event;
mod job;
mod report;
mod stages;
mod warning;

use thiserror::Error;

use crate::body_fit::BodyFitOptions;
use crate::carve::CarveError;
use crate::initial_body::InitialBodyError;
use crate::scan::Scan;
use crate::segment::SegmentOptions;
use crate::skeleton_fit::SkeletonFitError;
use job::Job;
use pirouette_body::Sex;
use pirouette_body::gltf::LoadAvatarError;
use pirouette_body::mannequin::MannequinError;

pub use crate::initial_body::InitialMannequin;
pub use event::{CancelToken, Event, Stage};
pub use report::{DropReason, DroppedView, Report};
pub use stages::{
    Normalizer, carve_views, make_avatar, normalized_outlines, photographed_outlines, render_priors,
};
pub use warning::Warning;

/// How views are brought to the reference pose
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// One body is fitted to all views
    #[default]
    Fit,
    /// The published method, view by view: limb alignment (eq. 1), registration, refinement
    ThreeStep,
}

/// How far the job goes
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Goal {
    /// Silhouettes
    Segment,
    /// Silhouettes in the reference pose
    Normalize,
    /// The body
    Reconstruct,
    /// Its measurements
    #[default]
    Measure,
}

impl Goal {
    /// Views without which there is no result
    ///
    /// A silhouette stands for itself; when of many views two are left, something is wrong. Two views that were all that was
    /// given do for a body fit.
    pub fn min_view_count(self) -> usize {
        match self {
            Goal::Segment | Goal::Normalize => 1,
            Goal::Reconstruct | Goal::Measure => 3,
        }
    }
}

/// Where the reference figure comes from
#[derive(Debug, Clone, PartialEq)]
pub enum AvatarSource {
    /// The built-in mannequin
    Mannequin {
        /// Whose proportions
        sex: Sex,
        /// Body mass, in kg; usual for the stature when not given
        mass_kg: Option<f64>,
    },
    /// A skinned glTF or VRM file
    File {
        /// What messages call it
        name: String,
        /// Its bytes
        bytes: Vec<u8>,
    },
}

/// What to do
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// How far to go
    pub goal: Goal,
    /// How views are brought to the reference pose
    pub method: Method,
    /// The reference figure
    pub avatar: AvatarSource,
    /// Whether each view is fitted to the reference by a rigid motion (eq. 2 to 4)
    pub register: bool,
    /// Whether arms and legs are refined against the reference (eq. 5 to 7)
    pub refine: bool,
    /// Views that were given, where some of them could not even be loaded; else all of the scan
    pub given_view_count: Option<usize>,
    /// Whether the visual hull is carved, too, where another body is the result
    pub hull: bool,
    /// How photos are segmented; photos of several cameras are always taken singly
    pub segment: SegmentOptions,
    /// How the body is fitted
    pub fit: BodyFitOptions,
}

impl Config {
    /// The usual way of a method: the published steps belong to `ThreeStep`
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
            given_view_count: None,
            hull: false,
            segment: SegmentOptions::default(),
            fit: BodyFitOptions::default(),
        }
    }
}

/// Why a job has no result
#[derive(Debug, Error)]
pub enum PipelineError {
    /// Too few views, or too few left
    #[error(
        "{left} usable {} too few, at least {needed} are needed; give more photos, or mend the views that were left out",
        if *left == 1 { "view is" } else { "views are" }
    )]
    TooFewViews {
        /// Views that can be used
        left: usize,
        /// Views that the goal needs
        needed: usize,
    },
    /// No mannequin of that stature
    #[error("cannot make the reference figure")]
    Mannequin(#[from] MannequinError),
    /// The given figure cannot be used
    #[error("cannot use {name} as the reference figure")]
    Avatar {
        /// Its name
        name: String,
        /// Why
        source: LoadAvatarError,
    },
    /// No skeleton
    #[error("no skeleton fits the keypoints")]
    SkeletonFit(#[from] SkeletonFitError),
    /// No body
    #[error("no body can be carved")]
    Carve(#[from] CarveError),
    /// Asked to stop
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

/// Does the whole job on a loaded scan, up to the goal of `config`
///
/// `on_event` receives progress and warnings; calls are serialized but may come from any thread.
///
/// # Errors
/// When too few views are left, the reference figure cannot be used, no skeleton fits, or the job was cancelled.
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

/// The stages that need a skeleton, up to the goal
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
    if goal < Goal::Measure {
        return Ok(());
    }
    job.measure(report, normalized_outlines)
}
