//! Problems of a scan: errors of the complete scan, of one view, and warnings.

use std::io;
use std::path::PathBuf;

use pirouette::check::CheckWarning;
use thiserror::Error;

use crate::formats::keypoints::KeypointsError;
use crate::formats::manifest::{ManifestError, Side};
use crate::formats::mask::{MaskError, MaskFix};
use crate::formats::photo::PhotoError;
use crate::source::SourceError;

/// Why a scan cannot be loaded
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum ScanError {
    #[error("{}: {source}", path.display())]
    Source { path: PathBuf, source: SourceError },
    #[error("cannot read {}: {source}", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error("{}: {source}", path.display())]
    Manifest {
        path: PathBuf,
        source: ManifestError,
    },
    #[error("{}: {source}", path.display())]
    Keypoints {
        path: PathBuf,
        source: KeypointsError,
    },
    #[error("{} points outside the scan folder; copy the file into it", path.display())]
    LinkLeaves { path: PathBuf },
    #[error(
        "no photos in {}; they end in .jpg, .jpeg, .png or .webp; of several videos, give the path of one", folder.display()
    )]
    NoPhotos { folder: PathBuf },
    #[error(
        "{} contains {count} photos that cannot be read ({first}), and no others; export them as JPEG (iPhone: Settings > Camera > Formats > Most Compatible)", folder.display()
    )]
    NoReadablePhotos {
        folder: PathBuf,
        count: usize,
        first: String,
    },
    #[error(
        "the photos are not in {} itself, but in its folders {first} and {second}; use the path of one of them", folder.display()
    )]
    SeveralFolders {
        folder: PathBuf,
        first: String,
        second: String,
    },
    #[error("{first} and {second} have the same name; rename one of them")]
    SameName { first: String, second: String },
}

impl ScanError {
    /// Converts the error of a source at a path
    #[cfg(feature = "folders")]
    pub(super) fn of_source(path: PathBuf, error: SourceError) -> Self {
        match error {
            SourceError::Read(source) => ScanError::Read { path, source },
            source => ScanError::Source { path, source },
        }
    }
}

/// Why one view cannot be used
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum ViewError {
    #[error("cannot read {file}: {source}")]
    Read { file: String, source: io::Error },
    #[error("there is no {file} in the scan folder; add it, or fix its name in scan.json")]
    Missing { file: String },
    #[error("{file}: {source}")]
    Photo { file: String, source: PhotoError },
    #[error("{file}: {source}")]
    Keypoints {
        file: String,
        source: KeypointsError,
    },
    #[error(
        "no keypoints: there is no {file} next to the photo or in keypoints/, and no pose detector is installed: run 'pirouette models install', or name the file by \"keypoints\" of the view in scan.json"
    )]
    NoKeypointFile { file: String },
    #[error("no keypoints: there is none of {files} in {}", folder.display())]
    NoGivenFile { files: String, folder: PathBuf },
    #[error(
        "no keypoints: {file} contains no person; repeat the detection with a clearer photo, or provide a mask in scan.json"
    )]
    NoPerson { file: String },
    #[error("its photo is that of view {first}; give each photo once, at its angle")]
    SamePhoto { first: String },
    #[error(
        "the turn angle is unknown, and cannot be found without keypoints; give angle_deg in scan.json, or keypoints"
    )]
    AngleUnknown,
    #[error(
        "no person was detected in {file}; show the person from head to toe, or provide keypoints"
    )]
    NotDetected { file: String },
    #[error(
        "{file} has {mask_width} x {mask_height} px, but the photo {photo_width} x {photo_height} px; they must have the same shape"
    )]
    MaskSize {
        file: String,
        mask_width: usize,
        mask_height: usize,
        photo_width: usize,
        photo_height: usize,
    },
    #[error("{file}: {source}")]
    Mask { file: String, source: MaskError },
    #[error("{file} is empty: it has no foreground pixels")]
    EmptyMask { file: String },
    #[error(
        "the photo has {width_px} x {height_px} px, but most photos have {common_width_px} x {common_height_px} px; take all photos of a scan with one camera in one orientation"
    )]
    OtherShape {
        width_px: usize,
        height_px: usize,
        common_width_px: usize,
        common_height_px: usize,
    },
}

