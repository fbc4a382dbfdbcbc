//! Accuracy of turn angles that are found in the photos, and their effect on the body.

use std::fmt::Write;

use pirouette::pipeline::{CancelToken, Config, Goal, Method, Report, run};
use pirouette::scan::Scan;
use pirouette::skeleton_fit::{KeypointView, SkeletonFitOptions, estimate_turns, fit_skeleton};
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::{Pose, TurnAngle};
use pirouette_synthetic::{Random, SyntheticScan, synthesize};
use serde_json::{Value, json};

use crate::people::{KEYPOINT_NOISE_PX, Person};
use crate::table::{Cell, Table, mean};
use crate::trial::{Score, score};
use crate::turn_errors::{TurnErrors, worst};
use crate::{OnStep, StudyError, do_all};

/// Largest deviation of a step of the turn from an even one, in degrees, on each side
const UNEVEN_DEGREES: f64 = 15.0;

/// Options of the study
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AnglesOptions {
    /// Number of people
    pub people: usize,
    /// Number of photos per person
    pub views: usize,
}

impl Default for AnglesOptions {
    fn default() -> Self {
        Self {
            people: 12,
            views: 8,
        }
    }
}

/// Results of the study
#[derive(Debug, Clone)]
pub struct AnglesStudy {
    /// Errors of the angles by the methods, and errors of the bodies
    pub tables: Vec<Table>,
    /// Every person, as JSON
    pub people: Value,
    /// The page, in Markdown
    pub page: String,
}

/// What finds the angles
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Finder {
    Keypoints,
    Skeleton,
    Body,
}

impl Finder {
    const ALL: [Finder; 3] = [Finder::Keypoints, Finder::Skeleton, Finder::Body];

    fn name(self) -> &'static str {
        match self {
            Finder::Keypoints => "keypoints of each photo",
            Finder::Skeleton => "+ skeleton fit",
            Finder::Body => "+ body fit",
        }
    }
}

/// Results of one person
struct Found {
    errors: [Option<TurnErrors>; Finder::ALL.len()],
    /// Scores of the body with unknown and with known angles
    scores: [Score; 2],
}

/// Scans photographed people at unknown, uneven angles in any order
///
/// Photos are rendered with sway and noisy keypoints. The true angle is that of the swaying person's hips.
///
/// # Errors
/// When there are no people or views, or the study was cancelled.
pub fn study(
    options: &AnglesOptions,
    cancel: &CancelToken,
    on_step: &mut OnStep,
) -> Result<AnglesStudy, StudyError> {
    if options.people == 0 || options.views == 0 {
        return Err(StudyError::Nothing);
    }
    let people: Vec<Person> = (FIRST_SEED..FIRST_SEED + options.people as u64)
        .filter_map(|seed| Person::new(seed).ok())
        .collect();
    let found = do_all(&people, cancel, on_step, |person| {
        let found = scan_person(person, options.views, cancel);
        let text = format!("{}: {}", person.describe(), found.scores[0].describe());
        (found, text)
    })?;
    Ok(write_study(options, &people, &found))
}

/// Seed of the first person; no other study uses it or the following ones
const FIRST_SEED: u64 = 8001;

/// Returns uneven turns in random order and direction
fn uneven_turns(views: usize, random: &mut Random) -> Vec<TurnAngle> {
    let (start, direction) = (
        random.between(0.0, 360.0),
        random.between(-1.0, 1.0).signum(),
    );
    let turn = |i: usize, off: f64| direction * (360.0 * i as f64 / views as f64 + off) + start;
    let mut keyed: Vec<(u64, f64)> = (0..views)
        .map(|i| {
            let off = random.between(-UNEVEN_DEGREES, UNEVEN_DEGREES);
            (random.bits(), turn(i, off))
        })
        .collect();
    keyed.sort_by_key(|(key, _)| *key);
    let turns = keyed
        .into_iter()
        .map(|(_, degrees)| TurnAngle::from_degrees(degrees).wrapped());
    turns.collect()
}

