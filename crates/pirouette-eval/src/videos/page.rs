//! Tables and page of the study.

use std::fmt::Write;

use serde_json::{Value, json};

use super::{COURSES, FRAMES_PER_S, Finder, Found, SIZE_PX, Scanned, USUAL, VIEW_COUNTS};
use crate::film::BITS_PER_S;
use crate::table::{Cell, Table, mean};
use crate::trial::{GIRTHS, Score};
use crate::turn_errors::{TurnErrors, mean_size, worst};

pub(super) fn describe(found: &Found) -> String {
    match &found.scans[USUAL] {
        Ok(Scanned { errors, score }) => format!(
            "angles off by {:.2} degrees, {:.1} at most; {}",
            mean_size(&errors.degrees).unwrap_or(f64::NAN),
            worst(&errors.degrees).unwrap_or(f64::NAN),
            score.describe()
        ),
        Err(reason) => format!("failed: {reason}"),
    }
}

pub(super) fn tables(found: &[Found]) -> Vec<Table> {
    vec![
        by_course(found),
        by_finder(found),
        by_angles(found),
        by_view_count(found),
    ]
}

/// Errors by the course of the turn
fn by_course(found: &[Found]) -> Table {
    let columns = [
        "turn",
        "videos",
        "failed",
        "mean error °",
        "worst °",
        "offset °",
    ];
    let mut table = Table::new("turn angles by the course of the turn", &columns);
    let all = COURSES.iter().map(|(name, _)| *name).chain(["all"]);
    for (index, name) in all.enumerate() {
        let row: Vec<&Found> = found
            .iter()
            .filter(|f| f.course == index || index == COURSES.len())
            .collect();
        let scans = row.iter().filter_map(|f| f.scans[USUAL].as_ref().ok());
        let good: Vec<&TurnErrors> = scans.map(|scanned| &scanned.errors).collect();
        let errors: Vec<f64> = good
            .iter()
            .flat_map(|e| e.degrees.iter().copied())
            .collect();
        let offsets: Vec<f64> = good.iter().map(|e| e.offset_degrees).collect();
        table.rows.push(vec![
            Cell::Text(name.to_owned()),
            Cell::Number(row.len() as f64, 0),
            Cell::Number((row.len() - good.len()) as f64, 0),
            Cell::number(mean_size(&errors), 2),
            Cell::number(worst(&errors), 1),
            Cell::number(worst(&offsets), 1),
        ]);
    }
    table
}

/// Errors by what finds the angles
fn by_finder(found: &[Found]) -> Table {
    let columns = [
        "found by",
        "mean error °",
        "worst °",
        "error / SD",
        "mean per 10°",
        "worst per 10°",
    ];
    let mut table = Table::new("turn angles by what finds them", &columns);
    for (index, finder) in Finder::ALL.iter().enumerate() {
        let row = found.iter().filter_map(|f| f.finders[index].as_ref());
        let mut cells = vec![Cell::Text(finder.name().to_owned())];
        cells.extend(TurnErrors::cells(&row.collect::<Vec<_>>()));
        table.rows.push(cells);
    }
    table
}

fn body_columns() -> Vec<String> {
    let girths = GIRTHS
        .iter()
        .map(|girth| format!("{} %", girth.name().trim_end_matches("_girth")));
    ["surface mm", "worst mm"]
        .map(str::to_owned)
        .into_iter()
        .chain(girths)
        .collect()
}

/// Returns mean and worst distance of surfaces, and the errors of the girths
fn body_cells(scores: &[&Score]) -> Vec<Cell> {
    let means: Vec<f64> = scores.iter().filter_map(|score| score.mean_mm).collect();
    let mut cells = vec![
        Cell::number(mean(&means), 2),
        Cell::number(worst(&means), 2),
    ];
    cells.extend((0..GIRTHS.len()).map(|girth| {
        let errors = scores.iter().filter_map(|score| score.girths_pct[girth]);
        Cell::spread(&errors.collect::<Vec<f64>>())
    }));
    cells
}

fn body_table(title: &str, first: &[&str]) -> Table {
    let columns = body_columns();
    let columns: Vec<&str> = first
        .iter()
        .copied()
        .chain(columns.iter().map(String::as_str))
        .collect();
    Table::new(title, &columns)
}

/// Bodies with found and with true angles
fn by_angles(found: &[Found]) -> Table {
    let mut table = body_table("bodies with found and with true angles", &["angles"]);
    let usual = || {
        found
            .iter()
            .map(|f| f.scans[USUAL].as_ref().ok().map(|s| &s.score))
    };
    let known = || found.iter().map(|f| f.with_true_angles.as_ref());
    // The same videos in both rows
    let both: Vec<(&Score, &Score)> = usual()
        .zip(known())
        .filter_map(|(a, b)| Some((a?, b?)))
        .collect();
    let (usual, known): (Vec<&Score>, Vec<&Score>) = both.into_iter().unzip();
    for (name, scores) in [("found", usual), ("true", known)] {
        let mut cells = vec![Cell::Text(name.to_owned())];
        cells.extend(body_cells(&scores));
        table.rows.push(cells);
    }
    table
}

