//! A running job: passes the results of each stage to the next ones.

use std::sync::{Mutex, PoisonError};
use web_time::Instant;

use pirouette_body::Avatar;
use pirouette_geom::Mask;
use pirouette_geom::outline_map::OutlineMap;
use pirouette_geom::parallel::prelude::*;

use crate::carve::{CarveOptions, carve, carve_beside_avatar};
use crate::color::{ColorOptions, ColorView, color_surface};
use crate::measure::{BodySource, Covering, MeasureInput, measure};
use crate::normalize::{NormalizeError, NormalizedView};
use crate::pipeline::stages::{
    Normalizer, carve_views, make_avatar, measure_views, normalized_outlines, outlines_with_core,
    photographed_outlines, render_priors,
};
use crate::pipeline::verdict::Doubts;
use crate::pipeline::warning::{self, Warning};
use crate::pipeline::{
    CancelToken, Config, DropReason, DroppedView, Event, Goal, Method, PipelineError, Report, Stage,
};
use crate::scan::{KeypointKind, KeypointSource, Scan, Subject, View};
use crate::segment::{SegmentError, SegmentOptions, SegmentView, Silhouette, segment};
use crate::skeleton_fit::{KeypointView, Skeleton, SkeletonFitOptions, SkeletonView, fit_skeleton};
use crate::skirt::Skirt;
use crate::view::{SolvedView, ViewId};

/// A running job
pub(super) struct Job<'a> {
    pub(super) scan: &'a Scan,
    pub(super) config: &'a Config,
    pub(super) cancel: &'a CancelToken,
    on_event: &'a mut (dyn FnMut(Event) + Send),
    pub(super) dropped: Vec<DroppedView>,
    pub(super) warnings: Vec<Warning>,
    pub(super) seconds: Vec<(Stage, f64)>,
}

/// Reports completed steps of a stage, from any thread
pub(super) struct Steps<'a> {
    stage: Stage,
    on_event: Mutex<&'a mut (dyn FnMut(Event) + Send)>,
}

impl Steps<'_> {
    pub(super) fn done(&self) {
        let mut on_event = self.on_event.lock().unwrap_or_else(PoisonError::into_inner);
        on_event(Event::StepDone { stage: self.stage });
    }
}

impl<'a> Job<'a> {
    pub(super) fn new(
        scan: &'a Scan,
        config: &'a Config,
        cancel: &'a CancelToken,
        on_event: &'a mut (dyn FnMut(Event) + Send),
    ) -> Self {
        Self {
            scan,
            config,
            cancel,
            on_event,
            dropped: Vec::new(),
            warnings: Vec::new(),
            seconds: Vec::new(),
        }
    }

    /// Runs one stage: emits its events, times it, and returns `Cancelled` if cancellation was requested
    pub(super) fn stage<T>(
        &mut self,
        stage: Stage,
        step_count: usize,
        work: impl FnOnce(&Steps) -> T,
    ) -> Result<T, PipelineError> {
        if self.cancel.cancelled() {
            return Err(PipelineError::Cancelled);
        }
        (self.on_event)(Event::StageStarted { stage, step_count });
        let start = Instant::now();
        let steps = Steps {
            stage,
            on_event: Mutex::new(&mut *self.on_event),
        };
        let result = work(&steps);
        let seconds = start.elapsed().as_secs_f64();
        if self.cancel.cancelled() {
            return Err(PipelineError::Cancelled);
        }
        (self.on_event)(Event::StageDone { stage, seconds });
        // Some stages run again when silhouettes are computed again.
        match self.seconds.iter_mut().find(|(other, _)| *other == stage) {
            Some((_, sum)) => *sum += seconds,
            None => self.seconds.push((stage, seconds)),
        }
        Ok(result)
    }

