//! Complete jobs in memory: order of stages, cancellation, rejected views, few views, the hull.

use pirouette::pipeline::{
    CancelToken, Config, Event, Goal, Method, PipelineError, Report, Stage, Warning, run,
};
use pirouette::scan::{Background, Photo, Scan};
use pirouette::view::ViewId;
use pirouette_body::Keypoints;
use pirouette_geom::Mask;
use pirouette_synthetic::people::turning_woman;

/// A scan whose silhouettes are given, which spares most of the segmentation
fn scan_of_masks(view_count: usize) -> Scan {
    let person = turning_woman(view_count);
    let mut scan = person.scan;
    for (view, silhouette) in scan.views.iter_mut().zip(person.truth.silhouettes) {
        view.mask = Some(silhouette);
    }
    scan
}

fn with_hull(method: Method) -> Config {
    Config {
        hull: true,
        ..Config::new(Goal::Measure, method)
    }
}

/// Runs a job and cancels it when `stop` starts
fn stages_until(
    scan: &Scan,
    config: &Config,
    stop: Option<Stage>,
) -> (Vec<Stage>, Result<Report, PipelineError>) {
    let cancel = CancelToken::default();
    let mut started = Vec::new();
    let result = run(scan, config, &cancel, &mut |event| {
        if let Event::StageStarted { stage, .. } = event {
            started.push(stage);
            if Some(stage) == stop {
                cancel.cancel();
            }
        }
    });
    (started, result)
}

const FIT_STAGES: [Stage; 9] = [
    Stage::Avatar,
    Stage::SkeletonFit,
    Stage::Prior,
    Stage::Segment,
    Stage::BodyFit,
    Stage::Color,
    Stage::Normalize,
    Stage::Carve,
    Stage::Measure,
];

#[test]
fn a_job_runs_the_stages_of_its_goal_and_no_others() {
    let scan = scan_of_masks(4);
    let stages = |goal, method| {
        let (stages, report) = stages_until(&scan, &Config::new(goal, method), None);
        let report = report.expect("a rendered person can be scanned");
        assert_eq!(
            stages,
            report.seconds.iter().map(|s| s.0).collect::<Vec<_>>()
        );
        (stages, report)
    };
    let (segment, report) = stages(Goal::Segment, Method::Fit);
    assert_eq!(segment, FIT_STAGES[..4]);
    assert!(report.fit.is_none() && report.body.is_none() && report.views.len() == 4);

    let (normalize, report) = stages(Goal::Normalize, Method::ThreeStep);
    assert_eq!(normalize, [&FIT_STAGES[..4], &[Stage::Normalize]].concat());
    assert!(report.views.iter().all(|view| view.normalized.is_some()));
    assert!(report.fit.is_none() && report.body.is_none());

    let (reconstruct, report) = stages(Goal::Reconstruct, Method::ThreeStep);
    assert_eq!(
        reconstruct,
        [&FIT_STAGES[..4], &[Stage::Normalize, Stage::Carve]].concat()
    );
    assert!(report.body.is_some() && report.measurements.is_none());
}

#[test]
fn a_job_can_be_cancelled_in_each_stage() {
    let scan = scan_of_masks(3);
    let config = with_hull(Method::Fit);
    for (index, &stage) in FIT_STAGES.iter().enumerate() {
        let (stages, result) = stages_until(&scan, &config, Some(stage));
        assert!(matches!(result, Err(PipelineError::Cancelled)), "{stage:?}");
        assert_eq!(stages, FIT_STAGES[..=index], "{stage:?}");
    }
}

#[test]
fn a_cancelled_job_does_not_start() {
    let cancel = CancelToken::default();
    cancel.cancel();
    let config = Config::new(Goal::Segment, Method::Fit);
    let mut events = 0;
    let result = run(&scan_of_masks(3), &config, &cancel, &mut |_| events += 1);
    assert!(matches!(result, Err(PipelineError::Cancelled)));
    assert_eq!(events, 0);
}

#[test]
fn the_hull_is_closed_and_encloses_the_fitted_body() {
    let (stages, report) = stages_until(&scan_of_masks(4), &with_hull(Method::Fit), None);
    let report = report.expect("a rendered person can be scanned");
    assert_eq!(stages, FIT_STAGES);
    let (body, hull) = (report.body.expect("a body"), report.hull.expect("a hull"));
    assert_eq!((body.check(), hull.check()), (Ok(()), Ok(())));
    assert!(hull.volume() > 1.02 * body.volume());
    assert!(hull.volume() < 1.5 * body.volume());
}

