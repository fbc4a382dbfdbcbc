//! A video as a scan: chosen frames, named by their times, with a manifest.

use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use pirouette::pipeline::CancelToken;
use pirouette::scan::Background;
use pirouette::video::{
    ExtractError, ExtractOptions, Extracted, ExtractedView, TurnTrack, TwoPeople, extract_views,
};
use pirouette_geom::parallel::prelude::*;
use pirouette_pose::PoseModel;
use serde_json::{Map, Value, json};
use thiserror::Error;

use super::{FfmpegVideo, VideoError};
use crate::formats::json::to_strict;
use crate::formats::manifest::{self, PersonBesideAnother, Side, VideoFacts};
use crate::formats::photo::{encode_background, encode_jpeg};
use crate::source::{Source, SourceError, read_bounded_file};

/// File extensions of videos
const EXTENSIONS: [&str; 17] = [
    "mp4", "mov", "m4v", "mkv", "webm", "avi", "3gp", "3g2", "mts", "m2ts", "ts", "mpg", "mpeg",
    "wmv", "ogv", "flv", "mxf",
];

/// Quality of the extracted frames, which are compressed a second time
const JPEG_QUALITY: u8 = 97;

/// Name of the picture of the scene without the person
const BACKGROUND_FILE: &str = "background.png";

/// Largest manifest, in bytes
const MAX_JSON_BYTES: u64 = 1 << 20;

/// A video of a person, and its manifest
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VideoFile {
    /// The video
    pub video: PathBuf,
    /// Stature and other facts: `scan.json` in the folder of the video, or the file of its name that ends in `.json`
    pub manifest: Option<PathBuf>,
}

impl VideoFile {
    /// Returns the video that a path names: the file itself, or the only video in a folder without photos
    pub fn find(path: &Path) -> Option<Self> {
        if path.is_file() {
            let manifest = path.with_extension("json");
            return has_extension(path, &EXTENSIONS).then(|| Self {
                video: path.to_owned(),
                manifest: manifest.is_file().then_some(manifest),
            });
        }
        let entries = fs::read_dir(path).ok()?.flatten().map(|entry| entry.path());
        let files: Vec<PathBuf> = entries.filter(|path| path.is_file()).collect();
        let of = |extensions: &[&str]| -> Vec<&PathBuf> {
            files
                .iter()
                .filter(|file| has_extension(file, extensions))
                .collect()
        };
        let (videos, photos) = (of(&EXTENSIONS), of(&crate::scan_folder::PHOTO_EXTENSIONS));
        let [video] = videos.as_slice() else {
            return None;
        };
        let manifest = path.join(manifest::FILE_NAME);
        photos.is_empty().then(|| Self {
            video: (*video).clone(),
            manifest: manifest.is_file().then_some(manifest),
        })
    }
}

fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    extension.is_some_and(|extension| extensions.contains(&extension.as_str()))
}

/// Options of [`scan_of_video`]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VideoOptions {
    /// Number of views of one turn
    pub views: usize,
}

impl Default for VideoOptions {
    fn default() -> Self {
        Self { views: 16 }
    }
}

/// A video as a scan
#[derive(Debug)]
pub struct VideoScan {
    /// The chosen frames as JPEG files, and the manifest
    pub source: Source,
    /// What was found in the video, without the pictures
    pub extracted: Extracted,
}

