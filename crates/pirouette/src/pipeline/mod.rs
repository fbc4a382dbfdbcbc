//! The whole job: stages in order, events, cancellation.
//!
//! [`run`] is pure computation over a loaded scan; [`crate::io::results`] writes what it found. A view that a
//! stage cannot use is dropped with a warning while enough are left. Photos are never copied.

mod event;
mod report;
mod warning;

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use pirouette_geom::Grid;
use rayon::prelude::*;
use thiserror::Error;

use crate::avatar::gltf::{LoadAvatarError, load_avatar};
use crate::avatar::mannequin::{MannequinError, MannequinParameters, Sex, mannequin};
use crate::avatar::{Avatar, render};
use crate::bundle::{Bundle, BundleError, BundleOptions, BundleView, bundle};
use crate::pose::pose_bones;
use crate::scan::Scan;
use crate::segment::{SegmentError, SegmentOptions, SegmentView, Silhouette, segment};

pub use event::{CancelToken, Event, Stage};
pub use report::{DropReason, DroppedView, Report, ViewReport};
pub use warning::Warning;

/// How views are brought to the reference pose
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// One skeleton for all views gives targets that agree in space
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
    /// Two views cannot bound a body; a silhouette stands for itself.
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
    let mut job = Job {
        scan,
        config,
        cancel,
        tell,
        dropped: Vec::new(),
        warnings: Vec::new(),
        seconds: Vec::new(),
    };
    job.check_left(scan.views.len())?;
    let avatar = job.make_avatar()?;
    let bundle = job.find_skeleton(&avatar)?;
    let priors = job.render_priors(bundle.as_ref())?;
    let views = job.segment(&priors)?;
    Ok(Report {
        method: config.method,
        goal: config.goal,
        avatar,
        bundle,
        views,
        dropped: job.dropped,
        warnings: job.warnings,
        seconds: job.seconds,
    })
}

/// A running job
struct Job<'a> {
    scan: &'a Scan,
    config: &'a Config,
    cancel: &'a CancelToken,
    tell: &'a mut (dyn FnMut(Event) + Send),
    dropped: Vec<DroppedView>,
    warnings: Vec<Warning>,
    seconds: Vec<(Stage, f64)>,
}

/// Counts the steps of a stage, from any thread
struct Steps<'a> {
    stage: Stage,
    tell: Mutex<&'a mut (dyn FnMut(Event) + Send)>,
}

impl Steps<'_> {
    fn done(&self) {
        let mut tell = self.tell.lock().unwrap_or_else(PoisonError::into_inner);
        tell(Event::StepDone { stage: self.stage });
    }
}

