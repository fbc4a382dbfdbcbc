//! A scan gives the same results from a folder, a zip file and memory, written to a folder and to memory.

use std::collections::BTreeMap;
use std::fs;
use std::io::{Cursor, Write};
use std::path::Path;

use pirouette::pipeline::{CancelToken, Config, Event, Goal, Method, Stage};
use pirouette_files::formats::charts::built_in_charts;
use pirouette_files::formats::export::ExportFormat;
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::job::{FinishedJob, JobError, JobEvent, JobOptions, ScaleSource, run_job};
use pirouette_files::results::ResultOptions;
use pirouette_files::scan_folder::{scan_files, write_scan};
use pirouette_files::source::Source;
use pirouette_synthetic::people::turning_woman;
use zip::write::{SimpleFileOptions, ZipWriter};

type Files = BTreeMap<String, Vec<u8>>;

fn files_below(folder: &Path, root: &Path, found: &mut Files) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            files_below(&path, root, found);
        } else {
            let parts = path
                .strip_prefix(root)
                .expect("below the root")
                .components();
            let names: Vec<_> = parts
                .map(|p| p.as_os_str().to_str().expect("a UTF-8 name"))
                .collect();
            found.insert(names.join("/"), fs::read(&path).expect("a file"));
        }
    }
}

/// Creates a zip file with a top folder, as desktop programs do
fn zipped(files: &Files) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    writer.add_directory("anna", options).expect("memory");
    for (name, bytes) in files {
        writer
            .start_file(format!("anna/{name}"), options)
            .expect("memory");
        writer.write_all(bytes).expect("memory");
    }
    writer.finish().expect("memory").into_inner()
}

/// Runs a job; its times are cleared, since they differ between runs
fn finished(source: Source) -> FinishedJob {
    let config = Config::new(Goal::Measure, Method::Fit);
    let mut done = run_job(
        source,
        &config,
        &JobOptions::default(),
        &CancelToken::default(),
        &mut |_| {},
    )
    .expect("a rendered person can be scanned");
    done.load_seconds = 0.5;
    done.report.seconds.clear();
    done
}

#[track_caller]
fn assert_same(found: &Files, expected: &Files) {
    let names = |all: &Files| all.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(found), names(expected));
    for (name, bytes) in found {
        assert!(bytes == &expected[name], "{name}");
    }
}

#[test]
fn folder_zip_and_memory_give_the_same_bytes() {
    let person = turning_woman(4);
    let files = scan_files(&person.scan).unwrap();
    let scan_folder = tempfile::tempdir().unwrap();
    write_scan(scan_folder.path(), &person.scan).unwrap();
    let mut written = BTreeMap::new();
    files_below(scan_folder.path(), scan_folder.path(), &mut written);
    assert_same(&files, &written);

    let charts = built_in_charts();
    let options = ResultOptions {
        formats: &[MeshFormat::Ply, MeshFormat::Glb],
        page_title: Some("Anna"),
        charts: &charts,
        exports: &[ExportFormat::Csv],
        ..ResultOptions::default()
    };
    let from_folder = finished(Source::open(scan_folder.path()).unwrap());
    let artifacts = from_folder.artifacts(&options).unwrap();
    for name in [
        "result.json",
        "measurements.json",
        "measurements.csv",
        "report.html",
        "contact.jpg",
        "tapes.jpg",
        "residuals.jpg",
        "body.ply",
        "body.glb",
        "views/000/mask.png",
    ] {
        assert!(artifacts.contains_key(name), "{name} is missing");
    }
    let out = tempfile::tempdir().unwrap();
    from_folder.write(out.path(), &options).unwrap();
    let mut written = BTreeMap::new();
    files_below(out.path(), out.path(), &mut written);
    assert_same(&artifacts, &written);

    let from_zip = finished(Source::from_zip("anna.zip", zipped(&files)).unwrap());
    assert_same(&from_zip.artifacts(&options).unwrap(), &artifacts);
    let from_memory = finished(Source::from_files("anna", files).unwrap());
    assert_same(&from_memory.artifacts(&options).unwrap(), &artifacts);
}

#[test]
fn a_job_reports_excluded_views_and_the_source_of_the_scale() {
    let mut files = scan_files(&turning_woman(3).scan).unwrap();
    files.insert("001.jpg".to_owned(), b"no photo".to_vec());
    let mut events = Vec::new();
    let source = Source::from_files("anna", files).unwrap();
    let config = Config::new(Goal::Normalize, Method::Fit);
    let done = run_job(
        source,
        &config,
        &JobOptions {
            scale: Some(ScaleSource::Card),
            ..JobOptions::default()
        },
        &CancelToken::default(),
        &mut |event| match event {
            JobEvent::ViewFailed(failed) => events.push(failed.to_string()),
            JobEvent::CardNotNeeded => events.push("no card".to_owned()),
            JobEvent::Pipeline(Event::StageDone {
                stage: Stage::Load, ..
            }) => {
                events.push("loaded".to_owned());
            }
            _ => {}
        },
    )
    .unwrap();
    assert_eq!(done.loaded.scan.given_view_count(), 3);
    assert_eq!(events[..2], ["loaded", "no card"]);
    assert!(events[2].starts_with("view 001 is rejected (load): 001.jpg"));
    assert_eq!(events.len(), 3);
}

#[test]
fn a_job_fails_if_the_scale_cannot_be_determined() {
    let mut person = turning_woman(3);
    person.scan.stature_mm = None;
    let source = Source::from_files("anna", scan_files(&person.scan).unwrap()).unwrap();
    let config = Config::new(Goal::Measure, Method::Fit);
    let card = JobOptions {
        scale: Some(ScaleSource::Card),
        ..JobOptions::default()
    };
    let done = run_job(source, &config, &card, &CancelToken::default(), &mut |_| {});
    assert!(matches!(done, Err(JobError::Card(_))));
}
