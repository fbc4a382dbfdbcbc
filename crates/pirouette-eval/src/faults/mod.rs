//! Wrong input: whether mistakes are refused or corrected, and what the standard deviations of the others are worth.
//!
//! Each kind of fault in three strengths is applied to healthy captures of rendered people, whose files are then scanned
//! in memory by the complete job, as `pirouette scan` does. A fault is a pure function over the photos, keypoints, masks
//! and statements of a capture; random ones depend on the seed of the person.
//!
//! A capture is wrong if it is not refused and at least one measure (girths of neck, bust, waist, hip, thigh and calf,
//! crotch height) is off by more than three of its reported standard deviations and more than 10 mm, whatever the warnings
//! are. Missing measures are not wrong.

mod camera;
mod captures;
mod change;
mod keypoints;
mod masks;
mod outcome;
mod page;
mod statements;

use pirouette::measure::{Measure, measure_avatar};
use pirouette::pipeline::{CancelToken, Config, Goal, Method};
use pirouette::scan::{CameraSetup, Scan, View};
use pirouette_body::mannequin::MannequinError;
use pirouette_body::{Camera, ReferencePose};
use pirouette_files::job::{JobOptions, run_job};
use pirouette_files::scan_folder::scan_files;
use pirouette_files::source::Source;
use pirouette_geom::Mask;
use pirouette_synthetic::{Random, SyntheticOptions, SyntheticScan, synthesize};
use serde_json::Value;

use crate::people::Person;
use crate::table::Table;
use crate::tapes::STATED_STATURE_SD_MM;
use crate::{OnStep, Step, StudyError, do_all};
use outcome::{Judged, judge, refused};

/// First seed of the people; no other study uses it or the following ones
const FIRST_SEED: u64 = 7001;

/// Body mass indices of the people, in kg/m²
const BMI: std::ops::RangeInclusive<f64> = 18.0..=36.0;

/// Angle of arms between both poses, in degrees below the horizontal
const BETWEEN_DEGREES: f64 = 20.0;

/// Distance of the camera from people with stretched arms, relative to that from people in A-pose
const WIDER: f64 = 1.2;

/// Options of the study
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FaultsOptions {
    /// Number of people
    pub people: usize,
    /// Number of people that are left out before them, for a study of other people
    pub skipped: usize,
    /// Views of each person, at least four
    pub views: usize,
    /// Groups of faults; captures without a fault are always included
    pub groups: Vec<Group>,
}

impl Default for FaultsOptions {
    fn default() -> Self {
        Self {
            people: 10,
            skipped: 0,
            views: 8,
            groups: Group::ALL.to_vec(),
        }
    }
}

/// Results of the study
#[derive(Debug, Clone)]
pub struct FaultsStudy {
    /// Views of each person
    pub views: usize,
    /// The tables, in the order of the page
    pub tables: Vec<Table>,
    /// Every capture, as JSON
    pub captures: Value,
    /// The page, in Markdown
    pub page: String,
}

/// What a fault concerns
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// The keypoints
    Keypoints,
    /// The camera, and edited photos
    Camera,
    /// The statements of the manifest
    Statements,
    /// Given masks
    Masks,
    /// The photos and what they show
    Captures,
}

impl Group {
    /// All groups
    pub const ALL: [Group; 5] = [
        Group::Keypoints,
        Group::Camera,
        Group::Statements,
        Group::Masks,
        Group::Captures,
    ];

    /// Returns the name
    pub fn name(self) -> &'static str {
        match self {
            Group::Keypoints => "keypoints",
            Group::Camera => "camera",
            Group::Statements => "statements",
            Group::Masks => "masks",
            Group::Captures => "captures",
        }
    }
}

/// Strength of a fault
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Strength {
    Weak,
    Medium,
    Strong,
}

impl Strength {
    const ALL: [Strength; 3] = [Strength::Weak, Strength::Medium, Strength::Strong];

    /// Selects the value of this strength
    fn pick<T>(self, [weak, medium, strong]: [T; 3]) -> T {
        match self {
            Strength::Weak => weak,
            Strength::Medium => medium,
            Strength::Strong => strong,
        }
    }
}

/// How a person holds the arms
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Held {
    A,
    T,
    Between,
}

impl Held {
    const ALL: [Held; 3] = [Held::A, Held::T, Held::Between];

    fn person(self, seed: u64) -> Result<Person, MannequinError> {
        let (pose, arms) = match self {
            Held::A => (ReferencePose::A, None),
            Held::T => (ReferencePose::T, None),
            Held::Between => (ReferencePose::A, Some(BETWEEN_DEGREES)),
        };
        Person::holding(seed, pose, arms)
    }
}

