//! The body fit of a job, with silhouettes that are computed again where keypoints are uncertain.

use pirouette_body::{Avatar, Keypoint, Keypoints, Pose, Sex, TurnAngle, pose_bones};

use crate::body_fit::{
    BodyFitOptions, BodyFitPrior, CameraSpread, FittedView, Outlines, fit_outlines, fit_to_mesh,
    overlaps,
};
use crate::initial_body::{choose_start, fit_views, start_as};
use crate::pipeline::job::Job;
use crate::pipeline::stages::render_priors;
use crate::pipeline::{
    AvatarSource, Config, DropReason, Method, PipelineError, Report, Stage, TurnChange, Warning,
};
use crate::scan::{CameraSetup, KeypointKind, Scan};
use crate::segment::{SegmentView, segment};
use crate::skeleton_fit::{REPORTED_TURN_SIGMAS, SkeletonView, TurnFrom, are_wrong};
use crate::skirt::find_skirt;
use crate::view::{SolvedView, ViewId};

impl Job<'_> {
    /// Fits one body to all views
    ///
    /// Detected and estimated keypoints are less accurate than a fitted body: after a rough fit, its joints replace them,
    /// silhouettes are computed again with its outline, and it is fitted to both. If views are inconsistent with the others, they
    /// are dropped, and the body is fitted again.
    pub(super) fn fit_body(&mut self, report: &mut Report) -> Result<(), PipelineError> {
        let options = &self.config.fit;
        let detected = self.detected_keypoints(report);
        if self.segments_again() {
            self.fit_all(report, &options.rough())?;
            self.segment_again(report)?;
        }
        self.fit_all(report, options)?;
        self.find_skirt(report)?;
        let wrong = match self.scan.surface {
            // The turns of a known mesh are exact.
            Some(_) => Vec::new(),
            None => wrong_turns(self.scan, &report.views),
        };
        if !wrong.is_empty() {
            self.use_found_turns(report, &wrong);
            self.fit_all(report, options)?;
        }
        let bad = contradicting(&report.views);
        if !bad.is_empty() {
            for (id, reason) in &bad {
                self.drop_view(*id, Stage::BodyFit, reason.clone());
            }
            let is_bad = |id: ViewId| bad.iter().any(|(bad, _)| *bad == id);
            report.views.retain(|view| !is_bad(view.id));
            self.check_left(report.views.len())?;
            report.start = None;
            self.fit_all(report, options)?;
        }
        self.fit_to_mesh(report)?;
        adopt_camera(report);
        adopt_turns(report);
        // Pictures and the judgment of the body compare it with what was detected.
        for view in &mut report.views {
            let detected = detected.iter().find(|(id, _)| *id == view.id);
            if let (Some((_, keypoints)), Some(skeleton)) = (detected, &mut view.skeleton) {
                skeleton.keypoints = *keypoints;
            }
        }
        Ok(())
    }

    /// Finds a skirt; then computes the silhouettes again, with a prior that has one, and fits again
    fn find_skirt(&mut self, report: &mut Report) -> Result<(), PipelineError> {
        let Some(body) = report.fit.as_ref().map(|fit| &fit.avatar) else {
            return Ok(());
        };
        let views: Vec<SkeletonView> = report.views.iter().map(fitted_view).collect();
        let bodies = render_priors(body, &views, &|| ());
        let masks = report.views.iter().map(|view| &view.silhouette.mask);
        report.skirt = find_skirt(body, &views, &bodies, &masks.collect::<Vec<_>>());
        if report.skirt.is_some() {
            self.segment_again(report)?;
            self.fit_all(report, &self.config.fit)?;
        }
        Ok(())
    }

    /// Fits the body to the mesh that the views were rendered from, if they were, in the pose that explains it best
    fn fit_to_mesh(&mut self, report: &mut Report) -> Result<(), PipelineError> {
        let (scan, cancel) = (self.scan, self.cancel);
        let fitted = report
            .views
            .iter()
            .filter_map(|view| Some((view.fit?, view)));
        let overlap = |fit: &FittedView| fit.silhouette_iou.unwrap_or(0.0);
        let best = fitted.max_by(|(a, _), (b, _)| overlap(a).total_cmp(&overlap(b)));
        let best = best.map(|(fit, view)| (fit, view.skeleton().turn));
        if let (Some(mesh), Some(fit), Some((view, turn))) = (&scan.surface, &mut report.fit, best)
        {
            let pose = self.stage(Stage::BodyFit, 1, |_| {
                fit_to_mesh(fit, &view.pose, turn, mesh, &|| cancel.cancelled())
            })?;
            let views = report.views.iter();
            let poses = views.map(|view| pose.turned(turn, view.skeleton().turn));
            let poses: Vec<Pose> = poses.collect();
            let stature_mm = fit.avatar.stature_mm();
            let seen = fit_views(&report.views, &poses, stature_mm);
            let ious = overlaps(&fit.avatar, &seen, &poses);
            for ((view, pose), silhouette_iou) in report.views.iter_mut().zip(poses).zip(ious) {
                view.fit = view.fit.map(|fit| FittedView {
                    pose,
                    silhouette_iou,
                    ..fit
                });
            }
            cover_legs(report);
        }
        Ok(())
    }

    /// Replaces all stated turn angles by those of the fitted body, and reports the `wrong` ones
    fn use_found_turns(&mut self, report: &mut Report, wrong: &[ViewId]) {
        for view in &mut report.views {
            if let Some(skeleton) = &mut view.skeleton {
                skeleton.turn_from = TurnFrom::Corrected;
            }
        }
        let stated = |view: &SolvedView| (view.id, view.skeleton().turn);
        let stated: Vec<(ViewId, TurnAngle)> = report.views.iter().map(stated).collect();
        adopt_turns(report);
        let changes = report
            .views
            .iter()
            .zip(stated)
            .filter(|(view, _)| wrong.contains(&view.id));
        let views = changes.map(|(view, (id, stated))| TurnChange {
            view: self.scan.views[id.0].name.clone(),
            stated_degrees: stated.wrapped().degrees(),
            found_degrees: view.skeleton().turn.wrapped().degrees(),
        });
        let views = views.collect();
        self.warn(Warning::TurnsWrong { views });
    }

    /// Returns the keypoints of the views in which the fast detector found them
    fn detected_keypoints(&self, report: &Report) -> Vec<(ViewId, Keypoints)> {
        let detected = report
            .views
            .iter()
            .filter(|view| self.scan.views[view.id.0].keypoint_kind == KeypointKind::MediaPipe);
        detected
            .map(|view| (view.id, view.skeleton().keypoints))
            .collect()
    }

    /// Fits the body from the initial mannequin of an earlier fit, or from one that is selected now
    fn fit_all(
        &mut self,
        report: &mut Report,
        options: &BodyFitOptions,
    ) -> Result<(), PipelineError> {
        let (scan, config, cancel) = (self.scan, self.config, self.cancel);
        let Some(skeleton) = &report.skeleton else {
            return Ok(());
        };
        let (views, chosen) = (&report.views[..], report.start);
        let ((fit, fitted_views), start) = self.stage(Stage::BodyFit, 1, |_| {
            let stature_mm = scan.stature_mm.unwrap_or(skeleton.avatar.stature_mm());
            let cancelled = || cancel.cancelled();
            let poses: Vec<Pose> = views.iter().map(|view| view.skeleton().pose).collect();
            let outlines = Outlines::trace(&fit_views(views, &poses, stature_mm));
            let choose = || match chosen {
                Some(chosen) => start_as(scan, skeleton, views, chosen, stature_mm),
                None => choose_start(scan, skeleton, views, &outlines, stature_mm, &cancelled),
            };
            let start = is_free(config).then(choose).transpose()?;
            let (avatar, posture, poses) = match &start {
                Some(start) => (&start.avatar, &start.posture, &start.poses),
                None => (&skeleton.avatar, &skeleton.posture, &poses),
            };
            let fit = fit_outlines(
                avatar,
                &fit_views(views, poses, stature_mm),
                &outlines,
                &BodyFitPrior {
                    posture: *posture,
                    stature_mm: Some(stature_mm),
                    camera: camera_spread(&scan.camera),
                },
                options,
                &cancelled,
            );
            Ok::<_, PipelineError>((fit, start.map(|start| start.mannequin)))
        })??;
        report.fit = Some(fit);
        report.start = start;
        for (view, fit) in report.views.iter_mut().zip(fitted_views) {
            view.fit = Some(fit);
        }
        cover_legs(report);
        Ok(())
    }

    /// Segments again, with the joints and the outline of the fitted body, which are more accurate than estimated joints
    fn segment_again(&mut self, report: &mut Report) -> Result<(), PipelineError> {
        let (scan, cancel) = (self.scan, self.cancel);
        let Some(body) = report.fit.as_ref().map(|fit| &fit.avatar) else {
            return Ok(());
        };
        let fitted: Vec<SkeletonView> = report.views.iter().map(fitted_view).collect();
        let keypoints = report.views.iter().zip(&fitted).map(|(solved, fitted)| {
            match scan.views[solved.id.0].keypoints_are_rough() {
                true => joints_in(fitted, body),
                false => fitted.keypoints,
            }
        });
        let keypoints: Vec<Keypoints> = keypoints.collect();
        let skirt = report.skirt;
        let priors = self.stage(Stage::Prior, fitted.len(), |steps| {
            let mut priors = render_priors(body, &fitted, &|| steps.done());
            if let Some(skirt) = skirt {
                let views = priors.iter_mut().zip(&fitted);
                views.for_each(|(prior, view)| skirt.fill(body, view, prior));
            }
            priors
        })?;
        let options = self.segment_options();
        let silhouettes = self.stage(Stage::Segment, 1, |_| {
            let solved = report.views.iter().zip(&keypoints).zip(&priors);
            let views: Vec<SegmentView> = solved
                .map(|((solved, keypoints), prior)| {
                    let view = &scan.views[solved.id.0];
                    SegmentView {
                        photo: &view.photo,
                        keypoints,
                        prior: Some(prior),
                        mask: view.mask.as_ref(),
                        person_odds: view.person_odds.as_ref(),
                    }
                })
                .collect();
            segment(&views, scan.background.as_ref(), &options, &|| {
                cancel.cancelled()
            })
        })?;
        let solved = report.views.iter_mut().zip(keypoints).zip(silhouettes);
        for ((solved, keypoints), silhouette) in solved {
            if let Ok(silhouette) = silhouette {
                solved.silhouette = silhouette;
                // The camera remains that of the skeleton, whose uncertainty the fit knows.
                solved.skeleton = solved.skeleton.map(|skeleton| SkeletonView {
                    keypoints,
                    ..skeleton
                });
            }
        }
        Ok(())
    }
}

