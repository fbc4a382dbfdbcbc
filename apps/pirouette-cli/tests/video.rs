//! Scans of videos; skipped without the program ffmpeg or without a network of the pose detector.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use std::f64::consts::TAU;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::Command;

use common::{Folders, network, pirouette, text};
use pirouette::measure::{Measure, measure_avatar};
use pirouette::pipeline::{CancelToken, Config, Goal, Method};
use pirouette::pose::PoseModel;
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::{Avatar, Joint};
use pirouette_files::job::{JobOptions, run_job};
use pirouette_files::scan_folder::{LoadOptions, WithoutKeypoints, load_source};
use pirouette_files::video::{VideoFile, VideoOptions as ScanOptions, VideoWriter, scan_of_video};
use pirouette_synthetic::video::{TurnCourse, VideoOptions, render_video};
use pirouette_synthetic::{Clutter, SyntheticOptions};

/// Frames per second
const RATE: f64 = 10.0;

/// Returns the arguments that select the network, if the test can run
fn ready(test: &str) -> Option<[String; 2]> {
    let ffmpeg = Command::new("ffmpeg").arg("-version").output();
    if ffmpeg.is_err() {
        eprintln!("{test} is skipped: ffmpeg is not installed");
        return None;
    }
    network(test)
}

fn course() -> TurnCourse {
    TurnCourse {
        enter_s: 0.0,
        start_radians: 0.4,
        turned_radians: -TAU,
        turn_s: 5.0,
        still_s: 0.2,
        speed_change: 0.3,
        pause_s: 0.5,
    }
}

fn person() -> Avatar {
    mannequin(&MannequinParameters::default()).unwrap()
}

/// Films a person; returns the true angle of each frame, in radians
fn film(file: &Path, turn: TurnCourse) -> Vec<f64> {
    let person = person();
    let size = (288, 512);
    let options = VideoOptions {
        seed: 4,
        camera: SyntheticOptions::camera_for(person.stature_mm(), size.0, size.1),
        sway: 0.6,
        sensor_noise: 1.0,
        clutter: Clutter::LivedIn,
        frames_per_s: RATE,
        turn,
    };
    let mut writer = VideoWriter::create(file, size, RATE, 2_000_000).unwrap();
    let angles = render_video(&person, &options, &mut |_, photo| {
        writer.write(&photo).unwrap();
        ControlFlow::Continue(())
    });
    writer.finish().unwrap();
    angles
}

/// Checks that the room is found where the person hides it in the views: this person comes in
fn room_is_found(file: &Path, model: &str) {
    let model = PoseModel::parse(&std::fs::read(model).unwrap()).unwrap();
    let video = VideoFile::find(file).unwrap();
    let (options, cancel) = (ScanOptions { views: 8 }, CancelToken::default());
    let found = scan_of_video(&video, &model, &options, &cancel, &mut |_| {}).unwrap();
    let load = LoadOptions {
        without_keypoints: WithoutKeypoints::Loaded,
        ..LoadOptions::default()
    };
    let scan = load_source(found.source, &load).unwrap().scan;
    let room = scan.background.unwrap();
    let known = room.known.area() as f64 / room.known.as_slice().len() as f64;
    assert!(known > 0.95, "{known}");
    // Beside the person, each view shows the same; where the person stands, none does.
    let photo = &scan.views[0].photo;
    let off = |x: usize, y: usize| -> f64 {
        let (a, b) = (photo[(x, y)], room.photo[(x, y)]);
        (0..3).map(|c| f64::from(a[c].abs_diff(b[c]))).sum::<f64>() / 3.0
    };
    let (width, height) = (photo.width(), photo.height());
    let mean = |columns: std::ops::Range<usize>, rows: std::ops::Range<usize>| {
        let count = columns.len() * rows.len();
        let pixels = columns.flat_map(|x| rows.clone().map(move |y| (x, y)));
        pixels.map(|(x, y)| off(x, y)).sum::<f64>() / count as f64
    };
    let beside = mean(0..width / 8, 0..height);
    let trunk = mean(
        width * 45 / 100..width * 55 / 100,
        height * 30 / 100..height * 50 / 100,
    );
    assert!(beside < 4.0 && trunk > 4.0 * beside, "{beside} {trunk}");
}

