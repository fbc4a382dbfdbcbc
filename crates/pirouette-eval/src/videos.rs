//! Accuracy of the turn angles and girths from videos of rendered people.

use std::f64::consts::TAU;
use std::fmt::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use pirouette::measure::{Measure, measure_avatar};
use pirouette::pipeline::{CancelToken, Config, Goal, Method};
use pirouette::pose::PoseModel;
use pirouette_files::job::{JobOptions, run_job};
use pirouette_files::sink::write_atomic;
use pirouette_files::video::{VideoFile, VideoWriter, scan_of_video};
use pirouette_synthetic::video::{TurnCourse, VideoOptions, render_video};
use pirouette_synthetic::{Clutter, SyntheticOptions};
use serde_json::{Value, json};

use crate::people::Person;
use crate::table::{Cell, Table, mean};
use crate::trial::GIRTHS;
use crate::{OnStep, Step, StudyError};

/// Seed of the first person; no other study uses it or the following ones
const FIRST_SEED: u64 = 9001;

/// Columns, rows, frames and bits per second of the videos
const SIZE_PX: (usize, usize) = (540, 960);
const FRAMES_PER_S: f64 = 30.0;
const BITS_PER_S: u32 = 4_000_000;

/// Options of the study
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VideosOptions {
    /// Number of people
    pub people: usize,
    /// Number of views taken from each video
    pub views: usize,
    /// Folder that receives the videos
    pub folder: PathBuf,
}

/// Results of the study
#[derive(Debug, Clone)]
pub struct VideosStudy {
    /// The table
    pub table: Table,
    /// Every video, as JSON
    pub videos: Value,
    /// The page, in Markdown
    pub page: String,
}

/// The courses of the turn, with their names
const COURSES: [(&str, TurnCourse); 4] = [
    (
        "one turn at an even speed",
        TurnCourse {
            enter_s: 0.0,
            start_radians: 0.0,
            turned_radians: TAU,
            turn_s: 14.0,
            still_s: 1.0,
            speed_change: 0.0,
            pause_s: 0.0,
        },
    ),
    (
        "clockwise, at a changing speed",
        TurnCourse {
            enter_s: 0.0,
            start_radians: 0.3,
            turned_radians: -TAU,
            turn_s: 12.0,
            still_s: 0.5,
            speed_change: 0.5,
            pause_s: 0.0,
        },
    ),
    (
        "comes in, with a pause of 3 s",
        TurnCourse {
            enter_s: 2.0,
            start_radians: 0.0,
            turned_radians: TAU,
            turn_s: 10.0,
            still_s: 0.5,
            speed_change: 0.3,
            pause_s: 3.0,
        },
    ),
    (
        "one turn and a half, fast",
        TurnCourse {
            enter_s: 0.0,
            start_radians: -0.5,
            turned_radians: 1.5 * TAU,
            turn_s: 10.0,
            still_s: 0.5,
            speed_change: 0.3,
            pause_s: 0.0,
        },
    ),
];

/// Result of one video
struct Found {
    course: usize,
    person: String,
    /// Errors of the angles, in degrees, without their common offset; or why there is no result
    errors: Result<Vec<f64>, String>,
    offset: f64,
    girths_pct: Vec<f64>,
}

/// Films random people, and scans the videos
///
/// The true angle of a frame is that of the swaying person's hips.
///
/// # Errors
/// When there are no people, or the study was cancelled.
pub fn study(
    options: &VideosOptions,
    model: &PoseModel,
    cancel: &CancelToken,
    on_step: &mut OnStep,
) -> Result<VideosStudy, StudyError> {
    let people: Vec<Person> = (FIRST_SEED..FIRST_SEED + options.people as u64)
        .filter_map(|seed| Person::new(seed).ok())
        .collect();
    if people.is_empty() {
        return Err(StudyError::Nothing);
    }
    let total = people.len() * COURSES.len();
    let mut found = Vec::new();
    for person in &people {
        for (course, (name, _)) in COURSES.iter().enumerate() {
            if cancel.cancelled() {
                return Err(StudyError::Cancelled);
            }
            let result = scan_video(person, course, options, model, cancel);
            let text = format!("{}, {name}: {}", result.person, describe(&result));
            found.push(result);
            on_step(Step {
                done: found.len(),
                total,
                text,
            });
        }
    }
    let table = table(&found);
    Ok(VideosStudy {
        page: page(options, &table),
        videos: found.iter().map(to_json).collect(),
        table,
    })
}

