//! `pirouette scan` and its stages.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use pirouette::io::mesh::MeshFormat;
use pirouette::io::results::{ResultOptions, result_value, write_results};
use pirouette::io::scan_folder::{LoadOptions, LoadedScan, load_scan};
use pirouette::pipeline::{self, AvatarSource, CancelToken, Config, Event, Goal, Report, Stage};
use serde_json::{Value, json};

use crate::args::{Method, MethodArgs, ScanArgs};
use crate::output::Output;
use crate::progress::Progress;

/// Scans a folder up to a goal and writes the results
pub fn run(
    args: &ScanArgs,
    goal: Goal,
    output: Output,
    quiet: bool,
    cancel: &CancelToken,
) -> Result<()> {
    let progress = Progress::new(quiet);
    let config = config(&args.method, goal)?;
    let formats: Vec<MeshFormat> = args.format.iter().map(|format| format.of_mesh()).collect();
    let title = title(&args.scan);
    let options = ResultOptions {
        formats: &formats,
        page_title: args.report.then_some(title.as_str()),
    };
    let done = scan_folder(&args.scan, &args.out, &config, &options, &progress, cancel);
    progress.finish();
    let done = done?;
    output.done(&done.summary(&args.out), || done.json(&args.out))
}

/// The library's configuration for what the command line says
pub fn config(args: &MethodArgs, goal: Goal) -> Result<Config> {
    let method = match args.method {
        Method::Fit => pipeline::Method::Fit,
        Method::ThreeStep => pipeline::Method::ThreeStep,
    };
    let mut config = Config::new(goal, method);
    config.register = (config.register || args.register) && !args.no_register;
    config.refine = (config.refine || args.refine) && !args.no_refine;
    config.hull = args.hull;
    if let Some(file) = &args.avatar {
        let bytes = std::fs::read(file)
            .with_context(|| format!("cannot read the avatar {}", file.display()))?;
        let name = file.display().to_string();
        config.avatar = AvatarSource::File { name, bytes };
    }
    Ok(config)
}

/// What a scan is called: the name of its folder
fn title(scan: &Path) -> String {
    let full = scan.canonicalize().unwrap_or_else(|_| scan.to_owned());
    let name = full.file_name().unwrap_or(full.as_os_str());
    name.to_string_lossy().into_owned()
}

/// A finished job
pub struct Done {
    pub loaded: LoadedScan,
    pub load_seconds: f64,
    pub report: Report,
}

/// Loads a scan, does the job, writes the results
pub fn scan_folder(
    scan: &Path,
    out: &Path,
    config: &Config,
    results: &ResultOptions,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<Done> {
    let start = Instant::now();
    let options = LoadOptions {
        // Silhouettes of photos of all kinds are fine; only a body needs one camera.
        one_shape: config.goal > Goal::Segment,
        ..LoadOptions::default()
    };
    let loaded = load_scan(scan, &options)?;
    let load_seconds = start.elapsed().as_secs_f64();
    progress.show(&Event::StageDone {
        stage: Stage::Load,
        seconds: load_seconds,
    });
    for warning in &loaded.warnings {
        progress.say(&format!("warning: {warning}"));
    }
    for failed in &loaded.failed {
        progress.say(&format!(
            "warning: view {} is left out (load): {}",
            failed.view, failed.reason
        ));
    }
    let config = Config {
        given_view_count: Some(loaded.scan.views.len() + loaded.failed.len()),
        ..config.clone()
    };
    let report = pipeline::run(&loaded.scan, &config, cancel, &mut |event| {
        progress.show(&event);
    })
    .with_context(|| scan.display().to_string())?;
    write_results(out, &loaded, load_seconds, &report, results)?;
    Ok(Done {
        loaded,
        load_seconds,
        report,
    })
}

impl Done {
    /// One machine-readable line
    pub fn json(&self, out: &Path) -> Value {
        let mut value = json!({ "ok": true, "out": out });
        let result = result_value(&self.loaded, self.load_seconds, &self.report);
        let measurements = self.report.measurements.as_ref();
        for part in [Some(result), measurements.map(|m| json!(m))] {
            if let Some(Value::Object(part)) = part {
                for (key, entry) in part {
                    value[key] = entry;
                }
            }
        }
        value
    }

    fn summary(&self, out: &Path) -> String {
        let given = self.loaded.scan.views.len() + self.loaded.failed.len();
        let mut text = format!(
            "{}: {} of {given} views",
            out.display(),
            self.report.views.len()
        );
        if let Some(measurements) = &self.report.measurements {
            for (measure, measured) in measurements.iter() {
                let value = match &measured.value_mm {
                    Ok(value_mm) => format!("{value_mm:6.0} mm"),
                    Err(why) => format!("     -    {why}"),
                };
                text.push_str(&format!(
                    "\n{:<16}{value}",
                    measure.name().replace('_', " ")
                ));
            }
        }
        text
    }
}
