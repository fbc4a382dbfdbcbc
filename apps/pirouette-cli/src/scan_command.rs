//! `pirouette scan`, and the commands that run a part of its stages.

use std::path::Path;

use anyhow::{Context, Error, Result};
use pirouette::measure::Method::BelowClothes;
use pirouette::pipeline;
use pirouette::pipeline::{AvatarSource, CancelToken, Config, Goal};
use pirouette::sizes::{Advice, Chart, advise_person};
use pirouette_files::formats::charts::{built_in_charts, parse_charts};
use pirouette_files::formats::export::ExportFormat;
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::job::{FinishedJob, JobError, JobOptions, KeypointChoice, run_job};
use pirouette_files::results::{ResultOptions, remove_results};
use pirouette_files::scan_folder::GivenKeypoints;
use pirouette_files::source::Source;
use pirouette_files::video::VideoOptions;
use serde_json::{Value, json};

use crate::args::{Angles, KeypointInput, Looseness, Method, MethodArgs, ScanArgs};
use crate::models_command::pose_model;
use crate::open::open_scan;
use crate::output::Output;
use crate::progress::Progress;

/// Scans a folder or a zip file up to a goal and writes the results
pub fn run(
    args: &ScanArgs,
    goal: Goal,
    output: Output,
    quiet: bool,
    cancel: &CancelToken,
) -> Result<()> {
    let progress = Progress::new(quiet);
    let config = config(&args.method, goal)?;
    let scale = args.scale.map(|source| source.of_job());
    let pose_model = pose_model(args.pose_model.as_deref())?;
    let files = match &args.keypoints {
        Some(KeypointInput::Files(path)) => {
            Some(GivenKeypoints::open(path).context("--keypoints")?)
        }
        Some(KeypointInput::None) | None => None,
    };
    let keypoints = match (&args.keypoints, &files) {
        (Some(KeypointInput::None), _) => KeypointChoice::Estimate,
        (_, Some(files)) => KeypointChoice::Files(files),
        (_, None) => KeypointChoice::Best,
    };
    let video = VideoOptions {
        views: args.views.into(),
    };
    // The result of an earlier scan is not that of this one, even if this one fails.
    let source = open_scan(&args.scan, pose_model.as_ref(), &video, &progress, cancel)
        .inspect_err(|_| remove_results(&args.out))?;
    let title = source.title();
    let job_options = JobOptions {
        scale,
        pose_model: pose_model.as_ref(),
        keypoints,
        angles_unknown: args.angles == Some(Angles::Unknown),
    };
    let job = || scan_source(source, &config, &job_options, &progress, cancel);
    write_and_print(args, &title, output, &progress, job)
}

/// Runs a job, writes its results as the arguments say, and prints them
pub fn write_and_print(
    args: &ScanArgs,
    title: &str,
    output: Output,
    progress: &Progress,
    job: impl FnOnce() -> Result<FinishedJob>,
) -> Result<()> {
    let formats: Vec<MeshFormat> = args.format.iter().map(|format| format.of_mesh()).collect();
    let exports: Vec<ExportFormat> = args.export.iter().map(|e| e.of_file()).collect();
    let charts = charts(args.chart.as_deref())?;
    let options = ResultOptions {
        formats: &formats,
        body_pose: args.body_pose.of_results(),
        page_title: args.report.then_some(title),
        charts: &charts,
        exports: &exports,
    };
    let done = job().inspect_err(|_| remove_results(&args.out));
    let done = done.and_then(|done| Ok(done.write(&args.out, &options).map(|()| done)?));
    progress.finish();
    let done = done?;
    if let Some(refusal) = done.report.refusal {
        let results = args.out.display();
        return Err(
            Error::new(refusal).context(format!("{}: results in {results}", args.scan.display()))
        );
    }
    output.done(&summary(&done, &args.out, &charts), || {
        json_line(&done, &args.out, &charts)
    })
}

