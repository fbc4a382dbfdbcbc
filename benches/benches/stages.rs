//! Each stage separately, on one rendered scan of 8 views of 800 x 1000.
//!
//! `cargo bench -p pirouette-bench --bench stages -- NAME` runs those whose names contain NAME. Stages that process
//! each view separately are timed on the first one.

#![allow(missing_docs, reason = "criterion's macros generate public items")]

use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use pirouette::body_fit::{BodyFitOptions, BodyFitPrior, BodyFitView, fit_body};
use pirouette::carve::{CarveOptions, carve_beside_avatar};
use pirouette::measure::{BodySource, MeasureInput, MeasureView, measure};
use pirouette::normalize::refine::{RefineOptions, refine};
use pirouette::normalize::register::{ReferenceContourMap, RegisterOptions, register};
use pirouette::normalize::{NormalizeOptions, normalize};
use pirouette::scan::{StatureFrom, Subject};
use pirouette::segment::{SegmentOptions, segment};
use pirouette_bench::{Stages, far_outlines, fit_shared_skeleton};
use pirouette_geom::arap::{ArapOptions, ArapSolver};
use pirouette_geom::contour::{trace_contours, trace_windowed};
use pirouette_geom::distance_map::signed_distance;
use pirouette_geom::outline_map::OutlineMap;
use pirouette_geom::planar_mesh::{TriangulateOptions, triangulate};

fn photos_to_silhouettes(c: &mut Criterion) {
    let stages = Stages::new();
    let (avatar, synthetic) = (&stages.avatar, &stages.synthetic);
    c.bench_function("skeleton fit", |b| {
        b.iter(|| fit_shared_skeleton(avatar, synthetic));
    });
    let views = stages.segment_views();
    let options = SegmentOptions::default();
    let single = SegmentOptions {
        single: true,
        ..options
    };
    c.bench_function("segment one view", |b| {
        b.iter(|| segment(&views[..1], None, &single, &|| false));
    });
    c.bench_function("segment all views together", |b| {
        b.iter(|| segment(&views, None, &options, &|| false));
    });
}

fn planar_geometry(c: &mut Criterion) {
    let stages = Stages::new();
    let silhouette = &stages.silhouettes[0];
    c.bench_function("distance map, signed", |b| {
        b.iter(|| signed_distance(&silhouette.mask));
    });
    c.bench_function("contours of the mask", |b| {
        b.iter(|| trace_contours(&silhouette.mask));
    });
    c.bench_function("outline of the soft silhouette", |b| {
        b.iter(|| trace_windowed(&silhouette.soft, 0.5));
    });
    let (contours, spread) = stages.outline_with_handles(0);
    let options = TriangulateOptions::default();
    c.bench_function("triangulate with handles and fill", |b| {
        b.iter(|| triangulate(&contours, &spread.sources, &options));
    });
    let held = stages.held_mesh(0);
    c.bench_function("as-rigid-as-possible", |b| {
        b.iter(|| {
            let solver = ArapSolver::new(&held.mesh, &held.constrained);
            solver.map(|solver| solver.deform(&held.targets, &ArapOptions::default()))
        });
    });
}

fn silhouettes_to_normalized(c: &mut Criterion) {
    let stages = Stages::new();
    let coverage = &stages.references[0].coverage;
    c.bench_function("reference map", |b| {
        b.iter(|| ReferenceContourMap::from_coverage(coverage));
    });
    let map = ReferenceContourMap::from_coverage(coverage);
    let points = stages.outline_points(0);
    let joints = &stages.aligned[0].joints.aligned;
    c.bench_function("registration", |b| {
        b.iter(|| register(&points, joints, &map, &RegisterOptions::default()));
    });
    let found = register(&points, joints, &map, &RegisterOptions::default());
    let registered: Vec<_> = points.iter().map(|&p| found.apply(p)).collect();
    let joints = joints.map(|joint| joint.map(|p| found.apply(p)));
    c.bench_function("refinement", |b| {
        b.iter(|| refine(&registered, &joints, &map, &RefineOptions::default()));
    });
    let view = stages.normalize_view(0);
    c.bench_function("normalize one view, three steps", |b| {
        b.iter(|| normalize(&view, &NormalizeOptions::three_step()));
    });
}

fn silhouettes_to_bodies(c: &mut Criterion) {
    let stages = Stages::new();
    let (skeleton, scan) = (&stages.skeleton, &stages.synthetic.scan);
    let still = stages.still_silhouettes();
    c.bench_function("carve with surface", |b| b.iter(|| stages.carve(&still)));
    let outlines = far_outlines(&still);
    let views = stages.carve_views(&outlines);
    let options = CarveOptions::default();
    c.bench_function("carve outlines next to the avatar", |b| {
        b.iter(|| carve_beside_avatar(&views, &skeleton.avatar, &options));
    });

    let stature_mm = skeleton.avatar.stature_mm();
    let views: Vec<BodyFitView> = stages
        .views
        .iter()
        .zip(&stages.silhouettes)
        .map(|(view, silhouette)| BodyFitView {
            silhouette: &silhouette.soft,
            keypoints: &view.keypoints,
            camera: view.camera,
            turn: view.turn,
            stepped: false,
            tracked: None,
            pose: view.pose,
            stature_mm,
        })
        .collect();
    let prior = BodyFitPrior {
        posture: skeleton.posture,
        stature_mm: Some(stature_mm),
        ..BodyFitPrior::default()
    };
    let options = BodyFitOptions::default();
    let fit = || fit_body(&skeleton.avatar, &views, &prior, &options, &|| false);
    c.bench_function("fit the body", |b| b.iter(fit));

    let (fitted, fitted_views) = fit();
    let outlines: Vec<OutlineMap> = views
        .iter()
        .map(|view| OutlineMap::new(&view.silhouette.to_grid(), OutlineMap::NEAR_PX))
        .collect();
    let views: Vec<MeasureView> = views
        .iter()
        .zip(&outlines)
        .zip(&fitted_views)
        .map(|((view, outline), fitted)| MeasureView {
            outline,
            camera: view.camera,
            turn: view.turn,
            pose: fitted.pose,
        })
        .collect();
    let input = MeasureInput {
        body: &fitted.avatar.mesh,
        avatar: &fitted.avatar,
        source: BodySource::Fitted,
        views: &views,
        stature_mm: scan.stature_mm,
        stature_from: StatureFrom::Stated,
        subject: Subject::default(),
        given_masks: 0.0,
        detected_keypoints: 0.0,
        estimated_keypoints: 0.0,
        extra_sd: pirouette::measure::ExtraSd::default(),
        surface: pirouette::measure::Surface::Clothed,
        skirt: false,
    };
    c.bench_function("measure", |b| b.iter(|| measure(&input)));
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    targets = photos_to_silhouettes, planar_geometry, silhouettes_to_normalized, silhouettes_to_bodies
}
criterion_main!(benches);
