//! Tape measures of random people: how far each is off, by the number of views, and how honest its deviation is.

use std::fmt::Write;

use pirouette::measure::{Estimate, Measure, measure_figure};
use pirouette::pipeline::{CancelToken, Config, Goal, Method, run};
use pirouette::synthetic::Random;
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::people::Person;
use crate::table::{Cell, Spread, Table, mean, percentile};
use crate::{StudyError, Tell, do_all};

/// Standard deviation of the statures that people state, in mm
const STATED_STATURE_SD_MM: f64 = 5.0;

/// Seeds of people begin here: those before were looked at while the method was made
const FIRST_SEED: u64 = 2001;

/// What is studied
#[derive(Debug, Clone, PartialEq)]
pub struct TapesOptions {
    /// People whose exact silhouettes are given, at [`USUAL_VIEWS`]
    pub people: usize,
    /// Those of them for whom numbers of views are compared
    pub view_people: usize,
    /// People who are photographed and segmented, at [`USUAL_VIEWS`]
    pub photo_people: usize,
    /// People who are scanned again, swaying and told otherwise, at [`USUAL_VIEWS`]
    pub repeated: usize,
    /// Numbers of views
    pub views: Vec<usize>,
    /// Seed of the first person
    pub first_seed: u64,
}

/// Views of photographed and repeated people
pub const USUAL_VIEWS: usize = 8;

impl Default for TapesOptions {
    fn default() -> Self {
        Self {
            people: 60,
            view_people: 12,
            photo_people: 60,
            repeated: 20,
            views: vec![7, 8, 9, 12, 16, 36],
            first_seed: FIRST_SEED,
        }
    }
}

impl TapesOptions {
    /// Few people: a look, no study
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

/// How a person is scanned
#[derive(Debug, Clone, Copy, PartialEq)]
struct Condition {
    views: usize,
    photos: bool,
    /// 0 for the first time, other numbers for other sway and noise
    again: u64,
}

/// What was found of one measure of one person
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
    /// One per measure, in the order of [`Measure::ALL`]
    found: Vec<Option<Found>>,
    error: Option<String>,
}

/// What the study found
#[derive(Debug, Clone)]
pub struct TapesStudy {
    /// The tables, in the order of the page
    pub tables: Vec<Table>,
    /// Every person of every condition, for programs
    pub people: Value,
    /// The page, in Markdown
    pub page: String,
    /// Errors of girths from photos beside the goals, as an SVG picture
    pub errors_svg: String,
    /// Errors by number of views, as an SVG picture
    pub views_svg: String,
}