/// Computes the overlaps of the body with the silhouettes again, with its skirt if it has one
fn cover_legs(report: &mut Report) {
    let (Some(skirt), Some(fit)) = (report.skirt, &report.fit) else {
        return;
    };
    let body = &fit.avatar;
    let views: Vec<SkeletonView> = report.views.iter().map(fitted_view).collect();
    let bodies = render_priors(body, &views, &|| ());
    for ((view, body_mask), skeleton) in report.views.iter_mut().zip(bodies).zip(&views) {
        let mut covered = body_mask;
        skirt.fill(body, skeleton, &mut covered);
        let iou = covered.iou(&view.silhouette.mask);
        view.fit = view.fit.map(|fit| FittedView {
            silhouette_iou: Some(iou),
            ..fit
        });
    }
}

/// Replaces the camera of the skeleton by that of the fitted body
fn adopt_camera(report: &mut Report) {
    let fitted = report.views.first().and_then(|view| view.fit);
    let Some(camera) = fitted.map(|fit| fit.camera) else {
        return;
    };
    for view in &mut report.views {
        view.skeleton = view.skeleton.map(|skeleton| skeleton.with_camera(&camera));
    }
    if let Some(skeleton) = &mut report.skeleton {
        skeleton.camera = camera.with_size_of(&skeleton.camera);
    }
}

