//! The published results, on people of ours: one experiment for each, beside the published figures.
//!
//! Zwettler et al. 2021, "Three-step Alignment Approach for Fitting a Normalized Mask of a Person Rotating in A-Pose or
//! T-Pose" (VISAPP). Every experiment is a function with fixed seeds over the random people of [`crate::people`]. Each
//! one says how the paper is read, and shows what becomes of the figures when a part of the method is left out. What ours
//! must reach stands in one table, [`GOALS`].

mod deformation;
mod exhaustive;
mod goals;
mod page;
mod picture;
mod reconstruction;
mod refinement;
mod registration;
mod segmentation;

use std::path::PathBuf;

use pirouette::pipeline::CancelToken;
use pirouette::scan::Photo;
use pirouette_body::Camera;
use pirouette_synthetic::SyntheticOptions;
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use crate::folders::{ScoreError, photo_table, score_photos, with_truth};
use crate::people::Person;
use crate::table::{Table, percentile};
use crate::{Step, StudyError, Tell};

pub use goals::{Figure, GOALS, Goal, Limit};
pub use page::{MarkdownPage, PageError, markdown, web_page};

/// People in the experiments, by seeds from 1; in a quick look, and in all
const PEOPLE: [u64; 2] = [6, 20];

/// How much is done
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Effort {
    /// A look of less than a minute
    Quick,
    /// All of it
    #[default]
    Whole,
}

impl Effort {
    fn pick<T>(self, quick: T, whole: T) -> T {
        match self {
            Effort::Quick => quick,
            Effort::Whole => whole,
        }
    }
}

/// What is to be run
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Options {
    /// How much is done
    pub effort: Effort,
    /// Names of the experiments; all without any
    pub only: Vec<String>,
    /// Folders of real photos with truth, which join the segmentation
    pub photos: Vec<PathBuf>,
}

/// A picture with what it shows
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Its file is called so
    pub name: &'static str,
    /// What it shows
    pub caption: String,
    /// The picture
    pub photo: Photo,
}

/// What one experiment found
#[derive(Debug, Clone)]
pub struct Experiment {
    /// What it is called on the command line
    pub name: &'static str,
    /// What it is called on the page
    pub title: &'static str,
    /// How the paper is read, and what is done
    pub reading: Vec<&'static str>,
    /// What is compared with published figures
    pub figures: Vec<(Figure, f64)>,
    /// The whole result
    pub tables: Vec<Table>,
    /// Pictures
    pub pictures: Vec<Picture>,
    /// Every trial, for programs
    pub values: Vec<Value>,
}

/// What all experiments found
#[derive(Debug, Clone)]
pub struct Results {
    /// How much was done
    pub effort: Effort,
    /// In the order of the page
    pub experiments: Vec<Experiment>,
}

/// Runs one experiment on the people
type Run = fn(&[Person], Effort, &CancelToken, &mut Tell) -> Result<Experiment, StudyError>;

/// All experiments, by name
const EXPERIMENTS: [(&str, Run); 5] = [
    ("segmentation", segmentation::run),
    ("deformation", deformation::run),
    ("registration", registration::run),
    ("refinement", refinement::run),
    ("reconstruction", reconstruction::run),
];

/// Names of all experiments, in the order of the page
pub fn names() -> [&'static str; EXPERIMENTS.len()] {
    EXPERIMENTS.map(|(name, _)| name)
}

/// Runs the experiments
///
/// # Errors
/// When cancelled, a folder has no truth, or there is nothing to do.
pub fn run(
    options: &Options,
    cancel: &CancelToken,
    tell: &mut Tell,
) -> Result<Results, ScoreError> {
    let wanted = |name: &str| options.only.is_empty() || options.only.iter().any(|o| o == name);
    let [few, all] = PEOPLE;
    let people: Vec<Person> = (1..=options.effort.pick(few, all))
        .into_par_iter()
        .filter_map(|seed| Person::new(seed).ok())
        .collect();
    let mut experiments = Vec::new();
    for (name, run) in EXPERIMENTS.iter().filter(|(name, _)| wanted(name)) {
        let mut named = |step: Step| {
            tell(Step {
                text: format!("{name}: {}", step.text),
                ..step
            });
        };
        experiments.push(run(&people, options.effort, cancel, &mut named)?);
    }
    if !options.photos.is_empty() {
        experiments.push(photos(&options.photos, cancel, tell)?);
    }
    if experiments.is_empty() {
        return Err(StudyError::Nothing.into());
    }
    Ok(Results {
        effort: options.effort,
        experiments,
    })
}

