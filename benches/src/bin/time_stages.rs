//! Times stages on one thread, and writes their inputs and results.
//!
//! `time-stages FOLDER` writes photos, seeds and masks as PNG and other data to `inputs.json`, so that other programs
//! can do the same work; it prints milliseconds per stage as one JSON object, the best of a few runs each.

#![allow(clippy::print_stdout, reason = "the program prints the times")]

use std::error::Error;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use glam::DVec2;
use pirouette::carve::CarveOptions;
use pirouette::normalize::register::{ReferenceContourMap, RegisterOptions, register};
use pirouette::segment::{SegmentOptions, Silhouette, segment};
use pirouette_bench::{HeldMesh, PlanarPoints, Stages, VIEW_COUNT};
use pirouette_files::formats::photo::{encode_mask, encode_photo_png};
use pirouette_files::sink::{make_folder, write_atomic};
use pirouette_geom::arap::{ArapOptions, ArapSolver, ArapStart, ArapWeights};
use pirouette_geom::contour::trace_contours;
use pirouette_geom::distance_map::{distance_to, signed_distance};
use pirouette_geom::planar_mesh::{TriangulateOptions, triangulate};
use pirouette_geom::{Grid, Mask};
use serde_json::{Map, Value, json};

type Failure = Box<dyn Error + Send + Sync>;

/// Fixed number of rounds of the deformation
const ARAP: ArapOptions = ArapOptions {
    rounds: 20,
    tolerance: 0.0,
    start: ArapStart::Rest,
};

/// No additional points
const AS_GIVEN: TriangulateOptions = TriangulateOptions {
    max_area: None,
    clearance: 0.0,
};

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder] = arguments.as_slice() else {
        return Err("usage: time-stages FOLDER".into());
    };
    let folder = Path::new(folder);
    make_folder(folder)?;
    let stages = Stages::new();
    let single = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let times = single.install(|| time(&stages, folder))?;
    println!("{}", Value::Object(times));
    Ok(())
}

/// Returns the shortest of some runs, in ms, and the last result
fn best_ms<T>(runs: usize, mut work: impl FnMut() -> T) -> (f64, T) {
    let mut run = || {
        let start = Instant::now();
        let result = black_box(work());
        (start.elapsed().as_secs_f64() * 1e3, result)
    };
    let (mut best, mut result) = run();
    for _ in 1..runs {
        let (ms, again) = run();
        best = best.min(ms);
        result = again;
    }
    (best, result)
}

