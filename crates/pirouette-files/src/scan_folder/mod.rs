//! Scans in a folder, a zip file or memory: a manifest or only photos, their keypoints and given masks.
//!
//! An unusable view does not affect the others: it is returned with the reason. Only defects that concern the complete
//! folder (an unreadable manifest, a path that points outside the folder) are errors.

mod find;
mod keypoint_files;
mod problem;
mod view;
mod write;

use std::fmt;
#[cfg(feature = "folders")]
use std::path::Path;

use pirouette_geom::parallel::prelude::*;

use crate::formats::manifest;
use crate::formats::manifest::{Manifest, ManifestView, VideoFacts};
use crate::formats::photo::{decode_background, decode_photo, resample_mask, shrink};
use crate::source::Source;
#[cfg(feature = "folders")]
pub(crate) use find::PHOTO_EXTENSIONS;
use find::{Listing, PhotoFolder};
use keypoint_files::{AssignedFiles, check_common_links, paths_in_scan};
use pirouette::scan::{
    Background, CameraSetup, KeypointSource, Photo, STATED_TURN_SD_DEGREES, Scan, StatureFrom, View,
};
use pirouette::video::{COMPLETE_TURN_DEGREES, tracked_turn_sd_radians};
use pirouette_body::TurnAngle;
use view::{LoadedView, load_view, read_file};
pub(crate) use view::{MAX_PHOTO_BYTES, keypoints_in_input};

pub use keypoint_files::GivenKeypoints;
pub use problem::{ScanError, ScanWarning, ViewError};
#[cfg(feature = "folders")]
pub use write::write_scan;
pub use write::{WriteScanError, keypoint_file, scan_files};

/// Options for loading a scan
#[derive(Debug, Clone, Copy)]
pub struct LoadOptions<'a> {
    /// Longer side to which larger photos are shrunk, in px
    ///
    /// Time and memory grow with its square; at 1600 px a pixel shows about 1.2 mm of a person.
    pub max_side_px: usize,
    /// Whether to exclude views whose photos differ in shape from most others
    ///
    /// A rotated or cropped photo means another camera: only the silhouettes of such views can be consistent with the
    /// others.
    pub one_shape: bool,
    /// What happens to views without a keypoint file and without a mask
    pub without_keypoints: WithoutKeypoints,
    /// Whether keypoint files are not read, as if no view had one
    pub ignore_keypoint_files: bool,
    /// Whether stated turn angles are ignored, as if all were unknown
    pub angles_unknown: bool,
    /// Keypoint files that replace those in the scan
    pub keypoints: Option<&'a GivenKeypoints>,
}

impl Default for LoadOptions<'_> {
    fn default() -> Self {
        Self {
            max_side_px: 1600,
            one_shape: true,
            without_keypoints: WithoutKeypoints::default(),
            ignore_keypoint_files: false,
            angles_unknown: false,
            keypoints: None,
        }
    }
}

/// What happens to views without a keypoint file and without a mask
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WithoutKeypoints {
    /// They are unusable
    #[default]
    Rejected,
    /// They are loaded without keypoints
    Loaded,
    /// They are loaded without keypoints if no view has any; otherwise, they are unusable
    LoadedIfAll,
}

/// Relative tolerance of width over height for photos of one shape; scaling rounds to integer pixels
const SHAPE_TOLERANCE: f64 = 0.01;

/// Maximum size of a keypoint file or manifest, in bytes
const MAX_JSON_BYTES: u64 = 64 << 20;

/// Maximum relative spread of the fields of view of one camera; a larger spread is a different zoom
const MAX_FOV_SPREAD: f64 = 0.03;

/// Content of a scan folder
#[derive(Debug)]
pub struct LoadedScan {
    /// The usable views
    pub scan: Scan,
    /// The unusable views
    pub failed: Vec<FailedView>,
    /// Automatic corrections
    pub warnings: Vec<ScanWarning>,
    /// The video that the photos were taken from
    pub video: Option<VideoFacts>,
    /// Indices of the views without a keypoint file
    pub without_keypoints: Vec<usize>,
    /// Source of the photos
    source: Source,
    /// The photo file of each usable view
    files: Vec<String>,
}

impl LoadedScan {
    /// Wraps a scan whose photos are in memory only
    pub fn in_memory(scan: Scan) -> Self {
        let files = scan.views.iter().map(|view| format!("{}.png", view.name));
        Self {
            files: files.collect(),
            scan,
            failed: Vec::new(),
            warnings: Vec::new(),
            video: None,
            without_keypoints: Vec::new(),
            source: Source::default(),
        }
    }

