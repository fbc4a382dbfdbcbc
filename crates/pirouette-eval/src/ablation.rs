//! Ablation study: the same people, with one part of the method disabled at a time.

use pirouette::body_fit::BodyFitOptions;
use pirouette::pipeline::{AvatarSource, CancelToken, Config, Goal, Method};
use pirouette_body::Sex;
use pirouette_body::mannequin::DEFAULT_BMI;
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::people::Person;
use crate::table::{Cell, Table, mean};
use crate::trial::{GIRTHS, Score, try_person};
use crate::{OnStep, StudyError, do_all};

/// Options of the study
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AblationOptions {
    /// Number of people, with seeds from 1
    pub people: usize,
    /// Number of photos per person
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

/// A part of the method that can be disabled
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    /// No part is disabled
    Nothing,
    /// One body and skeleton for all views; without it, the published steps for each view
    SharedSkeleton,
    /// The background shared by all photos
    CleanPlate,
    /// Subpixel borders of silhouettes
    Alpha,
    /// Initial rounds with a large search distance and high stiffness; without it, the last half of the rounds
    WideStart,
    /// Sex and mass of the start estimated from the silhouettes; without it, an average neutral avatar
    ChosenStart,
    /// Left-right symmetry
    Symmetry,
    /// Mean posture in the surface instead of in the poses
    MeanPose,
    /// Soles fixed on the floor, crown at the stature
    Anchors,
    /// The camera as an unknown of the fit; without it, that of the skeleton
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

    /// Returns the default configuration without this part
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
                let stature_m = person.avatar.stature_mm() / 1000.0;
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

/// Results of the study
#[derive(Debug, Clone)]
pub struct AblationStudy {
    /// A row for each disabled part
    pub table: Table,
    /// Every person in every row, as JSON
    pub people: Value,
}

/// Scans photographed people with one part of the method disabled at a time
///
/// Photos are rendered at noise 1. Overlaps: of the segmented silhouettes, and in the reference pose after the best
/// shift of each. Surface and girths as in [`crate::bodies::study`]; without the shared skeleton the body is a visual
/// hull, which is systematically too large.
///
/// # Errors
/// When there are no people or views, or the study was cancelled.
pub fn study(
    options: &AblationOptions,
    cancel: &CancelToken,
    on_step: &mut OnStep,
) -> Result<AblationStudy, StudyError> {
    if options.people == 0 || options.views == 0 {
        return Err(StudyError::Nothing);
    }
    let people: Vec<Person> = (1..=options.people as u64)
        .into_par_iter()
        .filter_map(|seed| Person::new(seed).ok())
        .collect();
    // Photos of one person are used for all rows.
    let scores: Vec<Vec<Score>> = {
        let jobs: Vec<(&Person, &[Part])> = people.iter().map(|p| (p, &Part::ALL[..])).collect();
        do_all(&jobs, cancel, on_step, |(person, parts)| {
            let scan = person.photograph(options.views, 1.0, true);
            let scores: Vec<Score> = parts
                .iter()
                .map(|part| try_person(person, &scan, &part.left_out(person), cancel))
                .collect();
            let complete = scores.first().map(Score::describe).unwrap_or_default();
            (scores, format!("{}: {complete}", person.describe()))
        })?
    };
    let mut table = Table::new(
        format!(
            "{} photographed people in {} views, one part disabled",
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
    fn every_disabled_part_changes_the_configuration() {
        let person = Person::new(1).unwrap();
        let complete = Part::Nothing.left_out(&person);
        for part in &Part::ALL[1..] {
            assert_ne!(part.left_out(&person), complete, "{part:?}");
        }
    }
}