/// Returns the scan without its angles
fn without_angles(scan: &Scan) -> Scan {
    let mut unknown = scan.clone();
    for view in &mut unknown.views {
        (view.turn, view.turn_sd_radians) = (TurnAngle::default(), f64::INFINITY);
    }
    unknown
}

fn scan_person(person: &Person, views: usize, cancel: &CancelToken) -> Found {
    let mut options = person.options(views, 1.0, true);
    options.turns = uneven_turns(views, &mut Random::new(person.seed));
    options.turn_noise_radians = 0.0;
    let SyntheticScan { scan, truth } = synthesize(&person.avatar, &options);
    let sum = |turn: TurnAngle, pose: &Pose| {
        TurnAngle::from_radians(turn.radians() + pose.turned_more().radians())
    };
    let true_turns: Vec<TurnAngle> = scan
        .views
        .iter()
        .zip(&truth.poses)
        .map(|(view, pose)| sum(view.turn, pose))
        .collect();
    let unknown = without_angles(&scan);
    let keypoint_views: Vec<KeypointView> = unknown.views.iter().map(KeypointView::from).collect();
    let of_stature = MannequinParameters {
        stature_mm: scan.stature_mm,
        pose: scan.pose,
        ..MannequinParameters::default()
    };
    let reference = mannequin(&of_stature).ok();
    let by_keypoints = reference.as_ref().and_then(|reference| {
        let turns = estimate_turns(reference, &keypoint_views).into_iter();
        turns
            .map(|turn| Some((turn?, None)))
            .collect::<Option<Vec<_>>>()
    });
    let by_skeleton = reference.as_ref().and_then(|reference| {
        let options = SkeletonFitOptions::default();
        let (camera, stature_mm) = (&unknown.camera, unknown.stature_mm);
        let found = fit_skeleton(reference, &keypoint_views, camera, stature_mm, &options);
        let (_, views) = found.ok()?;
        Some(
            views
                .iter()
                .map(|view| (sum(view.turn, &view.pose), Some(view.turn_sd_radians)))
                .collect(),
        )
    });
    let config = Config::new(Goal::Measure, Method::Fit);
    let scan_as = |scan: &Scan| run(scan, &config, cancel, &mut |_| {});
    let rate = |report: &Result<Report, _>| match report {
        Ok(report) => score(person, &truth, report),
        Err(_) => Score::default(),
    };
    let (found, known) = (scan_as(&unknown), scan_as(&scan));
    let by_body = found.as_ref().ok().and_then(|report| {
        let all = report.views.len() == scan.views.len();
        let turn = |view: &pirouette::view::SolvedView| {
            let (skeleton, fit) = (view.skeleton?, view.fit?);
            Some((
                sum(skeleton.turn, &fit.pose),
                Some(skeleton.turn_sd_radians),
            ))
        };
        report
            .views
            .iter()
            .map(turn)
            .collect::<Option<Vec<_>>>()
            .filter(|_| all)
    });
    let errors = [by_keypoints, by_skeleton, by_body];
    Found {
        errors: errors.map(|turns: Option<Vec<_>>| Some(TurnErrors::new(&turns?, &true_turns))),
        scores: [rate(&found), rate(&known)],
    }
}

fn write_study(options: &AnglesOptions, people: &[Person], found: &[Found]) -> AnglesStudy {
    let tables = vec![angle_table(found), body_table(found)];
    let round = |errors: &[f64]| -> Vec<f64> {
        errors
            .iter()
            .map(|error| (error * 100.0).round() / 100.0)
            .collect()
    };
    let people = people.iter().zip(found).map(|(person, found)| {
        let mut value = json!({ "seed": person.seed });
        for (finder, errors) in Finder::ALL.iter().zip(&found.errors) {
            value[finder.name()] = json!(errors.as_ref().map(|errors| round(&errors.degrees)));
        }
        for (name, score) in ["unknown", "known"].into_iter().zip(&found.scores) {
            value[name] = json!({ "surface_mm": score.mean_mm });
        }
        value
    });
    AnglesStudy {
        people: people.collect(),
        page: page(options, &tables),
        tables,
    }
}