    /// Moves usable views to the unusable ones, with the reason; indices of other views change
    pub(crate) fn reject(&mut self, rejected: Vec<(usize, ViewError)>) {
        let start = self.failed.len();
        for (index, reason) in rejected.into_iter().rev() {
            let view = self.scan.views.remove(index);
            self.files.remove(index);
            self.scan.unusable_view_count += 1;
            self.failed.push(FailedView {
                turn: view.turn_is_stated().then_some(view.turn),
                view: view.name,
                reason,
            });
        }
        self.failed[start..].reverse();
        self.without_keypoints.clear();
    }

    /// Returns the photo file of a view
    pub fn photo_file(&self, view: usize) -> &str {
        &self.files[view]
    }

    /// Reads the photo of a view again at its original size; `None` if the file is missing or was changed
    pub fn full_size_photo(&self, view: usize) -> Option<Photo> {
        let (file, view) = (self.files.get(view)?, self.scan.views.get(view)?);
        let bytes = self.source.read(file, MAX_PHOTO_BYTES).ok()?;
        let photo = decode_photo(&bytes).ok()?.photo;
        let size = (photo.width(), photo.height());
        (size == view.input_size_px).then_some(photo)
    }
}

/// A view that could not be loaded
#[derive(Debug)]
pub struct FailedView {
    /// Stem of the photo's file name
    pub view: String,
    /// Turn angle of the person in this view, if stated
    pub turn: Option<TurnAngle>,
    /// Why it could not be loaded
    pub reason: ViewError,
}

impl fmt::Display for FailedView {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "view {} is rejected (load): {}", self.view, self.reason)
    }
}

/// Reads the photo of the room without the person, which must have the `size` of the views; or why it is unusable
fn load_background(
    source: &Source,
    file: &str,
    size: Option<(usize, usize)>,
    options: &LoadOptions,
) -> Result<Background, String> {
    let bytes = read_file(source, file, MAX_PHOTO_BYTES).map_err(|e| e.to_string())?;
    let (photo, known) = decode_background(&bytes).map_err(|e| format!("{file}: {e}"))?;
    let known = known.map(|&known| if known { 1.0 } else { 0.0 });
    let photo = shrink(photo, options.max_side_px);
    let (width, height) = (photo.width(), photo.height());
    if let Some((of_width, of_height)) = size.filter(|size| *size != (width, height)) {
        return Err(format!(
            "{file} has {width}x{height} px, the photos {of_width}x{of_height} px (long sides are shrunk to {} px)",
            options.max_side_px
        ));
    }
    // A pixel that partly covers an unknown one is unknown.
    let known = resample_mask(&known, width, height, 0.999);
    Ok(Background { photo, known })
}

/// Opens and loads a scan folder, or a zip file of one
///
/// # Errors
/// When it cannot be opened, and those of [`load_source`].
#[cfg(feature = "folders")]
pub fn load_scan(path: &Path, options: &LoadOptions) -> Result<LoadedScan, ScanError> {
    load_source(open_source(path)?, options)
}

/// Opens a scan folder, or a zip file of one
///
/// # Errors
/// When it is neither, or a zip file cannot be used.
#[cfg(feature = "folders")]
pub fn open_source(path: &Path) -> Result<Source, ScanError> {
    Source::open(path).map_err(|error| ScanError::of_source(path.to_owned(), error))
}

