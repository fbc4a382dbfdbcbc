//! `pirouette demo`: renders a turning person with known measurements, scans it, and compares.

use std::fmt::Write;
use std::io::ErrorKind;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use pirouette::measure::{Measure, Measurements, measure_avatar};
use pirouette::pipeline::{CancelToken, Goal};
use pirouette::scan::Scan;
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::{Avatar, Keypoints, ReferencePose};
use pirouette_eval::film::film;
use pirouette_files::formats::charts::built_in_charts;
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::formats::photo::encode_mask;
use pirouette_files::job::JobOptions;
use pirouette_files::results::ResultOptions;
use pirouette_files::scan_folder::write_scan;
use pirouette_files::sink::{make_folder, write_atomic};
use pirouette_synthetic::video::{TurnCourse, VideoOptions};
use pirouette_synthetic::{Clutter, SyntheticOptions, SyntheticScan, synthesize};
use serde_json::{Map, Value, json};

use crate::args::{DemoArgs, Pose};
use crate::avatar_command::mannequin_sex;
use crate::models_command::pose_model;
use crate::output::Output;
use crate::progress::Progress;
use crate::scan_command::{config, json_line, scan_folder};

/// Columns and rows of the photos
const PHOTO_SIZE_PX: (usize, usize) = (800, 1000);

/// Columns and rows of a video
const VIDEO_SIZE_PX: (usize, usize) = (720, 1280);

/// Frames of a video per second
const FRAMES_PER_S: f64 = 30.0;

/// Noise of the keypoints, in px at a stature of 800 px: typical of detectors on plain clothes
const KEYPOINT_NOISE_PX: f64 = 2.5;

/// Noise of the sensor, in gray levels
const SENSOR_NOISE: f64 = 2.0;

/// Renders a person, scans it and prints the comparison
pub fn run(args: &DemoArgs, output: Output, quiet: bool, cancel: &CancelToken) -> Result<()> {
    ensure!(
        (3..=72).contains(&args.views),
        "--views must be between 3 and 72, not {}",
        args.views
    );
    let progress = Progress::new(quiet);
    let config = config(&args.method, Goal::Measure)?;
    let person = person(args)?;
    let truth = measure_avatar(&person);
    progress.print_line("rendering the person and the room");
    let pose_model = pose_model(None)?;
    let scan = args.out.join(if args.video { "video" } else { "scan" });
    if args.video {
        film_turn(args, &person, &scan, &progress, cancel)?;
    } else {
        let mut synthetic = photograph(args, &person);
        if pose_model.is_some() {
            leave_keypoints_out(&mut synthetic.scan, &scan)?;
        }
        write_scan(&scan, &synthetic.scan).context("cannot write the rendered scan")?;
        write_truth(&scan.join("truth"), &synthetic, &truth)?;
    }
    let charts = built_in_charts();
    let options = ResultOptions {
        formats: &[MeshFormat::Ply, MeshFormat::Glb],
        page_title: args.report.then_some("a rendered person"),
        charts: &charts,
        exports: &[],
        ..ResultOptions::default()
    };
    let job_options = JobOptions {
        pose_model: pose_model.as_ref(),
        ..JobOptions::default()
    };
    let done = scan_folder(
        &scan,
        &args.out,
        &config,
        &job_options,
        &options,
        &progress,
        cancel,
    );
    progress.finish();
    let done = done?;
    let measured = done.report.measurements.as_ref();
    output.done(&table(&args.out, &truth, measured), || {
        let truth: Map<String, Value> = truth
            .iter()
            .map(|(measure, value)| (measure.name().to_owned(), json!(value)))
            .collect();
        let mut value = json_line(&done, &args.out, &charts);
        value["truth_mm"] = Value::Object(truth);
        value
    })
}

/// Leaves the joints to the pose detector: removes them, and the files of an earlier demo
fn leave_keypoints_out(scan: &mut Scan, folder: &Path) -> Result<()> {
    for view in &mut scan.views {
        view.keypoints = Keypoints::default();
        let file = folder.join(format!("{}_keypoints.json", view.name));
        match std::fs::remove_file(&file) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                return Err(error).with_context(|| format!("cannot remove {}", file.display()));
            }
            Ok(()) | Err(_) => {}
        }
    }
    Ok(())
}

