//! `pirouette scan` and its stages.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use pirouette::pipeline;
use pirouette::pipeline::{AvatarSource, CancelToken, Config, Event, Goal, Report, Stage};
use pirouette::scale::{scale_by_card, scale_by_pixels};
use pirouette::scan::StatureFrom;
use pirouette::sizes::{Advice, Chart, advise_person};
use pirouette_files::formats::charts::{built_in_charts, parse_charts};
use pirouette_files::formats::export::{ExportFormat, write_exports};
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::report::json::measurements_json;
use pirouette_files::results::{ResultOptions, result_value, write_results};
use pirouette_files::scan_folder::{LoadOptions, LoadedScan, load_scan};
use serde_json::{Value, json};

use crate::args::{Method, MethodArgs, ScaleSource, ScanArgs};
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
    let charts = charts(args.chart.as_deref())?;
    let options = ResultOptions {
        formats: &formats,
        page_title: args.report.then_some(title.as_str()),
        charts: &charts,
    };
    let scale = args.scale;
    let done = scan_folder(
        &args.scan, &args.out, &config, scale, &options, &progress, cancel,
    );
    progress.finish();
    let done = done?;
    if let Some(measurements) = &done.report.measurements {
        let exports: Vec<ExportFormat> = args.export.iter().map(|e| e.of_file()).collect();
        write_exports(&args.out, measurements, &exports)?;
    }
    output.done(&done.summary(&args.out, &charts), || {
        done.json(&args.out, &charts)
    })
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
    scale: Option<ScaleSource>,
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
    let mut loaded = load_scan(scan, &options)?;
    if config.goal > Goal::Segment {
        find_scale(&mut loaded, scale, progress)?;
    }
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

/// Finds the scale where the stature was not told
fn find_scale(
    loaded: &mut LoadedScan,
    source: Option<ScaleSource>,
    progress: &Progress,
) -> Result<()> {
    let scan = &mut loaded.scan;
    if scan.stature_mm.is_some() {
        if source.is_some() {
            progress.say("warning: scan.json tells the stature; no card is looked for");
        }
        return Ok(());
    }
    if let Some(ScaleSource::Card) = source {
        let (view, card) = scale_by_card(scan).context("--scale card")?;
        progress.say(&format!(
            "scale: the card in view {view}, tilted by {:.0} degrees, has {:.3} mm per px",
            card.tilt_degrees, card.mm_per_px
        ));
    } else if let (Some(mm_per_px), Some(view)) = (scan.mm_per_px, scan.views.first()) {
        // Large photos were shrunk.
        let shrunk = view.input_size_px.1 as f64 / view.photo.height() as f64;
        scale_by_pixels(scan, mm_per_px * shrunk, StatureFrom::PixelSize)
            .context("camera.mm_per_px")?;
    }
    Ok(())
}

/// The charts of a file, or those that come with the program
pub fn charts(file: Option<&Path>) -> Result<Vec<Chart>> {
    let Some(file) = file else {
        return Ok(built_in_charts());
    };
    let text = std::fs::read_to_string(file)
        .with_context(|| format!("cannot read the chart {}", file.display()))?;
    parse_charts(&text).with_context(|| file.display().to_string())
}

/// One line per chart
pub fn size_lines(advice: &[Advice]) -> String {
    let lines = advice.iter();
    let lines: Vec<String> = lines
        .map(|a| format!("{:<52}{}", a.chart, a.verdict))
        .collect();
    lines.join("\n")
}

impl Done {
    /// One machine-readable line
    pub fn json(&self, out: &Path, charts: &[Chart]) -> Value {
        let mut value = json!({ "ok": true, "out": out });
        let result = result_value(&self.loaded, self.load_seconds, &self.report);
        let measurements = self.report.measurements.as_ref();
        for part in [
            Some(result),
            measurements.map(|m| measurements_json(m, &advise_person(m, charts))),
        ] {
            if let Some(Value::Object(part)) = part {
                for (key, entry) in part {
                    value[key] = entry;
                }
            }
        }
        value
    }

    fn summary(&self, out: &Path, charts: &[Chart]) -> String {
        let given = self.loaded.scan.views.len() + self.loaded.failed.len();
        let mut text = format!(
            "{}: {} of {given} views",
            out.display(),
            self.report.views.len()
        );
        if let Some(measurements) = &self.report.measurements {
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
                text.push_str(&format!(
                    "\n{:<18}{value}",
                    measure.name().replace('_', " ")
                ));
            }
            if let Some(mass) = &measurements.mass {
                text.push_str(&format!(
                    "\n{:<18}{:6.1} l\n{:<18}{:6.1} kg ± {:.1}",
                    "volume", mass.volume_l, "body mass", mass.mass_kg, mass.mass_sd_kg
                ));
            }
            if measurements.in_mm() && measurements.subject.sex.is_some() {
                text.push('\n');
                text.push_str(&size_lines(&advise_person(measurements, charts)));
            }
        }
        text
    }
}