/// A kind of fault
#[derive(Debug, Clone, Copy)]
struct Fault {
    /// What it concerns; none for captures without a fault
    group: Option<Group>,
    kind: &'static str,
    /// Names of the strengths
    strengths: [&'static str; 3],
    /// How the person holds the arms, by strength
    held: [Held; 3],
    apply: fn(&mut Scan, &Setting, Strength),
}

impl Fault {
    const fn new(
        group: Group,
        kind: &'static str,
        strengths: [&'static str; 3],
        apply: fn(&mut Scan, &Setting, Strength),
    ) -> Self {
        Self::of_poses(group, kind, strengths, [Held::A; 3], apply)
    }

    const fn of_poses(
        group: Group,
        kind: &'static str,
        strengths: [&'static str; 3],
        held: [Held; 3],
        apply: fn(&mut Scan, &Setting, Strength),
    ) -> Self {
        Self {
            group: Some(group),
            kind,
            strengths,
            held,
            apply,
        }
    }

    fn name(&self) -> String {
        match self.group {
            Some(group) => format!("{}: {}", group.name(), self.kind),
            None => self.kind.to_owned(),
        }
    }
}

/// Captures without a fault
const HEALTHY: Fault = Fault {
    group: None,
    kind: "none",
    strengths: ["photos", "with masks", "T-pose"],
    held: [Held::A, Held::A, Held::T],
    apply: |scan, setting, strength| {
        if strength == Strength::Medium {
            masks::give_masks(scan, setting);
        }
    },
};

/// Returns captures without a fault, and the faults of the given groups
fn faults(groups: &[Group]) -> Vec<Fault> {
    let all = keypoints::FAULTS
        .into_iter()
        .chain(camera::FAULTS)
        .chain(statements::FAULTS)
        .chain(masks::FAULTS)
        .chain(captures::FAULTS);
    let selected = all.filter(|fault| fault.group.is_some_and(|g| groups.contains(&g)));
    std::iter::once(HEALTHY).chain(selected).collect()
}

/// What a fault may use in addition to the capture
struct Setting<'a> {
    /// The true silhouettes of all views
    silhouettes: &'a [Mask],
    /// The true camera
    camera: Camera,
    /// The mass of the person, in kg
    mass_kg: f64,
    /// Views of another person before the same camera, with their indices
    other: &'a [(usize, View)],
    seed: u64,
}

impl Setting<'_> {
    /// Returns a generator; each fault gets the same one
    fn random(&self) -> Random {
        Random::new(self.seed ^ 0xfa17)
    }

    /// Returns the first row of the person and the row below, over all views
    fn rows(&self) -> [usize; 2] {
        let bounds = self
            .silhouettes
            .iter()
            .filter_map(|mask| mask.bounding_box());
        bounds
            .map(|(_, top, _, bottom)| [top, bottom])
            .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
            .unwrap_or_default()
    }

    /// Returns the number of rows above the head
    fn head_row(&self) -> usize {
        self.rows()[0]
    }

    /// Returns the height of the person, in px
    fn person_px(&self) -> f64 {
        let [top, bottom] = self.rows();
        (bottom - top) as f64
    }
}

/// Returns the views that a fault changes: one, every second, all
fn some_views(count: usize, strength: Strength) -> Vec<usize> {
    match strength {
        Strength::Weak => vec![count / 4],
        Strength::Medium => (1..count).step_by(2).collect(),
        Strength::Strong => (0..count).collect(),
    }
}

/// A person in one pose, photographed without a fault
struct Photographed {
    person: Person,
    synthetic: SyntheticScan,
    /// The true measures
    truth: Vec<(Measure, f64)>,
}

impl Photographed {
    fn new(person: Person, held: Held, states_camera: bool, views: usize) -> Self {
        let stature_mm = person.avatar.stature_mm();
        let mut options = person.options(views, 1.0, true);
        if held != Held::A {
            let Camera {
                width_px,
                height_px,
                height_mm,
                ..
            } = options.camera;
            options.camera = Camera {
                height_mm,
                ..SyntheticOptions::camera_for(WIDER * stature_mm, width_px, height_px)
            };
        }
        let mut synthetic = synthesize(&person.avatar, &options);
        let error = Random::new(person.seed ^ 0x57a7).normal();
        synthetic.scan.stature_mm = Some(stature_mm + STATED_STATURE_SD_MM * error);
        if !states_camera {
            synthetic.scan.camera = CameraSetup::default();
        }
        let truth = measure_avatar(&person.avatar);
        Self {
            person,
            synthetic,
            truth,
        }
    }
}

/// One person of the study
struct Subject {
    /// In the order of [`Held::ALL`]
    photographed: Vec<Photographed>,
    other: Vec<(usize, View)>,
    states_camera: bool,
}

impl Subject {
    fn new(
        person: &Person,
        other: &Person,
        states_camera: bool,
        views: usize,
    ) -> Result<Self, MannequinError> {
        let photographed: Result<_, MannequinError> = Held::ALL
            .into_iter()
            .map(|held| {
                let person = held.person(person.seed)?;
                Ok(Photographed::new(person, held, states_camera, views))
            })
            .collect();
        // The room and the camera are those of the first person.
        let mut options = person.options(views, 1.0, true);
        let indices: Vec<usize> = (1..views).step_by(2).collect();
        options.turns = indices.iter().map(|&i| options.turns[i]).collect();
        let views = synthesize(&other.avatar, &options).scan.views;
        Ok(Self {
            photographed: photographed?,
            other: indices.into_iter().zip(views).collect(),
            states_camera,
        })
    }