    pub(super) fn scan(&self) -> &'a Scan {
        self.scan
    }

    pub(super) fn warn(&mut self, warning: Warning) {
        (self.on_event)(Event::Warning(warning.clone()));
        self.warnings.push(warning);
    }

    pub(super) fn drop_view(&mut self, id: ViewId, stage: Stage, reason: DropReason) {
        self.warn(Warning::ViewDropped {
            view: self.scan.views[id.0].name.clone(),
            stage,
            reason: reason.clone(),
        });
        self.dropped.push(DroppedView { id, stage, reason });
    }

    pub(super) fn check_left(&self, left: usize) -> Result<(), PipelineError> {
        let usual = self.config.goal.min_view_count();
        let given = self.scan.given_view_count();
        let needed = match self.config.method {
            Method::Fit => usual.min(given.max(MIN_FIT_VIEWS)),
            Method::ThreeStep => usual,
        };
        if left < needed {
            return Err(PipelineError::TooFewViews { left, needed });
        }
        Ok(())
    }

    pub(super) fn make_avatar(&mut self) -> Result<Avatar, PipelineError> {
        let (scan, source) = (self.scan, &self.config.avatar);
        let (avatar, hull) = self.stage(Stage::Avatar, 1, |_| make_avatar(scan, source))??;
        if let Some(hull) = hull {
            self.warn(Warning::AvatarClosed(hull));
        }
        Ok(avatar)
    }

    /// Fits one skeleton to all views; optional if only silhouettes are requested
    pub(super) fn fit_skeleton(
        &mut self,
        avatar: &Avatar,
    ) -> Result<Option<(Skeleton, Vec<SkeletonView>)>, PipelineError> {
        let scan = self.scan;
        if self.config.goal == Goal::Segment && !self.scan.has_one_shape() {
            return Ok(None);
        }
        let found = self.stage(Stage::SkeletonFit, 1, |_| {
            let views: Vec<KeypointView> = scan.views.iter().map(KeypointView::from).collect();
            let options = SkeletonFitOptions::default();
            fit_skeleton(avatar, &views, &scan.camera, scan.stature_mm, &options)
        })?;
        let (skeleton, views) = match found {
            Ok(found) => found,
            Err(error) if self.config.goal == Goal::Segment => {
                self.warn(Warning::NoSkeleton(error));
                return Ok(None);
            }
            Err(error) => return Err(error.into()),
        };
        let name = |index: usize| scan.views[index].name.clone();
        for &warning in &skeleton.warnings {
            // Silhouettes do not depend on the scale in mm.
            if self.config.goal > Goal::Segment || !warning::is_about_scale(warning) {
                self.warn(Warning::Skeleton(warning));
            }
        }
        let of_turns = warning::turn_warnings(scan, &skeleton, &views);
        of_turns.into_iter().for_each(|warning| self.warn(warning));
        for &(view, limb) in &skeleton.swaps {
            let view = name(view);
            self.warn(Warning::SidesSwapped { view, limb });
        }
        for outlier in &skeleton.outliers {
            self.warn(Warning::Outlier {
                view: name(outlier.view),
                joint: outlier.joint,
                residual_px: outlier.residual_px,
            });
        }
        Ok(Some((skeleton, views)))
    }

    /// Renders the avatar with the person's bones in the pose of each view; empty without a skeleton
    pub(super) fn render_priors(
        &mut self,
        skeleton: Option<&Skeleton>,
        views: Option<&[SkeletonView]>,
    ) -> Result<Vec<Mask>, PipelineError> {
        let Some((skeleton, views)) = skeleton.zip(views) else {
            return Ok(Vec::new());
        };
        self.stage(Stage::Prior, views.len(), |steps| {
            render_priors(&skeleton.avatar, views, &|| steps.done())
        })
    }

    pub(super) fn segment(
        &mut self,
        skeleton_views: Option<&[SkeletonView]>,
        priors: &[Mask],
    ) -> Result<Vec<SolvedView>, PipelineError> {
        let (scan, cancel) = (self.scan, self.cancel);
        let mut options = self.segment_options();
        if skeleton_views.is_some() && self.segments_again() {
            options = options.rough();
        }
        let silhouettes: Vec<Result<Silhouette, SegmentError>> =
            self.stage(Stage::Segment, 1, |_| {
                let views: Vec<SegmentView> = scan
                    .views
                    .iter()
                    .enumerate()
                    .map(|(index, view)| SegmentView {
                        photo: &view.photo,
                        keypoints: &view.keypoints,
                        prior: priors.get(index),
                        mask: view.mask.as_ref(),
                        person_odds: view.person_odds.as_ref(),
                    })
                    .collect();
                segment(&views, scan.background.as_ref(), &options, &|| {
                    cancel.cancelled()
                })
            })?;
        let mut views = Vec::new();
        for (index, silhouette) in silhouettes.into_iter().enumerate() {
            match silhouette {
                Ok(silhouette) => views.push(SolvedView {
                    id: ViewId(index),
                    silhouette,
                    skeleton: skeleton_views.map(|views| views[index]),
                    fit: None,
                    normalized: None,
                }),
                Err(error) => {
                    self.drop_view(ViewId(index), Stage::Segment, DropReason::Segment(error))
                }
            }
        }
        self.check_left(views.len())?;
        Ok(views)
    }

    /// Returns whether silhouettes are computed again with the fitted body: if keypoints are uncertain
    pub(super) fn segments_again(&self) -> bool {
        self.config.method == Method::Fit
            && self.config.goal >= Goal::Normalize
            && self.scan.views.iter().any(View::keypoints_are_rough)
    }

    pub(super) fn segment_options(&self) -> SegmentOptions {
        SegmentOptions {
            // Photos of different cameras have neither colors nor background in common.
            single: self.config.segment.single || !self.scan.has_one_shape(),
            ..self.config.segment
        }
    }

    /// Samples the colors of the fitted body
    pub(super) fn color(&mut self, report: &mut Report) -> Result<(), PipelineError> {
        let scan = self.scan;
        let (Some(fit), views, skirt) = (&report.fit, &report.views, report.skirt) else {
            return Ok(());
        };
        (report.colors, report.dressed) = self.stage(Stage::Color, 1, |_| {
            let views: Vec<ColorView> = views
                .iter()
                .map(|view| ColorView {
                    photo: &scan.views[view.id.0].photo,
                    mask: &view.silhouette.mask,
                    camera: view.skeleton().camera,
                    turn: view.skeleton().turn,
                    pose: view.fit.map_or(view.skeleton().pose, |fit| fit.pose),
                })
                .collect();
            let colors = color_surface(&fit.avatar, &views, &ColorOptions::default());
            let dressed = skirt.and_then(|skirt| skirt.dress(&fit.avatar, colors.as_ref()));
            (colors, dressed)
        })?;
        if let Some(Skirt { hem_mm }) = report.skirt {
            self.warn(Warning::Skirt { hem_mm });
        }
        Ok(())
    }

    /// Transforms each silhouette to the reference pose
    pub(super) fn normalize(&mut self, report: &mut Report) -> Result<(), PipelineError> {
        let (config, cancel) = (self.config, self.cancel);
        let read: &Report = report;
        let results: Vec<Option<Result<NormalizedView, NormalizeError>>> = self
            .stage(Stage::Normalize, read.views.len(), |steps| {
                let normalizer = Normalizer::new(config, read)?;
                let normalize = |view| {
                    if cancel.cancelled() {
                        return None;
                    }
                    let normalized = normalizer.normalize(view);
                    steps.done();
                    Some(normalized)
                };
                Some(read.views.par_iter().map(normalize).collect())
            })?
            .unwrap_or_default();
        let views = std::mem::take(&mut report.views);
        for (mut view, result) in views.into_iter().zip(results) {
            match result {
                Some(Ok(normalized)) => {
                    for &warning in &normalized.warnings {
                        let name = self.scan.views[view.id.0].name.clone();
                        self.warn(Warning::Normalize {
                            view: name,
                            warning,
                        });
                    }
                    view.normalized = Some(normalized);
                    report.views.push(view);
                }
                Some(Err(error)) => {
                    let reason = DropReason::Normalize(error);
                    self.drop_view(view.id, Stage::Normalize, reason);
                }
                None => return Err(PipelineError::Cancelled),
            }
        }
        self.check_left(report.views.len())
    }

    /// Carves the hull if it is the body or was requested, and returns the normalized outlines
    pub(super) fn carve(&mut self, report: &mut Report) -> Result<Vec<OutlineMap>, PipelineError> {
        let mut outlines = Vec::new();
        if report.fit.is_none() || self.config.hull {
            let (views, fit, avatar) = (&report.views, &report.fit, &report.avatar);
            let (hull, normalized) = self.stage(Stage::Carve, 1, |_| {
                let outlines = match fit {
                    Some(_) => normalized_outlines(views),
                    None => outlines_with_core(views, avatar),
                };
                let options = CarveOptions::default();
                let views = carve_views(views, &outlines);
                let hull = match fit {
                    Some(fit) => carve_beside_avatar(&views, &fit.avatar, &options)?,
                    None => carve(&views, &options)?,
                };
                Ok::<_, PipelineError>((hull, outlines))
            })??;
            report.hull = Some(hull);
            outlines = normalized;
        }
        report.body = match &report.fit {
            Some(fit) => Some(fit.avatar.mesh.clone()),
            None if self.config.hull => report.hull.clone(),
            None => report.hull.take(),
        };
        Ok(outlines)
    }

    /// Measures the body: the fitted one, or the one carved from the `normalized` outlines
    pub(super) fn measure(
        &mut self,
        report: &mut Report,
        normalized: Vec<OutlineMap>,
    ) -> Result<(), PipelineError> {
        let scan = self.scan;
        let (Some(body), Some(avatar)) = (&report.body, report.person()) else {
            return Ok(());
        };
        let views = &report.views[..];
        let source = match report.fit {
            Some(_) => BodySource::Fitted,
            None => BodySource::Hull,
        };
        let share_of = |of: &dyn Fn(&View) -> bool| {
            let count = views.iter().filter(|v| of(&scan.views[v.id.0])).count();
            count as f64 / views.len().max(1) as f64
        };
        let detected_keypoints = share_of(&|view| view.keypoint_kind == KeypointKind::MediaPipe);
        let estimated_keypoints = share_of(&|view| view.keypoints_from == KeypointSource::Estimate);
        let doubts = Doubts::of(scan, report);
        let (surface, skirt) = (self.config.surface, report.skirt.is_some());
        let subject = Subject {
            clothes: self.config.clothes.or(scan.subject.clothes),
            ..scan.subject
        };
        let found = self.stage(Stage::Measure, 1, |_| {
            let outlines = match source {
                // The fitted surface is more accurate than outlines of it.
                _ if scan.surface.is_some() => Vec::new(),
                BodySource::Fitted => photographed_outlines(views),
                BodySource::Hull => normalized,
            };
            measure(&MeasureInput {
                body,
                avatar,
                source,
                views: &measure_views(views, &outlines),
                stature_mm: scan.stature_mm,
                stature_from: scan.stature_from,
                subject,
                given_masks: share_of(&|view| view.mask.is_some()),
                detected_keypoints,
                estimated_keypoints,
                extra_sd: doubts.extra_sd(),
                surface,
                skirt,
            })
        })?;
        if detected_keypoints > 0.0 {
            self.warn(Warning::KeypointsDetected);
        }
        if estimated_keypoints > 0.0 && scan.surface.is_none() {
            self.warn(Warning::KeypointsEstimated);
        }
        doubts.warnings().into_iter().for_each(|w| self.warn(w));
        if let Some(mass) = found
            .mass
            .as_ref()
            .filter(|mass| mass.contradiction() > 0.0)
            && let Some(stated_kg) = mass.stated_kg
        {
            let mass_kg = mass.mass_kg;
            self.warn(Warning::MassContradicted { stated_kg, mass_kg });
        }
        if let Some(clothes) = &found.clothes {
            let covered = clothes.covered().copied().collect::<Vec<Covering>>();
            if !covered.is_empty() {
                self.warn(Warning::Covered { parts: covered });
            }
        }
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
        report.measurements = Some(found);
        Ok(())
    }

    /// Completes the report with rejected views, warnings and times
    pub(super) fn finish(self, report: Report) -> Report {
        Report {
            dropped: self.dropped,
            warnings: self.warnings,
            seconds: self.seconds,
            ..report
        }
    }
}

/// Minimum number of views of a body fit
const MIN_FIT_VIEWS: usize = 2;
