//! What each part of the method is good for: the same people, with one part off at a time.

use pirouette::body_fit::BodyFitOptions;
use pirouette::pipeline::{AvatarSource, CancelToken, Config, Goal, Method};
use pirouette_body::Sex;
use pirouette_body::mannequin::DEFAULT_BMI;
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::people::Person;
use crate::table::{Cell, Table, mean};
use crate::trial::{GIRTHS, Score, try_person};
use crate::{StudyError, Tell, do_all};

/// What is studied
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AblationOptions {
    /// People, by seeds from 1
    pub people: usize,
    /// Photos of each
    pub views: usize,
}

impl Default for AblationOptions {
    fn default() -> Self {
        Self {
            people: 6,
            views: 8,
        }
    }
}

/// A part of the method that can be left out
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    /// Nothing is left out
    Nothing,
    /// One body and skeleton for all views; without, the published steps view by view
    SharedSkeleton,
    /// The background that all photos share
    CleanPlate,
    /// Borders in fractions of pixels
    Alpha,
    /// Rounds that look far and bend stiffly; without, the last half of the rounds
    WideStart,
    /// Sex and mass of the start from the silhouettes; without, an average neutral figure
    ChosenStart,
    /// Left and right alike
    Symmetry,
    /// Posture in the surface instead of in the poses
    MeanPose,
    /// Soles on the floor, crown at the stature
    Anchors,
    /// The camera as an unknown of the fit; without, that of the skeleton
    Camera,
}

impl Part {
    const ALL: [Part; 10] = [
        Part::Nothing,
        Part::SharedSkeleton,
        Part::CleanPlate,
        Part::Alpha,
        Part::WideStart,
        Part::ChosenStart,
        Part::Symmetry,
        Part::MeanPose,
        Part::Anchors,
        Part::Camera,
    ];

    fn name(self) -> &'static str {
        match self {
            Part::Nothing => "nothing",
            Part::SharedSkeleton => "shared skeleton",
            Part::CleanPlate => "background plate",
            Part::Alpha => "alpha border",
            Part::WideStart => "wide start",
            Part::ChosenStart => "chosen start",
            Part::Symmetry => "symmetry",
            Part::MeanPose => "mean pose transfer",
            Part::Anchors => "anchors",
            Part::Camera => "fitted camera",
        }
    }

    /// The usual job without this part
    fn left_out(self, person: &Person) -> Config {
        let method = match self {
            Part::SharedSkeleton => Method::ThreeStep,
            _ => Method::Fit,
        };
        let mut config = Config::new(Goal::Measure, method);
        match self {
            Part::Nothing | Part::SharedSkeleton => {}
            Part::CleanPlate => config.segment.clean_plate = false,
            Part::Alpha => config.segment.alpha = false,
            Part::WideStart => {
                let rounds = BodyFitOptions::default().rounds;
                config.fit.rounds = rounds[rounds.len() / 2..].to_vec();
            }
            Part::ChosenStart => {
                let stature_m = person.figure.stature_mm() / 1000.0;
                config.avatar = AvatarSource::Mannequin {
                    sex: Sex::Neutral,
                    mass_kg: Some(DEFAULT_BMI * stature_m * stature_m),
                };
            }
            Part::Symmetry => config.fit.symmetry = false,
            Part::MeanPose => config.fit.transfer_mean_pose = false,
            Part::Anchors => config.fit.anchors = false,
            Part::Camera => config.fit.camera = false,
        }
        config
    }
}

/// What the study found
#[derive(Debug, Clone)]
pub struct AblationStudy {
    /// A row for each part that was left out
    pub table: Table,
    /// Every person in every row, for programs
    pub people: Value,
}

/// Scans photographed people with one part of the method off at a time
///
/// Photos are rendered at noise 1. Overlaps: of silhouettes as photographed, and in the reference pose after the best shift
/// of each. Surface and girths as in [`crate::bodies::study`]; without the shared skeleton the body is a visual hull,
/// too large by nature.
///
/// # Errors
/// When there are no people or views, or the study was cancelled.
pub fn study(
    options: &AblationOptions,
    cancel: &CancelToken,
    tell: &mut Tell,
) -> Result<AblationStudy, StudyError> {
    if options.people == 0 || options.views == 0 {
        return Err(StudyError::Nothing);
    }
    let people: Vec<Person> = (1..=options.people as u64)
        .into_par_iter()
        .filter_map(|seed| Person::new(seed).ok())
        .collect();
    // Photos of one person serve all rows.
    let scores: Vec<Vec<Score>> = {
        let jobs: Vec<(&Person, &[Part])> = people.iter().map(|p| (p, &Part::ALL[..])).collect();
        do_all(&jobs, cancel, tell, |(person, parts)| {
            let scan = person.photograph(options.views, 1.0, true);
            let scores: Vec<Score> = parts
                .iter()
                .map(|part| try_person(person, &scan, &part.left_out(person), cancel))
                .collect();
            let whole = scores.first().map(Score::describe).unwrap_or_default();
            (scores, format!("{}: {whole}", person.describe()))
        })?
    };
    let mut table = Table::new(
        format!(
            "{} photographed people in {} views, one part left out",
            people.len(),
            options.views
        ),
        &[
            "left out",
            "failed",
            "seg IoU",
            "norm IoU",
            "surface mm",
            "worst mm",
            "bust %",
            "waist %",
            "hip %",
        ],
    );
    let mut all = Vec::new();
    for (index, part) in Part::ALL.iter().enumerate() {
        let row: Vec<&Score> = scores.iter().filter_map(|s| s.get(index)).collect();
        let values = |value: &dyn Fn(&Score) -> Option<f64>| -> Vec<f64> {
            row.iter().filter_map(|score| value(score)).collect()
        };
        let means = values(&|s| s.mean_mm);
        let mut cells = vec![
            Cell::Text(part.name().to_owned()),
            Cell::Number((row.len() - means.len()) as f64, 0),
            Cell::number(mean(&values(&|s| s.seg_iou)), 4),
            Cell::number(mean(&values(&|s| s.norm_iou)), 4),
            Cell::number(mean(&means), 2),
            Cell::number(means.iter().copied().max_by(f64::total_cmp), 2),
        ];
        cells.extend((0..GIRTHS.len()).map(|g| Cell::spread(&values(&|s| s.girths_pct[g]))));
        table.rows.push(cells);
        for (person, score) in people.iter().zip(&row) {
            let mut value = score.to_json(person);
            value["left_out"] = json!(part.name());
            all.push(value);
        }
    }
    Ok(AblationStudy {
        table,
        people: Value::Array(all),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_that_is_left_out_changes_the_job() {
        let person = Person::new(1).unwrap();
        let whole = Part::Nothing.left_out(&person);
        for part in &Part::ALL[1..] {
            assert_ne!(part.left_out(&person), whole, "{part:?}");
        }
    }
}