fn describe(found: &Found) -> String {
    match &found.errors {
        Ok(errors) => format!(
            "angles off by {:.2} degrees, {:.1} at most",
            mean_size(errors).unwrap_or(f64::NAN),
            worst(errors).unwrap_or(f64::NAN)
        ),
        Err(reason) => format!("failed: {reason}"),
    }
}

/// Films one person and scans the video
fn scan_video(
    person: &Person,
    course: usize,
    options: &VideosOptions,
    model: &PoseModel,
    cancel: &CancelToken,
) -> Found {
    let mut found = Found {
        course,
        person: person.describe(),
        errors: Err(String::new()),
        offset: 0.0,
        girths_pct: Vec::new(),
    };
    let file = options.folder.join(format!("{}-{course}.mp4", person.seed));
    found.errors = film(person, COURSES[course].1, &file, cancel)
        .and_then(|truth| scan_file(person, &file, &truth, options, model, cancel))
        .map(|(errors, offset, girths_pct)| {
            (found.offset, found.girths_pct) = (offset, girths_pct);
            errors
        });
    found
}

/// Writes a video and its manifest; returns the true angle of each frame, in radians
fn film(
    person: &Person,
    turn: TurnCourse,
    file: &Path,
    cancel: &CancelToken,
) -> Result<Vec<f64>, String> {
    let stature_mm = person.avatar.stature_mm();
    let camera = SyntheticOptions::camera_for(stature_mm, SIZE_PX.0, SIZE_PX.1);
    let options = VideoOptions {
        seed: person.seed,
        camera,
        sway: 1.0,
        sensor_noise: 2.0,
        clutter: Clutter::LivedIn,
        frames_per_s: FRAMES_PER_S,
        turn,
    };
    let manifest = json!({
        "subject": { "stature_mm": stature_mm },
        "camera": {
            "vertical_fov_deg": camera.vertical_fov_radians.to_degrees(),
            "height_mm": camera.height_mm,
        },
    });
    let text = manifest.to_string();
    write_atomic(&file.with_extension("json"), text.as_bytes()).map_err(|e| e.to_string())?;
    let writer = VideoWriter::create(file, SIZE_PX, FRAMES_PER_S, BITS_PER_S);
    let mut writer = writer.map_err(|e| e.to_string())?;
    let mut written = Ok(());
    let truth = render_video(&person.avatar, &options, &mut |_, photo| {
        written = writer.write(&photo);
        if written.is_err() || cancel.cancelled() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    });
    written.map_err(|e| e.to_string())?;
    writer.finish().map_err(|e| e.to_string())?;
    Ok(truth)
}

/// Scans a video; returns the errors of the angles, their common offset, in degrees, and those of the girths, in percent
fn scan_file(
    person: &Person,
    file: &Path,
    truth: &[f64],
    options: &VideosOptions,
    model: &PoseModel,
    cancel: &CancelToken,
) -> Result<(Vec<f64>, f64, Vec<f64>), String> {
    let video = VideoFile::find(file).ok_or("there is no video")?;
    let video_options = pirouette_files::video::VideoOptions {
        views: options.views,
    };
    let found = scan_of_video(&video, model, &video_options, cancel, &mut |_| {});
    let found = found.map_err(|e| e.to_string())?;
    let config = Config::new(Goal::Measure, Method::Fit);
    let job_options = JobOptions {
        pose_model: Some(model),
        ..JobOptions::default()
    };
    let done = run_job(found.source, &config, &job_options, cancel, &mut |_| {});
    let done = done.map_err(|e| e.to_string())?;
    let views = done.report.views.iter().filter_map(|found| {
        let view = &done.loaded.scan.views[found.id.0];
        let true_radians = truth.get((view.time_s? * FRAMES_PER_S).round() as usize)?;
        let error = found.turn_in_use(view).degrees() - true_radians.to_degrees();
        Some((error + 180.0).rem_euclid(360.0) - 180.0)
    });
    let errors: Vec<f64> = views.collect();
    let offset = mean(&errors).ok_or("there are no views")?;
    let measured = done
        .report
        .measurements
        .ok_or("there are no measurements")?;
    let true_mm = measure_avatar(&person.avatar);
    let girths = GIRTHS.iter().filter_map(|girth| {
        let (_, true_mm) = true_mm.iter().find(|(measure, _)| measure == girth)?;
        Some(100.0 * (measured.value_mm(*girth)? / true_mm - 1.0))
    });
    let girths_pct = girths.collect();
    let centered = errors.iter().map(|error| error - offset).collect();
    Ok((centered, offset, girths_pct))
}