#[test]
fn a_view_without_a_person_is_rejected_and_the_others_keep_their_numbers() {
    let mut person = turning_woman(5);
    person.scan.views[1].keypoints = Keypoints::default();
    let name = person.scan.views[1].name.clone();
    let config = Config::new(Goal::Measure, Method::Fit);
    let mut warned = Vec::new();
    let report = run(
        &person.scan,
        &config,
        &CancelToken::default(),
        &mut |event| {
            if let Event::Warning(warning @ Warning::ViewDropped { .. }) = event {
                warned.push(warning);
            }
        },
    )
    .expect("four views are enough");
    let ids: Vec<ViewId> = report.views.iter().map(|view| view.id).collect();
    assert_eq!(ids, [0, 2, 3, 4].map(ViewId));
    let [dropped] = &report.dropped[..] else {
        panic!("{:?}", report.dropped);
    };
    assert_eq!((dropped.id, dropped.stage), (ViewId(1), Stage::Segment));
    assert_eq!(warned.len(), 1);
    assert_eq!(warned[0].view(), Some(&name[..]));
    assert_eq!(warned[0].code(), "view_dropped");
    assert!(report.measurements.is_some());
}

#[test]
fn two_views_make_a_body_unless_more_were_given() {
    let mut scan = scan_of_masks(4);
    scan.views.truncate(2);
    let fit = Config::new(Goal::Reconstruct, Method::Fit);
    let (_, report) = stages_until(&scan, &fit, None);
    let report = report.expect("a fit accepts two views");
    assert!(report.body.is_some_and(|body| body.check().is_ok()));

    let too_few = |scan: &Scan, method| {
        let config = Config::new(Goal::Reconstruct, method);
        match stages_until(scan, &config, None).1 {
            Err(PipelineError::TooFewViews { left, needed }) => (left, needed),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(too_few(&scan, Method::ThreeStep), (2, 3));
    scan.unusable_view_count = 2;
    assert_eq!(too_few(&scan, Method::Fit), (2, 3));
    scan.views.truncate(1);
    scan.unusable_view_count = 0;
    assert_eq!(too_few(&scan, Method::Fit), (1, 2));
    scan.views.clear();
    assert_eq!(too_few(&scan, Method::Fit), (0, 2));
}

#[test]
fn every_step_of_a_stage_is_reported() {
    let scan = scan_of_masks(4);
    let config = Config::new(Goal::Normalize, Method::ThreeStep);
    let (mut open, mut finished) = (None, Vec::new());
    run(
        &scan,
        &config,
        &CancelToken::default(),
        &mut |event| match event {
            Event::StageStarted { stage, step_count } => {
                assert_eq!(open.replace((stage, step_count, 0)), None, "{stage:?}");
            }
            Event::StepDone { stage } => {
                let (running, _, done) = open.as_mut().expect("a stage runs");
                assert_eq!(*running, stage);
                *done += 1;
            }
            Event::StageDone { stage, seconds } => {
                let (running, step_count, done) = open.take().expect("a stage runs");
                assert_eq!(running, stage);
                assert!(seconds >= 0.0);
                finished.push((stage, step_count, done));
            }
            _ => {}
        },
    )
    .expect("a rendered person can be scanned");
    assert_eq!(open, None);
    for (stage, step_count, done) in finished {
        assert!(
            done == step_count || (step_count == 1 && done == 0),
            "{stage:?}: {done} of {step_count}"
        );
    }
}

#[test]
fn the_room_without_the_person_improves_masks_and_that_of_another_place_changes_nothing() {
    let person = turning_woman(4);
    let room = person.truth.room.expect("photos are rendered");
    let masks = |background: Option<Background>| -> Vec<Mask> {
        let scan = Scan {
            background,
            ..person.scan.clone()
        };
        let config = Config::new(Goal::Segment, Method::Fit);
        let report = run(&scan, &config, &CancelToken::default(), &mut |_| {});
        let views = report.expect("a rendered person can be segmented").views;
        views.into_iter().map(|view| view.silhouette.mask).collect()
    };
    let background = |photo: Photo| {
        let known = Mask::filled(photo.width(), photo.height(), true);
        Some(Background { photo, known })
    };
    let overlap = |masks: &[Mask]| -> f64 {
        let pairs = masks.iter().zip(&person.truth.silhouettes);
        pairs.map(|(mask, truth)| mask.iou(truth)).sum::<f64>() / masks.len() as f64
    };
    let without = masks(None);
    let with = masks(background(room.clone()));
    assert!(
        overlap(&with) > overlap(&without),
        "{} {}",
        overlap(&without),
        overlap(&with)
    );
    let (width, height) = (room.width(), room.height());
    let elsewhere = Photo::from_fn(width, height, |x, y| room[(width - 1 - x, height - 1 - y)]);
    assert!(masks(background(elsewhere)) == without);
}
