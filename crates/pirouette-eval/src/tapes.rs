//! Tape measures of random people: errors by number of views, and the calibration of the standard deviations.

mod measures;
mod page;
mod views;

use std::fmt::Write;

use pirouette::measure::{Estimate, Measure, measure_avatar};
use pirouette::pipeline::{CancelToken, Config, Goal, Method, run};
use pirouette_synthetic::Random;
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::people::Person;
use crate::table::{Cell, Spread, Table, mean, percentile};
use crate::{OnStep, StudyError, do_all};
use measures::{measures_page, measures_picture};
use page::{errors_svg, page};
use views::{recommendation, trunk_table, views_svg, views_table};

/// Standard deviation of the statures that people state, in mm
pub(crate) const STATED_STATURE_SD_MM: f64 = 5.0;

/// First seed of the people; smaller ones were used during development
const FIRST_SEED: u64 = 2001;

/// Options of the study
#[derive(Debug, Clone, PartialEq)]
pub struct TapesOptions {
    /// Number of people with exact silhouettes, at [`USUAL_VIEWS`]
    pub people: usize,
    /// Number of these people for whom numbers of views are compared
    pub view_people: usize,
    /// Number of people who are photographed and segmented, at [`USUAL_VIEWS`]
    pub photo_people: usize,
    /// Number of people who are scanned again with other sway and other stated statures, at [`USUAL_VIEWS`]
    pub repeated: usize,
    /// Numbers of views
    pub views: Vec<usize>,
    /// Seed of the first person
    pub first_seed: u64,
}

/// Number of views of photographed and repeated people
pub const USUAL_VIEWS: usize = 8;

impl Default for TapesOptions {
    fn default() -> Self {
        Self {
            people: 60,
            view_people: 30,
            photo_people: 60,
            repeated: 20,
            views: vec![7, 8, 9, 12, 16, 36],
            first_seed: FIRST_SEED,
        }
    }
}

impl TapesOptions {
    /// Returns options for a quick run with few people
    pub fn quick() -> Self {
        Self {
            people: 4,
            view_people: 4,
            photo_people: 2,
            repeated: 2,
            views: vec![8, 9],
            first_seed: FIRST_SEED,
        }
    }
}

/// Conditions of a scan
#[derive(Debug, Clone, Copy, PartialEq)]
struct Condition {
    views: usize,
    photos: bool,
    /// 0 for the first scan, other numbers for other sway and noise
    again: u64,
}

/// Result of one measure of one person
#[derive(Debug, Clone, Copy)]
struct Found {
    true_mm: f64,
    value_mm: f64,
    sd_mm: f64,
    lines: Option<Estimate>,
    body: Option<Estimate>,
}

impl Found {
    fn error_mm(&self) -> f64 {
        self.value_mm - self.true_mm
    }
}

/// One person in one condition
struct Scanned<'a> {
    person: &'a Person,
    condition: Condition,
    /// Results in the order of [`Measure::ALL`]
    found: Vec<Option<Found>>,
    error: Option<String>,
}

/// Results of the study
#[derive(Debug, Clone)]
pub struct TapesStudy {
    /// The tables, in the order of the page
    pub tables: Vec<Table>,
    /// Every person of every condition, as JSON
    pub people: Value,
    /// The page, in Markdown
    pub page: String,
    /// The page of all measures with their definitions and accuracies, in Markdown
    pub measures_page: String,
    /// Its picture: a mannequin with all tapes, as JPEG
    pub measures_picture: Vec<u8>,
    /// Errors of girths from photos, as an SVG picture
    pub errors_svg: String,
    /// Errors by number of views, as an SVG picture
    pub views_svg: String,
}

/// Measures random people in all conditions
///
/// The true values are those of the same tape on the known body. Stated statures are off by a few mm, as in practice.
///
/// # Errors
/// When there are no people or views, or the study was cancelled.
pub fn study(
    options: &TapesOptions,
    cancel: &CancelToken,
    on_step: &mut OnStep,
) -> Result<TapesStudy, StudyError> {
    let most = options.people.max(options.photo_people);
    let people: Vec<Person> = (0..most.max(options.repeated) as u64)
        .into_par_iter()
        .filter_map(|index| Person::new(options.first_seed + index).ok())
        .collect();
    let mut jobs: Vec<(Condition, &Person)> = Vec::new();
    let mut add = |count: usize, condition: Condition| {
        jobs.extend(people.iter().take(count).map(|person| (condition, person)));
    };
    let usual = |photos, again| Condition {
        views: USUAL_VIEWS,
        photos,
        again,
    };
    for &views in &options.views {
        let condition = Condition {
            views,
            ..usual(false, 0)
        };
        let count = match views {
            USUAL_VIEWS => options.people,
            _ => options.view_people,
        };
        add(count, condition);
    }
    add(options.photo_people, usual(true, 0));
    add(options.repeated, usual(true, 1));
    if jobs.is_empty() {
        return Err(StudyError::Nothing);
    }
    let config = Config::new(Goal::Measure, Method::Fit);
    let scanned = do_all(&jobs, cancel, on_step, |&(condition, person)| {
        let scanned = scan(person, condition, &config, cancel);
        let text = format!(
            "{} views{}, {}{}",
            condition.views,
            if condition.photos { ", photos" } else { "" },
            person.describe(),
            scanned
                .error
                .as_ref()
                .map_or(String::new(), |e| format!(": {e}")),
        );
        (scanned, text)
    })?;
    Ok(write_study(options, &scanned))
}

