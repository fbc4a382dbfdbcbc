//! The manifest `scan.json`: metadata of a scan.

mod units;

use std::ops::RangeInclusive;
use std::path::Path;

use serde::{Deserialize, Deserializer, Serialize};
use thiserror::Error;

use super::json::{JsonError, to_strict};
use crate::source::stays_inside;
use pirouette::scan::{CameraSetup, Looseness, StatedClothes, Subject};
use pirouette_body::{ReferencePose, Sex};
use pirouette_pose::Region;

/// Name of the manifest in a scan folder
pub const FILE_NAME: &str = "scan.json";

const STATURE_MM: RangeInclusive<f64> = 500.0..=2700.0;
const MASS_KG: RangeInclusive<f64> = 10.0..=400.0;
const AGE_YEARS: RangeInclusive<f64> = 0.0..=130.0;
const MM_PER_PX: RangeInclusive<f64> = 0.05..=50.0;
const VERTICAL_FOV_DEG: RangeInclusive<f64> = 2.0..=150.0;
const CAMERA_HEIGHT_MM: RangeInclusive<f64> = 0.0..=10_000.0;
const CAMERA_DISTANCE_MM: RangeInclusive<f64> = 300.0..=100_000.0;
const PITCH_DEG: RangeInclusive<f64> = -80.0..=80.0;
const YAW_DEG: RangeInclusive<f64> = -60.0..=60.0;
const ANGLE_DEG: RangeInclusive<f64> = -3600.0..=3600.0;
const STATURE_SD_MM: RangeInclusive<f64> = 1.0..=100.0;
const SOLE_MM: RangeInclusive<f64> = 0.0..=150.0;
const ANGLE_SD_DEG: RangeInclusive<f64> = 0.5..=45.0;

/// A checked manifest
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Manifest {
    /// The intended pose of the person
    pub pose: ReferencePose,
    /// Height of the barefoot person, in mm
    pub stature_mm: Option<f64>,
    /// Size of a pixel at the turning axis, in mm
    pub mm_per_px: Option<f64>,
    /// Additional facts given about the person
    pub subject: Subject,
    /// Known parameters of the camera
    pub camera: CameraSetup,
    /// Standard deviation of the person's turn around the stated angles, in degrees
    pub angle_sd_deg: Option<f64>,
    /// A photo of the room without the person
    pub background: Option<String>,
    /// The video that the photos were taken from
    pub video: Option<VideoFacts>,
    /// The views; if absent, all images of the folder are used
    pub views: Option<Vec<ManifestView>>,
}

/// Where a person is in the frames of a video with another one
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PersonBesideAnother {
    /// Center of a square around the person who is measured, relative to the width of the frame: x right, y down
    pub center: [f64; 2],
    /// Edge length of the square, relative to the width of the frame
    pub size: f64,
    /// Where the other person is, as seen in the frame
    pub other: Side,
}

impl PersonBesideAnother {
    /// Returns the square in a frame of some width; `None` if values are not finite or too large
    pub fn measured(&self, width_px: usize) -> Option<Region> {
        let width = width_px as f64;
        Region::new(self.center.map(|x| x * width), self.size * width, 0.0)
    }
}

/// A side of the picture
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "the names document the variants")]
pub enum Side {
    Left,
    Right,
}

impl Side {
    /// Returns the name in English
    pub fn name(self) -> &'static str {
        match self {
            Side::Left => "left",
            Side::Right => "right",
        }
    }
}

/// Facts about the video that photos were taken from
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct VideoFacts {
    /// Angle between the extreme directions of the person, in degrees
    pub turned_deg: f64,
    /// Number of directions for which no frame is usable
    #[serde(default)]
    pub missing_count: usize,
    /// Whether colors of high dynamic range were converted
    #[serde(default)]
    pub hdr: bool,
    /// Where the person is who is measured, if there is another one
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub two_people: Option<PersonBesideAnother>,
    /// Times, in s, and turn angles, in degrees, continued beyond full turns
    #[serde(default)]
    pub turn: Vec<(f64, f64)>,
}