/// Angles and bodies by the number of views
fn by_view_count(found: &[Found]) -> Table {
    let first = ["views", "failed", "mean error °", "worst °"];
    let mut table = body_table("number of views", &first);
    for (index, views) in VIEW_COUNTS.iter().enumerate() {
        let good: Vec<&Scanned> = found
            .iter()
            .filter_map(|f| f.scans[index].as_ref().ok())
            .collect();
        let errors: Vec<f64> = good
            .iter()
            .flat_map(|s| s.errors.degrees.iter().copied())
            .collect();
        let mut cells = vec![
            Cell::Number(*views as f64, 0),
            Cell::Number((found.len() - good.len()) as f64, 0),
            Cell::number(mean_size(&errors), 2),
            Cell::number(worst(&errors), 1),
        ];
        let scores: Vec<&Score> = good.iter().map(|scanned| &scanned.score).collect();
        cells.extend(body_cells(&scores));
        table.rows.push(cells);
    }
    table
}

pub(super) fn to_json(found: &Found) -> Value {
    let rounded = |value: f64| (value * 100.0).round() / 100.0;
    let all = |values: &[f64]| -> Vec<f64> { values.iter().map(|v| rounded(*v)).collect() };
    let body = |score: &Score| {
        json!({
            "surface_mm": score.mean_mm.map(rounded),
            "girths_pct": score.girths_pct.map(|pct| pct.map(rounded)),
        })
    };
    let scans: Vec<Value> = VIEW_COUNTS
        .iter()
        .zip(&found.scans)
        .map(|(views, scanned)| match scanned {
            Ok(Scanned { errors, score }) => json!({
                "views": views,
                "angle_errors_deg": all(&errors.degrees),
                "body": body(score),
            }),
            Err(reason) => json!({ "views": views, "failed": reason }),
        })
        .collect();
    let finders: Value = Finder::ALL
        .iter()
        .zip(&found.finders)
        .map(|(finder, errors)| {
            let errors = errors.as_ref().map(|errors| all(&errors.degrees));
            (finder.name().to_owned(), json!(errors))
        })
        .collect();
    json!({
        "person": found.person,
        "turn": COURSES[found.course].0,
        "scans": scans,
        "angle_errors_deg_by": finders,
        "with_true_angles": found.with_true_angles.as_ref().map(body),
    })
}

pub(super) fn page(people: usize, tables: &[Table]) -> String {
    let mut page = String::new();
    let people = match people {
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
         value listed. Girths are relative to those of the known body: mean and standard deviation.\n",
        SIZE_PX.0,
        SIZE_PX.1,
        BITS_PER_S / 1_000_000,
        VIEW_COUNTS[USUAL],
    );
    let explained = [
        "",
        "\nErrors of the same frames. The last columns are the errors of the turn from one frame to the next, per 10 degrees of\n\
         turn. Baumgartner et al. (2020) publish 0.1 to 2.0 degrees per 10 degrees, for videos of real people, with keypoints,\n\
         optical flow at the spine and an elliptical body. The rows with flow reproduce that: between the frames in which the\n\
         person is detected, 10 a second, the turn follows from the motion of the clothes in front of the turning axis and the\n\
         half-axes of the trunk, which are fitted to the keypoints. Rendered clothes have little texture, and shading does not\n\
         turn with the body: flow is not part of the method.\n",
        "\nThe same frames and keypoints, with the angles that were found and with the true ones.\n",
        "\nThe same videos with fewer and with more views.\n",
    ];
    for (table, text) in tables.iter().zip(explained) {
        let _ = write!(page, "\n{}{text}", table.to_section());
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failed_videos_are_counted_and_do_not_spoil_the_errors() {
        let found = |course, errors: Option<&[f64]>| Found {
            course,
            person: "person 1".into(),
            scans: VIEW_COUNTS.map(|_| match errors {
                Some(degrees) => Ok(Scanned {
                    errors: TurnErrors {
                        degrees: degrees.to_vec(),
                        offset_degrees: -0.5,
                        ..TurnErrors::default()
                    },
                    score: Score {
                        mean_mm: Some(3.0),
                        girths_pct: [Some(1.0), None, Some(-2.0)],
                        ..Score::default()
                    },
                }),
                None => Err("cut".into()),
            }),
            finders: Default::default(),
            with_true_angles: None,
        };
        let all = [
            found(0, Some(&[1.0, -3.0])),
            found(0, None),
            found(3, Some(&[0.5])),
        ];
        let table = by_course(&all).to_markdown();
        assert!(
            table.contains("| one turn at an even speed | 2 | 1 | 2.00 | 3.0 | 0.5 |"),
            "{table}"
        );
        assert!(
            table.contains("| all | 3 | 1 | 1.50 | 3.0 | 0.5 |"),
            "{table}"
        );
        let table = by_view_count(&all).to_markdown();
        assert!(
            table.contains("| 16 | 1 | 1.50 | 3.0 | 3.00 | 3.00 |"),
            "{table}"
        );
        // Without the true angles there is nothing to compare.
        let table = by_angles(&all).to_markdown();
        assert!(table.contains("| found | - | - |"), "{table}");
    }
}