/// Builds the person; sex and build may differ from those of the reference
fn person(args: &DemoArgs) -> Result<Avatar> {
    let parameters = MannequinParameters {
        sex: mannequin_sex(Some(args.sex)),
        stature_mm: Some(args.stature),
        mass_kg: Some(args.mass),
        pose: match args.pose {
            Pose::A => ReferencePose::A,
            Pose::T => ReferencePose::T,
        },
        arm_angle_degrees: None,
    };
    Ok(mannequin(&parameters)?)
}

fn photograph(args: &DemoArgs, person: &Avatar) -> SyntheticScan {
    let (width, height) = PHOTO_SIZE_PX;
    synthesize(
        person,
        &SyntheticOptions {
            seed: args.seed,
            turns: SyntheticOptions::even_turns(args.views),
            camera: SyntheticOptions::camera_for(person.stature_mm(), width, height),
            sway: 1.0,
            keypoint_noise_px: KEYPOINT_NOISE_PX,
            turn_noise_radians: 0.0,
            sensor_noise: SENSOR_NOISE,
            clutter: Clutter::LivedIn,
            photos: true,
        },
    )
}

/// Films the turn, at 30 frames a second
fn film_turn(
    args: &DemoArgs,
    person: &Avatar,
    folder: &Path,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<()> {
    let (width, height) = VIDEO_SIZE_PX;
    let camera = SyntheticOptions::camera_for(person.stature_mm(), width, height);
    let options = VideoOptions {
        seed: args.seed,
        camera,
        sway: 1.0,
        sensor_noise: SENSOR_NOISE,
        clutter: Clutter::LivedIn,
        frames_per_s: FRAMES_PER_S,
        turn: TurnCourse {
            enter_s: 1.5,
            start_radians: 0.0,
            turned_radians: std::f64::consts::TAU,
            turn_s: 12.0,
            still_s: 1.0,
            speed_change: 0.3,
            pause_s: 0.0,
        },
    };
    film(person, &options, folder, cancel, &mut |share| {
        progress.share("render", share);
    })?;
    Ok(())
}

/// Writes silhouettes, the body in the reference pose, camera and measurements
fn write_truth(
    folder: &Path,
    synthetic: &SyntheticScan,
    measures: &[(Measure, f64)],
) -> Result<()> {
    make_folder(folder)?;
    let truth = &synthetic.truth;
    let masks = truth.silhouettes.iter().zip(&truth.canonical);
    for (view, (silhouette, canonical)) in synthetic.scan.views.iter().zip(masks) {
        for (kind, mask) in [("mask", silhouette), ("canonical", canonical)] {
            let file = folder.join(format!("{}_{kind}.png", view.name));
            write_atomic(&file, &encode_mask(mask)?)?;
        }
    }
    write_atomic(
        &folder.join("body.ply"),
        &MeshFormat::Ply.write(&truth.body),
    )?;
    let measures: Map<String, Value> = measures
        .iter()
        .map(|(measure, value)| (measure.name().to_owned(), json!(value)))
        .collect();
    let camera = &truth.camera;
    let text = json!({
        "measurements_mm": measures,
        "camera": {
            "vertical_fov_deg": camera.vertical_fov_radians.to_degrees(),
            "height_mm": camera.height_mm,
            "distance_mm": camera.distance_mm,
            "pitch_deg": camera.pitch_radians.to_degrees(),
        },
    });
    write_atomic(&folder.join("truth.json"), format!("{text:#}\n").as_bytes())?;
    Ok(())
}

/// Formats estimated and true measurements side by side
fn table(out: &Path, truth: &[(Measure, f64)], measured: Option<&Measurements>) -> String {
    let mut text = format!(
        "{}: a rendered person, scanned\n{:<24}{:>9}{:>9}{:>8}",
        out.display(),
        "mm",
        "found",
        "truth",
        "error"
    );
    for &(measure, true_mm) in truth {
        let name = measure.name().replace('_', " ");
        let found = measured.and_then(|m| m.value_mm(measure));
        // Writing to a string cannot fail.
        let _ = match found {
            Some(found) => write!(
                text,
                "\n{name:<24}{found:>9.0}{true_mm:>9.0}{:>+7.1}%",
                100.0 * (found / true_mm - 1.0)
            ),
            None => write!(text, "\n{name:<24}{:>9}{true_mm:>9.0}", "-"),
        };
    }
    text
}
