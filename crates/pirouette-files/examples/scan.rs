//! Scans a folder or a zip file of photos and writes a result folder, as `pirouette scan` does.
//!
//! ```text
//! cargo run --release -p pirouette-files --example scan -- photos/anna result
//! ```

#![allow(clippy::print_stdout, reason = "the example prints its results")]

use std::error::Error;
use std::path::PathBuf;

use pirouette::pipeline::{CancelToken, Config, Event, Goal, Method};
use pirouette_files::formats::charts::built_in_charts;
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::job::{JobEvent, JobOptions, run_job};
use pirouette_files::results::ResultOptions;
use pirouette_files::source::Source;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [scan, out] = &arguments[..] else {
        return Err("usage: scan FOLDER_OR_ZIP RESULT_FOLDER".into());
    };
    let source = Source::open(scan)?;
    let title = source.title();
    let config = Config::new(Goal::Measure, Method::Fit);
    // Another thread may call `cancel` on a clone of the token.
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
    if let Some(refusal) = &done.report.refusal {
        println!("refused: {refusal}");
    }
    if let Some(measurements) = &done.report.measurements {
        for (measure, measured) in measurements.iter() {
            match &measured.value_mm {
                Ok(mm) => println!("{:<18}{}", measure.name(), measurements.format_length(*mm)),
                Err(reason) => println!("{:<18}{reason}", measure.name()),
            }
        }
    }
    let charts = built_in_charts();
    done.write(
        out,
        &ResultOptions {
            formats: &[MeshFormat::Ply],
            page_title: Some(&title),
            charts: &charts,
            ..ResultOptions::default()
        },
    )?;
    println!("written to {}", out.display());
    Ok(())
}
