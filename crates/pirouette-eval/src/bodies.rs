//! Bodies of random people: surface errors by number of views and by noise.

use pirouette::pipeline::{CancelToken, Config, Goal, Method};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::people::Person;
use crate::table::{Cell, Table, mean};
use crate::trial::{GIRTHS, Part, Score, try_person};
use crate::{OnStep, StudyError, do_all};

/// Goal: largest mean error of the body of a person, in mm
pub const GOAL_MM: f64 = 7.0;

/// Options of the study
#[derive(Debug, Clone, PartialEq)]
pub struct BodiesOptions {
    /// Number of people with exact silhouettes, with seeds from 1
    pub people: usize,
    /// Number of people who are photographed and segmented, in [`PHOTO_VIEWS`] views at noise 1, with seeds from 1
    pub photo_people: usize,
    /// Numbers of views, each at the noise nearest to 1
    pub views: Vec<usize>,
    /// Factors on the errors of keypoints and turn angles, each at the number of views nearest to 8
    pub noise: Vec<f64>,
}

/// Number of views of photographed people
pub const PHOTO_VIEWS: usize = 8;

impl Default for BodiesOptions {
    fn default() -> Self {
        Self {
            people: 40,
            photo_people: 8,
            views: vec![4, 6, 8, 9, 12, 16, 36],
            noise: vec![0.5, 1.0, 2.0],
        }
    }
}

impl BodiesOptions {
    /// Returns options for a quick run: few people in few views
    pub fn quick() -> Self {
        Self {
            people: 6,
            photo_people: 2,
            views: vec![4, 8],
            noise: vec![1.0],
        }
    }

    fn conditions(&self) -> Vec<Condition> {
        let nearest_noise = |to: f64| {
            let all = self.noise.iter().copied();
            all.min_by(|a, b| (a - to).abs().total_cmp(&(b - to).abs()))
        };
        let nearest_views = self.views.iter().copied().min_by_key(|v| v.abs_diff(8));
        let (Some(noise), Some(views)) = (nearest_noise(1.0), nearest_views) else {
            return Vec::new();
        };
        let mut conditions: Vec<Condition> = Vec::new();
        let by_views = self.views.iter().map(|&views| (views, noise));
        for (views, noise) in by_views.chain(self.noise.iter().map(|&noise| (views, noise))) {
            let condition = Condition {
                views,
                noise,
                photos: false,
                people: self.people,
            };
            if !conditions.contains(&condition) && condition.people > 0 {
                conditions.push(condition);
            }
        }
        if self.photo_people > 0 {
            conditions.push(Condition {
                views: PHOTO_VIEWS,
                noise: 1.0,
                photos: true,
                people: self.photo_people,
            });
        }
        conditions
    }
}

/// The condition of a row of the table
#[derive(Debug, Clone, Copy, PartialEq)]
struct Condition {
    views: usize,
    noise: f64,
    photos: bool,
    people: usize,
}

/// Results of the study
#[derive(Debug, Clone)]
pub struct BodiesStudy {
    /// Surface and girths, a row for each condition
    pub errors: Table,
    /// Surface by parts of the body, a row for each condition
    pub parts: Table,
    /// Every person of every condition, as JSON
    pub people: Value,
}

/// Scans random people in all conditions
///
/// Surface: mean distance between the reconstructed and the true body in the reference pose, in both directions, after
/// a shift and a turn about the vertical; mean over people, mean of their 95th percentiles, and the largest mean of a
/// person. Girths: error relative to the true tape length, mean and standard deviation over people.
///
/// # Errors
/// When there are no people or views, or the study was cancelled.
pub fn study(
    options: &BodiesOptions,
    cancel: &CancelToken,
    on_step: &mut OnStep,
) -> Result<BodiesStudy, StudyError> {
    let conditions = options.conditions();
    let most = conditions.iter().map(|c| c.people).max();
    let people: Vec<Option<Person>> = (1..=most.ok_or(StudyError::Nothing)? as u64)
        .into_par_iter()
        .map(|seed| Person::new(seed).ok())
        .collect();
    let mut jobs: Vec<(Condition, &Person)> = Vec::new();
    for condition in &conditions {
        let people = people.iter().take(condition.people).flatten();
        jobs.extend(people.map(|person| (*condition, person)));
    }
    let config = Config::new(Goal::Measure, Method::Fit);
    let scores: Vec<Score> = do_all(&jobs, cancel, on_step, |(condition, person)| {
        let scan = person.photograph(condition.views, condition.noise, condition.photos);
        let score = try_person(person, &scan, &config, cancel);
        let text = format!(
            "{} views, noise {}{}, {}: {}",
            condition.views,
            condition.noise,
            if condition.photos { ", photos" } else { "" },
            person.describe(),
            score.describe()
        );
        (score, text)
    })?;
    let found: Vec<Found> = jobs
        .iter()
        .zip(scores)
        .map(|((condition, person), score)| Found {
            condition: *condition,
            person,
            score,
        })
        .collect();
    Ok(tables(&conditions, &found))
}