/// Loads a scan
///
/// Without a manifest, or without `views` in it, the photos are sorted by name, where runs of digits compare as numbers
/// (`2.jpg` before `10.jpg`). If only one subfolder contains photos, they are taken from there.
///
/// # Errors
/// When names or the manifest cannot be read, a path points outside the source, or there are no photos.
pub fn load_source(source: Source, options: &LoadOptions) -> Result<LoadedScan, ScanError> {
    let mut warnings = Vec::new();
    let listing = Listing::of(&source)?;
    let (manifest, folder) = read_manifest(&source, &listing)?;
    let mut entries = match manifest.views {
        Some(mut views) => {
            views
                .iter_mut()
                .for_each(|view| find::put_into(view, &folder));
            views
        }
        None => listing.find_photos(&source, &mut warnings)?,
    };
    listing.find_keypoint_files(&source, &mut entries, &mut warnings);
    let background_file = manifest
        .background
        .map(|file| format!("{folder}{file}"))
        .or_else(|| listing.background_file());
    check_links(&source, &entries)?;
    if let Some(file) = &background_file {
        check_link(&source, file)?;
    }

    let missing_count = entries.iter().filter(|e| e.angle_deg.is_none()).count();
    if missing_count > 0 && missing_count < entries.len() && !options.angles_unknown {
        warnings.push(ScanWarning::AnglesMissing { missing_count });
    }
    let turn = |index: usize| {
        let even = 360.0 * index as f64 / entries.len() as f64;
        let stated = entries[index].angle_deg.unwrap_or(Some(even));
        let stated = stated.filter(|_| !options.angles_unknown);
        stated.map(TurnAngle::from_degrees)
    };

    let keypoint_files = AssignedFiles::new(&source, &entries, options.keypoints)?;
    let mut loaded: Vec<_> = entries
        .par_iter()
        .enumerate()
        .map(|(view, entry)| load_view(&source, view, entry, &keypoint_files, options))
        .collect();
    reject_without_keypoints(&mut loaded, &entries, options.without_keypoints);
    if options.one_shape {
        reject_other_shapes(&mut loaded);
    }
    let (mut views, mut failed, mut fields_of_view) = (Vec::new(), Vec::new(), Vec::new());
    let (mut files, mut without_keypoints) = (Vec::new(), Vec::new());
    let mut missing_files = Vec::new();
    let mut cropped = None;
    for (index, (entry, result)) in entries.iter().zip(loaded).enumerate() {
        let name = manifest::stem(&entry.image);
        let turn = turn(index);
        match result {
            Ok(loaded) => {
                if loaded.people_count > 1 {
                    warnings.push(ScanWarning::SeveralPeople {
                        view: name.clone(),
                        people_count: loaded.people_count,
                    });
                }
                for fix in loaded.mask_fixes {
                    warnings.push(ScanWarning::MaskFixed {
                        view: name.clone(),
                        file: entry.mask.clone().unwrap_or_default(),
                        fix,
                    });
                }
                missing_files.extend(loaded.missing_keypoint_file);
                if !loaded.has_keypoint_file {
                    without_keypoints.push(views.len());
                }
                fields_of_view.extend(loaded.vertical_fov_radians);
                if let Some((exif_width_px, exif_height_px)) = loaded.cropped_from_px {
                    let (width_px, height_px) = loaded.input_size_px;
                    cropped.get_or_insert(ScanWarning::Cropped {
                        width_px,
                        height_px,
                        exif_width_px,
                        exif_height_px,
                    });
                }
                files.push(entry.image.clone());
                views.push(View {
                    name,
                    photo: loaded.photo,
                    input_size_px: loaded.input_size_px,
                    turn: turn.unwrap_or_default(),
                    turn_sd_radians: match (turn, manifest.angle_sd_deg, entry.time_s) {
                        (None, ..) => f64::INFINITY,
                        (Some(turn), None, Some(_)) => tracked_turn_sd_radians(turn),
                        (Some(_), stated, _) => {
                            stated.unwrap_or(STATED_TURN_SD_DEGREES).to_radians()
                        }
                    },
                    time_s: entry.time_s,
                    keypoints: loaded.keypoints,
                    keypoints_from: KeypointSource::Given,
                    keypoint_kind: loaded.keypoint_kind,
                    mask: loaded.mask,
                    person_odds: None,
                });
            }
            Err(reason) => failed.push(FailedView {
                view: name,
                turn,
                reason,
            }),
        }
    }
    if let Some(first) = missing_files.first() {
        warnings.push(ScanWarning::KeypointFilesMissing {
            missing_count: missing_files.len(),
            first: first.clone(),
        });
    }
    warnings.extend(manifest.video.iter().flat_map(video_warnings));
    let background = background_file.and_then(|file| {
        let size = views
            .first()
            .map(|view| (view.photo.width(), view.photo.height()));
        let loaded = load_background(&source, &file, size, options);
        loaded
            .map_err(|reason| warnings.push(ScanWarning::BackgroundUnusable { reason }))
            .ok()
    });
    warnings.extend(cropped.filter(|_| manifest.camera.vertical_fov_radians.is_none()));
    let camera = CameraSetup {
        vertical_fov_radians: manifest
            .camera
            .vertical_fov_radians
            .or_else(|| common_field_of_view(&mut fields_of_view, &mut warnings)),
        ..manifest.camera
    };
    Ok(LoadedScan {
        scan: Scan {
            pose: manifest.pose,
            stature_mm: manifest
                .stature_mm
                .map(|barefoot| barefoot + manifest.subject.sole_mm.unwrap_or(0.0)),
            stature_from: StatureFrom::default(),
            mm_per_px: manifest.mm_per_px,
            subject: manifest.subject,
            camera,
            views,
            background,
            unusable_view_count: failed.len(),
            surface: None,
        },
        failed,
        warnings,
        video: manifest.video,
        without_keypoints,
        source,
        files,
    })
}

/// Returns what is unusual about the video that the photos were taken from
fn video_warnings(video: &VideoFacts) -> Vec<ScanWarning> {
    let part = ScanWarning::PartOfTurn {
        turned_deg: video.turned_deg,
    };
    let missing = ScanWarning::DirectionsMissing {
        count: video.missing_count,
    };
    let all = [
        (video.turned_deg < COMPLETE_TURN_DEGREES).then_some(part),
        (video.missing_count > 0).then_some(missing),
        video.hdr.then_some(ScanWarning::HdrConverted),
        video
            .two_people
            .map(|people| ScanWarning::OtherPersonInVideo { side: people.other }),
    ];
    all.into_iter().flatten().collect()
}