/// Checks that a helper beside the person, who stands still, is reported and not followed
fn whoever_turns_is_measured(folders: &Folders, file: &Path, model: &str) {
    let (still, both) = (folders.path("still.png"), folders.path("both.mp4"));
    let ffmpeg = |arguments: &[&str]| {
        let made = Command::new("ffmpeg")
            .args(["-nostdin", "-loglevel", "error", "-y"])
            .args(arguments)
            .status();
        assert!(made.unwrap().success());
    };
    ffmpeg(&["-ss", "3", "-i", text(file), "-frames:v", "1", text(&still)]);
    let helper = [
        "-loop",
        "1",
        "-framerate",
        "10",
        "-t",
        "7",
        "-i",
        text(&still),
    ];
    let beside = ["-filter_complex", "[0][1]hstack", "-t", "7", text(&both)];
    ffmpeg(&[&helper[..], &["-i", text(file)], &beside].concat());
    let model = PoseModel::parse(&std::fs::read(model).unwrap()).unwrap();
    let video = VideoFile::find(&both).unwrap();
    let (options, cancel) = (ScanOptions { views: 8 }, CancelToken::default());
    let found = scan_of_video(&video, &model, &options, &cancel, &mut |_| {}).unwrap();
    let (low, high) = found.extracted.track.range();
    assert!((high - low).to_degrees() > 330.0, "{low} {high}");
    let people = found.extracted.two_people.unwrap();
    assert!(!people.is_other_right());
    // The keypoints are those of the same person.
    let done = run_job(
        found.source,
        &Config::new(Goal::Segment, Method::Fit),
        &JobOptions {
            pose_model: Some(&model),
            ..JobOptions::default()
        },
        &cancel,
        &mut |_| {},
    );
    let loaded = done.unwrap().loaded;
    assert!(loaded.warnings.iter().any(|w| w.code() == "second_person"));
    for view in &loaded.scan.views {
        let middle = view.keypoints.get(Joint::MidHip).position.x;
        assert!(middle > view.photo.width() as f64 / 2.0, "{middle}");
    }
}

#[test]
fn a_video_of_a_turn_is_measured() {
    let Some([flag, model]) = ready("a_video_of_a_turn_is_measured") else {
        return;
    };
    let folders = Folders::empty();
    let file = folders.path("scan/anna.mp4");
    let coming = TurnCourse {
        enter_s: 1.2,
        ..course()
    };
    let angles = film(&file, coming);
    folders.write(
        "scan/scan.json",
        format!(
            "{{ \"subject\": {{ \"stature_mm\": {} }} }}",
            person().stature_mm()
        ),
    );
    let run = folders.run("scan", &["--views", "8", "--report", &flag, &model]);
    let error = run.exits_with(0).stderr();
    assert!(error.contains("8 views"), "{error}");
    let result = folders.json("result.json");
    let views = result["views"].as_array().unwrap();
    assert!(views.len() >= 7, "{}", views.len());
    for view in views {
        let name = view["name"].as_str().unwrap();
        let time_s = view["time_s"].as_f64().unwrap();
        assert_eq!(name, format!("{time_s:07.3}s"));
        let true_deg = angles[(time_s * RATE).round() as usize].to_degrees();
        let error = view["angle_deg"].as_f64().unwrap() - true_deg;
        let error = (error + 180.0).rem_euclid(360.0) - 180.0;
        assert!(error.abs() < 15.0, "{name}: {error}");
    }
    let page = std::fs::read_to_string(folders.out().join("report.html")).unwrap();
    assert!(page.contains("<h2>Turn in the video</h2>"));
    assert_eq!(page.matches("<circle").count(), views.len());
    let truth = measure_avatar(&person());
    let measured = folders.json("measurements.json");
    for measure in [Measure::WaistGirth, Measure::HipGirth] {
        let (_, true_mm) = truth.iter().find(|(of, _)| *of == measure).unwrap();
        let value_mm = measured["measurements_mm"][measure.name()]
            .as_f64()
            .unwrap();
        assert!(
            (value_mm / true_mm - 1.0).abs() < 0.03,
            "{}: {value_mm}, {true_mm}",
            measure.name()
        );
    }
    room_is_found(&file, &model);
    whoever_turns_is_measured(&folders, &file, &model);
}

#[test]
fn files_that_show_no_turn_are_errors_that_name_them() {
    let Some([flag, model]) = ready("files_that_show_no_turn_are_errors_that_name_them") else {
        return;
    };
    let folders = Folders::empty();
    let file = folders.path("anna.mp4");
    let out = folders.out();
    let fails = |file: &Path, expected: &str| {
        let run = pirouette(&["scan", text(file), "-o", text(&out), &flag, &model]);
        let error = run.exits_with(1).stderr();
        assert!(error.contains(expected), "{error}");
        assert!(error.contains("anna"), "{error}");
        assert!(!out.join("result.json").exists());
    };
    // The result of an earlier scan does not survive one that fails.
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("result.json"), r#"{ "files": [ "result.json" ] }"#).unwrap();
    let quarter = TurnCourse {
        turned_radians: TAU / 4.0,
        turn_s: 2.0,
        pause_s: 0.0,
        ..course()
    };
    film(&file, quarter);
    fails(&file, "the person turns by only");
    // A file of which the end, with the index, is missing
    let bytes = std::fs::read(&file).unwrap();
    std::fs::write(&file, &bytes[..bytes.len() / 2]).unwrap();
    fails(&file, "cannot be decoded");
    let make = |arguments: &[&str], name: &str| {
        let file = folders.path(name);
        let made = Command::new("ffmpeg")
            .args(["-loglevel", "error", "-f", "lavfi", "-i"])
            .args(arguments)
            .arg(&file)
            .status();
        assert!(made.unwrap().success());
        file
    };
    let sound = make(&["sine=duration=1"], "anna_sound.mp4");
    fails(&sound, "contains no video");
    let pattern = make(
        &["testsrc=duration=1:size=320x240:rate=10"],
        "anna_room.mkv",
    );
    fails(&pattern, "no person is found");
}