/// One view of a manifest; paths are relative to the scan folder and stay inside it
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestView {
    /// The photo
    pub image: String,
    /// Its keypoints; if absent, `<stem>_keypoints.json` is searched for
    pub keypoints: Option<String>,
    /// Turn angle, in degrees; `Some(None)` for `null`, an unknown angle
    #[serde(default, deserialize_with = "present")]
    pub angle_deg: Option<Option<f64>>,
    /// Time stamp in the video that the photo was taken from, in s
    pub time_s: Option<f64>,
    /// A given silhouette, which replaces segmentation
    pub mask: Option<String>,
}

/// Distinguishes a key that is `null` from one that is absent
fn present<'de, D: Deserializer<'de>>(file: D) -> Result<Option<Option<f64>>, D::Error> {
    Option::deserialize(file).map(Some)
}

/// Why a manifest cannot be used
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum ManifestError {
    #[error("{0}; the smallest file is {{ \"subject\": {{ \"stature_mm\": 1748 }} }}")]
    Json(JsonError),
    #[error("{0}")]
    Key(serde_json::Error),
    #[error("`{key}` is {value}; it must lie between {lowest} and {highest}")]
    OutOfRange {
        key: String,
        value: f64,
        lowest: f64,
        highest: f64,
    },
    #[error("`{key}` is {value}, which looks like {unit}: write \"{name}\": {corrected}")]
    Unit {
        key: String,
        value: f64,
        unit: &'static str,
        name: &'static str,
        corrected: f64,
    },
    #[error(
        "all `angle_deg` of `views` are at most 6.3, which looks like {unit}: write degrees, such as \"angle_deg\": {corrected} instead of {value}"
    )]
    AngleUnit {
        unit: &'static str,
        value: f64,
        corrected: f64,
    },
    #[error(
        "`{key}` is \"{path}\"; paths are relative to the scan folder and must not point outside (no \"..\")"
    )]
    PathLeaves { key: String, path: String },
    #[error("`views` is empty; omit the key to use all images of the folder")]
    NoViews,
    #[error("`views[{first}]` and `views[{second}]` both have the name \"{name}\"; rename a photo")]
    SameName {
        first: usize,
        second: usize,
        name: String,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    pose: Option<PoseName>,
    subject: Option<SubjectFile>,
    camera: Option<CameraFile>,
    angle_sd_deg: Option<f64>,
    background: Option<String>,
    video: Option<VideoFacts>,
    views: Option<Vec<ManifestView>>,
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum PoseName {
    A,
    T,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct SubjectFile {
    stature_mm: Option<f64>,
    stature_sd_mm: Option<f64>,
    sex: Option<SexName>,
    mass_kg: Option<f64>,
    age_years: Option<f64>,
    clothes: Option<ClothesFile>,
    sole_mm: Option<f64>,
}

/// One looseness for all clothes, or one each for those above and below the waist
#[derive(Deserialize, Clone, Copy)]
#[serde(
    untagged,
    expecting = "clothes are \"tight\", \"normal\" or \"loose\", or { \"top\": \"loose\", \"bottom\": \"tight\" }"
)]
enum ClothesFile {
    All(LoosenessName),
    Parts(ClothesParts),
}

#[derive(Deserialize, Clone, Copy)]
#[serde(deny_unknown_fields)]
struct ClothesParts {
    top: LoosenessName,
    bottom: LoosenessName,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "lowercase")]
enum LoosenessName {
    Tight,
    Normal,
    Loose,
}

impl LoosenessName {
    fn looseness(self) -> Looseness {
        match self {
            LoosenessName::Tight => Looseness::Tight,
            LoosenessName::Normal => Looseness::Normal,
            LoosenessName::Loose => Looseness::Loose,
        }
    }
}

