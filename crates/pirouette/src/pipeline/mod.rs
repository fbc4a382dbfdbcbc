//! The whole job: stages in order, events, cancellation.
//!
//! [`run`] is pure computation over a loaded scan; [`pirouette_files::results`] writes what it found. A view that a
//! stage cannot use is dropped with a warning while enough are left. Photos are never copied.

mod event;
mod job;
mod report;
mod views;
mod warning;

use thiserror::Error;

use crate::body_fit::{Fit, FitOptions};
use crate::carve::CarveError;
use crate::scan::Scan;
use crate::segment::SegmentOptions;
use crate::skeleton_fit::BundleError;
use job::Job;
use pirouette_body::Sex;
use pirouette_body::gltf::LoadAvatarError;
use pirouette_body::mannequin::MannequinError;

pub use crate::initial_body::StartFigure;
pub use event::{CancelToken, Event, Stage};
pub use report::{DropReason, DroppedView, Report, ViewReport};
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
    pub fit: FitOptions,
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
            fit: FitOptions::default(),
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
    Bundle(#[from] BundleError),
    /// No body
    #[error("no body can be carved")]
    Carve(#[from] CarveError),
    /// Asked to stop
    #[error("cancelled")]
    Cancelled,
}

/// Does the whole job on a loaded scan, up to the goal of `config`
///
/// `tell` hears of progress and warnings, one at a time but from any thread.
///
/// # Errors
/// When too few views are left, the reference figure cannot be used, no skeleton fits, or the job was cancelled.
pub fn run(
    scan: &Scan,
    config: &Config,
    cancel: &CancelToken,
    tell: &mut (dyn FnMut(Event) + Send),
) -> Result<Report, PipelineError> {
    let mut job = Job::new(scan, config, cancel, tell);
    job.check_left(scan.views.len())?;
    let avatar = job.make_avatar()?;
    let mut bundle = job.find_skeleton(&avatar)?;
    let priors = job.render_priors(bundle.as_ref())?;
    let mut views = job.segment(&priors)?;
    drop(priors);
    let mut found_fit = None;
    let mut start = None;
    let mut colors = None;
    let mut hull = None;
    let mut body = None;
    let mut measurements = None;
    if let Some(bundle) = &mut bundle
        && config.goal >= Goal::Normalize
    {
        let mut fit = match config.method {
            Method::Fit => {
                let (fit, figure) = job.fit(bundle, &mut views)?;
                if let Some(camera) = fit.cameras.first() {
                    bundle.move_cameras(camera);
                }
                start = figure;
                Some(fit)
            }
            Method::ThreeStep => None,
        };
        let bundle = &*bundle;
        if let Some(fit) = &fit
            && config.goal >= Goal::Reconstruct
        {
            colors = job.color(bundle, fit, &views)?;
        }
        let fitted: Vec<usize> = views.iter().map(|view| view.index).collect();
        views = job.normalize(&avatar, bundle, fit.as_ref(), views)?;
        if let Some(fit) = &mut fit {
            let left: Vec<usize> = views.iter().map(|view| view.index).collect();
            keep_views(fit, &fitted, &left);
        }
        let mut normalized = Vec::new();
        if config.goal >= Goal::Reconstruct {
            if fit.is_none() || config.hull {
                let (carved, outlines) = job.carve(bundle, fit.as_ref(), &views)?;
                hull = Some(carved);
                normalized = outlines;
            }
            body = match &fit {
                Some(fit) => Some(fit.avatar.mesh.clone()),
                None if config.hull => hull.clone(),
                None => hull.take(),
            };
        }
        if config.goal >= Goal::Measure
            && let Some(body) = &body
        {
            measurements = Some(job.measure(bundle, fit.as_ref(), &views, normalized, body)?);
        }
        found_fit = fit;
    }
    let Job {
        dropped,
        warnings,
        seconds,
        ..
    } = job;
    Ok(Report {
        method: config.method,
        goal: config.goal,
        avatar,
        bundle,
        fit: found_fit,
        start,
        views,
        body,
        colors,
        hull,
        measurements,
        dropped,
        warnings,
        seconds,
    })
}

/// Leaves out what a fit holds about views that were dropped since; `fitted` and `left` are places in the scan
fn keep_views(fit: &mut Fit, fitted: &[usize], left: &[usize]) {
    let mut keep = fitted.iter().map(|index| left.contains(index));
    let mut keep_camera = keep.clone();
    let mut keep_iou = keep.clone();
    fit.poses.retain(|_| keep.next().unwrap_or(false));
    fit.cameras.retain(|_| keep_camera.next().unwrap_or(false));
    fit.silhouette_ious
        .retain(|_| keep_iou.next().unwrap_or(false));
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use pirouette_body::Camera;
    use pirouette_body::Pose;
    use pirouette_body::mannequin::{MannequinParameters, mannequin};

    #[test]
    fn poses_stay_beside_the_views_that_are_left() {
        let pose = |x: f64| Pose {
            shift_mm: DVec3::X * x,
            ..Pose::default()
        };
        let camera = |height_mm: f64| Camera {
            width_px: 8,
            height_px: 10,
            vertical_fov_radians: 0.8,
            height_mm,
            distance_mm: 2400.0,
            pitch_radians: 0.0,
        };
        let mut fit = Fit {
            avatar: mannequin(&MannequinParameters::default()).unwrap(),
            poses: vec![pose(0.0), pose(2.0), pose(3.0), pose(5.0)],
            cameras: [0.0, 2.0, 3.0, 5.0].map(camera).to_vec(),
            silhouette_ious: vec![0.0, 0.2, 0.3, 0.5],
            residual_px: 1.0,
        };
        keep_views(&mut fit, &[0, 2, 3, 5], &[0, 3, 5]);
        assert_eq!(fit.poses, [pose(0.0), pose(3.0), pose(5.0)]);
        assert_eq!(fit.cameras, [0.0, 3.0, 5.0].map(camera));
        assert_eq!(fit.silhouette_ious, [0.0, 0.3, 0.5]);
    }
}
