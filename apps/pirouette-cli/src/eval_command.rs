//! `pirouette eval`: studies on rendered people, and scores against ground truth.

use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use pirouette::pipeline::{CancelToken, Goal};
use pirouette_eval::ablation::{self, AblationOptions};
use pirouette_eval::angles::{self, AnglesOptions};
use pirouette_eval::bodies::{self, BodiesOptions};
use pirouette_eval::clothes::{self, ClothesOptions};
use pirouette_eval::faults::{self, FaultsOptions, Group};
use pirouette_eval::folders::{
    name_of, photo_table, scan_table, score_photos, score_scan, with_truth,
};
use pirouette_eval::published::{self, Effort};
use pirouette_eval::tapes::{self, TapesOptions};
use pirouette_eval::videos::{self, VideosOptions};
use pirouette_eval::{Step, StudyError, Table};
use pirouette_files::formats::charts::built_in_charts;
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::job::JobOptions;
use pirouette_files::results::ResultOptions;
use pirouette_files::sink::{make_folder, write_atomic};
use serde_json::{Value, json};

use crate::args::{
    EvalAblationArgs, EvalAnglesArgs, EvalArgs, EvalBodiesArgs, EvalClothesArgs, EvalFaultsArgs,
    EvalPhotosArgs, EvalPublishedArgs, EvalScansArgs, EvalTable, EvalTapesArgs, EvalVideosArgs,
};
use crate::models_command::pose_model;
use crate::output::Output;
use crate::progress::Progress;
use crate::scan_command::{config, scan_folder};

/// Runs the selected study and prints its tables
pub fn run(args: &EvalArgs, output: Output, quiet: bool, cancel: &CancelToken) -> Result<()> {
    let progress = Progress::new(quiet);
    let made = match &args.table {
        None => eval_published(&args.published, output, &progress, cancel),
        Some(EvalTable::Bodies(args)) => eval_bodies(args, &progress, cancel),
        Some(EvalTable::Tapes(args)) => eval_tapes(args, &progress, cancel),
        Some(EvalTable::Faults(args)) => eval_faults(args, &progress, cancel),
        Some(EvalTable::Ablation(args)) => eval_ablation(args, &progress, cancel),
        Some(EvalTable::Angles(args)) => eval_angles(args, &progress, cancel),
        Some(EvalTable::Clothes(args)) => eval_clothes(args, &progress, cancel),
        Some(EvalTable::Videos(args)) => eval_videos(args, &progress, cancel),
        Some(EvalTable::Scans(args)) => eval_scans(args, &progress, cancel),
        Some(EvalTable::Photos(args)) => eval_photos(args, &progress, cancel),
    };
    progress.finish();
    let (text, value) = made?;
    output.done(&text, || value)
}