/// Replaces turn angles that were found with the skeleton by those of the fitted body, and their standard deviations
///
/// No point of the body moves. Turn 0 is where the poses of views with stated angles have it on average.
fn adopt_turns(report: &mut Report) {
    let turned = |view: &SolvedView| Some(view.fit?.pose.turned_more().radians());
    let stated = |view: &&SolvedView| view.skeleton().turn_from == TurnFrom::Stated;
    let of_stated: Vec<f64> = report
        .views
        .iter()
        .filter(stated)
        .filter_map(turned)
        .collect();
    let zero = of_stated.iter().sum::<f64>() / of_stated.len().max(1) as f64;
    for view in &mut report.views {
        let (Some(fit), Some(skeleton)) = (&mut view.fit, &mut view.skeleton) else {
            continue;
        };
        skeleton.turn_sd_radians = fit.turn_sd_radians;
        if skeleton.turn_from != TurnFrom::Stated {
            let more = fit.pose.turned_more().radians() - zero;
            let turn = TurnAngle::from_radians(skeleton.turn.radians() + more);
            fit.pose = fit.pose.about_turn(skeleton.turn, turn);
            skeleton.pose = skeleton.pose.about_turn(skeleton.turn, turn);
            skeleton.turn = turn;
        }
    }
}

/// Returns the views whose stated turn angles the fitted body contradicts; empty if they are right on the whole
///
/// Outlines show the turn of a body more accurately than keypoints.
fn wrong_turns(scan: &Scan, views: &[SolvedView]) -> Vec<ViewId> {
    let deviation = |view: &SolvedView| {
        let stated = view.skeleton().turn_from == TurnFrom::Stated;
        let sd = scan.views[view.id.0].turn_sd_radians;
        let turned = view.fit?.pose.turned_more().radians();
        stated.then_some((view.id, turned / sd))
    };
    let deviations: Vec<(ViewId, f64)> = views.iter().filter_map(deviation).collect();
    if !are_wrong(deviations.iter().map(|(_, off)| *off)) {
        return Vec::new();
    }
    let reported = deviations
        .iter()
        .filter(|(_, off)| off.abs() > REPORTED_TURN_SIGMAS);
    reported.map(|(id, _)| *id).collect()
}