fn time(stages: &Stages, folder: &Path) -> Result<Map<String, Value>, Failure> {
    let mut times = Map::new();
    let mut inputs = Map::new();
    let photos = stages.segment_views();
    for (name, options) in [
        ("segment_together", SegmentOptions::default()),
        (
            "segment_singly",
            SegmentOptions {
                single: true,
                ..SegmentOptions::default()
            },
        ),
    ] {
        let (ms, found) = best_ms(2, || segment(&photos, None, &options, &|| false));
        let found: Vec<Silhouette> = found.into_iter().collect::<Result<_, _>>()?;
        times.insert(name.into(), json!(ms));
        let truth = &stages.synthetic.truth.silhouettes;
        let ious = found.iter().zip(truth).map(|(f, t)| f.mask.iou(t));
        inputs.insert(format!("{name}_iou"), json!(ious.collect::<Vec<f64>>()));
        // Both variants start with the same seeds: those of the prior.
        for (view, found) in found.iter().enumerate().filter(|_| !options.single) {
            write_photo(stages, view, found, folder)?;
        }
    }

    let masks: Vec<&Mask> = stages.masks().collect();
    // OpenCV measures the distance to the nearest zero: from the person to the background.
    let outside: Vec<Mask> = masks
        .iter()
        .map(|mask| mask.map(|&inside| !inside))
        .collect();
    let (ms, maps) = best_ms(5, || outside.iter().map(distance_to).collect::<Vec<_>>());
    times.insert("distance_map".into(), json!(ms));
    let sum = |map: &Grid<f32>| map.as_slice().iter().map(|&d| f64::from(d)).sum::<f64>();
    let sums: Vec<f64> = maps.iter().map(sum).collect();
    inputs.insert("distance_sums".into(), json!(sums));
    let (ms, _) = best_ms(5, || {
        let signed = masks.iter().map(|mask| signed_distance(mask));
        signed.collect::<Vec<_>>()
    });
    times.insert("signed_distance_map".into(), json!(ms));

    let (ms, contours) = best_ms(5, || {
        let contours = masks.iter().map(|mask| trace_contours(mask));
        contours.collect::<Vec<_>>()
    });
    times.insert("contours".into(), json!(ms));
    let counts: Vec<usize> = contours
        .iter()
        .map(|all| all.iter().map(|contour| contour.points.len()).sum())
        .collect();
    inputs.insert("contour_points".into(), json!(counts));

    let planar: Vec<PlanarPoints> = (0..VIEW_COUNT).map(|v| stages.planar_points(v)).collect();
    let (ms, meshes) = best_ms(5, || {
        let meshes = planar
            .iter()
            .map(|points| triangulate(&points.contours, &points.interior, &AS_GIVEN));
        meshes.collect::<Result<Vec<_>, _>>()
    });
    times.insert("triangulate".into(), json!(ms));
    let described = planar.iter().zip(meshes?).map(|(points, made)| {
        let contours = points.contours.iter().map(|c| coordinates(&c.points));
        json!({
            "contours": contours.collect::<Vec<_>>(),
            "interior": coordinates(&points.interior),
            "triangle_count": made.mesh.triangles.len(),
        })
    });
    inputs.insert("planar".into(), described.collect());

    let held: Vec<HeldMesh> = (0..VIEW_COUNT).map(|v| stages.held_mesh(v)).collect();
    let (ms, deformed) = best_ms(5, || {
        let deformed = held.iter().map(|held| {
            let weights = ArapWeights::Cotangent;
            let solver = ArapSolver::with_weights(&held.mesh, &held.constrained, weights)?;
            Ok(solver.deform(&held.targets, &ARAP).positions)
        });
        deformed.collect::<Result<Vec<_>, pirouette_geom::arap::ArapError>>()
    });
    times.insert("arap".into(), json!(ms));
    let described = held.iter().zip(deformed?).map(|(held, deformed)| {
        json!({
            "positions": coordinates(&held.mesh.positions),
            "triangles": held.mesh.triangles,
            "constrained": held.constrained,
            "targets": coordinates(&held.targets),
            "deformed": coordinates(&deformed),
        })
    });
    inputs.insert("arap".into(), described.collect());

    let mut slowest: f64 = 0.0;
    for (view, reference) in stages.references.iter().enumerate() {
        let map = ReferenceContourMap::from_coverage(&reference.coverage);
        let contour = stages.outline_points(view);
        let joints = &stages.aligned[view].joints.aligned;
        let options = RegisterOptions::default();
        let (ms, _) = best_ms(5, || register(&contour, joints, &map, &options));
        slowest = slowest.max(ms);
    }
    times.insert("register_slowest_view".into(), json!(slowest));

    let still = stages.still_silhouettes();
    let (ms, hull) = best_ms(3, || stages.carve(&still));
    times.insert("carve".into(), json!(ms));
    let hull = hull?;
    for (view, mask) in stages.synthetic.truth.canonical.iter().enumerate() {
        let png = encode_mask(mask)?;
        write_atomic(&folder.join(format!("{view:03}_still.png")), &png)?;
    }
    let camera = stages.synthetic.truth.camera;
    let (low, high) = hull.bounds().ok_or("the hull is empty")?;
    let views = stages.synthetic.scan.views.iter();
    let turns = views.map(|view| view.turn.radians());
    inputs.insert(
        "carve".into(),
        json!({
            "turns_radians": turns.collect::<Vec<f64>>(),
            "focal_px": camera.focal_px(),
            "height_mm": camera.height_mm,
            "distance_mm": camera.distance_mm,
            "pitch_radians": camera.pitch_radians,
            "voxel_mm": CarveOptions::default().voxel_size_mm,
            "low_mm": low.to_array(),
            "high_mm": high.to_array(),
            "volume_liters": hull.volume() * 1e-6,
        }),
    );
    let inputs = Value::Object(inputs).to_string();
    write_atomic(&folder.join("inputs.json"), inputs.as_bytes())?;
    Ok(times)
}

fn coordinates(points: &[DVec2]) -> Vec<[f64; 2]> {
    points.iter().map(|p| p.to_array()).collect()
}

/// Writes the photo, its seeds as gray levels 0 to 3, and the true silhouette
fn write_photo(
    stages: &Stages,
    view: usize,
    found: &Silhouette,
    folder: &Path,
) -> Result<(), Failure> {
    let file = |kind: &str| folder.join(format!("{view:03}_{kind}.png"));
    let photo = &stages.synthetic.scan.views[view].photo;
    write_atomic(&file("photo"), &encode_photo_png(photo)?)?;
    let seeds = found.seeds.as_ref().ok_or("the view has no seeds")?;
    let gray = seeds.map(|&seed| [seed as u8; 3]);
    write_atomic(&file("seeds"), &encode_photo_png(&gray)?)?;
    let truth = &stages.synthetic.truth.silhouettes[view];
    write_atomic(&file("truth"), &encode_mask(truth)?)?;
    let mask = encode_mask(&stages.silhouettes[view].mask)?;
    write_atomic(&file("mask"), &mask)?;
    Ok(())
}
