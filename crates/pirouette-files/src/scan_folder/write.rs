//! Writing scans into folders or memory, for demonstrations and tests.

use std::collections::BTreeMap;
#[cfg(feature = "folders")]
use std::path::Path;

use serde_json::json;
use thiserror::Error;

use crate::formats::keypoints::MEDIA_PIPE;
use crate::formats::{manifest, photo};
#[cfg(feature = "folders")]
use crate::sink::make_folder;
use crate::sink::{Sink, WriteError};
use pirouette::scan::{KeypointKind, STATED_TURN_SD_DEGREES, Scan, StatedClothes, View};
use pirouette::video::tracked_turn_sd_radians;
use pirouette_body::{Keypoints, ReferencePose, Sex};

/// JPEG quality of written photos, typical of cameras
const JPEG_QUALITY: u8 = 92;

/// Name of the picture of the scene without the person
const BACKGROUND_FILE: &str = "background.png";

/// Why a scan could not be written
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WriteScanError {
    /// Writing fails
    #[error(transparent)]
    Write(#[from] WriteError),
    /// Not encodable: JPEG files have 1 to 65535 pixels per side
    #[error("the photo of view {view} cannot be a JPEG file: {source}")]
    Photo {
        /// Name of the view
        view: String,
        /// Error of the encoder
        source: jpeg_encoder::EncodingError,
    },
    /// Not encodable: PNG files have at least one pixel
    #[error("the picture of the room cannot be a PNG file: {0}")]
    Background(#[source] image::ImageError),
    /// Not encodable: PNG files have at least one pixel
    #[error("the mask of view {view} cannot be a PNG file: {source}")]
    Mask {
        /// Name of the view
        view: String,
        /// Error of the encoder
        source: image::ImageError,
    },
}

/// Writes photos as JPEG, keypoints (where there are any) as OpenPose JSON, given masks as PNG, and the manifest
///
/// # Errors
/// When the folder cannot be written.
#[cfg(feature = "folders")]
pub fn write_scan(folder: &Path, scan: &Scan) -> Result<(), WriteScanError> {
    make_folder(folder)?;
    put_scan(&Sink::folder(folder.to_owned()), scan)
}

/// Encodes the files that [`write_scan`] writes, in memory: bytes by name
///
/// # Errors
/// When an encoder rejects a photo or a mask.
pub fn scan_files(scan: &Scan) -> Result<BTreeMap<String, Vec<u8>>, WriteScanError> {
    let sink = Sink::memory();
    put_scan(&sink, scan)?;
    Ok(sink.into_artifacts())
}

fn put_scan(sink: &Sink, scan: &Scan) -> Result<(), WriteScanError> {
    for view in &scan.views {
        put_view(sink, view)?;
    }
    if let Some(background) = &scan.background {
        let png = photo::encode_background(background).map_err(WriteScanError::Background)?;
        sink.put(BACKGROUND_FILE, png)?;
    }
    let manifest = format!("{:#}\n", manifest_of(scan));
    Ok(sink.put(manifest::FILE_NAME, manifest.into_bytes())?)
}

fn put_view(sink: &Sink, view: &View) -> Result<(), WriteScanError> {
    let name = &view.name;
    let jpeg =
        photo::encode_jpeg(&view.photo, JPEG_QUALITY).map_err(|source| WriteScanError::Photo {
            view: name.clone(),
            source,
        })?;
    sink.put(&format!("{name}.jpg"), jpeg)?;
    if let Some(file) = keypoint_file_name(view) {
        let keypoints = keypoint_file(&view.keypoints, view.keypoint_kind).to_string();
        sink.put(&file, keypoints.into_bytes())?;
    }
    if let Some(mask) = &view.mask {
        let png = photo::encode_mask(mask).map_err(|source| WriteScanError::Mask {
            view: name.clone(),
            source,
        })?;
        sink.put(&format!("{name}_mask.png"), png)?;
    }
    Ok(())
}

/// Returns the name of the keypoint file of a view; `None` if it has no keypoints
fn keypoint_file_name(view: &View) -> Option<String> {
    let name = &view.name;
    (view.keypoints.found_count() > 0).then(|| format!("{name}_keypoints.json"))
}

/// Returns one person as OpenPose JSON 1.3, with the name of the detector if its joints are not OpenPose's
pub fn keypoint_file(keypoints: &Keypoints, kind: KeypointKind) -> serde_json::Value {
    let rounded = |value: f64, digits: f64| (value * digits).round() / digits;
    let numbers: Vec<f64> = keypoints
        .iter()
        .flat_map(|(_, keypoint)| {
            [
                rounded(keypoint.position.x, 1e3),
                rounded(keypoint.position.y, 1e3),
                rounded(keypoint.confidence, 1e6),
            ]
        })
        .collect();
    let mut file =
        json!({ "version": 1.3, "people": [{ "person_id": [-1], "pose_keypoints_2d": numbers }] });
    if kind == KeypointKind::MediaPipe {
        file["detector"] = json!(MEDIA_PIPE);
    }
    file
}

fn manifest_of(scan: &Scan) -> serde_json::Value {
    let mut file = json!({
        "pose": match scan.pose { ReferencePose::A => "a", ReferencePose::T => "t" },
    });
    let subject = [
        ("stature_mm", scan.barefoot_mm()),
        ("sole_mm", scan.subject.sole_mm),
        ("mass_kg", scan.subject.mass_kg),
        ("age_years", scan.subject.age_years),
        ("stature_sd_mm", scan.subject.stature_sd_mm),
    ];
    for (key, value) in subject {
        if let Some(value) = value {
            file["subject"][key] = json!(value);
        }
    }
    if let Some(sex) = scan.subject.sex.filter(|sex| *sex != Sex::Neutral) {
        file["subject"]["sex"] = json!(sex.name());
    }
    if let Some(StatedClothes { top, bottom }) = scan.subject.clothes {
        file["subject"]["clothes"] = json!({ "top": top, "bottom": bottom });
    }
    let camera = [
        (
            "vertical_fov_deg",
            scan.camera.vertical_fov_radians.map(f64::to_degrees),
        ),
        ("height_mm", scan.camera.height_mm),
        ("distance_mm", scan.camera.distance_mm),
        ("pitch_deg", scan.camera.pitch_radians.map(f64::to_degrees)),
        ("yaw_deg", scan.camera.yaw_radians.map(f64::to_degrees)),
        ("mm_per_px", scan.mm_per_px),
    ];
    for (key, value) in camera {
        if let Some(value) = value {
            file["camera"][key] = json!(value);
        }
    }
    let is_default = |view: &View| {
        let usual = match view.time_s {
            Some(_) => tracked_turn_sd_radians(view.turn),
            None => STATED_TURN_SD_DEGREES.to_radians(),
        };
        (view.turn_sd_radians - usual).abs() < 1e-6
    };
    let stated = scan.views.iter().find(|view| view.turn_is_stated());
    if let Some(view) = stated.filter(|view| !is_default(view)) {
        file["angle_sd_deg"] = json!(view.turn_sd_radians.to_degrees());
    }
    let views = scan.views.iter().map(|view| {
        let name = &view.name;
        let mut entry = json!({
            "image": format!("{name}.jpg"),
            "angle_deg": view.turn_is_stated().then(|| view.turn.degrees()),
        });
        if let Some(time_s) = view.time_s {
            entry["time_s"] = json!(time_s);
        }
        if let Some(file) = keypoint_file_name(view) {
            entry["keypoints"] = json!(file);
        }
        if view.mask.is_some() {
            entry["mask"] = json!(format!("{name}_mask.png"));
        }
        entry
    });
    file["views"] = views.collect();
    if scan.background.is_some() {
        file["background"] = json!(BACKGROUND_FILE);
    }
    file
}