/// Returns whether the initial mannequin of the fit is selected by the silhouettes: if none was specified
///
/// Earlier stages use a neutral one. A coarse mannequin does not suffice there: it has no separate fingers, and with it
/// as the prior, the segmentation loses hands (160 rendered photos: 10 % quantile of the IoU 0.985 to 0.978).
fn is_free(config: &Config) -> bool {
    let said_nothing = matches!(
        config.avatar,
        AvatarSource::Mannequin {
            sex: Sex::Neutral,
            mass_kg: None
        }
    );
    said_nothing && config.method == Method::Fit
}

/// Returns the uncertainty of the skeleton's camera; zero for given parameters
///
/// The joints of an avatar differ in position from the points that a detector reports, which tilts the camera by 0.1 to
/// 0.3 degrees and moves it by up to 0.7 %.
fn camera_spread(given: &CameraSetup) -> CameraSpread {
    let unless = |given: Option<f64>, spread: f64| if given.is_some() { 0.0 } else { spread };
    CameraSpread {
        distance_mm: unless(given.distance_mm, 100.0),
        height_mm: unless(given.height_mm, 50.0),
        pitch_radians: unless(given.pitch_radians, 1.0_f64.to_radians()),
    }
}

/// Returns a view with pose and camera of the fitted body
fn fitted_view(view: &SolvedView) -> SkeletonView {
    let skeleton = *view.skeleton();
    view.fit.map_or(skeleton, |fit| SkeletonView {
        camera: fit.camera.with_size_of(&skeleton.camera),
        pose: fit.pose,
        ..skeleton
    })
}

/// Returns the joints of a body in a view, with the confidences of its keypoints
fn joints_in(view: &SkeletonView, body: &Avatar) -> Keypoints {
    let posed = pose_bones(&body.bone_heads, &view.pose, view.turn);
    let joints = posed.keypoints(&body.keypoints);
    let moved = view.keypoints.iter().map(|(joint, keypoint)| {
        let position = view.camera.project(joints[joint]);
        let keypoint = Keypoint {
            position,
            ..keypoint
        };
        (joint, keypoint)
    });
    moved.collect()
}

/// A view is inconsistent with the others if its overlap is this much below the median
///
/// Overlaps of rendered people and a clothed man are within 0.02 of it; that of a photo of another pose or person is
/// lower by 0.1 and more.
const CONTRADICTION: f64 = 0.07;

/// Returns the views that are inconsistent with the others, if the others are a clear majority
fn contradicting(views: &[SolvedView]) -> Vec<(ViewId, DropReason)> {
    let ious: Vec<(ViewId, f64)> = views
        .iter()
        .filter_map(|view| Some((view.id, view.fit?.silhouette_iou?)))
        .collect();
    let mut sorted: Vec<f64> = ious.iter().map(|(_, iou)| *iou).collect();
    sorted.sort_by(f64::total_cmp);
    let Some(&usual) = sorted.get(sorted.len() / 2) else {
        return Vec::new();
    };
    let bad: Vec<(ViewId, DropReason)> = ious
        .iter()
        .filter(|(_, iou)| *iou < usual - CONTRADICTION)
        .map(|&(id, iou)| (id, DropReason::Contradicts { iou, usual }))
        .collect();
    // With few views, the wrong one cannot be identified.
    if 4 * bad.len() <= ious.len() {
        bad
    } else {
        Vec::new()
    }
}
