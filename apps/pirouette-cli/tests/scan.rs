//! `scan` and its stages on a rendered person, from input files to result files.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use common::{Folders, person, pirouette, text};
use pirouette::pipeline::{CancelToken, Config, Goal, Method};
use pirouette_files::formats::charts::built_in_charts;
use pirouette_files::formats::export::ExportFormat;
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::formats::photo::decode_mask;
use pirouette_files::job::{JobOptions, run_job};
use pirouette_files::results::ResultOptions;

#[test]
fn scan_writes_the_complete_result_folder() {
    let folders = Folders::with_views(4);
    let formats = "ply,glb,obj,stl,off";
    let run = folders
        .run("scan", &["--format", formats, "--json"])
        .exits_with(0);
    let line = run.json_line();
    for ending in formats.split(',') {
        assert!(folders.out().join(format!("body.{ending}")).exists());
    }
    let bytes = std::fs::read(folders.out().join("body.ply")).unwrap();
    let body = pirouette_files::formats::mesh::read_ply(&bytes).unwrap();
    body.check().unwrap();
    let (low, high) = body.bounds().unwrap();
    assert!((high.y - low.y - 1650.0).abs() < 60.0, "{low} {high}");
    for (view, truth) in person().truth.canonical.iter().enumerate() {
        let file = folders
            .out()
            .join(format!("views/{view:03}/normalized.png"));
        let mask = decode_mask(&std::fs::read(file).unwrap()).unwrap();
        let iou = mask.iou(truth);
        assert!(iou > 0.75, "view {view}: {iou}");
    }
    let measurements = folders.json("measurements.json");
    let hip = measurements["measurements_mm"]["hip_girth"]
        .as_f64()
        .unwrap();
    assert!((850.0..1200.0).contains(&hip), "{hip}");
    assert_eq!(measurements["details"]["stature"]["method"], "given");
    assert_eq!(line["goal"], "measure");
    assert_eq!(line["measurements_mm"], measurements["measurements_mm"]);
    let view = folders.json("views/001/view.json");
    for step in ["detected", "aligned", "registered", "refined"] {
        assert!(
            view["joints_px"][step]["left_knee"][0].is_number(),
            "{step}"
        );
    }
    assert!(view["registration"].is_null());
    for picture in ["contact.jpg", "residuals.jpg"] {
        let bytes = std::fs::read(folders.out().join(picture)).unwrap();
        assert!(bytes.starts_with(&[0xff, 0xd8]), "{picture}");
    }
    let ply = String::from_utf8_lossy(&bytes);
    assert!(ply.contains("property uchar red"));
    assert!(!folders.out().join("report.html").exists());
}

#[test]
fn steps_of_the_three_step_method_can_be_skipped() {
    let folders = Folders::with_views(3);
    folders
        .run("normalize", &["--method", "three-step"])
        .exits_with(0);
    assert_eq!(folders.json("result.json")["method"], "three-step");
    let view = folders.json("views/000/view.json");
    let registration = &view["registration"];
    let error = |key: &str| registration[key].as_f64().unwrap();
    assert!(error("error_after_px") <= error("error_before_px"));
    assert!(!view["limbs"].as_object().unwrap().is_empty());
    folders
        .run(
            "normalize",
            &["--method", "three-step", "--no-register", "--no-refine"],
        )
        .exits_with(0);
    let view = folders.json("views/000/view.json");
    assert!(view["registration"].is_null());
    assert_eq!(view["joints_px"]["aligned"], view["joints_px"]["refined"]);
}

#[test]
fn segment_computes_the_silhouettes() {
    let folders = Folders::with_views(4);
    folders.run("segment", &[]).exits_with(0);
    for (view, truth) in person().truth.silhouettes.iter().enumerate() {
        let file = folders.out().join(format!("views/{view:03}/mask.png"));
        let mask = decode_mask(&std::fs::read(file).unwrap()).unwrap();
        let iou = mask.iou(truth);
        assert!(iou > 0.9, "view {view}: {iou}");
    }
    let result = folders.json("result.json");
    assert_eq!(result["goal"], "segment");
    assert!(result["camera"]["distance_mm"].as_f64().unwrap() > 1000.0);
    assert!(result["seconds"]["segment"].as_f64().unwrap() > 0.0);
    let view = folders.json("views/000/view.json");
    assert_eq!(view["width_px"], 200);
    assert_eq!(
        view["joints_px"]["detected"]["nose"]
            .as_array()
            .unwrap()
            .len(),
        3
    );
    assert!(!folders.out().join("body.ply").exists());
}

