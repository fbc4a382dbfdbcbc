//! A complete front end in memory: files and results are bytes.
//!
//! ```text
//! cargo run --release -p pirouette-files --example from_memory
//! ```
//!
//! The photos, keypoints and manifest are those of a rendered person; a server gets them from an upload, a browser from
//! a form. `Source::from_zip(name, bytes)` reads a zip file instead.

#![allow(clippy::print_stdout, reason = "the example prints its results")]

use std::collections::BTreeMap;
use std::error::Error;
use std::hash::{DefaultHasher, Hasher};

use pirouette::pipeline::{CancelToken, Config, Event, Goal, Method};
use pirouette_files::formats::charts::built_in_charts;
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::job::{JobEvent, JobOptions, run_job};
use pirouette_files::results::ResultOptions;
use pirouette_files::scan_folder::scan_files;
use pirouette_files::source::Source;
use pirouette_synthetic::people::turning_woman;

fn main() -> Result<(), Box<dyn Error>> {
    let uploaded = scan_files(&turning_woman(4).scan)?;
    let files: Vec<(&str, &[u8])> = uploaded.iter().map(|(n, b)| (&n[..], &b[..])).collect();
    for (name, bytes) in scan_bytes("anna", &files)? {
        println!("{:>9} bytes  {:016x}  {name}", bytes.len(), hash(&bytes));
    }
    Ok(())
}

/// Makes results comparable at a glance
fn hash(bytes: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    hasher.write(bytes);
    hasher.finish()
}

/// Scans a person from photos, keypoint files and `scan.json`; returns every result by name
fn scan_bytes(
    name: &str,
    files: &[(&str, &[u8])],
) -> Result<BTreeMap<String, Vec<u8>>, Box<dyn Error>> {
    let source = Source::from_files(name, files.iter().copied())?;
    let config = Config::new(Goal::Measure, Method::Fit);
    let cancel = CancelToken::default();
    let done = run_job(
        source,
        &config,
        &JobOptions::default(),
        &cancel,
        &mut |event| match event {
            JobEvent::Pipeline(Event::StageDone { stage, seconds }) => {
                println!("{}: {seconds:.2} s", stage.name());
            }
            JobEvent::Pipeline(Event::Warning(warning)) => println!("warning: {warning}"),
            JobEvent::LoadWarning(warning) => println!("warning: {warning}"),
            JobEvent::ViewFailed(failed) => println!("warning: {failed}"),
            _ => {}
        },
    )?;
    let charts = built_in_charts();
    Ok(done.artifacts(&ResultOptions {
        formats: &[MeshFormat::Ply, MeshFormat::Glb],
        page_title: Some(name),
        charts: &charts,
        exports: &[],
        ..ResultOptions::default()
    })?)
}