fn scan<'a>(
    person: &'a Person,
    condition: Condition,
    config: &Config,
    cancel: &CancelToken,
) -> Scanned<'a> {
    let seed = person.seed ^ (condition.again << 32);
    let again = Person {
        seed,
        ..person.clone()
    };
    let mut synthetic = again.photograph(condition.views, 1.0, condition.photos);
    let stature_mm = person.avatar.stature_mm();
    let stated_mm = stature_mm + STATED_STATURE_SD_MM * Random::new(seed ^ 0x57a7).normal();
    synthetic.scan.stature_mm = Some(stated_mm);
    let mut scanned = Scanned {
        person,
        condition,
        found: vec![None; Measure::ALL.len()],
        error: None,
    };
    match run(&synthetic.scan, config, cancel, &mut |_| {}) {
        Err(error) => scanned.error = Some(error.to_string()),
        Ok(report) => {
            let truth = measure_avatar(&person.avatar);
            for (slot, &measure) in scanned.found.iter_mut().zip(&Measure::ALL) {
                let measured = report.measurements.as_ref().map(|m| m.get(measure));
                let true_mm = truth.iter().find(|(m, _)| *m == measure).map(|t| t.1);
                *slot = measured.zip(true_mm).and_then(|(measured, true_mm)| {
                    Some(Found {
                        true_mm,
                        value_mm: measured.value_mm.ok()?,
                        sd_mm: measured.sd_mm?,
                        lines: measured.lines,
                        body: measured.body,
                    })
                });
            }
        }
    }
    scanned
}

/// Returns errors for comparison, in mm: the mean error that ISO 20685-1 allows, the mean absolute error of the best
/// published photo method (two silhouettes, height and weight), and that of regressions on height and weight (ANSUR II,
/// mean of men and women)
fn others(measure: Measure) -> [Option<f64>; 3] {
    match measure {
        Measure::BustGirth => [Some(9.0), Some(16.0), Some(30.0)],
        Measure::WaistGirth => [Some(9.0), Some(15.0), Some(36.5)],
        Measure::HipGirth => [Some(9.0), Some(10.0), Some(21.5)],
        Measure::ThighGirth => [Some(9.0), None, Some(17.5)],
        Measure::NeckGirth => [Some(4.0), None, Some(11.0)],
        Measure::UpperArmGirth => [Some(4.0), None, Some(13.5)],
        Measure::CalfGirth => [Some(4.0), None, Some(13.0)],
        Measure::CrotchHeight => [Some(4.0), Some(14.0), Some(18.5)],
        Measure::ArmLength => [Some(5.0), None, Some(15.0)],
        Measure::ShoulderWidth => [Some(4.0), None, Some(11.5)],
        Measure::Stature
        | Measure::BustHeight
        | Measure::WaistHeight
        | Measure::HipHeight
        | Measure::KneeGirth
        | Measure::AnkleGirth
        | Measure::WristGirth
        | Measure::LowerKneeGirth
        | Measure::ElbowGirth
        | Measure::ForearmGirth
        | Measure::NapeHeight
        | Measure::ShoulderHeight
        | Measure::UnderbustHeight
        | Measure::NarrowestWaistHeight
        | Measure::KneeHeight => [Some(4.0), None, None],
        Measure::BackLength
        | Measure::NapeToWaist
        | Measure::ShoulderToWrist
        | Measure::ShoulderLength
        | Measure::UpperArmLength
        | Measure::NapeToWrist
        | Measure::AcrossBack
        | Measure::AcrossFront
        | Measure::BustSpan
        | Measure::SideNeckToBust
        | Measure::FrontLength
        | Measure::WaistToHip
        | Measure::BodyRise
        | Measure::WaistToKnee => [Some(5.0), None, None],
        Measure::UnderbustGirth
        | Measure::OverbustGirth
        | Measure::NarrowestWaistGirth
        | Measure::HighHipGirth
        | Measure::MidThighGirth => [Some(9.0), None, None],
        Measure::FootLength | Measure::HeadGirth => [Some(2.0), None, None],
        Measure::Rise | Measure::FrontRise | Measure::BackRise => [None; 3],
    }
}