/// Why a video gives no scan
#[derive(Debug, Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages document the variants")]
pub enum VideoScanError {
    #[error(transparent)]
    Video(#[from] VideoError),
    #[error("{}: {source}", path.display())]
    Extract {
        path: PathBuf,
        #[source]
        source: ExtractError<VideoError>,
    },
    #[error("cancelled")]
    Cancelled,
    #[error("{}: {message}", path.display())]
    Manifest { path: PathBuf, message: String },
    #[error("a frame cannot be encoded: {0}")]
    Encode(#[from] jpeg_encoder::EncodingError),
    #[error("the picture of the room cannot be encoded: {0}")]
    EncodeBackground(#[from] image::ImageError),
    #[error("{}: {source}", path.display())]
    Source {
        path: PathBuf,
        #[source]
        source: SourceError,
    },
}

/// Finds the turn in a video, and returns sharp frames of it as a scan
///
/// `on_share` gets the share of the video that is done, from 0 to 1, where its duration is known.
///
/// # Errors
/// When the video cannot be decoded, shows no person who turns, or its manifest cannot be used.
pub fn scan_of_video(
    file: &VideoFile,
    model: &PoseModel,
    options: &VideoOptions,
    cancel: &CancelToken,
    on_share: &mut dyn FnMut(f64),
) -> Result<VideoScan, VideoScanError> {
    let manifest = read_manifest(file)?;
    let mut video = FfmpegVideo::open(&file.video)?;
    let duration_s = video.duration_s();
    let mut extract = ExtractOptions::default();
    extract.choice.views = options.views;
    let extracted = extract_views(&mut video, model, &extract, &mut |time_s| {
        if let Some(duration_s) = duration_s {
            on_share((time_s / duration_s).clamp(0.0, 1.0));
        }
        if cancel.cancelled() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    });
    let mut extracted = extracted.map_err(|source| match source {
        ExtractError::Cancelled => VideoScanError::Cancelled,
        ExtractError::Decode(source) => VideoScanError::Video(source),
        source => VideoScanError::Extract {
            path: file.video.clone(),
            source,
        },
    })?;
    let views = std::mem::take(&mut extracted.views);
    let facts = VideoFacts {
        turned_deg: round(extracted.choice.turned_radians.to_degrees(), 10.0),
        missing_count: extracted.choice.missing,
        hdr: video.is_hdr(),
        two_people: extracted
            .two_people
            .map(|people| person_beside_another(&people, extracted.size_px.0)),
        turn: turn_over_time(&extracted.track),
    };
    let background = extracted.background.take();
    let source = make_source(file, manifest, &facts, (&views, background.as_ref()))?;
    Ok(VideoScan { source, extracted })
}

/// Encodes the frames and the manifest as files in memory
fn make_source(
    file: &VideoFile,
    mut manifest: Map<String, Value>,
    facts: &VideoFacts,
    (views, background): (&[ExtractedView], Option<&Background>),
) -> Result<Source, VideoScanError> {
    let name = |view: &ExtractedView| format!("{:07.3}s.jpg", view.time_s);
    let entries: Vec<Value> = views
        .iter()
        .map(|view| {
            json!({
                "image": name(view),
                "angle_deg": round(view.turn.degrees(), 10.0),
                "time_s": round(view.time_s, 1000.0),
            })
        })
        .collect();
    manifest.insert("views".to_owned(), Value::Array(entries));
    manifest.insert("video".to_owned(), json!(facts));
    let encoded: Vec<_> = views
        .par_iter()
        .map(|view| encode_jpeg(&view.photo, JPEG_QUALITY))
        .collect();
    let mut files: Vec<(String, Arc<[u8]>)> = Vec::with_capacity(views.len() + 1);
    for (view, bytes) in views.iter().zip(encoded) {
        files.push((name(view), Arc::from(bytes?)));
    }
    if let Some(background) = background {
        let png = encode_background(background)?;
        files.push((BACKGROUND_FILE.to_owned(), Arc::from(png)));
        manifest.insert("background".to_owned(), json!(BACKGROUND_FILE));
    }
    let manifest = Value::Object(manifest).to_string().into_bytes();
    files.push((manifest::FILE_NAME.to_owned(), Arc::from(manifest)));
    let stem = file.video.file_stem().unwrap_or_default();
    Source::from_files(&stem.to_string_lossy(), files).map_err(|source| VideoScanError::Source {
        path: file.video.clone(),
        source,
    })
}

/// Returns where the person is, in frames of some width
fn person_beside_another(people: &TwoPeople, width_px: usize) -> PersonBesideAnother {
    let share = |px: f64| round(px / width_px as f64, 1e4);
    PersonBesideAnother {
        center: people.followed.center().map(share),
        size: share(people.followed.size()),
        other: if people.is_other_right() {
            Side::Right
        } else {
            Side::Left
        },
    }
}

/// Returns the turn over time, in s and degrees, by at most a few hundred points
fn turn_over_time(track: &TurnTrack) -> Vec<(f64, f64)> {
    const POINTS: usize = 300;
    let step = track.samples.len().div_ceil(POINTS).max(1);
    let samples = track.samples.iter().step_by(step);
    samples
        .map(|s| {
            (
                round(s.time_s, 100.0),
                round(s.angle_radians.to_degrees(), 10.0),
            )
        })
        .collect()
}

fn round(value: f64, per_unit: f64) -> f64 {
    (value * per_unit).round() / per_unit
}

/// Reads the manifest of a video; `views` would be those of photos
fn read_manifest(file: &VideoFile) -> Result<Map<String, Value>, VideoScanError> {
    let Some(path) = &file.manifest else {
        return Ok(Map::new());
    };
    let failed = |message: String| VideoScanError::Manifest {
        path: path.clone(),
        message,
    };
    let bytes = read_bounded_file(path, MAX_JSON_BYTES).map_err(|e| failed(e.to_string()))?;
    manifest::parse_manifest(&bytes).map_err(|e| failed(e.to_string()))?;
    let strict = to_strict(&bytes).map_err(|e| failed(e.to_string()))?;
    match serde_json::from_slice(&strict) {
        Ok(Value::Object(manifest)) if !manifest.contains_key("views") => Ok(manifest),
        _ => Err(failed(
            "`views` are those of photos; remove them, since the views of a video are found in it"
                .to_owned(),
        )),
    }
}
