//! The published results, reproduced with random people: one experiment for each, compared with the published figures.
//!
//! Zwettler et al. 2021, "Three-step Alignment Approach for Fitting a Normalized Mask of a Person Rotating in A-Pose or
//! T-Pose" (VISAPP). Every experiment is a function with fixed seeds over the random people of [`crate::people`]. Each
//! states how the paper is interpreted, and how the figures change when a part of the method is disabled. Our goals are
//! listed in one table, [`GOALS`].

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
use crate::{OnStep, Step, StudyError};

pub use goals::{Figure, GOALS, Goal, Limit};
pub use page::{MarkdownPage, PageError, markdown, web_page};

/// Number of people in the experiments, with seeds from 1; in a quick and in a full run
const PEOPLE: [u64; 2] = [6, 20];

/// Extent of a run
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Effort {
    /// A run of less than a minute
    Quick,
    /// A full run
    #[default]
    Full,
}

impl Effort {
    fn pick<T>(self, quick: T, full: T) -> T {
        match self {
            Effort::Quick => quick,
            Effort::Full => full,
        }
    }
}

/// Options of a run
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Options {
    /// Extent of the run
    pub effort: Effort,
    /// Names of the selected experiments; empty for all
    pub only: Vec<String>,
    /// Folders of real photos with ground truth, added to the segmentation
    pub photos: Vec<PathBuf>,
}

/// A picture with its caption
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Stem of its file name
    pub name: &'static str,
    /// Caption
    pub caption: String,
    /// The picture
    pub photo: Photo,
}

/// Result of one experiment
#[derive(Debug, Clone)]
pub struct Experiment {
    /// Name on the command line
    pub name: &'static str,
    /// Title on the page
    pub title: &'static str,
    /// Interpretation of the paper, and description of the experiment
    pub reading: Vec<&'static str>,
    /// Figures that are compared with published ones
    pub figures: Vec<(Figure, f64)>,
    /// The complete results
    pub tables: Vec<Table>,
    /// Pictures
    pub pictures: Vec<Picture>,
    /// Every trial, as JSON
    pub values: Vec<Value>,
}

/// Results of all experiments
#[derive(Debug, Clone)]
pub struct Results {
    /// Extent of the run
    pub effort: Effort,
    /// Experiments in the order of the page
    pub experiments: Vec<Experiment>,
}

/// Function that runs one experiment on the people
type Run = fn(&[Person], Effort, &CancelToken, &mut OnStep) -> Result<Experiment, StudyError>;

/// All experiments, by name
const EXPERIMENTS: [(&str, Run); 5] = [
    ("segmentation", segmentation::run),
    ("deformation", deformation::run),
    ("registration", registration::run),
    ("refinement", refinement::run),
    ("reconstruction", reconstruction::run),
];

/// Returns the names of all experiments, in the order of the page
pub fn names() -> [&'static str; EXPERIMENTS.len()] {
    EXPERIMENTS.map(|(name, _)| name)
}

/// Runs the experiments
///
/// # Errors
/// When cancelled, a folder has no ground truth, or no experiment is selected.
pub fn run(
    options: &Options,
    cancel: &CancelToken,
    on_step: &mut OnStep,
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
            on_step(Step {
                text: format!("{name}: {}", step.text),
                ..step
            });
        };
        experiments.push(run(&people, options.effort, cancel, &mut named)?);
    }
    if !options.photos.is_empty() {
        experiments.push(photos(&options.photos, cancel, on_step)?);
    }
    if experiments.is_empty() {
        return Err(StudyError::Nothing.into());
    }
    Ok(Results {
        effort: options.effort,
        experiments,
    })
}

/// Segments real photos with masks, independently
fn photos(
    folders: &[PathBuf],
    cancel: &CancelToken,
    on_step: &mut OnStep,
) -> Result<Experiment, ScoreError> {
    let scores = score_photos(&with_truth(folders)?, cancel, on_step)?;
    let overlaps: Vec<f64> = scores.iter().map(|score| score.iou).collect();
    let passed = overlaps
        .iter()
        .filter(|o| **o >= segmentation::PASS)
        .count();
    Ok(Experiment {
        name: "photos",
        title: "Segmentation of given photos",
        reading: vec![
            "Each photo is segmented separately, from its keypoints, and compared with the mask in the folder `truth`. The \
             criterion for passing is that of rendered photos.",
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
    /// Returns all figures with their goals, in the order of the goals
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

    /// Returns the figures that miss their goals, one line each
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

    /// Returns a table of our figures and the published ones
    pub fn summary(&self) -> Table {
        let mut table = Table::new(
            match self.effort {
                Effort::Quick => "Published results and ours (quick run: few people)",
                Effort::Full => "Published results and ours",
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

    /// Returns all results except the pictures as JSON
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

/// Returns the camera of all experiments: 800 x 1000 px, with a person of about 830 px
fn camera_of(stature_mm: f64) -> Camera {
    SyntheticOptions::camera_for(stature_mm, 800, 1000)
}