/// The page embeds all pictures, and names are never interpreted as HTML
#[cfg(unix)]
#[test]
fn the_report_is_self_contained_and_escapes_names() {
    let folders = Folders::with_views(4);
    for ending in [".jpg", "_keypoints.json"] {
        let from = folders.path(&format!("scan/000{ending}"));
        let to = folders.path(&format!("scan/<img src=x>&'\"{ending}"));
        std::fs::rename(from, to).unwrap();
    }
    folders.write("scan/002.jpg", "no photo");
    std::fs::remove_file(folders.path("scan/scan.json")).unwrap();
    folders.run("scan", &["--report"]).exits_with(0);
    let html = std::fs::read_to_string(folders.out().join("report.html")).unwrap();
    assert!(html.contains("&lt;img src=x&gt;&amp;&#39;&quot;"));
    assert!(!html.contains("<img src=x"));
    // Tapes, contact sheet, residuals and three views
    let pictures: Vec<&str> = html.split(" src=\"").skip(1).collect();
    assert_eq!(pictures.len(), 6);
    for picture in pictures {
        assert!(picture.starts_with("data:image/jpeg;base64,"));
    }
    for outside in ["http:", "https:", "url(", "<link", "<script", "href="] {
        assert!(!html.contains(outside), "{outside}");
    }
    for expected in [
        "<h1>scan</h1>",
        "hip girth",
        "view 002 is rejected",
        "the stature is unknown",
        "distance to the turning axis",
        "<th>fit</th>",
    ] {
        assert!(html.contains(expected), "{expected}");
    }
}

#[test]
fn segment_accepts_a_single_photo() {
    let folders = Folders::with_views(1);
    std::fs::remove_file(folders.path("scan/scan.json")).unwrap();
    let run = folders.run("segment", &["--json", "--quiet"]).exits_with(0);
    assert_eq!(run.stderr(), "");
    let line = run.json_line();
    assert_eq!(line["ok"], true);
    assert_eq!(line["views"][0]["status"], "ok");
    assert!(folders.out().join("views/000/mask.png").exists());
}

#[test]
fn a_given_mask_is_the_result() {
    let folders = Folders::empty();
    let mut person = person().clone();
    person.scan.views[2].mask = Some(person.truth.silhouettes[2].clone());
    pirouette_files::scan_folder::write_scan(&folders.scan(), &person.scan).unwrap();
    folders.run("segment", &[]).exits_with(0);
    let file = folders.out().join("views/002/mask.png");
    let mask = decode_mask(&std::fs::read(file).unwrap()).unwrap();
    assert_eq!(mask, person.truth.silhouettes[2]);
    assert_eq!(folders.json("views/002/view.json")["mask_given"], true);
}

#[test]
fn other_files_in_the_result_folder_are_kept() {
    let folders = Folders::with_views(1);
    std::fs::create_dir_all(folders.out()).unwrap();
    folders.write("out/notes.txt", "mine");
    folders.write("out/result.json", "old");
    folders.run("segment", &[]).exits_with(0);
    assert_eq!(
        std::fs::read(folders.path("out/notes.txt")).unwrap(),
        b"mine"
    );
    assert_eq!(folders.json("result.json")["goal"], "segment");
}

#[test]
fn a_result_folder_that_cannot_be_created_is_one_clear_error() {
    let folders = Folders::with_views(1);
    folders.write("out", "a file, not a folder");
    let run = folders.run("segment", &["--quiet"]).exits_with(1);
    let error = run.stderr();
    assert_eq!(error.lines().count(), 1, "{error}");
    assert!(error.contains(text(&folders.out())), "{error}");
}

/// A limit on file sizes simulates a full disk
#[cfg(unix)]
#[test]
fn a_full_disk_is_one_clear_error_and_leaves_nothing_partial() {
    let folders = Folders::with_views(1);
    std::fs::create_dir_all(folders.out()).unwrap();
    folders.write("out/result.json", "old");
    // The limit raises a signal, which a full disk does not; it must not end the process.
    let script = "trap '' XFSZ; ulimit -f 0; exec \"$@\"";
    let command = assert_cmd::cargo::cargo_bin("pirouette");
    let output = std::process::Command::new("bash")
        .args(["-c", script, "bash", text(&command), "segment", "--quiet"])
        .args([text(&folders.scan()), "-o", text(&folders.out())])
        .output()
        .unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert_eq!(error.lines().count(), 1, "{error}");
    assert!(
        error.contains("cannot write") && error.contains("free disk space"),
        "{error}"
    );
    assert_eq!(
        std::fs::read(folders.path("out/result.json")).unwrap(),
        b"old"
    );
    let left = std::fs::read_dir(folders.out().join("views/000")).unwrap();
    assert_eq!(left.count(), 0);
}

#[cfg(unix)]
#[test]
fn an_interrupt_ends_the_job_cleanly() {
    ends_the_job_cleanly("-INT");
}