fn check_link(source: &Source, name: &str) -> Result<(), ScanError> {
    if source.is_inside(name) {
        Ok(())
    } else {
        let path = source.path_of(name);
        Err(ScanError::LinkLeaves { path })
    }
}

fn check_links(source: &Source, entries: &[ManifestView]) -> Result<(), ScanError> {
    for entry in entries {
        check_link(source, &entry.image)?;
        for name in entry.keypoints.iter().chain(&entry.mask) {
            check_link(source, name)?;
        }
        for name in paths_in_scan(&entry.image) {
            check_link(source, &name)?;
        }
    }
    check_common_links(source)
}

/// Reads the manifest; returns it with the folder that its paths are relative to
///
/// If the photos are in a subfolder, the manifest may be there.
fn read_manifest(source: &Source, listing: &Listing) -> Result<(Manifest, String), ScanError> {
    let mut folder = String::new();
    if !source.contains(manifest::FILE_NAME)
        && let PhotoFolder::Below(below) = listing.photo_folder()
    {
        folder = format!("{below}/");
    }
    let name = format!("{folder}{}", manifest::FILE_NAME);
    let path = source.path_of(&name);
    if !source.contains(&name) {
        return Ok((Manifest::default(), folder));
    }
    check_link(source, &name)?;
    match source.read(&name, MAX_JSON_BYTES) {
        Ok(json) => match manifest::parse_manifest(&json) {
            Ok(manifest) => Ok((manifest, folder)),
            Err(source) => Err(ScanError::Manifest { path, source }),
        },
        Err(source) => Err(ScanError::Read { path, source }),
    }
}

/// Rejects views without keypoints and mask, as selected
fn reject_without_keypoints(
    loaded: &mut [Result<LoadedView, ViewError>],
    entries: &[ManifestView],
    without: WithoutKeypoints,
) {
    let any_found = loaded.iter().flatten().any(|view| view.has_keypoint_file);
    match without {
        WithoutKeypoints::Loaded => return,
        WithoutKeypoints::LoadedIfAll if !any_found => return,
        WithoutKeypoints::LoadedIfAll | WithoutKeypoints::Rejected => {}
    }
    for (view, entry) in loaded.iter_mut().zip(entries) {
        let Ok(found) = view else {
            continue;
        };
        if let Some(file) = found.missing_keypoint_file.take() {
            *view = Err(ViewError::Missing { file });
        } else if !found.has_keypoint_file && found.mask.is_none() {
            let paths = paths_in_scan(&entry.image);
            let file = paths.into_iter().next().unwrap_or_default();
            *view = Err(ViewError::NoKeypointFile { file });
        }
    }
}

/// Rejects the views whose photos differ in shape from most; of equally frequent shapes, the first is kept
fn reject_other_shapes(loaded: &mut [Result<LoadedView, ViewError>]) {
    let sizes: Vec<(usize, usize)> = loaded.iter().flatten().map(|v| v.input_size_px).collect();
    let alike = |a: (usize, usize), b: (usize, usize)| {
        let shape = |(width, height): (usize, usize)| width as f64 / height as f64;
        (shape(a) / shape(b) - 1.0).abs() <= SHAPE_TOLERANCE
    };
    let votes = |size: (usize, usize)| sizes.iter().filter(|&&other| alike(size, other)).count();
    // `max_by_key` returns the last of equal maxima, so the order is reversed.
    let Some(&common) = sizes.iter().rev().max_by_key(|&&size| votes(size)) else {
        return;
    };
    for view in loaded {
        if let Ok(found) = view
            && !alike(found.input_size_px, common)
        {
            *view = Err(ViewError::OtherShape {
                width_px: found.input_size_px.0,
                height_px: found.input_size_px.1,
                common_width_px: common.0,
                common_height_px: common.1,
            });
        }
    }
}

/// Returns the median field of view by the EXIF data of the photos
fn common_field_of_view(
    fields_of_view: &mut [f64],
    warnings: &mut Vec<ScanWarning>,
) -> Option<f64> {
    fields_of_view.sort_by(f64::total_cmp);
    let (smallest, largest) = (*fields_of_view.first()?, *fields_of_view.last()?);
    if largest > smallest * (1.0 + MAX_FOV_SPREAD) {
        warnings.push(ScanWarning::FieldsOfViewDiffer {
            smallest_deg: smallest.to_degrees(),
            largest_deg: largest.to_degrees(),
        });
    }
    Some(fields_of_view[fields_of_view.len() / 2])
}

#[cfg(test)]
#[cfg(feature = "folders")]
mod tests;