/// Errors of the angles by the method
fn angle_table(found: &[Found]) -> Table {
    let mut table = Table::new(
        "turn angles",
        &[
            "found by",
            "failed",
            "mean error °",
            "worst °",
            "error / SD",
            "mean per 10°",
            "worst per 10°",
        ],
    );
    for (index, finder) in Finder::ALL.iter().enumerate() {
        let row: Vec<&TurnErrors> = found
            .iter()
            .filter_map(|f| f.errors[index].as_ref())
            .collect();
        let mut cells = vec![
            Cell::Text(finder.name().to_owned()),
            Cell::Number((found.len() - row.len()) as f64, 0),
        ];
        cells.extend(TurnErrors::cells(&row));
        table.rows.push(cells);
    }
    table
}

/// Errors of the body with unknown and with known angles
fn body_table(found: &[Found]) -> Table {
    let mut table = Table::new(
        "bodies",
        &[
            "angles",
            "failed",
            "surface mm",
            "worst mm",
            "bust %",
            "waist %",
            "hip %",
        ],
    );
    for (index, name) in ["unknown", "stated, true but for sway"]
        .into_iter()
        .enumerate()
    {
        let row: Vec<&Score> = found.iter().map(|found| &found.scores[index]).collect();
        let means: Vec<f64> = row.iter().filter_map(|score| score.mean_mm).collect();
        let girth = |girth: usize| {
            let errors = row.iter().filter_map(|score| score.girths_pct[girth]);
            Cell::spread(&errors.collect::<Vec<f64>>())
        };
        table.rows.push(vec![
            Cell::Text(name.to_owned()),
            Cell::Number((row.len() - means.len()) as f64, 0),
            Cell::number(mean(&means), 2),
            Cell::number(worst(&means), 2),
            girth(0),
            girth(1),
            girth(2),
        ]);
    }
    table
}

fn page(options: &AnglesOptions, tables: &[Table]) -> String {
    let mut page = String::new();
    let _ = write!(
        page,
        "# Unknown turn angles\n\n\
         `pirouette eval angles` generates this page. {} random people turn in front of the camera, in {} photos of 800 x\n\
         1000 px at uneven angles (steps vary by up to {:.0} degrees), which neither start at the front nor are in order. They\n\
         sway, keypoints have an error of {KEYPOINT_NOISE_PX:.0} px at a stature of 800 px, and no angle is stated. The true angle is that of the\n\
         swaying person's hips; the common offset of all angles of a scan is subtracted.\n",
        options.people,
        options.views,
        2.0 * UNEVEN_DEGREES,
    );
    let explained = [
        "`error / SD` is the root mean square of the errors relative to the standard deviations in `result.json`, 1 if these are\n\
         right. The last columns are the errors of the turn from one photo to the next, per 10 degrees of turn. Baumgartner\n\
         et al. (2020) publish 0.1 to 2.0 degrees per 10 degrees, for videos of real people (skeleton, optical flow on the\n\
         trunk, and an elliptical body).\n",
        "The same photos scanned with and without their angles. Errors of the surface are mean distances, as in\n\
         `pirouette eval bodies`.\n",
    ];
    for (table, text) in tables.iter().zip(explained) {
        let _ = write!(page, "\n{}\n{text}", table.to_section());
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_uneven_and_all_around() {
        let turns = uneven_turns(8, &mut Random::new(3));
        let mut sorted: Vec<f64> = turns.iter().map(|turn| turn.degrees()).collect();
        assert!(sorted.windows(2).any(|pair| pair[1] < pair[0]));
        sorted.sort_by(f64::total_cmp);
        let steps: Vec<f64> = sorted.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(
            steps.iter().all(|step| (15.0..=75.0).contains(step)),
            "{steps:?}"
        );
        assert!(steps.iter().any(|step| (step - 45.0).abs() > 5.0));
    }
}
