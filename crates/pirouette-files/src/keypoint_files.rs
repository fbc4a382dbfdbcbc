//! The pose detector alone: photos in, one keypoint file and one picture per photo out.
//!
//! `<stem>_keypoints.json` has the format and the name that a scan reads next to the photo. `<stem>_rendered.jpg` shows
//! the skeleton with the names of the joints; a scan never uses it as a photo.

use std::collections::BTreeMap;
#[cfg(feature = "folders")]
use std::path::Path;

use pirouette::pipeline::{CancelToken, Event, Stage};
use pirouette::scan::View;
use pirouette_geom::parallel::prelude::*;
use pirouette_pose::PoseModel;
use web_time::Instant;

use crate::job::{JobError, JobEvent, detect};
use crate::report::keypoint_picture;
use crate::results::{ResultError, as_jpeg, put_json};
use crate::scan_folder::{
    FailedView, LoadOptions, LoadedScan, ScanWarning, ViewError, WithoutKeypoints, keypoint_file,
    keypoints_in_input, load_source,
};
#[cfg(feature = "folders")]
use crate::scan_folder::{MAX_PHOTO_BYTES, PHOTO_EXTENSIONS, ScanError, open_source};
use crate::sink::Sink;
#[cfg(feature = "folders")]
use crate::sink::make_folder;
use crate::source::Source;

/// Photos with the keypoints that were detected in them
#[derive(Debug)]
pub struct DetectedPhotos {
    loaded: LoadedScan,
}

/// Opens a scan folder, a zip file of one, or a single photo
///
/// # Errors
/// When it is none of them, or cannot be read.
#[cfg(feature = "folders")]
pub fn open_photos(path: &Path) -> Result<Source, ScanError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    let is_photo = extension.is_some_and(|e| PHOTO_EXTENSIONS.contains(&e.as_str()));
    let Some(name) = path.file_name().filter(|_| is_photo && !path.is_dir()) else {
        return open_source(path);
    };
    let read_error = |source| ScanError::Read {
        path: path.to_owned(),
        source,
    };
    let metadata = std::fs::metadata(path).map_err(read_error)?;
    // A pipe would block, and a device would never end.
    if !metadata.is_file() {
        return Err(read_error(std::io::Error::other("not a file")));
    }
    if metadata.len() > MAX_PHOTO_BYTES {
        return Err(read_error(std::io::ErrorKind::FileTooLarge.into()));
    }
    let bytes = std::fs::read(path).map_err(read_error)?;
    let name = name.to_string_lossy();
    // With a manifest, the photo is used whatever its name is.
    let manifest = serde_json::json!({ "views": [{ "image": name }] }).to_string();
    let folder = path.parent().unwrap_or(Path::new("")).display().to_string();
    let files = [
        (name.into_owned(), bytes),
        (
            crate::formats::manifest::FILE_NAME.to_owned(),
            manifest.into_bytes(),
        ),
    ];
    Source::from_files(&folder, files).map_err(|source| ScanError::Source {
        path: path.to_owned(),
        source,
    })
}

/// Detects the keypoints in all photos of a source; existing keypoint files are not read
///
/// `on_event` receives progress and warnings, one [`JobEvent::ViewFailed`] for each photo without a person included;
/// calls are serialized but may come from any thread.
///
/// # Errors
/// When the photos cannot be listed, or the detection is cancelled.
pub fn detect_photos(
    source: Source,
    model: &PoseModel,
    cancel: &CancelToken,
    on_event: &mut (dyn FnMut(JobEvent) + Send),
) -> Result<DetectedPhotos, JobError> {
    let start = Instant::now();
    let options = LoadOptions {
        one_shape: false,
        without_keypoints: WithoutKeypoints::Loaded,
        ignore_keypoint_files: true,
        ..LoadOptions::default()
    };
    let mut loaded = load_source(source, &options)?;
    on_event(JobEvent::Pipeline(Event::StageDone {
        stage: Stage::Load,
        seconds: start.elapsed().as_secs_f64(),
    }));
    detect(&mut loaded, model, cancel, on_event)?;
    // A scan uses views with a mask but without keypoints.
    let views = loaded.scan.views.iter().enumerate();
    let without = views.filter(|(_, view)| view.keypoints.found_count() == 0);
    let rejected = without.map(|(index, _)| {
        let file = loaded.photo_file(index).to_owned();
        (index, ViewError::NotDetected { file })
    });
    loaded.reject(rejected.collect());
    // The other warnings are about turn angles and the camera, which do not matter here.
    for warning in &loaded.warnings {
        use ScanWarning::{ImageIgnored, SecondPerson};
        if matches!(warning, ImageIgnored { .. } | SecondPerson { .. }) {
            on_event(JobEvent::LoadWarning(warning));
        }
    }
    for failed in &loaded.failed {
        on_event(JobEvent::ViewFailed(failed));
    }
    Ok(DetectedPhotos { loaded })
}

impl DetectedPhotos {
    /// Returns the photos in which a person was found; keypoints are in px of the photo as loaded
    pub fn views(&self) -> &[View] {
        &self.loaded.scan.views
    }

    /// Returns the photos that cannot be read or show no person
    pub fn failed(&self) -> &[FailedView] {
        &self.loaded.failed
    }

    /// Returns the names of the files of a photo: keypoints, picture
    pub fn file_names(view: &View) -> [String; 2] {
        let name = &view.name;
        [
            format!("{name}_keypoints.json"),
            format!("{name}_rendered.jpg"),
        ]
    }

    /// Encodes all files in memory: bytes by name
    ///
    /// # Errors
    /// When an encoder rejects a picture.
    pub fn artifacts(&self) -> Result<BTreeMap<String, Vec<u8>>, ResultError> {
        let sink = Sink::memory();
        self.put(&sink)?;
        Ok(sink.into_artifacts())
    }

    /// Writes all files into a folder
    ///
    /// # Errors
    /// When the folder cannot be written; files written until then remain, none is partial.
    #[cfg(feature = "folders")]
    pub fn write(&self, folder: &Path) -> Result<(), ResultError> {
        make_folder(folder)?;
        self.put(&Sink::folder(folder.to_owned()))
    }

    fn put(&self, sink: &Sink) -> Result<(), ResultError> {
        let put = |view: &View| {
            let [keypoints, picture] = Self::file_names(view);
            let drawn = keypoint_picture(&view.photo, &view.keypoints);
            sink.put(&picture, as_jpeg(&sink.path(&picture), &drawn)?)?;
            put_json(
                sink,
                &keypoints,
                &keypoint_file(
                    &keypoints_in_input(view, &view.keypoints),
                    view.keypoint_kind,
                ),
            )
        };
        self.views().par_iter().map(put).collect()
    }
}
