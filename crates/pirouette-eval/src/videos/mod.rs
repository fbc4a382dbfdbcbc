//! Accuracy of the turn angles and girths from videos of rendered people.

mod flow;
mod page;

use std::f64::consts::TAU;
use std::ops::ControlFlow;
use std::path::PathBuf;

use pirouette::pipeline::{CancelToken, Config, Goal, Method, Report, run};
use pirouette::pose::PoseModel;
use pirouette::scan::Scan;
use pirouette::video::{FrameSource, Survey, SurveyOptions, TurnTrack, survey};
use pirouette_body::{Pose, TurnAngle};
use pirouette_files::job::{JobOptions, run_job};
use pirouette_files::video::{FfmpegVideo, VideoFile, VideoOptions as ScanOptions, scan_of_video};
use pirouette_synthetic::video::{TurnCourse, VideoOptions};
use pirouette_synthetic::{Clutter, SyntheticOptions};
use serde_json::Value;

use crate::film::{film, filmed};
use crate::people::Person;
use crate::table::Table;
use crate::trial::{Score, score_body};
use crate::turn_errors::TurnErrors;
use crate::{OnStep, Step, StudyError};
use flow::{TrunkMotion, TrunkShape, trunk_motion, with_flow};

/// Seed of the first person; no other study uses it or the following ones
const FIRST_SEED: u64 = 9001;

/// Columns, rows and frames per second of the videos
const SIZE_PX: (usize, usize) = (540, 960);
const FRAMES_PER_S: f64 = 30.0;

/// Numbers of views taken from each video; all tables but one are of the second
const VIEW_COUNTS: [usize; 3] = [8, 16, 36];
const USUAL: usize = 1;

/// Options of the study
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VideosOptions {
    /// Number of people
    pub people: usize,
    /// Folder of the videos; those that are there are not rendered again
    pub folder: PathBuf,
}

/// Results of the study
#[derive(Debug, Clone)]
pub struct VideosStudy {
    /// Angles by the course of the turn, by what finds them, and bodies
    pub tables: Vec<Table>,
    /// Every video, as JSON
    pub videos: Value,
    /// The page, in Markdown
    pub page: String,
}

/// The courses of the turn, with their names
const COURSES: [(&str, TurnCourse); 4] = [
    (
        "one turn at an even speed",
        TurnCourse {
            enter_s: 0.0,
            start_radians: 0.0,
            turned_radians: TAU,
            turn_s: 14.0,
            still_s: 1.0,
            speed_change: 0.0,
            pause_s: 0.0,
        },
    ),
    (
        "clockwise, at a changing speed",
        TurnCourse {
            enter_s: 0.0,
            start_radians: 0.3,
            turned_radians: -TAU,
            turn_s: 12.0,
            still_s: 0.5,
            speed_change: 0.5,
            pause_s: 0.0,
        },
    ),
    (
        "comes in, with a pause of 3 s",
        TurnCourse {
            enter_s: 2.0,
            start_radians: 0.0,
            turned_radians: TAU,
            turn_s: 10.0,
            still_s: 0.5,
            speed_change: 0.3,
            pause_s: 3.0,
        },
    ),
    (
        "one turn and a half, fast",
        TurnCourse {
            enter_s: 0.0,
            start_radians: -0.5,
            turned_radians: 1.5 * TAU,
            turn_s: 10.0,
            still_s: 0.5,
            speed_change: 0.3,
            pause_s: 0.0,
        },
    ),
];

/// What finds the angles of a video
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Finder {
    Keypoints,
    CircularFlow,
    EllipticFlow,
    WithoutBias,
    Skeleton,
    Body,
}

impl Finder {
    const ALL: [Finder; 6] = [
        Finder::Keypoints,
        Finder::CircularFlow,
        Finder::EllipticFlow,
        Finder::WithoutBias,
        Finder::Skeleton,
        Finder::Body,
    ];

    fn name(self) -> &'static str {
        match self {
            Finder::Keypoints => "keypoints of all frames",
            Finder::CircularFlow => "keypoints, flow on a circular trunk",
            Finder::EllipticFlow => "keypoints, flow on an elliptic trunk",
            Finder::WithoutBias => "keypoints without the bias of the detector",
            Finder::Skeleton => "+ skeleton fit",
            Finder::Body => "+ body fit",
        }
    }
}

/// Results of the scan of a video
struct Scanned {
    /// Errors of the angles in the result
    errors: TurnErrors,
    score: Score,
}

/// Results of one video
struct Found {
    course: usize,
    person: String,
    /// Scans by the number of views, or why there are none
    scans: [Result<Scanned, String>; VIEW_COUNTS.len()],
    /// Errors of the angles of the frames of the usual scan
    finders: [Option<TurnErrors>; Finder::ALL.len()],
    /// Body from these frames with their true angles
    with_true_angles: Option<Score>,
}