/// Returns the results of one measure for all people of one condition
fn found_of<'a>(
    scanned: &'a [Scanned],
    condition: Condition,
    measure: Measure,
) -> impl Iterator<Item = Found> + 'a {
    let place = Measure::ALL.iter().position(|&m| m == measure);
    scanned
        .iter()
        .filter(move |s| s.condition == condition)
        .filter_map(move |s| s.found[place?])
}

fn errors(scanned: &[Scanned], condition: Condition, measure: Measure) -> Vec<f64> {
    found_of(scanned, condition, measure)
        .map(|f| f.error_mm())
        .collect()
}

/// Returns the standard deviation of a scan from the mean of two scans of the same person, over people
fn repeatability(scanned: &[Scanned], measure: Measure) -> Option<f64> {
    let place = Measure::ALL.iter().position(|&m| m == measure)?;
    let value = |again: u64, seed: u64| {
        let usual = Condition {
            views: USUAL_VIEWS,
            photos: true,
            again,
        };
        let of = scanned
            .iter()
            .find(|s| s.condition == usual && s.person.seed == seed)?;
        Some(of.found[place]?.value_mm)
    };
    let differences: Vec<f64> = scanned
        .iter()
        .filter(|s| s.condition.again == 1)
        .filter_map(|s| Some(value(1, s.person.seed)? - value(0, s.person.seed)?))
        .collect();
    Some((mean(&differences.iter().map(|d| d * d).collect::<Vec<_>>())? / 2.0).sqrt())
}

fn write_study(options: &TapesOptions, scanned: &[Scanned]) -> TapesStudy {
    let photos = Condition {
        views: USUAL_VIEWS,
        photos: true,
        again: 0,
    };
    let masks = Condition {
        photos: false,
        ..photos
    };
    let tables = vec![
        errors_table("from photos, 8 views", scanned, photos),
        errors_table("from exact silhouettes, 8 views", scanned, masks),
        estimates_table(scanned, photos),
        views_table(options, scanned),
        trunk_table(options, scanned),
    ];
    let mut study = TapesStudy {
        people: scanned.iter().map(person_value).collect(),
        errors_svg: errors_svg(scanned, photos),
        views_svg: views_svg(options, scanned),
        page: String::new(),
        measures_page: measures_page(scanned, photos),
        measures_picture: measures_picture(),
        tables,
    };
    study.page = page(options, scanned, &study.tables);
    study
}

fn errors_table(title: &str, scanned: &[Scanned], condition: Condition) -> Table {
    let mut table = Table::new(
        title,
        &[
            "measure",
            "people",
            "bias",
            "SD",
            "MAE",
            "P90",
            "repeat",
            "within 1 sd",
            "ISO mean",
            "photo method",
            "regression",
        ],
    );
    for measure in Measure::ALL {
        let found: Vec<Found> = found_of(scanned, condition, measure).collect();
        let errors: Vec<f64> = found.iter().map(Found::error_mm).collect();
        let absolute: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
        let spread = Spread::of(&errors);
        let inside = found.iter().filter(|f| f.error_mm().abs() <= f.sd_mm);
        let share = 100.0 * inside.count() as f64 / found.len().max(1) as f64;
        let repeat = condition.photos.then(|| repeatability(scanned, measure));
        let mut row = vec![
            Cell::Text(measure.name().replace('_', " ")),
            Cell::Number(found.len() as f64, 0),
            Cell::number(spread.map(|s| s.mean), 1),
            Cell::number(spread.map(|s| s.sd), 1),
            Cell::number(mean(&absolute), 1),
            Cell::number(percentile(&absolute, 0.9), 1),
            Cell::number(repeat.flatten(), 1),
            Cell::number((!found.is_empty()).then_some(share), 0),
        ];
        row.extend(others(measure).map(|v| Cell::number(v, 1)));
        table.rows.push(row);
    }
    table
}