impl ClothesFile {
    fn statement(self) -> StatedClothes {
        match self {
            ClothesFile::All(looseness) => StatedClothes::all(looseness.looseness()),
            ClothesFile::Parts(ClothesParts { top, bottom }) => StatedClothes {
                top: top.looseness(),
                bottom: bottom.looseness(),
            },
        }
    }
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum SexName {
    Female,
    Male,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    vertical_fov_deg: Option<f64>,
    height_mm: Option<f64>,
    distance_mm: Option<f64>,
    pitch_deg: Option<f64>,
    yaw_deg: Option<f64>,
    mm_per_px: Option<f64>,
}

/// Parses and checks a manifest
///
/// # Errors
/// When the bytes are not JSON, contain an unknown key, or a value out of its range; the message names the key and its
/// position.
pub fn parse_manifest(json: &[u8]) -> Result<Manifest, ManifestError> {
    let json = to_strict(json).map_err(ManifestError::Json)?;
    let file: File = serde_json::from_slice(&json).map_err(ManifestError::Key)?;
    let camera = file.camera.unwrap_or_default();
    let subject = file.subject.unwrap_or_default();
    units::check_subject(subject.stature_mm, subject.mass_kg)?;
    units::check_camera(&camera)?;
    let checked = Manifest {
        pose: match file.pose {
            Some(PoseName::T) => ReferencePose::T,
            Some(PoseName::A) | None => ReferencePose::A,
        },
        stature_mm: within(subject.stature_mm, STATURE_MM, || {
            "subject.stature_mm".into()
        })?,
        mm_per_px: within(camera.mm_per_px, MM_PER_PX, || "camera.mm_per_px".into())?,
        subject: Subject {
            sex: subject.sex.map(|sex| match sex {
                SexName::Female => Sex::Female,
                SexName::Male => Sex::Male,
            }),
            mass_kg: within(subject.mass_kg, MASS_KG, || "subject.mass_kg".into())?,
            age_years: within(subject.age_years, AGE_YEARS, || "subject.age_years".into())?,
            stature_sd_mm: within(subject.stature_sd_mm, STATURE_SD_MM, || {
                "subject.stature_sd_mm".into()
            })?,
            clothes: subject.clothes.map(ClothesFile::statement),
            sole_mm: within(subject.sole_mm, SOLE_MM, || "subject.sole_mm".into())?,
        },
        camera: CameraSetup {
            vertical_fov_radians: within(camera.vertical_fov_deg, VERTICAL_FOV_DEG, || {
                "camera.vertical_fov_deg".into()
            })?
            .map(f64::to_radians),
            height_mm: within(camera.height_mm, CAMERA_HEIGHT_MM, || {
                "camera.height_mm".into()
            })?,
            distance_mm: within(camera.distance_mm, CAMERA_DISTANCE_MM, || {
                "camera.distance_mm".into()
            })?,
            pitch_radians: within(camera.pitch_deg, PITCH_DEG, || "camera.pitch_deg".into())?
                .map(f64::to_radians),
            yaw_radians: within(camera.yaw_deg, YAW_DEG, || "camera.yaw_deg".into())?
                .map(f64::to_radians),
            distortion: 0.0,
        },
        angle_sd_deg: within(file.angle_sd_deg, ANGLE_SD_DEG, || "angle_sd_deg".into())?,
        background: file.background,
        video: file.video,
        views: file.views,
    };
    if let Some(path) = &checked.background {
        check_path(path, || "background".to_owned())?;
    }
    if let Some(views) = &checked.views {
        check_views(views)?;
    }
    Ok(checked)
}

fn check_views(views: &[ManifestView]) -> Result<(), ManifestError> {
    if views.is_empty() {
        return Err(ManifestError::NoViews);
    }
    units::check_angles(views)?;
    let mut names = std::collections::HashMap::new();
    for (index, view) in views.iter().enumerate() {
        within(view.angle_deg.flatten(), ANGLE_DEG, || {
            format!("views[{index}].angle_deg")
        })?;
        let paths = [
            ("image", Some(&view.image)),
            ("keypoints", view.keypoints.as_ref()),
            ("mask", view.mask.as_ref()),
        ];
        for (key, path) in paths {
            if let Some(path) = path {
                check_path(path, || format!("views[{index}].{key}"))?;
            }
        }
        let name = stem(&view.image);
        // A folder of this name receives the results.
        if name.trim_matches('.').is_empty() {
            return Err(ManifestError::PathLeaves {
                key: format!("views[{index}].image"),
                path: view.image.clone(),
            });
        }
        if let Some(first) = names.insert(name.clone(), index) {
            return Err(ManifestError::SameName {
                first,
                second: index,
                name,
            });
        }
    }
    Ok(())
}

fn check_path(path: &str, key: impl FnOnce() -> String) -> Result<(), ManifestError> {
    if stays_inside(path) {
        return Ok(());
    }
    Err(ManifestError::PathLeaves {
        key: key(),
        path: path.to_owned(),
    })
}

fn within(
    value: Option<f64>,
    range: RangeInclusive<f64>,
    key: impl FnOnce() -> String,
) -> Result<Option<f64>, ManifestError> {
    match value {
        Some(value) if !range.contains(&value) => Err(ManifestError::OutOfRange {
            key: key(),
            value,
            lowest: *range.start(),
            highest: *range.end(),
        }),
        inside => Ok(inside),
    }
}

/// Returns the name of a view: the photo's file name without its extension
pub fn stem(image: &str) -> String {
    let stem = Path::new(image).file_stem();
    stem.map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(json: &str) -> String {
        parse_manifest(json.as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn all_keys_are_read() {
        let manifest = parse_manifest(
            br#"{ "pose": "t", "subject": { "stature_mm": 1748.0, "stature_sd_mm": 4, "sex": "male", "mass_kg": 81, "age_years": 44 },
                 "camera": { "mm_per_px": 2.1, "vertical_fov_deg": 50.0, "height_mm": 890, "distance_mm": 2400.0, "pitch_deg": -5 },
                 "views": [ { "image": "a/000.jpg", "keypoints": "k.json", "angle_deg": 45, "mask": "m.png" } ] }"#,
        )
        .unwrap();
        assert_eq!(manifest.pose, ReferencePose::T);
        assert_eq!(manifest.stature_mm, Some(1748.0));
        assert_eq!(manifest.camera.height_mm, Some(890.0));
        assert_eq!(manifest.mm_per_px, Some(2.1));
        let subject = manifest.subject;
        assert_eq!(
            (subject.sex, subject.mass_kg),
            (Some(Sex::Male), Some(81.0))
        );
        assert_eq!(subject.age_years, Some(44.0));
        assert_eq!(subject.stature_sd_mm, Some(4.0));
        let pitch = manifest.camera.pitch_radians.unwrap();
        assert!((pitch.to_degrees() + 5.0).abs() < 1e-9);
        let view = &manifest.views.unwrap()[0];
        assert_eq!(stem(&view.image), "000");
        assert_eq!(view.angle_deg, Some(Some(45.0)));
        assert_eq!(view.mask.as_deref(), Some("m.png"));
    }

    #[test]
    fn clothes_are_one_looseness_or_one_above_and_one_below() {
        let clothes = |json: &str| {
            let file = format!(r#"{{ "subject": {{ "clothes": {json} }} }}"#);
            parse_manifest(file.as_bytes()).map(|manifest| manifest.subject.clothes)
        };
        let all = StatedClothes::all(Looseness::Loose);
        assert_eq!(clothes(r#""loose""#).unwrap(), Some(all));
        let parts = StatedClothes {
            top: Looseness::Normal,
            bottom: Looseness::Tight,
        };
        let json = r#"{ "top": "normal", "bottom": "tight" }"#;
        assert_eq!(clothes(json).unwrap(), Some(parts));
        let unknown = r#"{ "top": "loose", "bottom": "loose", "hat": "loose" }"#;
        for wrong in [r#""baggy""#, "3", r#"{ "top": "loose" }"#, unknown] {
            let message = clothes(wrong).unwrap_err().to_string();
            assert!(
                message.contains(r#""tight", "normal" or "loose""#),
                "{message}"
            );
        }
    }

    #[test]
    fn an_angle_that_is_null_is_unknown() {
        let manifest = parse_manifest(
            br#"{ "angle_sd_deg": 12, "views": [ { "image": "0.jpg", "angle_deg": null }, { "image": "1.jpg" } ] }"#,
        )
        .unwrap();
        assert_eq!(manifest.angle_sd_deg, Some(12.0));
        let angles = manifest.views.unwrap();
        assert_eq!(angles[0].angle_deg, Some(None));
        assert_eq!(angles[1].angle_deg, None);
        assert!(error(r#"{ "angle_sd_deg": 0 }"#).contains("angle_sd_deg"));
    }

    #[test]
    fn photos_of_a_video_have_times_and_its_turn() {
        let manifest = parse_manifest(
            br#"{ "video": { "turned_deg": 200.5, "turn": [ [0.0, -10.0], [4.0, 190.5] ] },
                "views": [ { "image": "0.jpg", "time_s": 1.5 } ] }"#,
        )
        .unwrap();
        assert_eq!(manifest.views.unwrap()[0].time_s, Some(1.5));
        let video = manifest.video.unwrap();
        assert_eq!(
            (video.turned_deg, video.missing_count, video.hdr),
            (200.5, 0, false)
        );
        assert_eq!(video.turn, [(0.0, -10.0), (4.0, 190.5)]);
        assert!(error(r#"{ "video": {} }"#).contains("turned_deg"));
    }

    #[test]
    fn all_keys_are_optional() {
        assert_eq!(parse_manifest(b"{}").unwrap(), Manifest::default());
    }

    #[test]
    fn an_unknown_key_is_reported_with_its_position() {
        let message = error("{\n \"subject\": { \"statur_mm\": 1700 } }");
        assert!(message.contains("statur_mm"), "{message}");
        assert!(message.contains("line 2"), "{message}");
        assert!(
            error(r#"{ "views": [ { "image": "a.jpg", "angle": 3 } ] }"#).contains("`angle`"),
            "keys of views are checked too"
        );
    }

    #[test]
    fn values_out_of_range_are_reported_with_the_range() {
        let message = error(r#"{ "subject": { "stature_mm": 400 } }"#);
        assert!(message.contains("subject.stature_mm"), "{message}");
        assert!(message.contains("500") && message.contains("2700"));
        for (key, value) in [
            ("vertical_fov_deg", "-40"),
            ("height_mm", "-1"),
            ("distance_mm", "0"),
            ("pitch_deg", "90"),
            ("mm_per_px", "0"),
        ] {
            let json = format!("{{ \"camera\": {{ \"{key}\": {value} }} }}");
            assert!(error(&json).contains(&format!("camera.{key}")));
        }
        for poison in ["NaN", "1e999", "\"50\""] {
            let json = format!("{{ \"camera\": {{ \"height_mm\": {poison} }} }}");
            assert!(error(&json).contains("line 1"), "{poison}");
        }
    }

    #[test]
    fn text_that_is_not_json_is_reported_with_a_right_line() {
        let message = error("{ \"subject\": { \"stature_mm\" 1748 } }");
        for part in ["line 1, column 29", "`1748 } }`", "\"stature_mm\": 1748 }"] {
            assert!(message.contains(part), "{message}");
        }
        assert!(error("").contains("empty"));
        // The first key is read although the file was fixed.
        assert!(error("'{ \"statur_mm\": 3, }'").contains("`statur_mm`"));
    }

    #[test]
    fn paths_stay_inside() {
        for path in [
            "../a.jpg",
            "a/../../b.jpg",
            "/etc/passwd",
            "..",
            "",
            "C:\\a.jpg",
            "a\\..\\..\\b",
        ] {
            let json = serde_json::json!({ "views": [ { "image": path } ] }).to_string();
            assert!(error(&json).contains("views[0].image"), "{path}");
            let json =
                serde_json::json!({ "views": [ { "image": "a.jpg", "mask": path } ] }).to_string();
            assert!(error(&json).contains("views[0].mask"), "{path}");
        }
        // Its results would go to the folder `..`.
        let dots = r#"{ "views": [ { "image": "...jpg" } ] }"#;
        assert!(error(dots).contains("views[0].image"));
    }

    #[test]
    fn names_must_be_unique() {
        let message = error(r#"{ "views": [ { "image": "a/1.jpg" }, { "image": "b/1.png" } ] }"#);
        assert!(message.contains("\"1\""), "{message}");
        assert!(error(r#"{ "views": [] }"#).contains("empty"));
        assert!(error(r#"{ "views": [ { "angle_deg": 3 } ] }"#).contains("image"));
    }
}