/// Real photos with masks, each segmented by itself
fn photos(
    folders: &[PathBuf],
    cancel: &CancelToken,
    tell: &mut Tell,
) -> Result<Experiment, ScoreError> {
    let scores = score_photos(&with_truth(folders)?, cancel, tell)?;
    let overlaps: Vec<f64> = scores.iter().map(|score| score.iou).collect();
    let passed = overlaps
        .iter()
        .filter(|o| **o >= segmentation::PASS)
        .count();
    Ok(Experiment {
        name: "photos",
        title: "Segmentation of given photos",
        reading: vec![
            "Each photo is segmented by itself, from its keypoints, and compared with the mask in the folder `truth`. It \
             passes as rendered ones do.",
        ],
        figures: vec![
            (
                Figure::PhotosMedian,
                percentile(&overlaps, 0.5).unwrap_or(f64::NAN),
            ),
            (
                Figure::PhotosPassed,
                100.0 * passed as f64 / overlaps.len().max(1) as f64,
            ),
        ],
        tables: vec![photo_table(&scores)],
        pictures: Vec::new(),
        values: scores
            .iter()
            .map(|s| json!({ "photo": s.photo, "jaccard": (s.iou * 1e4).round() / 1e4 }))
            .collect(),
    })
}

impl Results {
    /// All figures with their goals, in the order of the goals
    pub fn figures(&self) -> Vec<(&'static Goal, f64)> {
        let all: Vec<&(Figure, f64)> = self.experiments.iter().flat_map(|e| &e.figures).collect();
        GOALS
            .iter()
            .filter_map(|goal| {
                let found = all.iter().find(|(figure, _)| *figure == goal.figure)?;
                Some((goal, found.1))
            })
            .collect()
    }

    /// The figures that fall short of their goals, one line each
    pub fn shortfalls(&self) -> Vec<String> {
        let short = self.figures().into_iter();
        short
            .filter(|(goal, value)| !goal.reached(*value))
            .map(|(goal, value)| {
                let (found, limit) = (goal.show(value), goal.show_limit());
                format!("{}: {found}, must be {limit}", goal.name)
            })
            .collect()
    }

    /// Our figures beside the published ones
    pub fn summary(&self) -> Table {
        let mut table = Table::new(
            match self.effort {
                Effort::Quick => {
                    "The published results, ours beside them (a quick look: few people)"
                }
                Effort::Whole => "The published results, ours beside them",
            },
            &["result", "published", "must be", "ours", ""],
        );
        table.rows = self
            .figures()
            .into_iter()
            .map(|(goal, value)| {
                let reached = if goal.reached(value) { "" } else { "short" };
                [
                    goal.name.to_owned(),
                    goal.published.to_owned(),
                    goal.show_limit(),
                    goal.show(value),
                    reached.to_owned(),
                ]
                .map(crate::table::Cell::Text)
                .to_vec()
            })
            .collect();
        table
    }

    /// Everything but the pictures, for programs
    pub fn to_json(&self) -> Value {
        let figures = self.figures();
        let figures = figures.iter().map(|(goal, value)| goal.to_json(*value));
        let experiments = self.experiments.iter().map(|experiment| {
            let tables: Vec<Value> = experiment.tables.iter().map(Table::to_json).collect();
            let value = json!({ "tables": tables, "trials": experiment.values });
            (experiment.name.to_owned(), value)
        });
        json!({
            "quick": self.effort == Effort::Quick,
            "figures": figures.collect::<Vec<Value>>(),
            "experiments": experiments.collect::<Map<String, Value>>(),
        })
    }
}

impl std::fmt::Display for Results {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for experiment in &self.experiments {
            writeln!(f, "{}\n", experiment.title)?;
            for table in &experiment.tables {
                writeln!(f, "{table}\n")?;
            }
        }
        write!(f, "{}", self.summary())
    }
}

/// The camera of all experiments: 800 x 1000 px, about 830 of which are the person
fn camera_of(stature_mm: f64) -> Camera {
    SyntheticOptions::camera_for(stature_mm, 800, 1000)
}
