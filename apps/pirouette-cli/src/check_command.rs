//! `pirouette check`: what is wrong or doubtful with a capture, per photo.

use anyhow::{Result, bail};
use pirouette::pipeline::{AvatarSource, CancelToken, Capture};
use pirouette_body::Sex;
use pirouette_files::job::{JobOptions, check_job};
use pirouette_files::scan_folder::LoadedScan;
use pirouette_files::video::VideoOptions;
use serde_json::{Value, json};

use crate::args::{Angles, CheckArgs};
use crate::models_command::pose_model;
use crate::open::open_scan;
use crate::output::Output;
use crate::progress::Progress;
use crate::scan_command::with_cause;

/// Runs the command
pub fn run(args: &CheckArgs, output: Output, quiet: bool, cancel: &CancelToken) -> Result<()> {
    let progress = Progress::new(quiet);
    let pose_model = pose_model(args.pose_model.as_deref())?;
    let options = JobOptions {
        pose_model: pose_model.as_ref(),
        angles_unknown: args.angles == Some(Angles::Unknown),
        ..JobOptions::default()
    };
    let avatar = AvatarSource::Mannequin {
        sex: Sex::Neutral,
        mass_kg: None,
    };
    let video = VideoOptions::default();
    let source = open_scan(&args.scan, pose_model.as_ref(), &video, &progress, cancel)?;
    let scan = source.path();
    let checked = check_job(source, &avatar, &options, cancel, &mut |event| {
        progress.show_job(&event);
    });
    progress.finish();
    let (loaded, capture) = checked.map_err(|error| with_cause(error, &scan))?;
    let refused = capture.refused_count();
    // A failure has its own line of JSON, with the reason.
    if output != Output::Json || refused.is_none() {
        output.done(&table(&loaded, &capture), || to_json(&loaded, &capture))?;
    }
    if let Some(count) = refused {
        bail!(
            "{}: {count} photos do not show the complete person: the scan would be refused{}",
            scan.display(),
            first_finding(&loaded, &capture)
        );
    }
    Ok(())
}

/// Returns the first finding with its photo
fn first_finding(loaded: &LoadedScan, capture: &Capture) -> String {
    let views = loaded.scan.views.iter().zip(&capture.findings);
    let mut found = views.filter_map(|(view, found)| Some((view, found.first()?)));
    found.next().map_or_else(String::new, |(view, finding)| {
        format!(" ({}: {finding})", view.name)
    })
}

/// Formats one line per photo, and the warnings about the complete scan
fn table(loaded: &LoadedScan, capture: &Capture) -> String {
    let views = loaded
        .scan
        .views
        .iter()
        .zip(&capture.turns)
        .zip(&capture.joint_counts);
    let mut lines = vec![format!("{:<12}{:>6}{:>8}  ", "photo", "angle", "joints")];
    for (((view, turn), count), found) in views.zip(&capture.findings) {
        let start = format!("{:<12}{:>5.0}°{count:>8}  ", view.name, turn.degrees());
        let found: Vec<String> = found.iter().map(ToString::to_string).collect();
        let all = if found.is_empty() {
            "ok".to_owned()
        } else {
            found.join(&format!("\n{:28}", ""))
        };
        lines.push(start + &all);
    }
    for failed in &loaded.failed {
        let angle = failed
            .turn
            .map_or_else(|| "-".to_owned(), |turn| format!("{:.0}°", turn.degrees()));
        lines.push(format!(
            "{:<12}{angle:>6}{:>8}  {}",
            failed.view, "-", failed.reason
        ));
    }
    let warnings = loaded.warnings.iter().map(ToString::to_string);
    let of_skeleton = capture.skeleton.warnings.iter().map(ToString::to_string);
    let of_turns = capture.turn_warnings(&loaded.scan);
    let of_turns = of_turns.iter().map(ToString::to_string);
    lines.extend(warnings.chain(of_skeleton).chain(of_turns));
    lines.join("\n")
}

fn to_json(loaded: &LoadedScan, capture: &Capture) -> Value {
    let views = loaded
        .scan
        .views
        .iter()
        .zip(&capture.turns)
        .zip(&capture.joint_counts);
    let views: Vec<Value> = views
        .zip(&capture.findings)
        .map(|(((view, turn), count), found)| {
            let findings = found
                .iter()
                .map(|finding| json!({ "code": finding.code(), "message": finding.to_string() }));
            json!({
                "name": view.name,
                "angle_deg": turn.degrees(),
                "joints": count,
                "findings": findings.collect::<Vec<_>>(),
            })
        })
        .collect();
    let failed: Vec<Value> = loaded
        .failed
        .iter()
        .map(|failed| json!({ "name": failed.view, "reason": failed.reason.to_string() }))
        .collect();
    let warnings = loaded.warnings.iter().map(ToString::to_string);
    let of_skeleton = capture.skeleton.warnings.iter().map(ToString::to_string);
    let of_turns = capture.turn_warnings(&loaded.scan);
    let of_turns = of_turns.iter().map(ToString::to_string);
    json!({
        "ok": true,
        "views": views,
        "failed": failed,
        "warnings": warnings.chain(of_skeleton).chain(of_turns).collect::<Vec<_>>(),
        "rms_px": capture.skeleton.rms_px,
    })
}