/// Scans a folder, a zip file or a video with the scale it provides, and writes the results
pub fn scan_folder(
    scan: &Path,
    out: &Path,
    config: &Config,
    job_options: &JobOptions,
    results: &ResultOptions,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<FinishedJob> {
    let video = VideoOptions::default();
    let source = open_scan(scan, job_options.pose_model, &video, progress, cancel)?;
    let done = scan_source(source, config, job_options, progress, cancel)?;
    done.write(out, results)?;
    Ok(done)
}

/// Scans and shows progress; errors name the scan or the flag that caused them
fn scan_source(
    source: Source,
    config: &Config,
    options: &JobOptions,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<FinishedJob> {
    let scan = source.path();
    let done = run_job(source, config, options, cancel, &mut |event| {
        progress.show_job(&event);
    });
    done.map_err(|error| with_cause(error, &scan))
}

/// Names the scan or the flag that caused an error
pub fn with_cause(error: JobError, scan: &Path) -> Error {
    match error {
        JobError::Card(error) => Error::new(error).context("--scale card"),
        JobError::Pipeline(error) => Error::new(error).context(scan.display().to_string()),
        error @ (JobError::Estimate(_) | JobError::Background(_) | JobError::AnglesUnknown) => {
            Error::new(error).context(scan.display().to_string())
        }
        JobError::Check(error) => Error::new(error).context(scan.display().to_string()),
        error => error.into(),
    }
}

/// Returns the library's configuration for the command line arguments
pub fn config(args: &MethodArgs, goal: Goal) -> Result<Config> {
    let method = match args.method {
        Method::Fit => pipeline::Method::Fit,
        Method::ThreeStep => pipeline::Method::ThreeStep,
    };
    let mut config = Config::new(goal, method);
    config.register = (config.register || args.register) && !args.no_register;
    config.refine = (config.refine || args.refine) && !args.no_refine;
    config.hull = args.hull;
    config.clothes = args.clothes.map(Looseness::statement);
    config.surface = args.surface.of_config();
    if let Some(file) = &args.avatar {
        let bytes = std::fs::read(file)
            .with_context(|| format!("cannot read the avatar {}", file.display()))?;
        let name = file.display().to_string();
        config.avatar = AvatarSource::File { name, bytes };
    }
    Ok(config)
}

/// Returns the charts of a file, or the built-in ones
pub fn charts(file: Option<&Path>) -> Result<Vec<Chart>> {
    let Some(file) = file else {
        return Ok(built_in_charts());
    };
    let text = std::fs::read_to_string(file)
        .with_context(|| format!("cannot read the chart {}", file.display()))?;
    parse_charts(&text).with_context(|| file.display().to_string())
}

/// Formats the recommendations, one line per chart
pub fn size_lines(advice: &[Advice]) -> String {
    let lines = advice.iter();
    let lines: Vec<String> = lines
        .map(|a| format!("{:<52}{}", a.chart, a.verdict))
        .collect();
    lines.join("\n")
}

/// Returns the results for the line of JSON
pub fn json_line(done: &FinishedJob, out: &Path, charts: &[Chart]) -> Value {
    let mut value = json!({ "ok": true, "out": out });
    if let (Value::Object(value), Value::Object(found)) = (&mut value, done.to_json(charts)) {
        value.extend(found);
    }
    value
}

/// Formats the measurements as text
fn summary(done: &FinishedJob, out: &Path, charts: &[Chart]) -> String {
    let given = done.loaded.scan.given_view_count();
    let mut text = format!(
        "{}: {} of {given} views",
        out.display(),
        done.report.views.len()
    );
    if let Some(measurements) = &done.report.measurements {
        for (measure, measured) in measurements.iter() {
            let value = match &measured.value_mm {
                Ok(value_mm) => match measured.sd_mm.filter(|_| measurements.in_mm()) {
                    Some(sd_mm) => {
                        format!("{} ± {sd_mm:.0}", measurements.format_length(*value_mm))
                    }
                    None => measurements.format_length(*value_mm),
                },
                Err(why) => format!("     -    {why}"),
            };
            let seen = measured.pixels.filter(|_| measured.method == BelowClothes);
            let seen = seen.map_or(String::new(), |seen| {
                format!("   below clothes; seen {:.0} mm", seen.value_mm)
            });
            text.push_str(&format!(
                "\n{:<24}{value}{seen}",
                measure.name().replace('_', " ")
            ));
        }
        if let Some(mass) = &measurements.mass {
            text.push_str(&format!(
                "\n{:<24}{:6.1} l\n{:<24}{:6.1} kg ± {:.1}",
                "volume", mass.volume_l, "body mass", mass.mass_kg, mass.mass_sd_kg
            ));
        }
        if let Some(clothes) = &measurements.clothes
            && clothes.stated.is_none()
            && clothes.covered().next().is_none()
        {
            text.push_str("\nassumes tight clothes; state others by --clothes normal or loose");
        }
        if measurements.in_mm() && measurements.subject.sex.is_some() {
            text.push('\n');
            text.push_str(&size_lines(&advise_person(measurements, charts)));
        }
    }
    text
}
