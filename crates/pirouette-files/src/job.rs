//! A complete job: load a scan, determine its scale, compute, and return the results.
//!
//! A front end opens a [`Source`], calls [`run_job`], and takes the artifacts as bytes or has them written into a
//! folder. It provides flags, progress display and texts; all decisions are made here.

use std::collections::BTreeMap;
#[cfg(feature = "folders")]
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use web_time::Instant;

use pirouette::check::{CheckError, check_scan};
use pirouette::detect::detect_keypoints;
use pirouette::estimate::{EstimateError, estimate_keypoints};
use pirouette::geom::TriMesh;
use pirouette::mesh_scan::{MeshScanError, MeshScanOptions, scan_of_mesh};
use pirouette::pipeline::{
    self, AvatarSource, CancelToken, Capture, Config, Event, Goal, PipelineError, Report, Stage,
    check_capture,
};
use pirouette::scale::{Card, ScaleError, scale_by_card, scale_by_pixels};
use pirouette::scan::{KeypointKind, KeypointSource, Photo, StatureFrom, View};
use pirouette::sizes::{Chart, advise_person};
use pirouette_pose::PoseModel;
use serde_json::Value;
use thiserror::Error;

use crate::report::json::measurements_json;
#[cfg(feature = "folders")]
use crate::results::write_results;
use crate::results::{ResultError, ResultOptions, make_artifacts, result_value};
use crate::scan_folder::{
    FailedView, GivenKeypoints, LoadOptions, LoadedScan, ScanError, ScanWarning, ViewError,
    WithoutKeypoints, load_source,
};
use crate::source::Source;

/// Source of the scale when the manifest contains neither the stature nor the size of a pixel
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ScaleSource {
    /// An ID-1 card (85.60 x 53.98 mm, as bank cards) next to the person
    Card,
}