fn mean_size(errors: &[f64]) -> Option<f64> {
    mean(&errors.iter().map(|error| error.abs()).collect::<Vec<_>>())
}

fn worst(errors: &[f64]) -> Option<f64> {
    errors.iter().map(|e| e.abs()).max_by(f64::total_cmp)
}

/// Errors by the course of the turn
fn table(found: &[Found]) -> Table {
    let names: Vec<String> = GIRTHS.iter().map(|girth| short(*girth)).collect();
    let mut columns = vec![
        "turn",
        "videos",
        "failed",
        "mean error °",
        "worst °",
        "offset °",
    ];
    columns.extend(names.iter().map(String::as_str));
    let mut table = Table::new("videos", &columns);
    let all = COURSES.iter().map(|(name, _)| *name).chain(["all"]);
    for (index, name) in all.enumerate() {
        let row = || {
            found
                .iter()
                .filter(move |f| f.course == index || index == COURSES.len())
        };
        let good: Vec<&Found> = row().filter(|f| f.errors.is_ok()).collect();
        let errors: Vec<f64> = good
            .iter()
            .flat_map(|f| f.errors.iter().flatten().copied())
            .collect();
        let offsets: Vec<f64> = good.iter().map(|f| f.offset).collect();
        let mut cells = vec![
            Cell::Text(name.to_owned()),
            Cell::Number(row().count() as f64, 0),
            Cell::Number((row().count() - good.len()) as f64, 0),
            Cell::number(mean_size(&errors), 2),
            Cell::number(worst(&errors), 1),
            Cell::number(worst(&offsets), 1),
        ];
        cells.extend((0..GIRTHS.len()).map(|girth| {
            let errors = good.iter().filter_map(|f| f.girths_pct.get(girth).copied());
            Cell::spread(&errors.collect::<Vec<f64>>())
        }));
        table.rows.push(cells);
    }
    table
}

/// Returns the name of a girth in the table
fn short(girth: Measure) -> String {
    format!("{} %", girth.name().trim_end_matches("_girth"))
}

fn to_json(found: &Found) -> Value {
    let rounded = |values: &[f64]| -> Vec<f64> {
        values.iter().map(|v| (v * 100.0).round() / 100.0).collect()
    };
    json!({
        "person": found.person,
        "turn": COURSES[found.course].0,
        "failed": found.errors.as_ref().err(),
        "angle_errors_deg": found.errors.as_ref().ok().map(|errors| rounded(errors)),
        "girths_pct": rounded(&found.girths_pct),
    })
}

fn page(options: &VideosOptions, table: &Table) -> String {
    let mut page = String::new();
    let people = match options.people {
        1 => "1 random person is".to_owned(),
        count => format!("{count} random people are"),
    };
    // Writing to a string cannot fail.
    let _ = write!(
        page,
        "# Videos\n\n\
         `pirouette eval videos` generates this page. {people} filmed ({} x {} px, {FRAMES_PER_S:.0} frames a second, H.264\n\
         at {} Mbit/s, motion blur, smooth sway), and {} views of each video are scanned with detected keypoints. The true angle of\n\
         a frame is that of the swaying person's hips; the common offset of the angles of a video is subtracted, and its largest\n\
         value listed. Girths are relative to those of the known body: mean and standard deviation.\n\n{}",
        SIZE_PX.0,
        SIZE_PX.1,
        BITS_PER_S / 1_000_000,
        options.views,
        table.to_markdown()
    );
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failed_videos_are_counted_and_do_not_spoil_the_errors() {
        let found = |course, errors| Found {
            course,
            person: "person 1".into(),
            errors,
            offset: -0.5,
            girths_pct: vec![1.0, 2.0, 3.0],
        };
        let all = [
            found(0, Ok(vec![1.0, -3.0])),
            found(0, Err("cut".into())),
            found(3, Ok(vec![0.5])),
        ];
        let table = table(&all).to_markdown();
        assert!(
            table.contains("| one turn at an even speed | 2 | 1 | 2.00 | 3.0 | 0.5 |"),
            "{table}"
        );
        assert!(
            table.contains("| all | 3 | 1 | 1.50 | 3.0 | 0.5 |"),
            "{table}"
        );
    }
}