/// Measures random people in all conditions
///
/// Truth is the same tape on the known body. Stated statures are wrong by a few mm, as those of people are.
///
/// # Errors
/// When there are no people or views, or the study was cancelled.
pub fn study(
    options: &TapesOptions,
    cancel: &CancelToken,
    tell: &mut Tell,
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
    let scanned = do_all(&jobs, cancel, tell, |&(condition, person)| {
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
    let stature_mm = person.figure.stature_mm();
    let told = stature_mm + STATED_STATURE_SD_MM * Random::new(seed ^ 0x57a7).normal();
    synthetic.scan.stature_mm = Some(told);
    let mut scanned = Scanned {
        person,
        condition,
        found: vec![None; Measure::ALL.len()],
        error: None,
    };
    match run(&synthetic.scan, config, cancel, &mut |_| {}) {
        Err(error) => scanned.error = Some(error.to_string()),
        Ok(report) => {
            let truth = measure_figure(&person.figure);
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

/// Limits and figures of others: mean error that ISO 20685-1 allows, mean absolute error of the best published photo method
/// (two silhouettes, height and weight) and of regressions on height and weight (ANSUR II, mean of men and women), in mm
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
        | Measure::WristGirth => [Some(4.0), None, None],
        Measure::BackLength | Measure::NapeToWaist | Measure::ShoulderToWrist => {
            [Some(5.0), None, None]
        }
        Measure::UnderbustGirth => [Some(9.0), None, None],
        Measure::FootLength | Measure::HeadGirth => [Some(2.0), None, None],
        Measure::Rise => [None; 3],
    }
}

/// Errors of one measure over the people of one condition
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

/// Standard deviation of one scan of a person around the mean of two, over people
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
    ];
    let mut study = TapesStudy {
        people: scanned.iter().map(person_value).collect(),
        errors_svg: errors_svg(scanned, photos),
        views_svg: views_svg(options, scanned),
        page: String::new(),
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

/// Both estimates of each girth: errors in percent, and how many lie within their deviations
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

/// Measures in the table by number of views
const BY_VIEWS: [Measure; 9] = [
    Measure::NeckGirth,
    Measure::BustGirth,
    Measure::WaistGirth,
    Measure::HipGirth,
    Measure::ThighGirth,
    Measure::CalfGirth,
    Measure::UpperArmGirth,
    Measure::WristGirth,
    Measure::CrotchHeight,
];

fn at_views(views: usize) -> Condition {
    Condition {
        views,
        photos: false,
        again: 0,
    }
}

/// Mean absolute error over the people for whom numbers of views are compared
fn mae(
    options: &TapesOptions,
    scanned: &[Scanned],
    condition: Condition,
    measure: Measure,
) -> Option<f64> {
    let place = Measure::ALL.iter().position(|&m| m == measure)?;
    let end = options.first_seed + options.view_people as u64;
    let people = scanned
        .iter()
        .filter(|s| s.condition == condition && s.person.seed < end);
    let errors = people.filter_map(|s| Some(s.found[place]?.error_mm().abs()));
    mean(&errors.collect::<Vec<_>>())
}

fn views_table(options: &TapesOptions, scanned: &[Scanned]) -> Table {
    let names: Vec<String> = BY_VIEWS
        .iter()
        .map(|m| m.name().replace('_', " "))
        .collect();
    let mut columns = vec!["views"];
    columns.extend(names.iter().map(String::as_str));
    let mut table = Table::new(
        "mean absolute error by number of views, exact silhouettes, the same people",
        &columns,
    );
    for &views in &options.views {
        let mut row = vec![Cell::Number(views as f64, 0)];
        let of = |m: &Measure| Cell::number(mae(options, scanned, at_views(views), *m), 1);
        row.extend(BY_VIEWS.iter().map(of));
        table.rows.push(row);
    }
    table
}

fn person_value(scanned: &Scanned) -> Value {
    let rounded = |value: f64| (value * 100.0).round() / 100.0;
    let mut value = json!({
        "seed": scanned.person.seed,
        "sex": scanned.person.sex.name(),
        "stature_mm": rounded(scanned.person.figure.stature_mm()),
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

fn page(options: &TapesOptions, scanned: &[Scanned], tables: &[Table]) -> String {
    let mut page = String::new();
    let failed = scanned.iter().filter(|s| s.error.is_some()).count();
    let _ = write!(
        page,
        "# How accurate the tape measures are\n\n\
         `pirouette eval tapes` wrote this page: {} random people, women and men of body mass indices from 17 to 38, rendered\n\
         with sway, noisy keypoints, turn angles that are off by 2 degrees, and statures stated with a standard deviation of\n\
         {STATED_STATURE_SD_MM:.0} mm. Their seeds are not those that the method was made with. Truth is the same tape on the known body. {failed} of\n\
         {} scans failed.\n\n\
         Rendered people are not people: no clothes, no hair, no breath, and tapes that find their places by the same rules\n\
         on the true and on the found body. Beside the figures stand the limits of ISO 20685-1 on the mean error of a scanner,\n\
         what the best published method with two photos reaches (mean absolute error), and what a regression on height and\n\
         weight does. This is no claim of conformity.\n\n\
         All in mm. `SD` is the spread of the errors over people, `MAE` their mean size, `P90` the size that 90 % stay below;\n\
         `repeat` is the deviation of a second scan of the same person, swaying and told otherwise; `within 1 sd` is the share\n\
         of errors that are smaller than the standard deviation told with the value: 68 would be right.\n\n",
        options.people.max(options.photo_people),
        scanned.len(),
    );
    let _ = write!(
        page,
        "![Errors of girths from photos](accuracy-errors.svg)\n\n\
         ![Errors by number of views](accuracy-views.svg)\n\n"
    );
    for table in tables {
        let _ = write!(
            page,
            "## {}\n\n{}\n",
            capitalized(&table.title),
            markdown(table)
        );
    }
    page.push_str(&recommendation(options, scanned));
    page
}

fn capitalized(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(|c| c.to_uppercase().to_string());
    first.unwrap_or_default() + letters.as_str()
}

fn markdown(table: &Table) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let mut text = line(&table.columns);
    text.push_str(&line(&vec!["---".to_owned(); table.columns.len()]));
    for row in &table.rows {
        text.push_str(&line(&row.iter().map(Cell::to_string).collect::<Vec<_>>()));
    }
    text
}

/// Which number of views to take, by the girths of the trunk
fn recommendation(options: &TapesOptions, scanned: &[Scanned]) -> String {
    const TRUNK: [Measure; 3] = [Measure::BustGirth, Measure::WaistGirth, Measure::HipGirth];
    let trunk = |views: usize| {
        let errors: Vec<f64> = TRUNK
            .iter()
            .filter_map(|&m| mae(options, scanned, at_views(views), m))
            .collect();
        mean(&errors)
    };
    let mut text =
        String::from("## How many photos\n\nMean absolute error of bust, waist and hip: ");
    let parts: Vec<String> = options
        .views
        .iter()
        .filter_map(|&v| Some(format!("{v} views {:.1} mm", trunk(v)?)))
        .collect();
    let _ = write!(text, "{}. ", parts.join(", "));
    // More photos than this are not worth the while: what is gained is less than a tenth.
    let enough = options.views.iter().copied().find(|&v| {
        let more = options.views.iter().filter(|&&w| w > v);
        let best = more.filter_map(|&w| trunk(w)).fold(f64::INFINITY, f64::min);
        trunk(v).is_some_and(|here| here <= 1.1 * best)
    });
    if let Some(enough) = enough {
        let _ = write!(
            text,
            "From {enough} on, more photos gain less than a tenth. "
        );
    }
    text.push_str(
        "Odd numbers see twice as many directions as even ones: opposite photos of an even turn show nearly the same outline.\n",
    );
    text
}

/// A strip per girth: every person's error as a dot, bias and spread
fn errors_svg(scanned: &[Scanned], condition: Condition) -> String {
    let girths: Vec<Measure> = Measure::ALL
        .iter()
        .copied()
        .filter(|m| !m.girths().is_empty())
        .collect();
    let (row, left, width) = (24.0, 150.0, 560.0);
    let scale = width / 2.0 / 50.0;
    let middle = left + width / 2.0;
    let height = row * girths.len() as f64 + 40.0;
    let mut svg = svg_open(left + width + 20.0, height);
    for tick in [-50.0, -25.0, 0.0, 25.0, 50.0f64] {
        let x = middle + tick * scale;
        let _ = writeln!(
            svg,
            "<line x1=\"{x}\" y1=\"8\" x2=\"{x}\" y2=\"{}\" stroke=\"#ccc\"/><text x=\"{x}\" y=\"{}\" \
             text-anchor=\"middle\">{tick:+.0} mm</text>",
            height - 26.0,
            height - 10.0
        );
    }
    for (i, &girth) in girths.iter().enumerate() {
        let y = 20.0 + row * i as f64;
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>",
            left - 8.0,
            y + 4.0,
            girth.name().replace('_', " ")
        );
        let errors = errors(scanned, condition, girth);
        for e in &errors {
            let x = middle + e.clamp(-50.0, 50.0) * scale;
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y}\" r=\"3\" fill=\"#1f6fb2\" fill-opacity=\"0.4\"/>"
            );
        }
        if let Some(Spread { mean, sd }) = Spread::of(&errors) {
            let [a, b] = [mean - sd, mean + sd].map(|e| middle + e.clamp(-50.0, 50.0) * scale);
            let _ = writeln!(
                svg,
                "<line x1=\"{a:.1}\" y1=\"{y}\" x2=\"{b:.1}\" y2=\"{y}\" stroke=\"#c33\" stroke-width=\"3\"/>"
            );
        }
    }
    svg.push_str("</svg>\n");
    svg
}

/// Mean absolute errors of the trunk's girths over the number of views
fn views_svg(options: &TapesOptions, scanned: &[Scanned]) -> String {
    const LINES: [(Measure, &str); 4] = [
        (Measure::BustGirth, "#c33"),
        (Measure::WaistGirth, "#1f6fb2"),
        (Measure::HipGirth, "#2a8a3a"),
        (Measure::ThighGirth, "#b27a1f"),
    ];
    let (left, top, width, height, most) = (50.0, 15.0, 480.0, 220.0, 20.0);
    let count = options.views.len().max(2) as f64 - 1.0;
    let x = |i: usize| left + width * i as f64 / count;
    let y = |mm: f64| top + height * (1.0 - mm.clamp(0.0, most) / most);
    let mut svg = svg_open(left + width + 130.0, top + height + 45.0);
    for tick in [0.0, 5.0, 10.0, 15.0, 20.0] {
        let at = y(tick);
        let _ = writeln!(
            svg,
            "<line x1=\"{left}\" y1=\"{at}\" x2=\"{}\" y2=\"{at}\" stroke=\"#ccc\"/><text x=\"{}\" y=\"{}\" \
             text-anchor=\"end\">{tick}</text>",
            left + width,
            left - 6.0,
            at + 4.0
        );
    }
    for (i, views) in options.views.iter().enumerate() {
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{views}</text>",
            x(i),
            top + height + 18.0
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">views; mean absolute error in mm</text>",
        left + width / 2.0,
        top + height + 38.0
    );
    for (measure, color) in LINES {
        let points: Vec<(f64, f64)> = options
            .views
            .iter()
            .enumerate()
            .filter_map(|(i, &v)| Some((x(i), y(mae(options, scanned, at_views(v), measure)?))))
            .collect();
        let path: Vec<String> = points
            .iter()
            .map(|p| format!("{:.1},{:.1}", p.0, p.1))
            .collect();
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>",
            path.join(" ")
        );
        if let Some((x, y)) = points.last() {
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{color}\">{}</text>",
                x + 6.0,
                y + 4.0,
                measure.name().replace('_', " ")
            );
        }
    }
    svg.push_str("</svg>\n");
    svg
}

fn svg_open(width: f64, height: f64) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_makes_no_table() {
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
    fn errors_that_go_together_are_correlated() {
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