/// One person in one condition
struct Found<'a> {
    condition: Condition,
    person: &'a Person,
    score: Score,
}

fn tables(conditions: &[Condition], found: &[Found]) -> BodiesStudy {
    let mut errors = Table::new(
        "bodies of random people: surface in mm, girths in percent",
        &[
            "views",
            "noise",
            "input",
            "people",
            "failed",
            "mean",
            "p95",
            "worst",
            "bust",
            "waist",
            "hip",
            "worst person",
        ],
    );
    let mut columns = vec!["views", "noise", "input"];
    columns.extend(Part::ALL.map(Part::name));
    let mut parts = Table::new("mean distance from parts of the true body, in mm", &columns);
    let mut worst_of_all: Option<&Found> = None;
    for condition in conditions {
        let row: Vec<&Found> = found.iter().filter(|f| f.condition == *condition).collect();
        let values = |value: &dyn Fn(&Score) -> Option<f64>| -> Vec<f64> {
            row.iter().filter_map(|f| value(&f.score)).collect()
        };
        let worst = worst(row.iter().copied());
        worst_of_all = crate::bodies::worst(worst_of_all.into_iter().chain(worst));
        let means = values(&|score| score.mean_mm);
        let head = [
            Cell::Number(condition.views as f64, 0),
            Cell::Number(condition.noise, 1),
            Cell::Text(if condition.photos { "photos" } else { "masks" }.into()),
        ];
        let mut cells = head.to_vec();
        cells.extend([
            Cell::Number(row.len() as f64, 0),
            Cell::Number((row.len() - means.len()) as f64, 0),
            Cell::number(mean(&means), 2),
            Cell::number(mean(&values(&|score| score.p95_mm)), 2),
            Cell::number(worst.and_then(|f| f.score.mean_mm), 2),
        ]);
        cells.extend((0..GIRTHS.len()).map(|g| Cell::spread(&values(&|s| s.girths_pct[g]))));
        cells.push(worst.map_or(Cell::Missing, |f| Cell::Text(f.person.describe())));
        errors.rows.push(cells);
        let mut cells = head.to_vec();
        cells.extend(
            (0..Part::ALL.len()).map(|p| Cell::number(mean(&values(&|s| s.parts_mm[p])), 2)),
        );
        parts.rows.push(cells);
    }
    errors.notes.push(goal_note(worst_of_all));
    let people = found
        .iter()
        .map(|f| {
            let mut value = f.score.to_json(f.person);
            value["views"] = json!(f.condition.views);
            value["noise"] = json!(f.condition.noise);
            value["photos"] = json!(f.condition.photos);
            value
        })
        .collect();
    BodiesStudy {
        errors,
        parts,
        people,
    }
}

/// Returns the person with the largest error
fn worst<'a>(found: impl Iterator<Item = &'a Found<'a>>) -> Option<&'a Found<'a>> {
    found.filter(|f| f.score.mean_mm.is_some()).max_by(|a, b| {
        f64::total_cmp(
            &a.score.mean_mm.unwrap_or(0.0),
            &b.score.mean_mm.unwrap_or(0.0),
        )
    })
}

fn goal_note(worst: Option<&Found>) -> String {
    let goal = format!("goal: at most {GOAL_MM} mm for each person");
    match worst.and_then(|f| Some((f, f.score.mean_mm?))) {
        Some((f, mean_mm)) => format!(
            "{goal}; {}: {} has an error of {mean_mm:.2} mm in {} views at noise {}",
            if mean_mm <= GOAL_MM { "met" } else { "missed" },
            f.person.describe(),
            f.condition.views,
            f.condition.noise
        ),
        None => format!("{goal}; no body was reconstructed"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_vary_at_noise_1_and_noise_at_eight_views() {
        let options = BodiesOptions {
            people: 3,
            photo_people: 0,
            views: vec![4, 8, 36],
            noise: vec![0.5, 1.0],
        };
        let conditions = options.conditions();
        let found: Vec<(usize, f64)> = conditions.iter().map(|c| (c.views, c.noise)).collect();
        assert_eq!(found, [(4, 1.0), (8, 1.0), (36, 1.0), (8, 0.5)]);
    }

    #[test]
    fn no_people_give_no_table() {
        let options = BodiesOptions {
            people: 0,
            photo_people: 0,
            ..BodiesOptions::quick()
        };
        let found = study(&options, &CancelToken::default(), &mut |_| {});
        assert_eq!(found.unwrap_err(), StudyError::Nothing);
    }
}