/// Progress and warnings of a job
#[derive(Debug)]
#[non_exhaustive]
pub enum JobEvent<'a> {
    /// Progress of a stage, [`Stage::Load`] included, or a warning of the computation
    Pipeline(Event),
    /// An automatic correction while loading
    LoadWarning(&'a ScanWarning),
    /// A view that cannot be loaded and is excluded
    ViewFailed(&'a FailedView),
    /// A card provides the scale
    CardFound {
        /// Name of the view that shows it
        view: &'a str,
        /// The card
        card: &'a Card,
    },
    /// No card was searched for, since the manifest provides the stature
    CardNotNeeded,
}

/// Why a job has no result
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum JobError {
    /// The scan cannot be loaded
    #[error(transparent)]
    Scan(#[from] ScanError),
    /// The scale cannot be determined from a card
    #[error("scale from a card: {0}")]
    Card(#[source] ScaleError),
    /// The scale cannot be computed from the size of a pixel
    #[error("camera.mm_per_px: {0}")]
    PixelSize(#[source] ScaleError),
    /// The photo of the room without the person cannot be used
    #[error("the photo of the room without the person: {0}")]
    Background(String),
    /// There are no keypoints, and they cannot be estimated
    #[error(
        "there are no keypoints, and they cannot be estimated: {0}; \
         or install the pose detector with 'pirouette models install'"
    )]
    Estimate(#[source] EstimateError),
    /// Turn angles are unknown, and there are no keypoints to find them
    #[error(
        "unknown turn angles cannot be found without keypoints: give angle_deg of all views in scan.json, provide keypoints, \
         or install the pose detector with 'pirouette models install'"
    )]
    AnglesUnknown,
    /// The mesh cannot be measured
    #[error(transparent)]
    Mesh(#[from] MeshScanError),
    /// The photos cannot give a body
    #[error(transparent)]
    Check(#[from] CheckError),
    /// The computation failed or was cancelled
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
}

/// A finished job
#[derive(Debug)]
pub struct FinishedJob {
    /// The scan, with its scale
    pub loaded: LoadedScan,
    /// Duration of loading, in seconds
    pub load_seconds: f64,
    /// Results of the computation
    pub report: Report,
}

/// Options of a job in addition to the configuration of the computation
#[derive(Debug, Clone, Copy, Default)]
pub struct JobOptions<'a> {
    /// Source of the scale if the manifest contains neither the stature nor the size of a pixel
    pub scale: Option<ScaleSource>,
    /// Detects keypoints in photos without a keypoint file
    ///
    /// Without it, keypoints are estimated if no photo has any; otherwise, photos without keypoints are unusable.
    pub pose_model: Option<&'a PoseModel>,
    /// Source of the keypoints
    pub keypoints: KeypointChoice<'a>,
    /// Whether turn angles are found in the photos, even if they are stated
    pub angles_unknown: bool,
}

/// Source of the keypoints of a job
#[derive(Debug, Clone, Copy, Default)]
pub enum KeypointChoice<'a> {
    /// The files in the scan, otherwise the detector, otherwise an estimate
    #[default]
    Best,
    /// These files instead of those in the scan
    Files(&'a GivenKeypoints),
    /// An estimate, from the photos and the turn angles alone
    Estimate,
}

/// Loads a scan, detects missing keypoints, determines the scale, and computes up to the goal of `config`
///
/// `on_event` receives progress and warnings; calls are serialized but may come from any thread.
///
/// # Errors
/// When the scan cannot be loaded, its scale cannot be determined, or the computation fails or is cancelled.
pub fn run_job(
    source: Source,
    config: &Config,
    options: &JobOptions,
    cancel: &CancelToken,
    on_event: &mut (dyn FnMut(JobEvent) + Send),
) -> Result<FinishedJob, JobError> {
    let Prepared {
        loaded,
        load_seconds,
        detect_seconds,
    } = prepare(source, config.goal, options, cancel, on_event)?;
    let mut report = pipeline::run(&loaded.scan, config, cancel, &mut |event| {
        on_event(JobEvent::Pipeline(event));
    })?;
    let detected = detect_seconds.map(|seconds| (Stage::Detect, seconds));
    report.seconds.splice(..0, detected);
    Ok(FinishedJob {
        loaded,
        load_seconds,
        report,
    })
}

/// Loads a scan, detects missing keypoints, determines the scale, and checks each photo, without computing a body
///
/// Warnings and rejected views are those that [`run_job`] reports before it starts to compute.
///
/// # Errors
/// As [`run_job`], when no skeleton fits.
pub fn check_job(
    source: Source,
    avatar: &AvatarSource,
    options: &JobOptions,
    cancel: &CancelToken,
    on_event: &mut (dyn FnMut(JobEvent) + Send),
) -> Result<(LoadedScan, Capture), JobError> {
    let prepared = prepare(source, Goal::Measure, options, cancel, on_event)?;
    let capture = check_capture(&prepared.loaded.scan, avatar)?;
    Ok((prepared.loaded, capture))
}

/// Fits a body to a mesh of a person and measures it, up to the goal of `config`
///
/// # Errors
/// When the mesh is no person, or the computation fails or is cancelled.
pub fn run_mesh_job(
    mesh: &TriMesh,
    options: &MeshScanOptions,
    config: &Config,
    cancel: &CancelToken,
    on_event: &mut (dyn FnMut(JobEvent) + Send),
) -> Result<FinishedJob, JobError> {
    let (stage, start) = (Stage::Load, Instant::now());
    on_event(JobEvent::Pipeline(Event::StageStarted {
        stage,
        step_count: 1,
    }));
    let scan = scan_of_mesh(mesh, options, &|| cancel.cancelled())?;
    let load_seconds = start.elapsed().as_secs_f64();
    on_event(JobEvent::Pipeline(Event::StageDone {
        stage,
        seconds: load_seconds,
    }));
    let report = pipeline::run(&scan, config, cancel, &mut |event| {
        on_event(JobEvent::Pipeline(event));
    })?;
    Ok(FinishedJob {
        loaded: LoadedScan::in_memory(scan),
        load_seconds,
        report,
    })
}

/// A scan that is ready to compute
struct Prepared {
    loaded: LoadedScan,
    load_seconds: f64,
    detect_seconds: Option<f64>,
}

/// Loads a scan, detects missing keypoints, checks it and determines the scale
fn prepare(
    source: Source,
    goal: Goal,
    options: &JobOptions,
    cancel: &CancelToken,
    on_event: &mut (dyn FnMut(JobEvent) + Send),
) -> Result<Prepared, JobError> {
    let start = Instant::now();
    let load_options = LoadOptions {
        // Silhouettes may come from photos of any size; only a body requires a single camera.
        one_shape: goal > Goal::Segment,
        without_keypoints: match (options.keypoints, options.pose_model) {
            (KeypointChoice::Estimate, _) | (_, Some(_)) => WithoutKeypoints::Loaded,
            (_, None) => WithoutKeypoints::LoadedIfAll,
        },
        ignore_keypoint_files: matches!(options.keypoints, KeypointChoice::Estimate),
        angles_unknown: options.angles_unknown,
        keypoints: match options.keypoints {
            KeypointChoice::Files(files) => Some(files),
            KeypointChoice::Best | KeypointChoice::Estimate => None,
        },
        ..LoadOptions::default()
    };
    let mut loaded = load_source(source, &load_options)?;
    let load_seconds = start.elapsed().as_secs_f64();
    on_event(JobEvent::Pipeline(Event::StageDone {
        stage: Stage::Load,
        seconds: load_seconds,
    }));
    let detect_seconds = match (options.keypoints, options.pose_model) {
        (KeypointChoice::Best | KeypointChoice::Files(_), Some(model)) => {
            detect(&mut loaded, model, cancel, on_event)?
        }
        (KeypointChoice::Estimate, _) | (_, None) => estimate(&mut loaded, cancel, on_event)?,
    };
    if goal > Goal::Segment {
        reject_unknown_angles(&mut loaded);
        check(&mut loaded)?;
        find_scale(&mut loaded, options.scale, on_event)?;
    }
    for warning in &loaded.warnings {
        on_event(JobEvent::LoadWarning(warning));
    }
    for failed in &loaded.failed {
        on_event(JobEvent::ViewFailed(failed));
    }
    Ok(Prepared {
        loaded,
        load_seconds,
        detect_seconds,
    })
}

/// Leaves out views whose turn angles are unknown and cannot be found
fn reject_unknown_angles(loaded: &mut LoadedScan) {
    let views = loaded.scan.views.iter().enumerate();
    let unknown = views.filter(|(_, view)| {
        !view.turn_is_stated() && view.keypoints.found_count() < MIN_JOINTS_OF_ANGLE
    });
    let rejected = unknown
        .map(|(index, _)| (index, ViewError::AngleUnknown))
        .collect();
    loaded.reject(rejected);
}

/// Minimum number of joints by which an unknown turn angle can be found
const MIN_JOINTS_OF_ANGLE: usize = 8;

/// Checks the scan, and leaves out repeated photos
fn check(loaded: &mut LoadedScan) -> Result<(), CheckError> {
    let found = check_scan(&mut loaded.scan)?;
    let of_scan = found.warnings.into_iter().map(ScanWarning::Check);
    loaded.warnings.extend(of_scan);
    let rejected = found.repeats.into_iter().map(|(view, first)| {
        let first = loaded.scan.views[first].name.clone();
        (view, ViewError::SamePhoto { first })
    });
    let rejected = rejected.collect();
    loaded.reject(rejected);
    Ok(())
}

/// Detects the keypoints of views without a keypoint file; returns the duration, in seconds
pub(crate) fn detect(
    loaded: &mut LoadedScan,
    model: &PoseModel,
    cancel: &CancelToken,
    on_event: &mut (dyn FnMut(JobEvent) + Send),
) -> Result<Option<f64>, PipelineError> {
    let indices = std::mem::take(&mut loaded.without_keypoints);
    if indices.is_empty() {
        return Ok(None);
    }
    let (stage, start) = (Stage::Detect, Instant::now());
    on_event(JobEvent::Pipeline(Event::StageStarted {
        stage,
        step_count: indices.len(),
    }));
    let photos: Vec<&Photo> = indices
        .iter()
        .map(|&i| &loaded.scan.views[i].photo)
        .collect();
    let progress = Mutex::new(&mut *on_event);
    let step = || {
        let mut on_event = progress.lock().unwrap_or_else(PoisonError::into_inner);
        on_event(JobEvent::Pipeline(Event::StepDone { stage }));
    };
    // Photos of one scene have a clean plate, which knows more.
    let single = loaded.scan.views.len() < 2 || !loaded.scan.has_one_shape();
    // Of two people in a video, the one whose turn was found
    let two_people = loaded.video.as_ref().and_then(|video| video.two_people);
    let person = two_people.and_then(|people| people.measured(photos[0].width()));
    let found = detect_keypoints(model, &photos, person, single, &step, &|| {
        cancel.cancelled()
    });
    if cancel.cancelled() {
        return Err(PipelineError::Cancelled);
    }
    if let Some(&first) = found.second_person.first() {
        loaded.warnings.push(ScanWarning::SecondPerson {
            count: found.second_person.len(),
            first: loaded.photo_file(indices[first]).to_owned(),
        });
    }
    let mut rejected = Vec::new();
    let found = found.keypoints.into_iter().zip(found.person_odds);
    for (index, (found, person_odds)) in indices.into_iter().zip(found) {
        let view = &mut loaded.scan.views[index];
        view.person_odds = person_odds;
        match found {
            Some(keypoints) => {
                view.keypoints = keypoints;
                view.keypoints_from = KeypointSource::BlazePose;
                view.keypoint_kind = KeypointKind::MediaPipe;
            }
            None if view.mask.is_some() => {}
            None => {
                let file = loaded.photo_file(index).to_owned();
                rejected.push((index, ViewError::NotDetected { file }));
            }
        }
    }
    loaded.reject(rejected);
    let seconds = start.elapsed().as_secs_f64();
    on_event(JobEvent::Pipeline(Event::StageDone { stage, seconds }));
    Ok(Some(seconds))
}

/// Estimates the keypoints of all views if none has any; returns the duration, in seconds
fn estimate(
    loaded: &mut LoadedScan,
    cancel: &CancelToken,
    on_event: &mut (dyn FnMut(JobEvent) + Send),
) -> Result<Option<f64>, JobError> {
    let missing_count = std::mem::take(&mut loaded.without_keypoints).len();
    if missing_count < loaded.scan.views.len() || missing_count == 0 {
        return Ok(None);
    }
    let (stage, start) = (Stage::Detect, Instant::now());
    on_event(JobEvent::Pipeline(Event::StageStarted {
        stage,
        step_count: 1,
    }));
    if !loaded.scan.views.iter().all(View::turn_is_stated) {
        return Err(JobError::AnglesUnknown);
    }
    // Without a detector, the photo of the room decides: it must be usable if it is given.
    let unusable = loaded.warnings.iter().find_map(|warning| match warning {
        ScanWarning::BackgroundUnusable { reason } => Some(reason.clone()),
        _ => None,
    });
    if let Some(reason) = unusable {
        return Err(JobError::Background(reason));
    }
    let background = loaded.scan.background.as_ref();
    let background =
        background.filter(|background| background.known.as_slice().iter().all(|known| *known));
    let background = background.map(|background| &background.photo);
    let estimated = estimate_keypoints(&loaded.scan, background, &|| cancel.cancelled());
    let estimated = estimated.map_err(JobError::Estimate)?;
    if cancel.cancelled() {
        return Err(PipelineError::Cancelled.into());
    }
    for (view, keypoints) in loaded.scan.views.iter_mut().zip(estimated) {
        view.keypoints = keypoints;
        view.keypoints_from = KeypointSource::Estimate;
    }
    let seconds = start.elapsed().as_secs_f64();
    on_event(JobEvent::Pipeline(Event::StageDone { stage, seconds }));
    Ok(Some(seconds))
}

/// Determines the scale if the manifest does not contain the stature
fn find_scale(
    loaded: &mut LoadedScan,
    source: Option<ScaleSource>,
    on_event: &mut (dyn FnMut(JobEvent) + Send),
) -> Result<(), JobError> {
    let scan = &mut loaded.scan;
    if scan.stature_mm.is_some() {
        if source.is_some() {
            on_event(JobEvent::CardNotNeeded);
        }
        return Ok(());
    }
    if let Some(ScaleSource::Card) = source {
        let (view, card) = scale_by_card(scan).map_err(JobError::Card)?;
        on_event(JobEvent::CardFound {
            view: &view,
            card: &card,
        });
    } else if let (Some(mm_per_px), Some(view)) = (scan.mm_per_px, scan.views.first()) {
        // The photo may have been shrunk on loading.
        let shrunk = view.input_size_px.1 as f64 / view.photo.height() as f64;
        scale_by_pixels(scan, mm_per_px * shrunk, StatureFrom::PixelSize)
            .map_err(JobError::PixelSize)?;
    }
    Ok(())
}

impl FinishedJob {
    /// Returns all results in memory: bytes by name, such as `result.json` and `views/000/mask.png`
    ///
    /// # Errors
    /// When an encoder rejects an image.
    pub fn artifacts(
        &self,
        options: &ResultOptions,
    ) -> Result<BTreeMap<String, Vec<u8>>, ResultError> {
        make_artifacts(&self.loaded, self.load_seconds, &self.report, options)
    }

    /// Writes all results into a folder, file by file, `result.json` last
    ///
    /// # Errors
    /// When the folder cannot be written; files written until then remain, none is partial.
    #[cfg(feature = "folders")]
    pub fn write(&self, folder: &Path, options: &ResultOptions) -> Result<(), ResultError> {
        write_results(
            folder,
            &self.loaded,
            self.load_seconds,
            &self.report,
            options,
        )
    }

    /// Returns the content of `result.json` and `measurements.json` in one object
    pub fn to_json(&self, charts: &[Chart]) -> Value {
        let mut value = result_value(&self.loaded, self.load_seconds, &self.report);
        if let Some(measurements) = &self.report.measurements {
            let advice = advise_person(measurements, charts);
            let measured = measurements_json(measurements, &advice);
            if let (Value::Object(value), Value::Object(measured)) = (&mut value, measured) {
                value.extend(measured);
            }
        }
        value
    }
}