/// Reproduces the published experiments
fn eval_published(
    args: &EvalPublishedArgs,
    output: Output,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<(String, Value)> {
    let options = published::Options {
        effort: if args.quick {
            Effort::Quick
        } else {
            Effort::Full
        },
        only: args.only.clone(),
        photos: args.photos.clone(),
    };
    let results = published::run(&options, cancel, &mut |step| show(progress, &step))?;
    if let Some(file) = &args.html {
        write_atomic(file, published::web_page(&results)?.as_bytes())?;
    }
    if let Some(file) = &args.markdown {
        let folder = file.with_extension("");
        let name = name_of(&folder);
        let page = published::markdown(&results, &name)?;
        make_folder(&folder)?;
        for (name, bytes) in &page.pictures {
            write_atomic(&folder.join(name), bytes)?;
        }
        write_atomic(file, page.text.as_bytes())?;
    }
    let short = results.shortfalls();
    if args.check && !short.is_empty() {
        // The results are printed as well, but only as text: programs get one line.
        if output == Output::Text {
            progress.finish();
            output.done(&results.to_string(), || Value::Null)?;
        }
        bail!("goals missed: {}", short.join("; "));
    }
    let mut value = json!({ "ok": true, "table": "published", "short": short });
    if let (Value::Object(value), Value::Object(found)) = (&mut value, results.to_json()) {
        value.extend(found);
    }
    Ok((results.to_string(), value))
}

fn eval_bodies(
    args: &EvalBodiesArgs,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<(String, Value)> {
    let usual = if args.quick {
        BodiesOptions::quick()
    } else {
        BodiesOptions::default()
    };
    let views = |views: &Vec<u16>| views.iter().map(|&v| usize::from(v)).collect();
    let options = BodiesOptions {
        people: args.people.unwrap_or(usual.people),
        photo_people: args.photo_people.unwrap_or(usual.photo_people),
        views: args.views.as_ref().map_or(usual.views, views),
        noise: args.noise.clone().unwrap_or(usual.noise),
    };
    let study = bodies::study(&options, cancel, &mut |step| show(progress, &step))?;
    let text = format!("{}\n\n{}", study.errors, study.parts);
    let value = json!({
        "ok": true,
        "table": "bodies",
        "goal_mm": bodies::GOAL_MM,
        "errors": study.errors.to_json(),
        "parts": study.parts.to_json(),
        "people": study.people,
    });
    Ok((text, value))
}

fn eval_tapes(
    args: &EvalTapesArgs,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<(String, Value)> {
    let usual = if args.quick {
        TapesOptions::quick()
    } else {
        TapesOptions::default()
    };
    let views = |views: &Vec<u16>| views.iter().map(|&v| usize::from(v)).collect();
    let options = TapesOptions {
        people: args.people.unwrap_or(usual.people),
        view_people: args
            .people
            .unwrap_or(usual.view_people)
            .min(usual.view_people),
        photo_people: args.people.unwrap_or(usual.photo_people),
        repeated: args.people.unwrap_or(usual.repeated).min(usual.repeated),
        views: args.views.as_ref().map_or(usual.views, views),
        first_seed: args.first_seed.unwrap_or(usual.first_seed),
    };
    let study = tapes::study(&options, cancel, &mut |step| show(progress, &step))?;
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot create the folder {}", folder.display()))?;
        for (name, bytes) in [
            ("accuracy-errors.svg", study.errors_svg.as_bytes()),
            ("accuracy-views.svg", study.views_svg.as_bytes()),
            ("accuracy.md", study.page.as_bytes()),
            ("measures.jpg", &study.measures_picture),
            ("measures.md", study.measures_page.as_bytes()),
        ] {
            write_atomic(&folder.join(name), bytes)?;
        }
    }
    let (text, tables) = written(&study.tables);
    let value = json!({
        "ok": true,
        "table": "tapes",
        "tables": tables,
        "people": study.people,
    });
    Ok((text, value))
}

/// Returns tables as text and as JSON
fn written(tables: &[Table]) -> (String, Vec<Value>) {
    let text: Vec<String> = tables.iter().map(ToString::to_string).collect();
    (
        text.join("\n\n"),
        tables.iter().map(Table::to_json).collect(),
    )
}

fn read_json(path: &Path) -> Result<Value> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    serde_json::from_slice(&bytes).with_context(|| format!("{} is no JSON", path.display()))
}

fn eval_faults(
    args: &EvalFaultsArgs,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<(String, Value)> {
    let selected =
        |group: &Group| args.only.is_empty() || args.only.iter().any(|n| n == group.name());
    let options = FaultsOptions {
        people: args.people,
        skipped: args.skip,
        views: usize::from(args.views),
        groups: Group::ALL.into_iter().filter(selected).collect(),
    };
    let study = if args.join.is_empty() {
        faults::study(&options, cancel, &mut |step| show(progress, &step))?
    } else {
        let parts: Result<Vec<Value>> = args.join.iter().map(|path| read_json(path)).collect();
        faults::join(&parts?).map_err(|error| match error {
            StudyError::Part { index, what } => anyhow!("{} is {what}", args.join[index].display()),
            other => other.into(),
        })?
    };
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot create the folder {}", folder.display()))?;
        write_atomic(&folder.join("faults.md"), study.page.as_bytes())?;
    }
    let (text, tables) = written(&study.tables);
    let value = json!({
        "ok": true,
        "table": "faults",
        "views": study.views,
        "tables": tables,
        "captures": study.captures,
    });
    Ok((text, value))
}

fn eval_ablation(
    args: &EvalAblationArgs,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<(String, Value)> {
    let options = AblationOptions {
        people: args.people,
        views: usize::from(args.views),
    };
    let study = ablation::study(&options, cancel, &mut |step| show(progress, &step))?;
    let value = json!({
        "ok": true,
        "table": "ablation",
        "errors": study.table.to_json(),
        "people": study.people,
    });
    Ok((study.table.to_string(), value))
}

fn eval_angles(
    args: &EvalAnglesArgs,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<(String, Value)> {
    let options = AnglesOptions {
        people: args.people,
        views: usize::from(args.views),
    };
    let study = angles::study(&options, cancel, &mut |step| show(progress, &step))?;
    if let Some(folder) = &args.out {
        make_folder(folder)?;
        write_atomic(&folder.join("angles.md"), study.page.as_bytes())?;
    }
    let (text, tables) = written(&study.tables);
    let value = json!({
        "ok": true,
        "table": "angles",
        "tables": tables,
        "people": study.people,
    });
    Ok((text, value))
}

fn eval_clothes(
    args: &EvalClothesArgs,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<(String, Value)> {
    let options = ClothesOptions {
        people: args.people,
        first_seed: args.first_seed,
        ..ClothesOptions::default()
    };
    let study = clothes::study(&options, cancel, &mut |step| show(progress, &step))?;
    if let Some(folder) = &args.out {
        make_folder(folder)?;
        write_atomic(&folder.join("clothes.md"), study.page.as_bytes())?;
    }
    let (text, tables) = written(&study.tables);
    let value = json!({
        "ok": true,
        "table": "clothes",
        "tables": tables,
        "people": study.people,
    });
    Ok((text, value))
}

fn eval_videos(
    args: &EvalVideosArgs,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<(String, Value)> {
    let Some(model) = pose_model(args.pose_model.as_deref())? else {
        bail!("the turn in a video is found by the pose detector: run 'pirouette models install'");
    };
    make_folder(&args.videos)?;
    let options = VideosOptions {
        people: args.people,
        folder: args.videos.clone(),
    };
    let study = videos::study(&options, &model, cancel, &mut |step| show(progress, &step))?;
    if let Some(folder) = &args.out {
        make_folder(folder)?;
        write_atomic(&folder.join("videos.md"), study.page.as_bytes())?;
    }
    let (text, tables) = written(&study.tables);
    let value = json!({
        "ok": true,
        "table": "videos",
        "tables": tables,
        "videos": study.videos,
    });
    Ok((text, value))
}

fn eval_scans(
    args: &EvalScansArgs,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<(String, Value)> {
    let config = config(&args.method, Goal::Measure)?;
    let charts = built_in_charts();
    let results = ResultOptions {
        formats: &[MeshFormat::Ply],
        page_title: None,
        charts: &charts,
        exports: &[],
        ..ResultOptions::default()
    };
    let folders = with_truth(&args.folders)?;
    let mut scores = Vec::new();
    for (index, folder) in folders.iter().enumerate() {
        let out = args.out.join(name_of(folder));
        if !args.keep {
            scan_folder(
                folder,
                &out,
                &config,
                &JobOptions::default(),
                &results,
                progress,
                cancel,
            )?;
        } else if !out.is_dir() {
            return Err(std::io::Error::from(std::io::ErrorKind::NotFound))
                .with_context(|| format!("no results in {}", out.display()));
        }
        if cancel.cancelled() {
            return Err(StudyError::Cancelled.into());
        }
        let score = score_scan(folder, &out)?;
        let text = format!("scored {}", folder.display());
        progress.step(index + 1, folders.len(), &text);
        scores.push(score);
    }
    let scans: Vec<Value> = scores.iter().map(|score| score.to_json()).collect();
    let value = json!({ "ok": true, "table": "scans", "scans": scans });
    Ok((scan_table(&scores).to_string(), value))
}

fn eval_photos(
    args: &EvalPhotosArgs,
    progress: &Progress,
    cancel: &CancelToken,
) -> Result<(String, Value)> {
    let folders = with_truth(&args.folders)?;
    let scores = score_photos(&folders, cancel, &mut |step| show(progress, &step))?;
    let table = photo_table(&scores);
    let photos: Vec<Value> = scores
        .iter()
        .map(|score| json!({ "photo": score.photo, "iou": (score.iou * 1e4).round() / 1e4 }))
        .collect();
    let value = json!({
        "ok": true,
        "table": "photos",
        "errors": table.to_json(),
        "photos": photos,
    });
    Ok((table.to_string(), value))
}

fn show(progress: &Progress, step: &Step) {
    progress.step(step.done, step.total, &step.text);
}
