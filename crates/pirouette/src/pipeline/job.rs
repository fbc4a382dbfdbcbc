//! A running job: what each stage takes from those before it.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use pirouette_geom::{Mask, TriMesh};
use rayon::prelude::*;

use crate::body_fit::{CameraSpread, Fit, FitPrior, Outlines, fit_outlines};
use crate::carve::{CarveOptions, carve, carve_beside_avatar};
use crate::color::{ColorOptions, ColorView, SurfaceColors, color_surface};
use crate::initial_body;
use crate::measure::{MeasureInput, Measurements, measure};
use crate::normalize::{NormalizeError, NormalizedView};
use crate::pipeline::views::{
    Normalizer, carve_views, measure_views, normalized_outlines, photographed_outlines,
};
use crate::pipeline::warning;
use crate::pipeline::warning::Warning;
use crate::pipeline::{
    AvatarSource, CancelToken, Config, DropReason, DroppedView, Event, Goal, Method, PipelineError,
    Stage, StartFigure, ViewReport,
};
use crate::scan::{CameraSetup, Scan};
use crate::segment::{SegmentError, SegmentOptions, SegmentView, Silhouette, segment};
use crate::skeleton_fit::{Bundle, BundleOptions, BundleView, bundle};
use pirouette_body::gltf::load_avatar;
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::{Avatar, render};
use pirouette_body::{Pose, pose_bones};
use pirouette_geom::outline_map::OutlineMap;

/// A running job
pub(super) struct Job<'a> {
    scan: &'a Scan,
    config: &'a Config,
    cancel: &'a CancelToken,
    tell: &'a mut (dyn FnMut(Event) + Send),
    pub(super) dropped: Vec<DroppedView>,
    pub(super) warnings: Vec<Warning>,
    pub(super) seconds: Vec<(Stage, f64)>,
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

impl<'a> Job<'a> {
    pub(super) fn new(
        scan: &'a Scan,
        config: &'a Config,
        cancel: &'a CancelToken,
        tell: &'a mut (dyn FnMut(Event) + Send),
    ) -> Self {
        Self {
            scan,
            config,
            cancel,
            tell,
            dropped: Vec::new(),
            warnings: Vec::new(),
            seconds: Vec::new(),
        }
    }

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