/// Compares both estimates of each girth: errors in percent, and the share within the standard deviations
fn estimates_table(scanned: &[Scanned], condition: Condition) -> Table {
    let mut table = Table::new(
        "both estimates of each girth, errors in percent of the girth",
        &[
            "measure",
            "lines",
            "within 1 sd",
            "body",
            "body within 1 sd",
            "correlation",
        ],
    );
    for measure in Measure::ALL {
        if measure.girths().is_empty() {
            continue;
        }
        let found: Vec<Found> = found_of(scanned, condition, measure).collect();
        let pct = |which: fn(&Found) -> Option<Estimate>| -> Vec<f64> {
            let some = found.iter().filter_map(|f| Some((which(f)?, f.true_mm)));
            some.map(|(e, true_mm)| 100.0 * (e.value_mm / true_mm - 1.0))
                .collect()
        };
        let share = |which: fn(&Found) -> Option<Estimate>| {
            let some: Vec<bool> = found
                .iter()
                .filter_map(|f| Some((which(f)?.value_mm - f.true_mm).abs() <= which(f)?.sd_mm))
                .collect();
            let inside = some.iter().filter(|&&i| i).count() as f64;
            (!some.is_empty()).then(|| 100.0 * inside / some.len() as f64)
        };
        let both: Vec<(f64, f64)> = found
            .iter()
            .filter_map(|f| Some((f.lines?.value_mm - f.true_mm, f.body?.value_mm - f.true_mm)))
            .collect();
        table.rows.push(vec![
            Cell::Text(measure.name().replace('_', " ")),
            Cell::spread(&pct(|f| f.lines)),
            Cell::number(share(|f| f.lines), 0),
            Cell::spread(&pct(|f| f.body)),
            Cell::number(share(|f| f.body), 0),
            Cell::number(correlation(&both), 2),
        ]);
    }
    table
}

fn correlation(pairs: &[(f64, f64)]) -> Option<f64> {
    let a = Spread::of(&pairs.iter().map(|p| p.0).collect::<Vec<_>>())?;
    let b = Spread::of(&pairs.iter().map(|p| p.1).collect::<Vec<_>>())?;
    let products: Vec<f64> = pairs
        .iter()
        .map(|(x, y)| (x - a.mean) * (y - b.mean))
        .collect();
    Some(mean(&products)? / (a.sd * b.sd)).filter(|c| c.is_finite())
}

fn person_value(scanned: &Scanned) -> Value {
    let rounded = |value: f64| (value * 100.0).round() / 100.0;
    let mut value = json!({
        "seed": scanned.person.seed,
        "sex": scanned.person.sex.name(),
        "stature_mm": rounded(scanned.person.avatar.stature_mm()),
        "bmi": rounded(scanned.person.bmi),
        "views": scanned.condition.views,
        "photos": scanned.condition.photos,
        "again": scanned.condition.again,
        "error": scanned.error,
    });
    for (measure, found) in Measure::ALL.iter().zip(&scanned.found) {
        value["measures"][measure.name()] = json!(found.map(|f| {
            let estimate = |e: Option<Estimate>| e.map(|e| [rounded(e.value_mm), rounded(e.sd_mm)]);
            json!({
                "true_mm": rounded(f.true_mm),
                "value_mm": rounded(f.value_mm),
                "sd_mm": rounded(f.sd_mm),
                "lines": estimate(f.lines),
                "body": estimate(f.body),
            })
        }));
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_people_give_no_table() {
        let options = TapesOptions {
            people: 0,
            view_people: 0,
            photo_people: 0,
            repeated: 0,
            views: vec![8],
            first_seed: FIRST_SEED,
        };
        let found = study(&options, &CancelToken::default(), &mut |_| {});
        assert_eq!(found.unwrap_err(), StudyError::Nothing);
    }

    #[test]
    fn errors_that_vary_together_are_correlated() {
        let together: Vec<(f64, f64)> =
            (0..9).map(|i| (f64::from(i), 2.0 * f64::from(i))).collect();
        assert!((correlation(&together).unwrap() - 1.0).abs() < 1e-9);
        let apart: Vec<(f64, f64)> = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].to_vec();
        assert!(correlation(&apart).unwrap().abs() < 1e-9);
        assert_eq!(correlation(&[]), None);
    }

    #[test]
    fn one_person_in_few_views_fills_tables_page_and_pictures() {
        let options = TapesOptions {
            people: 1,
            view_people: 1,
            photo_people: 0,
            repeated: 0,
            views: vec![4],
            first_seed: FIRST_SEED,
        };
        let study = study(&options, &CancelToken::default(), &mut |_| {}).unwrap();
        let waist = &study.people[0]["measures"]["waist_girth"];
        let error = waist["value_mm"].as_f64().unwrap() - waist["true_mm"].as_f64().unwrap();
        assert!(error.abs() < 80.0, "{waist}");
        assert!(study.page.contains("| waist girth |"), "{}", study.page);
        for svg in [&study.errors_svg, &study.views_svg] {
            assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
        }
    }
}