    fn photographed(&self, held: Held) -> &Photographed {
        &self.photographed[held as usize]
    }
}

/// One fault in one strength
#[derive(Debug, Clone, Copy)]
struct Case {
    fault: usize,
    strength: Strength,
}

/// The result of one case of one person
#[derive(Debug, Clone)]
struct Found {
    person: String,
    seed: u64,
    states_camera: bool,
    case: Case,
    judged: Judged,
}

/// Scans random people with faults in their captures
///
/// Half of the people state neither the field of view nor the height of the camera.
///
/// # Errors
/// When there are no people or fewer than four views, or the study was cancelled.
pub fn study(
    options: &FaultsOptions,
    cancel: &CancelToken,
    on_step: &mut OnStep,
) -> Result<FaultsStudy, StudyError> {
    if options.people == 0 || options.views < 4 {
        return Err(StudyError::Nothing);
    }
    let faults = faults(&options.groups);
    let cases: Vec<Case> = (0..faults.len())
        .flat_map(|fault| Strength::ALL.map(|strength| Case { fault, strength }))
        .collect();
    // One more, whose photos are mixed with those of the last person
    let people: Vec<Person> = (FIRST_SEED..)
        .filter_map(|seed| Person::new(seed).ok())
        .filter(|person| BMI.contains(&person.bmi))
        .take_while(|_| !cancel.cancelled())
        .skip(options.skipped)
        .take(options.people + 1)
        .collect();
    let config = Config::new(Goal::Measure, Method::Fit);
    let mut found: Vec<Found> = Vec::new();
    for (index, pair) in people.windows(2).enumerate() {
        // Women and men mostly alternate: this varies by pairs that contain both.
        let states_camera = (options.skipped + index).div_ceil(2).is_multiple_of(2);
        let Ok(subject) = Subject::new(&pair[0], &pair[1], states_camera, options.views) else {
            continue;
        };
        let before = found.len();
        let mut shifted = |step: Step| {
            on_step(Step {
                done: before + step.done,
                total: options.people * cases.len(),
                text: step.text,
            });
        };
        let of_person = do_all(&cases, cancel, &mut shifted, |&case| {
            let found = try_case(&faults[case.fault], case, &subject, &config, cancel);
            let text = describe(&faults[case.fault], &found);
            (found, text)
        })?;
        found.extend(of_person);
    }
    if found.is_empty() {
        return Err(StudyError::Cancelled);
    }
    Ok(page::write_study(options, &faults, &found))
}

/// Joins studies of different people, from the JSON that `pirouette eval faults --json` prints for each
///
/// # Errors
/// When there is none, one is no such JSON, or the studies have people in common or differ in their views.
pub fn join(parts: &[Value]) -> Result<FaultsStudy, StudyError> {
    let faults = faults(&Group::ALL);
    let mut found: Vec<Found> = Vec::new();
    let mut views = None;
    for (index, part) in parts.iter().enumerate() {
        let not = |what: &'static str| StudyError::Part { index, what };
        let of_part = part["views"].as_u64().map(|views| views as usize);
        let captures = part["captures"].as_array().zip(of_part);
        let (captures, of_part) = captures.ok_or(not("no result of `eval faults --json`"))?;
        if *views.get_or_insert(of_part) != of_part {
            return Err(not("of another number of views than the first"));
        }
        let captures: Option<Vec<Found>> = captures
            .iter()
            .map(|capture| page::read_capture(&faults, capture))
            .collect();
        let captures = captures.ok_or(not("of another version of this study"))?;
        if captures
            .iter()
            .any(|new| found.iter().any(|old| old.seed == new.seed))
        {
            return Err(not("of a person who is also in an earlier part"));
        }
        found.extend(captures);
    }
    found.sort_by_key(|found| found.seed);
    let mut seeds: Vec<u64> = found.iter().map(|found| found.seed).collect();
    seeds.dedup();
    let Some(views) = views.filter(|_| !found.is_empty()) else {
        return Err(StudyError::Nothing);
    };
    let options = FaultsOptions {
        people: seeds.len(),
        views,
        ..FaultsOptions::default()
    };
    Ok(page::write_study(&options, &faults, &found))
}

fn describe(fault: &Fault, found: &Found) -> String {
    let judged = &found.judged;
    let details = judged
        .reason
        .clone()
        .unwrap_or_else(|| judged.wrong_measures());
    let details = if details.is_empty() {
        details
    } else {
        format!(" ({details})")
    };
    format!(
        "{}, {}, {}: {}{details}",
        fault.name(),
        found.case.strength.pick(fault.strengths),
        found.person,
        judged.outcome.name()
    )
}

fn try_case(
    fault: &Fault,
    case: Case,
    subject: &Subject,
    config: &Config,
    cancel: &CancelToken,
) -> Found {
    let Photographed {
        person,
        synthetic,
        truth,
    } = subject.photographed(case.strength.pick(fault.held));
    let setting = Setting {
        silhouettes: &synthetic.truth.silhouettes,
        camera: synthetic.truth.camera,
        mass_kg: person.bmi * (person.avatar.stature_mm() / 1000.0).powi(2),
        other: &subject.other,
        seed: person.seed,
    };
    let mut scan = synthetic.scan.clone();
    (fault.apply)(&mut scan, &setting, case.strength);
    Found {
        person: person.describe(),
        seed: person.seed,
        states_camera: subject.states_camera,
        case,
        judged: scan_in_memory(&scan, config, truth, cancel),
    }
}

/// Encodes a capture as files and scans them
fn scan_in_memory(
    scan: &Scan,
    config: &Config,
    truth: &[(Measure, f64)],
    cancel: &CancelToken,
) -> Judged {
    let files = match scan_files(scan) {
        Ok(files) => files,
        Err(error) => return refused(error.to_string()),
    };
    let source = match Source::from_files("capture", files) {
        Ok(source) => source,
        Err(error) => return refused(error.to_string()),
    };
    let options = JobOptions::default();
    judge(
        &run_job(source, config, &options, cancel, &mut |_| {}),
        truth,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the setting of a rendered person, without another one
    pub(super) fn setting_of(synthetic: &SyntheticScan) -> Setting<'_> {
        Setting {
            silhouettes: &synthetic.truth.silhouettes,
            camera: synthetic.truth.camera,
            mass_kg: 60.0,
            other: &[],
            seed: 1,
        }
    }

    #[test]
    fn faults_have_different_names_and_at_least_thirty_kinds() {
        let all = faults(&Group::ALL);
        let mut names: Vec<String> = all.iter().map(Fault::name).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), all.len());
        assert!(names.len() > 30);
        for fault in &all {
            let [weak, medium, strong] = fault.strengths;
            assert!(weak != medium && medium != strong && weak != strong);
        }
    }

    #[test]
    fn one_group_contains_the_healthy_captures_and_its_faults() {
        let names: Vec<String> = faults(&[Group::Masks]).iter().map(Fault::name).collect();
        let expected = [
            "none",
            "masks: too wide",
            "masks: too narrow",
            "masks: of the next view",
            "masks: inverted",
        ];
        assert_eq!(names, expected);
    }

    #[test]
    fn one_every_second_or_all_views_are_changed() {
        let indices = Strength::ALL.map(|strength| some_views(6, strength));
        assert_eq!(indices, [vec![1], vec![1, 3, 5], vec![0, 1, 2, 3, 4, 5]]);
    }

    #[test]
    fn no_people_give_no_table() {
        let options = FaultsOptions {
            people: 0,
            ..FaultsOptions::default()
        };
        let found = study(&options, &CancelToken::default(), &mut |_| {});
        assert_eq!(found.unwrap_err(), StudyError::Nothing);
    }

    #[test]
    fn a_cancelled_study_has_no_table() {
        let cancel = CancelToken::default();
        cancel.cancel();
        let found = study(&FaultsOptions::default(), &cancel, &mut |_| {});
        assert_eq!(found.unwrap_err(), StudyError::Cancelled);
    }
}