/// Films random people, and scans the videos
///
/// The true angle of a frame is that of the swaying person's hips.
///
/// # Errors
/// When there are no people, or the study was cancelled.
pub fn study(
    options: &VideosOptions,
    model: &PoseModel,
    cancel: &CancelToken,
    on_step: &mut OnStep,
) -> Result<VideosStudy, StudyError> {
    let people: Vec<Person> = (FIRST_SEED..FIRST_SEED + options.people as u64)
        .filter_map(|seed| Person::new(seed).ok())
        .collect();
    if people.is_empty() {
        return Err(StudyError::Nothing);
    }
    let total = people.len() * COURSES.len();
    let mut found = Vec::new();
    for person in &people {
        for (course, (name, _)) in COURSES.iter().enumerate() {
            let result = scan_video(person, course, options, model, cancel);
            if cancel.cancelled() {
                return Err(StudyError::Cancelled);
            }
            let text = format!("{}, {name}: {}", result.person, page::describe(&result));
            found.push(result);
            on_step(Step {
                done: found.len(),
                total,
                text,
            });
        }
    }
    let tables = page::tables(&found);
    Ok(VideosStudy {
        page: page::page(options.people, &tables),
        videos: found.iter().map(page::to_json).collect(),
        tables,
    })
}

/// Films one person and scans the video
fn scan_video(
    person: &Person,
    course: usize,
    options: &VideosOptions,
    model: &PoseModel,
    cancel: &CancelToken,
) -> Found {
    let folder = options.folder.join(format!("{}-{course}", person.seed));
    let mut found = Found {
        course,
        person: person.describe(),
        scans: VIEW_COUNTS.map(|_| Err(String::new())),
        finders: Default::default(),
        with_true_angles: None,
    };
    let turn = COURSES[course].1;
    let truth = match filmed(&folder) {
        Some(truth) => Ok(truth),
        None => film(
            &person.avatar,
            &video_options(person, turn),
            &folder,
            cancel,
            &mut |_| {},
        )
        .map_err(|error| error.to_string()),
    };
    let work = Work {
        person,
        video: VideoFile::find(&folder),
        truth: truth.clone().unwrap_or_default(),
        model,
        cancel,
    };
    for (index, &views) in VIEW_COUNTS.iter().enumerate() {
        let done = match &truth {
            Ok(_) => work.scan(views),
            Err(reason) => Err(reason.clone()),
        };
        if let (USUAL, Ok((scan, report))) = (index, &done) {
            found.finders = work.compare_finders(scan, report).unwrap_or_default();
            found.with_true_angles = work.scan_with_true_angles(scan);
        }
        found.scans[index] = done.map(|(scan, report)| Scanned {
            errors: work.errors(&scan, &turns_in_use(&scan, &report)),
            score: score_body(person, &report),
        });
    }
    found
}

fn video_options(person: &Person, turn: TurnCourse) -> VideoOptions {
    VideoOptions {
        seed: person.seed,
        camera: SyntheticOptions::camera_for(person.avatar.stature_mm(), SIZE_PX.0, SIZE_PX.1),
        sway: 1.0,
        sensor_noise: 2.0,
        clutter: Clutter::LivedIn,
        frames_per_s: FRAMES_PER_S,
        turn,
    }
}

/// A turn that was found, with its standard deviation in radians if there is one; by view
type Turns = Vec<Option<(TurnAngle, Option<f64>)>>;

/// Returns the turns of a result; rejected views have none
fn turns_in_use(scan: &Scan, report: &Report) -> Turns {
    let mut turns = vec![None; scan.views.len()];
    for view in &report.views {
        let sd = view.skeleton.map(|skeleton| skeleton.turn_sd_radians);
        turns[view.id.0] = Some((view.turn_in_use(&scan.views[view.id.0]), sd));
    }
    turns
}

/// A video and what its scans need
struct Work<'a> {
    person: &'a Person,
    video: Option<VideoFile>,
    /// True angle of each frame, in radians
    truth: Vec<f64>,
    model: &'a PoseModel,
    cancel: &'a CancelToken,
}

