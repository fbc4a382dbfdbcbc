//! One view: its photo, keypoints and mask.

use std::borrow::Cow;
use std::io;

use pirouette_geom::Mask;

use super::keypoint_files::AssignedFiles;
use super::{LoadOptions, ViewError};
use crate::formats::keypoints::Detection;
use crate::formats::manifest::ManifestView;
use crate::formats::mask::{GivenMask, MaskError, MaskFix, read_mask};
use crate::formats::photo;
use crate::source::{MAX_ENTRY_BYTES, Source};
use pirouette::scan::{KeypointKind, Photo, View};
use pirouette_body::Keypoints;

/// Maximum size of a photo file, in bytes
pub(crate) const MAX_PHOTO_BYTES: u64 = MAX_ENTRY_BYTES;

/// Content of the files of one view
pub(super) struct LoadedView {
    pub(super) photo: Photo,
    pub(super) input_size_px: (usize, usize),
    pub(super) keypoints: Keypoints,
    pub(super) keypoint_kind: KeypointKind,
    pub(super) people_count: usize,
    pub(super) has_keypoint_file: bool,
    /// A keypoint file that the manifest names, but does not exist
    pub(super) missing_keypoint_file: Option<String>,
    pub(super) mask: Option<Mask>,
    /// Differences of the mask file from the expected form
    pub(super) mask_fixes: Vec<MaskFix>,
    pub(super) vertical_fov_radians: Option<f64>,
    /// Sides of the photo as taken, by EXIF, if it was cropped
    pub(super) cropped_from_px: Option<(usize, usize)>,
}

/// Reads the files of one view, and shrinks large photos; `view` is its index in `keypoint_files`
pub(super) fn load_view(
    source: &Source,
    view: usize,
    entry: &ManifestView,
    keypoint_files: &AssignedFiles,
    options: &LoadOptions,
) -> Result<LoadedView, ViewError> {
    let image = &entry.image;
    let bytes = read_file(source, image, MAX_PHOTO_BYTES)?;
    let in_photo = |source| ViewError::Photo {
        file: image.clone(),
        source,
    };
    let decoded = photo::decode_photo(&bytes).map_err(in_photo)?;
    drop(bytes);
    let (width, height) = (decoded.photo.width(), decoded.photo.height());
    let found = match options.ignore_keypoint_files {
        true => Ok(None),
        false => keypoint_files.read(view, entry, width, height),
    };
    let (found, missing_keypoint_file) = match found {
        Ok(found) => (found, None),
        Err(ViewError::Missing { file }) => (None, Some(file)),
        Err(error) => return Err(error),
    };
    let given = entry.mask.as_ref().map(|file| {
        let keypoints = found.map_or_else(Keypoints::default, |found| found.keypoints);
        load_mask(source, file, (width, height), &keypoints)
    });
    let (mask, mask_fixes) = match given.transpose()? {
        Some(given) => (Some(given.mask), given.fixes),
        None => (None, Vec::new()),
    };
    let has_keypoint_file = found.is_some();
    let Detection {
        mut keypoints,
        people_count,
        kind,
    } = found.unwrap_or_default();
    let photo = photo::shrink(decoded.photo, options.max_side_px);
    if mask.is_none() {
        photo::check_contrast(&photo).map_err(in_photo)?;
    }
    let (shrunk_width, shrunk_height) = (photo.width(), photo.height());
    let scale = glam::DVec2::new(
        shrunk_width as f64 / width as f64,
        shrunk_height as f64 / height as f64,
    );
    keypoints = scale_keypoints(&keypoints, scale);
    let mask = mask.map(|mask| {
        let soft = mask.map(|&inside| if inside { 1.0 } else { 0.0 });
        photo::resample_mask(&soft, shrunk_width, shrunk_height, 0.5)
    });
    Ok(LoadedView {
        photo,
        input_size_px: (width, height),
        keypoints,
        keypoint_kind: kind,
        people_count,
        has_keypoint_file,
        missing_keypoint_file,
        mask,
        mask_fixes,
        vertical_fov_radians: decoded.vertical_fov_radians,
        cropped_from_px: decoded.cropped_from_px,
    })
}

pub(super) fn read_file<'a>(
    source: &'a Source,
    file: &str,
    limit: u64,
) -> Result<Cow<'a, [u8]>, ViewError> {
    source.read(file, limit).map_err(|source| {
        let file = file.to_owned();
        match source.kind() {
            io::ErrorKind::NotFound => ViewError::Missing { file },
            _ => ViewError::Read { file, source },
        }
    })
}

fn load_mask(
    source: &Source,
    file: &str,
    photo_size: (usize, usize),
    keypoints: &Keypoints,
) -> Result<GivenMask, ViewError> {
    let bytes = read_file(source, file, MAX_PHOTO_BYTES)?;
    let file = file.to_owned();
    read_mask(&bytes, photo_size, keypoints).map_err(|source| match source {
        MaskError::Photo(source) => ViewError::Photo { file, source },
        MaskError::Size { width, height } => ViewError::MaskSize {
            file,
            mask_width: width,
            mask_height: height,
            photo_width: photo_size.0,
            photo_height: photo_size.1,
        },
        MaskError::Empty => ViewError::EmptyMask { file },
        source => ViewError::Mask { file, source },
    })
}

/// Returns keypoints of a view in px of the photo as given
pub(crate) fn keypoints_in_input(view: &View, keypoints: &Keypoints) -> Keypoints {
    let (width, height) = view.input_size_px;
    let scale = glam::DVec2::new(
        width as f64 / view.photo.width() as f64,
        height as f64 / view.photo.height() as f64,
    );
    scale_keypoints(keypoints, scale)
}

/// Returns keypoints in px of a photo of another size
fn scale_keypoints(keypoints: &Keypoints, scale: glam::DVec2) -> Keypoints {
    let mut scaled = Keypoints::default();
    for (joint, mut keypoint) in keypoints.iter() {
        keypoint.position *= scale;
        scaled.set(joint, keypoint);
    }
    scaled
}
