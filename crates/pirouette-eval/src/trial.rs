//! One job on one rendered person, and its score.

use pirouette::measure::{Measure, measure_avatar};
use pirouette::pipeline::{CancelToken, Config, Report, run};
use pirouette_body::Bone;
use pirouette_geom::Mask;
use pirouette_synthetic::{SyntheticScan, Truth};
use serde_json::{Value, json};

use crate::people::Person;
use crate::score::masks::{best_shift_iou, halved};
use crate::score::surface::{SurfaceError, surface_error};
use crate::table::mean;

/// Girths in the tables
pub(crate) const GIRTHS: [Measure; 3] =
    [Measure::BustGirth, Measure::WaistGirth, Measure::HipGirth];

/// A part of the body in the tables
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    Head,
    Trunk,
    UpperArms,
    Forearms,
    Hands,
    Thighs,
    Shins,
    Feet,
}

impl Part {
    pub(crate) const ALL: [Part; 8] = [
        Part::Head,
        Part::Trunk,
        Part::UpperArms,
        Part::Forearms,
        Part::Hands,
        Part::Thighs,
        Part::Shins,
        Part::Feet,
    ];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Part::Head => "head",
            Part::Trunk => "trunk",
            Part::UpperArms => "upper arms",
            Part::Forearms => "forearms",
            Part::Hands => "hands",
            Part::Thighs => "thighs",
            Part::Shins => "shins",
            Part::Feet => "feet",
        }
    }

    fn of(bone: Bone) -> Self {
        use Bone::*;
        match bone {
            Neck | Head => Part::Head,
            Root | LowerSpine | UpperSpine | LeftClavicle | RightClavicle => Part::Trunk,
            LeftUpperArm | RightUpperArm => Part::UpperArms,
            LeftForearm | RightForearm => Part::Forearms,
            LeftHand | RightHand => Part::Hands,
            LeftThigh | RightThigh => Part::Thighs,
            LeftShin | RightShin => Part::Shins,
            LeftFoot | RightFoot => Part::Feet,
        }
    }
}

/// Score of one job; values that were not computed are missing
#[derive(Debug, Clone, Default)]
pub(crate) struct Score {
    pub(crate) mean_mm: Option<f64>,
    pub(crate) p95_mm: Option<f64>,
    /// Mean distance from each part of the true body, in mm
    pub(crate) parts_mm: [Option<f64>; Part::ALL.len()],
    /// Errors of the tape measures, in percent
    pub(crate) girths_pct: [Option<f64>; GIRTHS.len()],
    /// Mean overlap of the segmented silhouettes; a rejected view counts as 0
    pub(crate) seg_iou: Option<f64>,
    /// Mean overlap of the silhouettes in the reference pose, each after its best shift
    pub(crate) norm_iou: Option<f64>,
    /// Why there is no result
    pub(crate) error: Option<String>,
}

/// Runs a job on a person and scores it
pub(crate) fn try_person(
    person: &Person,
    synthetic: &SyntheticScan,
    config: &Config,
    cancel: &CancelToken,
) -> Score {
    match run(&synthetic.scan, config, cancel, &mut |_| {}) {
        Ok(report) => score(person, &synthetic.truth, &report),
        Err(error) => Score {
            error: Some(error.to_string()),
            ..Score::default()
        },
    }
}

/// Scores body and girths of a person
pub(crate) fn score_body(person: &Person, report: &Report) -> Score {
    let mut score = Score::default();
    let body = report.body.as_ref();
    if let Some(error) = body.and_then(|body| surface_error(body, &person.avatar.mesh)) {
        score.mean_mm = Some(error.mean_mm);
        score.p95_mm = Some(error.p95_mm);
        score.parts_mm = parts(person, &error);
    }
    if let Some(measurements) = &report.measurements {
        let true_measures = measure_avatar(&person.avatar);
        score.girths_pct = GIRTHS.map(|girth| {
            let (_, true_mm) = true_measures.iter().find(|(m, _)| *m == girth)?;
            Some(100.0 * (measurements.value_mm(girth)? / true_mm - 1.0))
        });
    }
    score
}

/// Scores the result of a job on a person
pub(crate) fn score(person: &Person, truth: &Truth, report: &Report) -> Score {
    let mut score = score_body(person, report);
    let view = |index: usize| report.views.iter().find(|view| view.id.0 == index);
    let overlaps = truth
        .silhouettes
        .iter()
        .enumerate()
        .map(|(index, truth)| view(index).map_or(0.0, |view| view.silhouette.mask.iou(truth)));
    score.seg_iou = mean(&overlaps.collect::<Vec<f64>>());
    if report.views.iter().any(|view| view.normalized.is_some()) {
        let overlaps = truth.canonical.iter().enumerate().map(|(index, truth)| {
            let found = view(index).and_then(|view| view.normalized.as_ref());
            let pair = |found: &Mask| [(halved(found), halved(truth))];
            found.map_or(0.0, |found| {
                best_shift_iou(&pair(&found.mask)).unwrap_or(0.0)
            })
        });
        score.norm_iou = mean(&overlaps.collect::<Vec<f64>>());
    }
    score
}

/// Returns the mean distance from each part of the true body
fn parts(person: &Person, error: &SurfaceError) -> [Option<f64>; Part::ALL.len()] {
    let part_of = |triangle: usize| {
        let vertex = person.avatar.mesh.triangles[triangle][0];
        Part::of(person.avatar.weights[vertex as usize].strongest())
    };
    Part::ALL.map(|part| {
        let of_part = error.from_truth.iter().filter(|(t, _)| part_of(*t) == part);
        mean(&of_part.map(|(_, distance)| *distance).collect::<Vec<f64>>())
    })
}

impl Score {
    /// Returns the score of one person as JSON
    pub(crate) fn to_json(&self, person: &Person) -> Value {
        let rounded = |value: Option<f64>| value.map(|v| (v * 1e4).round() / 1e4);
        let mut value = json!({
            "seed": person.seed,
            "sex": person.sex.name(),
            "stature_mm": rounded(Some(person.avatar.stature_mm())),
            "bmi": rounded(Some(person.bmi)),
            "mean_mm": rounded(self.mean_mm),
            "p95_mm": rounded(self.p95_mm),
            "seg_iou": rounded(self.seg_iou),
            "norm_iou": rounded(self.norm_iou),
        });
        for (part, mean_mm) in Part::ALL.iter().zip(self.parts_mm) {
            value["parts_mm"][part.name()] = json!(rounded(mean_mm));
        }
        for (girth, pct) in GIRTHS.iter().zip(self.girths_pct) {
            value[format!("{}_pct", girth.name())] = json!(rounded(pct));
        }
        if let Some(error) = &self.error {
            value["error"] = json!(error);
        }
        value
    }

    /// Describes the result in a few words
    pub(crate) fn describe(&self) -> String {
        match (self.mean_mm, &self.error) {
            (Some(mean_mm), _) => format!("{mean_mm:.2} mm"),
            (None, Some(error)) => error.clone(),
            (None, None) => "no body".to_owned(),
        }
    }
}