/// An automatic correction while loading
#[derive(Debug, Clone, PartialEq, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum ScanWarning {
    #[error(
        "{people_count} people in the keypoint file; used the most confident one near the middle of the photo"
    )]
    SeveralPeople { view: String, people_count: usize },
    #[error(
        "{missing_count} keypoint files that scan.json names do not exist ({first}); their keypoints are found in the photos instead"
    )]
    KeypointFilesMissing { missing_count: usize, first: String },
    #[error(
        "{missing_count} views have no angle_deg; assumed evenly spaced turn angles, which is correct only for a uniform turn"
    )]
    AnglesMissing { missing_count: usize },
    #[error(
        "the photos were taken with different zoom ({smallest_deg:.1} to {largest_deg:.1} degrees by EXIF); used the median"
    )]
    FieldsOfViewDiffer { smallest_deg: f64, largest_deg: f64 },
    #[error(
        "{file} was ignored, since its name is not that of a photo; list it in \"views\" of scan.json to use it (\"image\", or \"mask\" for a silhouette)"
    )]
    ImageIgnored { file: String },
    #[error(
        "EXIF data describe photos of {exif_width_px} x {exif_height_px} px, but these have {width_px} x {height_px} px: \
         they were cropped, and the field of view by EXIF is not used; give camera.vertical_fov_deg, or the photos as taken"
    )]
    Cropped {
        width_px: usize,
        height_px: usize,
        exif_width_px: usize,
        exif_height_px: usize,
    },
    #[error("{0}")]
    Check(CheckWarning),
    #[error("{file}: {fix}")]
    MaskFixed {
        view: String,
        file: String,
        fix: MaskFix,
    },
    #[error("the photos are in the folder {folder}; used these")]
    PhotosInFolder { folder: String },
    #[error(
        "{count} keypoint files were found by the names of their photos ({first}); usual names are such as 000_keypoints.json"
    )]
    KeypointFilesFound { count: usize, first: String },
    #[error(
        "{first} and {second} have the name of this photo; used neither: name one by \"keypoints\" of the view in scan.json"
    )]
    KeypointFileUnclear {
        view: String,
        first: String,
        second: String,
    },
    #[error(
        "{count} JSON files have the name of no photo ({first}); if they are keypoint files, name them by \"keypoints\" of each view in scan.json"
    )]
    JsonFilesUnused { count: usize, first: String },
    #[error(
        "{count} photos show a second person or a mirror image ({first}); the joints are those of the person who turns; take \
         photos without anyone else, since colors and outlines of both may be confused"
    )]
    SecondPerson { count: usize, first: String },
    #[error(
        "the video shows a turn by {turned_deg:.0} degrees only: what is seen from one side only is less accurate; turn once \
         completely"
    )]
    PartOfTurn { turned_deg: f64 },
    #[error(
        "another person or a mirror image is in the video, on the {}; the other one is measured; film one person alone, since \
         colors and outlines of both may be confused",
        side.name()
    )]
    OtherPersonInVideo { side: Side },
    #[error("{count} directions have no usable frame: the person was not found in the video there")]
    DirectionsMissing { count: usize },
    #[error(
        "the colors of the video have a high dynamic range, and were converted to the usual one"
    )]
    HdrConverted,
    #[error(
        "the photo of the room without the person is not used: {reason}; take it from the same place, with the same camera"
    )]
    BackgroundUnusable { reason: String },
}

impl ScanWarning {
    /// Returns the name of the affected view, if it concerns one
    pub fn view(&self) -> Option<&str> {
        match self {
            ScanWarning::SeveralPeople { view, .. }
            | ScanWarning::MaskFixed { view, .. }
            | ScanWarning::KeypointFileUnclear { view, .. } => Some(view),
            _ => None,
        }
    }

    /// Returns the stable, machine-readable code
    pub fn code(&self) -> &'static str {
        match self {
            ScanWarning::SeveralPeople { .. } => "several_people",
            ScanWarning::KeypointFilesMissing { .. } => "keypoint_files_missing",
            ScanWarning::AnglesMissing { .. } => "angles_missing",
            ScanWarning::FieldsOfViewDiffer { .. } => "fields_of_view_differ",
            ScanWarning::ImageIgnored { .. } => "image_ignored",
            ScanWarning::Cropped { .. } => "cropped",
            ScanWarning::Check(warning) => warning.code(),
            ScanWarning::MaskFixed { .. } => "mask_fixed",
            ScanWarning::PhotosInFolder { .. } => "photos_in_folder",
            ScanWarning::KeypointFilesFound { .. } => "keypoint_files_found",
            ScanWarning::KeypointFileUnclear { .. } => "keypoint_file_unclear",
            ScanWarning::JsonFilesUnused { .. } => "json_files_unused",
            ScanWarning::SecondPerson { .. } | ScanWarning::OtherPersonInVideo { .. } => {
                "second_person"
            }
            ScanWarning::PartOfTurn { .. } => "part_of_turn",
            ScanWarning::DirectionsMissing { .. } => "directions_missing",
            ScanWarning::HdrConverted => "hdr_converted",
            ScanWarning::BackgroundUnusable { .. } => "background_unusable",
        }
    }
}