impl Job<'_> {
    /// Runs one stage: told, timed, and not begun or not believed once the job was cancelled
    fn stage<T>(
        &mut self,
        stage: Stage,
        step_count: usize,
        work: impl FnOnce(&Steps) -> T,
    ) -> Result<T, PipelineError> {
        if self.cancel.cancelled() {
            return Err(PipelineError::Cancelled);
        }
        (self.tell)(Event::StageStarted { stage, step_count });
        let start = Instant::now();
        let steps = Steps {
            stage,
            tell: Mutex::new(&mut *self.tell),
        };
        let result = work(&steps);
        let seconds = start.elapsed().as_secs_f64();
        if self.cancel.cancelled() {
            return Err(PipelineError::Cancelled);
        }
        (self.tell)(Event::StageDone { stage, seconds });
        self.seconds.push((stage, seconds));
        Ok(result)
    }

    fn warn(&mut self, warning: Warning) {
        (self.tell)(Event::Warning(warning.clone()));
        self.warnings.push(warning);
    }

    fn drop_view(&mut self, index: usize, stage: Stage, reason: DropReason) {
        self.warn(Warning::ViewDropped {
            view: self.scan.views[index].name.clone(),
            stage,
            reason: reason.clone(),
        });
        self.dropped.push(DroppedView {
            index,
            stage,
            reason,
        });
    }

    fn check_left(&self, left: usize) -> Result<(), PipelineError> {
        let needed = self.config.goal.min_view_count();
        if left < needed {
            return Err(PipelineError::TooFewViews { left, needed });
        }
        Ok(())
    }

    /// Whether all photos can come from one camera
    fn one_shape(&self) -> bool {
        let mut shapes = self.scan.views.iter().map(|view| {
            let (width, height) = (view.photo.width(), view.photo.height());
            width as f64 / height as f64
        });
        let first = shapes.next();
        first.is_none_or(|first| shapes.all(|shape| (shape / first - 1.0).abs() < 0.02))
    }

    fn make_avatar(&mut self) -> Result<Avatar, PipelineError> {
        let (scan, source) = (self.scan, &self.config.avatar);
        self.stage(Stage::Avatar, 1, |_| match source {
            AvatarSource::Mannequin { sex, mass_kg } => Ok(mannequin(&MannequinParameters {
                sex: *sex,
                stature_mm: scan.stature_mm,
                mass_kg: *mass_kg,
                pose: scan.pose,
                ..MannequinParameters::default()
            })?),
            AvatarSource::File { name, bytes } => {
                let avatar =
                    load_avatar(bytes, scan.pose).map_err(|source| PipelineError::Avatar {
                        name: name.clone(),
                        source,
                    })?;
                Ok(match scan.stature_mm {
                    Some(stature_mm) => avatar.scaled_to(stature_mm),
                    None => avatar,
                })
            }
        })?
    }

    /// One skeleton for all views; silhouettes alone can do without
    fn find_skeleton(&mut self, avatar: &Avatar) -> Result<Option<Bundle>, PipelineError> {
        let scan = self.scan;
        if self.config.goal == Goal::Segment && !self.one_shape() {
            return Ok(None);
        }
        let found = self.stage(Stage::Bundle, 1, |_| {
            let views: Vec<BundleView> = scan
                .views
                .iter()
                .map(|view| BundleView {
                    turn: view.turn,
                    keypoints: view.keypoints,
                    width_px: view.photo.width(),
                    height_px: view.photo.height(),
                })
                .collect();
            let options = BundleOptions::default();
            bundle(avatar, &views, &scan.camera, scan.stature_mm, &options)
        })?;
        let bundle = match found {
            Ok(bundle) => bundle,
            Err(error) if self.config.goal == Goal::Segment => {
                self.warn(Warning::NoSkeleton(error));
                return Ok(None);
            }
            Err(error) => return Err(error.into()),
        };
        let name = |index: usize| scan.views[index].name.clone();
        for &warning in &bundle.warnings {
            // Silhouettes have no size in mm.
            if self.config.goal > Goal::Segment || !warning::is_about_scale(warning) {
                self.warn(Warning::Bundle(warning));
            }
        }
        for &(view, limb) in &bundle.swaps {
            let view = name(view);
            self.warn(Warning::SidesSwapped { view, limb });
        }
        for outlier in &bundle.outliers {
            self.warn(Warning::Outlier {
                view: name(outlier.view),
                joint: outlier.joint,
                residual_px: outlier.residual_px,
            });
        }
        Ok(Some(bundle))
    }

    /// Where each photo shows the avatar with the person's bones in the person's pose
    fn render_priors(
        &mut self,
        bundle: Option<&Bundle>,
    ) -> Result<Vec<Option<Grid<f32>>>, PipelineError> {
        let Some(bundle) = bundle else {
            return Ok(self.scan.views.iter().map(|_| None).collect());
        };
        let view_count = self.scan.views.len();
        self.stage(Stage::Prior, view_count, |steps| {
            let avatar = &bundle.avatar;
            let mesh = render::SilhouetteMesh::new(&avatar.mesh.triangles);
            let render = |index: usize| {
                let posed = pose_bones(
                    &avatar.bone_heads,
                    &bundle.poses[index],
                    bundle.turns[index],
                );
                let positions = posed.skin(&avatar.mesh.positions, &avatar.weights);
                let coverage = mesh.silhouette(&positions, &bundle.cameras[index]);
                steps.done();
                Some(coverage)
            };
            (0..view_count).into_par_iter().map(render).collect()
        })
    }

    fn segment(&mut self, priors: &[Option<Grid<f32>>]) -> Result<Vec<ViewReport>, PipelineError> {
        let (scan, cancel) = (self.scan, self.cancel);
        let options = SegmentOptions {
            // Photos of different cameras share neither colors nor background.
            single: !self.one_shape(),
            ..SegmentOptions::default()
        };
        let silhouettes: Vec<Result<Silhouette, SegmentError>> =
            self.stage(Stage::Segment, 1, |_| {
                let views: Vec<SegmentView> = scan
                    .views
                    .iter()
                    .zip(priors)
                    .map(|(view, prior)| SegmentView {
                        photo: &view.photo,
                        keypoints: &view.keypoints,
                        prior: prior.as_ref(),
                        mask: view.mask.as_ref(),
                    })
                    .collect();
                segment(&views, &options, &|| cancel.cancelled())
            })?;
        let mut views = Vec::new();
        for (index, silhouette) in silhouettes.into_iter().enumerate() {
            match silhouette {
                Ok(silhouette) => views.push(ViewReport { index, silhouette }),
                Err(error) => self.drop_view(index, Stage::Segment, DropReason::Segment(error)),
            }
        }
        self.check_left(views.len())?;
        Ok(views)
    }
}