impl Work<'_> {
    /// Scans the video as `pirouette scan` does
    fn scan(&self, views: usize) -> Result<(Scan, Report), String> {
        let video = self.video.as_ref().ok_or("there is no video")?;
        let options = ScanOptions { views };
        let found = scan_of_video(video, self.model, &options, self.cancel, &mut |_| {});
        let found = found.map_err(|e| e.to_string())?;
        let job_options = JobOptions {
            pose_model: Some(self.model),
            ..JobOptions::default()
        };
        let done = run_job(
            found.source,
            &config(),
            &job_options,
            self.cancel,
            &mut |_| {},
        );
        let done = done.map_err(|e| e.to_string())?;
        Ok((done.loaded.scan, done.report))
    }

    /// Returns the true turn of a frame
    fn true_turn(&self, time_s: f64) -> Option<TurnAngle> {
        let frame = (time_s * FRAMES_PER_S).round() as usize;
        self.truth
            .get(frame)
            .map(|&turn| TurnAngle::from_radians(turn))
    }

    fn errors(&self, scan: &Scan, turns: &Turns) -> TurnErrors {
        let known = scan.views.iter().zip(turns).filter_map(|(view, &found)| {
            let truth = self.true_turn(view.time_s?)?;
            Some((found?, truth))
        });
        let (found, truth): (Vec<_>, Vec<_>) = known.unzip();
        TurnErrors::new(&found, &truth)
    }

    /// Returns the errors by each finder
    fn compare_finders(
        &self,
        scan: &Scan,
        report: &Report,
    ) -> Option<[Option<TurnErrors>; Finder::ALL.len()]> {
        let (survey, motions) = self.look()?;
        let searched = survey.frames.iter().filter(|frame| frame.searched);
        let track = TurnTrack::find(searched.map(|f| (f.time_s, f.keypoints.as_ref()))).ok()?;
        let with_flow = |shape| with_flow(&track, &motions, shape).unwrap_or_else(|| track.clone());
        let of_track = |track: TurnTrack| -> Turns {
            let turn = |time_s| Some((TurnAngle::from_radians(track.angle_at(time_s)?), None));
            let views = scan.views.iter();
            views.map(|view| view.time_s.and_then(turn)).collect()
        };
        let mut by_skeleton: Turns = vec![None; scan.views.len()];
        for view in &report.views {
            let turned =
                |turn: TurnAngle, pose: &Pose| turn.radians() + pose.turned_more().radians();
            by_skeleton[view.id.0] = view.skeleton.as_ref().map(|skeleton| {
                let turn = turned(skeleton.turn, &skeleton.pose);
                (TurnAngle::from_radians(turn), None)
            });
        }
        Some(Finder::ALL.map(|finder| {
            let turns = match finder {
                Finder::Keypoints => of_track(track.clone()),
                Finder::CircularFlow => of_track(with_flow(TrunkShape::Circular)),
                Finder::EllipticFlow => of_track(with_flow(TrunkShape::Elliptic)),
                Finder::WithoutBias => of_track(track.clone().without_detector_bias()),
                Finder::Skeleton => by_skeleton.clone(),
                Finder::Body => turns_in_use(scan, report),
            };
            Some(self.errors(scan, &turns))
        }))
    }

    /// Returns the facts about all frames, and the motions of the trunk between those in which the person was searched
    fn look(&self) -> Option<(Survey, Vec<TrunkMotion>)> {
        let mut video = FfmpegVideo::open(&self.video.as_ref()?.video).ok()?;
        let options = SurveyOptions::default();
        let go_on = &mut |_| ControlFlow::Continue(());
        let survey = survey(&mut video, self.model, &options, go_on).ok()?;
        let searched = survey.frames.iter().filter(|frame| frame.searched);
        let indices: Vec<usize> = searched.map(|frame| frame.index).collect();
        let mut before: Option<pirouette::video::Frame> = None;
        let mut motions = Vec::new();
        video
            .frames(options.max_side_px, Some(&indices), &mut |frame| {
                if let Some(before) = &before
                    && let Some(facts) = survey.frames.iter().find(|f| f.index == before.index)
                    && let Some(keypoints) = &facts.keypoints
                    && let Some(motion) = trunk_motion(&before.photo, &frame.photo, keypoints)
                {
                    motions.push(TrunkMotion {
                        from_s: before.time_s,
                        to_s: frame.time_s,
                        motion,
                    });
                }
                before = Some(frame);
                ControlFlow::Continue(())
            })
            .ok()?;
        Some((survey, motions))
    }

    /// Scores the body from the same frames and keypoints, with their true angles
    fn scan_with_true_angles(&self, scan: &Scan) -> Option<Score> {
        let mut known = scan.clone();
        for view in &mut known.views {
            view.turn = self.true_turn(view.time_s?)?;
            view.turn_sd_radians = TRUE_ANGLE_SD_DEGREES.to_radians();
        }
        let report = run(&known, &config(), self.cancel, &mut |_| {}).ok()?;
        Some(score_body(self.person, &report))
    }
}

/// Standard deviation of true angles as the scan gets them, in degrees
const TRUE_ANGLE_SD_DEGREES: f64 = 0.5;

fn config() -> Config {
    Config::new(Goal::Measure, Method::Fit)
}