#[cfg(unix)]
#[test]
fn a_request_to_terminate_ends_the_job_cleanly() {
    ends_the_job_cleanly("-TERM");
}

/// Sends a signal, as a terminal does, once the job has started
#[cfg(unix)]
#[track_caller]
fn ends_the_job_cleanly(signal: &str) {
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};

    let folders = Folders::with_views(4);
    let mut child = Command::new(assert_cmd::cargo::cargo_bin("pirouette"))
        .args(["scan", text(&folders.scan()), "-o", text(&folders.out())])
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let first = lines.next().unwrap().unwrap();
    assert!(first.starts_with("load"), "{first}");
    let pid = child.id().to_string();
    assert!(
        Command::new("kill")
            .args([signal, &pid])
            .status()
            .unwrap()
            .success()
    );
    let rest: Vec<String> = lines.map(Result::unwrap).collect();
    assert_eq!(child.wait().unwrap().code(), Some(1), "{rest:?}");
    assert!(rest.last().unwrap().contains("cancelled"), "{rest:?}");
    assert!(!folders.out().exists());
}

#[test]
fn a_zip_file_is_scanned_like_its_folder_and_like_memory() {
    let folders = Folders::with_views(3);
    folders
        .run("scan", &["--quiet", "--export", "csv"])
        .exits_with(0);
    let (zip, out) = (folders.zip(), folders.path("from_zip"));
    pirouette(&["scan", text(&zip), "-o", text(&out), "--export", "csv"]).exits_with(0);

    let mut person = person().clone();
    person.scan.views.truncate(3);
    let files = pirouette_files::scan_folder::scan_files(&person.scan).unwrap();
    let source = pirouette_files::source::Source::from_files("scan", files).unwrap();
    let config = Config::new(Goal::Measure, Method::Fit);
    let done = run_job(
        source,
        &config,
        &JobOptions::default(),
        &CancelToken::default(),
        &mut |_| {},
    )
    .unwrap();
    let options = ResultOptions {
        formats: &[MeshFormat::Ply],
        page_title: None,
        charts: &built_in_charts(),
        exports: &[ExportFormat::Csv],
        ..ResultOptions::default()
    };
    let artifacts = done.artifacts(&options).unwrap();
    assert!(artifacts.len() > 10);
    for (name, bytes) in artifacts {
        if name == "result.json" {
            continue; // contains the seconds of each stage
        }
        assert!(bytes == std::fs::read(out.join(&name)).unwrap(), "{name}");
        let from_folder = std::fs::read(folders.out().join(&name)).unwrap();
        assert!(bytes == from_folder, "{name}");
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let folders = Folders::with_views(3);
    folders.run("segment", &["--jobs", "1"]).exits_with(0);
    let masks = || -> Vec<Vec<u8>> {
        let file = |view| folders.out().join(format!("views/{view:03}/mask.png"));
        (0..3)
            .map(|view| std::fs::read(file(view)).unwrap())
            .collect()
    };
    let one = masks();
    folders.run("segment", &["--jobs", "3"]).exits_with(0);
    assert_eq!(one, masks());
    let version = pirouette(&["--version"]).exits_with(0);
    assert!(version.stdout().contains(env!("CARGO_PKG_VERSION")));
}

#[test]
fn no_file_of_an_earlier_result_remains() {
    let folders = Folders::with_views(3);
    folders.run("segment", &[]).exits_with(0);
    let listed = folders.json("result.json")["files"].clone();
    let listed: Vec<&str> = listed
        .as_array()
        .unwrap()
        .iter()
        .map(|f| f.as_str().unwrap())
        .collect();
    for name in ["contact.jpg", "result.json", "views/002/mask.png"] {
        assert!(listed.contains(&name), "{listed:?}");
    }
    assert!(listed.iter().all(|name| folders.out().join(name).is_file()));
    std::fs::write(folders.out().join("notes.txt"), "mine").unwrap();
    std::fs::write(
        folders.scan().join("scan.json"),
        r#"{ "views": [ { "image": "000.jpg" }, { "image": "001.jpg" } ] }"#,
    )
    .unwrap();
    folders.run("segment", &[]).exits_with(0);
    assert!(folders.out().join("views/001/mask.png").exists());
    assert!(!folders.out().join("views/002").exists());
    // A failed scan leaves no result of another one.
    std::fs::write(folders.scan().join("scan.json"), "{ view }").unwrap();
    folders.run("segment", &[]).exits_with(1);
    let left: Vec<_> = std::fs::read_dir(folders.out()).unwrap().collect();
    assert_eq!(left.len(), 1, "{left:?}");
    assert!(folders.out().join("notes.txt").exists());
}