    pub(super) fn check_left(&self, left: usize) -> Result<(), PipelineError> {
        let usual = self.config.goal.min_view_count();
        let given = self.config.given_view_count;
        let given = given.unwrap_or(self.scan.views.len());
        let needed = match self.config.method {
            Method::Fit => usual.min(given.max(MIN_FIT_VIEWS)),
            Method::ThreeStep => usual,
        };
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

    pub(super) fn make_avatar(&mut self) -> Result<Avatar, PipelineError> {
        let (scan, config) = (self.scan, self.config);
        self.stage(Stage::Avatar, 1, |_| match &config.avatar {
            AvatarSource::Mannequin { sex, mass_kg } => {
                let parameters = MannequinParameters {
                    sex: *sex,
                    stature_mm: scan.stature_mm,
                    mass_kg: *mass_kg,
                    pose: scan.pose,
                    ..MannequinParameters::default()
                };
                Ok(mannequin(&parameters)?)
            }
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
    pub(super) fn find_skeleton(
        &mut self,
        avatar: &Avatar,
    ) -> Result<Option<Bundle>, PipelineError> {
        let scan = self.scan;
        if self.config.goal == Goal::Segment && !self.one_shape() {
            return Ok(None);
        }
        let found = self.stage(Stage::Bundle, 1, |_| {
            let views: Vec<BundleView> = scan.views.iter().map(BundleView::from).collect();
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
    pub(super) fn render_priors(
        &mut self,
        bundle: Option<&Bundle>,
    ) -> Result<Vec<Option<Mask>>, PipelineError> {
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
                Some(coverage.threshold(0.5))
            };
            (0..view_count).into_par_iter().map(render).collect()
        })
    }

    pub(super) fn segment(
        &mut self,
        priors: &[Option<Mask>],
    ) -> Result<Vec<ViewReport>, PipelineError> {
        let (scan, cancel) = (self.scan, self.cancel);
        let options = SegmentOptions {
            // Photos of different cameras share neither colors nor background.
            single: self.config.segment.single || !self.one_shape(),
            ..self.config.segment
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
                Ok(silhouette) => views.push(ViewReport {
                    index,
                    silhouette,
                    normalized: None,
                }),
                Err(error) => self.drop_view(index, Stage::Segment, DropReason::Segment(error)),
            }
        }
        self.check_left(views.len())?;
        Ok(views)
    }

    /// One body in the poses of all views
    ///
    /// Views that contradict the others are dropped, and the body is fitted again.
    pub(super) fn fit(
        &mut self,
        bundle: &Bundle,
        views: &mut Vec<ViewReport>,
    ) -> Result<(Fit, Option<StartFigure>), PipelineError> {
        let mut found = self.fit_all(bundle, views)?;
        let bad = contradicting(&found.0.silhouette_ious);
        if !bad.is_empty() {
            for &(place, ref reason) in &bad {
                self.drop_view(views[place].index, Stage::Fit, reason.clone());
            }
            let mut place = 0;
            views.retain(|_| {
                place += 1;
                !bad.iter().any(|(bad, _)| bad + 1 == place)
            });
            self.check_left(views.len())?;
            found = self.fit_all(bundle, views)?;
        }
        Ok(found)
    }

    fn fit_all(
        &mut self,
        bundle: &Bundle,
        views: &[ViewReport],
    ) -> Result<(Fit, Option<StartFigure>), PipelineError> {
        let (scan, config, cancel) = (self.scan, self.config, self.cancel);
        let free = initial_body::is_free(config);
        self.stage(Stage::Fit, 1, |_| {
            let stature_mm = scan.stature_mm.unwrap_or(bundle.avatar.stature_mm());
            let cancelled = || cancel.cancelled();
            let poses: Vec<Pose> = views.iter().map(|view| bundle.poses[view.index]).collect();
            let outlines =
                Outlines::trace(&initial_body::fit_views(bundle, views, &poses, stature_mm));
            let choose = || {
                initial_body::choose_start(scan, bundle, views, &outlines, stature_mm, &cancelled)
            };
            let start = free.then(choose).transpose()?;
            let (avatar, posture, poses) = match &start {
                Some(start) => (&start.avatar, &start.posture, &start.poses),
                None => (&bundle.avatar, &bundle.posture, &poses),
            };
            let fit = fit_outlines(
                avatar,
                &initial_body::fit_views(bundle, views, poses, stature_mm),
                &outlines,
                &FitPrior {
                    posture: *posture,
                    stature_mm: Some(stature_mm),
                    camera: camera_spread(&scan.camera),
                },
                &config.fit,
                &cancelled,
            );
            Ok((fit, start.map(|start| start.figure)))
        })?
    }

    /// Colors of the fitted body
    pub(super) fn color(
        &mut self,
        bundle: &Bundle,
        fit: &Fit,
        views: &[ViewReport],
    ) -> Result<Option<SurfaceColors>, PipelineError> {
        let scan = self.scan;
        self.stage(Stage::Color, 1, |_| {
            let views: Vec<ColorView> = views
                .iter()
                .zip(&fit.poses)
                .map(|(view, &pose)| ColorView {
                    photo: &scan.views[view.index].photo,
                    mask: &view.silhouette.mask,
                    camera: bundle.cameras[view.index],
                    turn: bundle.turns[view.index],
                    pose,
                })
                .collect();
            color_surface(&fit.avatar, &views, &ColorOptions::default())
        })
    }

    /// Brings each silhouette to the reference pose
    pub(super) fn normalize(
        &mut self,
        avatar: &Avatar,
        bundle: &Bundle,
        fit: Option<&Fit>,
        views: Vec<ViewReport>,
    ) -> Result<Vec<ViewReport>, PipelineError> {
        let (config, cancel) = (self.config, self.cancel);
        let results: Vec<Option<Result<NormalizedView, NormalizeError>>> =
            self.stage(Stage::Normalize, views.len(), |steps| {
                let normalizer = Normalizer::new(config, avatar, bundle, fit);
                views
                    .par_iter()
                    .enumerate()
                    .map(|(place, view)| {
                        if cancel.cancelled() {
                            return None;
                        }
                        let normalized = normalizer.normalize(place, view);
                        steps.done();
                        Some(normalized)
                    })
                    .collect()
            })?;
        let mut left = Vec::new();
        for (mut view, result) in views.into_iter().zip(results) {
            match result {
                Some(Ok(normalized)) => {
                    for &warning in &normalized.warnings {
                        let name = self.scan.views[view.index].name.clone();
                        self.warn(Warning::Normalize {
                            view: name,
                            warning,
                        });
                    }
                    view.normalized = Some(normalized);
                    left.push(view);
                }
                Some(Err(error)) => {
                    let reason = DropReason::Normalize(error);
                    self.drop_view(view.index, Stage::Normalize, reason);
                }
                None => return Err(PipelineError::Cancelled),
            }
        }
        self.check_left(left.len())?;
        Ok(left)
    }

    /// The body that all normalized silhouettes allow, and their outlines
    pub(super) fn carve(
        &mut self,
        bundle: &Bundle,
        fit: Option<&Fit>,
        views: &[ViewReport],
    ) -> Result<(TriMesh, Vec<OutlineMap>), PipelineError> {
        self.stage(Stage::Carve, 1, |_| {
            let outlines = normalized_outlines(views);
            let options = CarveOptions::default();
            let views = carve_views(bundle, views, &outlines);
            let hull = match fit {
                Some(fit) => carve_beside_avatar(&views, &fit.avatar, &options)?,
                None => carve(&views, &options)?,
            };
            Ok((hull, outlines))
        })?
    }

    /// Tapes around the body: the fitted one, or the one carved from the `normalized` outlines
    pub(super) fn measure(
        &mut self,
        bundle: &Bundle,
        fit: Option<&Fit>,
        views: &[ViewReport],
        normalized: Vec<OutlineMap>,
        body: &TriMesh,
    ) -> Result<Measurements, PipelineError> {
        let scan = self.scan;
        let found = self.stage(Stage::Measure, 1, |_| {
            let outlines = match fit {
                Some(_) => photographed_outlines(views),
                None => normalized,
            };
            measure(&MeasureInput {
                body,
                avatar: fit.map_or(&bundle.avatar, |fit| &fit.avatar),
                fitted: fit.is_some(),
                views: &measure_views(bundle, fit, views, &outlines),
                stature_mm: scan.stature_mm,
                stature_from: scan.stature_from,
                subject: scan.subject,
                given_masks: views
                    .iter()
                    .filter(|view| scan.views[view.index].mask.is_some())
                    .count() as f64
                    / views.len().max(1) as f64,
            })
        })?;
        for (measure, measured) in found.iter() {
            if let (true, Some(lines), Some(body)) =
                (measured.contradicted, measured.lines, measured.body)
            {
                self.warn(Warning::TapesDiffer {
                    measure,
                    lines_mm: lines.value_mm,
                    body_mm: body.value_mm,
                });
            }
        }
        Ok(found)
    }
}

/// How far the skeleton's camera may be off, where it was not given
///
/// The places of a figure's joints in its body are not those of a detector, which tilts the camera by 0.1 to 0.3 degrees
/// and moves it by up to 0.7 %.
fn camera_spread(given: &CameraSetup) -> CameraSpread {
    let unless = |given: Option<f64>, spread: f64| if given.is_some() { 0.0 } else { spread };
    CameraSpread {
        distance_mm: unless(given.distance_mm, 100.0),
        height_mm: unless(given.height_mm, 50.0),
        pitch_radians: unless(given.pitch_radians, 1.0_f64.to_radians()),
    }
}

/// Views that a body fit needs at least
const MIN_FIT_VIEWS: usize = 2;

/// A view contradicts the others when its overlap is this much below the median
///
/// Rendered people and a clothed man stay within 0.02 of it; a photo of another pose or person falls by 0.1 and more.
const CONTRADICTION: f64 = 0.07;

/// Views that contradict the others, if those are a clear majority
fn contradicting(ious: &[f64]) -> Vec<(usize, DropReason)> {
    let mut sorted = ious.to_vec();
    sorted.sort_by(f64::total_cmp);
    let Some(&usual) = sorted.get(sorted.len() / 2) else {
        return Vec::new();
    };
    let bad: Vec<(usize, DropReason)> = ious
        .iter()
        .enumerate()
        .filter(|(_, iou)| **iou < usual - CONTRADICTION)
        .map(|(place, &iou)| (place, DropReason::Contradicts { iou, usual }))
        .collect();
    // Of few views nobody knows which one is wrong.
    if 4 * bad.len() <= ious.len() {
        bad
    } else {
        Vec::new()
    }
}
