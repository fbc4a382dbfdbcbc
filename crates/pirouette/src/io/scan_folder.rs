//! Scan folders: a manifest or bare photos, their keypoints and given masks.
//!
//! A view that cannot be used never takes the others down: it is handed back with its reason. Only what
//! concerns the whole folder (an unreadable manifest, a path that leaves the folder) is an error.

use std::cmp::Ordering;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use pirouette_geom::Mask;
use rayon::prelude::*;
use thiserror::Error;

use crate::io::manifest::{self, Manifest, ManifestError, ManifestView};
use crate::io::openpose::{self, KeypointsError};
use crate::io::photo::{self, PhotoError};
use crate::scan::{CameraSetup, Photo, Scan, View};
use crate::skeleton::Keypoints;
use crate::units::TurnAngle;

/// Photos are shrunk to this length of the longer side, in px
///
/// Twice as many pixels per body as the masks need for girths (2 mm a pixel at 900 px of stature); time and
/// memory grow with the area, and phones deliver 4000 px.
pub const DEFAULT_MAX_SIDE_PX: usize = 1600;

/// Longest keypoint file or manifest that is read, in bytes
const MAX_JSON_BYTES: u64 = 64 << 20;

/// Longest photo file that is read, in bytes
const MAX_PHOTO_BYTES: u64 = 512 << 20;

/// Fields of view of one camera agree within this share; more is another zoom
const MAX_FOV_SPREAD: f64 = 0.03;

/// Endings of photo files in a folder without a manifest, in lower case
const PHOTO_ENDINGS: [&str; 4] = ["jpg", "jpeg", "png", "webp"];

/// Ends of the names of images that are no photos: masks, OpenPose's own pictures
const NO_PHOTO_ENDS: [&str; 2] = ["_mask", "_rendered"];

/// What was found in a scan folder
#[derive(Debug)]
pub struct LoadedScan {
    /// The views that can be used
    pub scan: Scan,
    /// The views that cannot
    pub failed: Vec<FailedView>,
    /// What was decided without being asked
    pub warnings: Vec<ScanWarning>,
}

/// A view that could not be loaded
#[derive(Debug)]
pub struct FailedView {
    /// Stem of the photo's file name
    pub view: String,
    /// How far the person has turned in it
    pub turn: TurnAngle,
    /// Why
    pub reason: ViewError,
}

/// Why a whole scan cannot be loaded
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum ScanError {
    #[error(
        "{} is no folder; a scan is a folder of photos with keypoint files", path.display()
    )]
    NotAFolder { path: PathBuf },
    #[error("cannot read {}: {source}", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error("{}: {source}", path.display())]
    Manifest {
        path: PathBuf,
        source: ManifestError,
    },
    #[error("{} leads out of the scan folder; copy the file into it", path.display())]
    LinkLeaves { path: PathBuf },
    #[error(
        "no photos in {}; they end in .jpg, .jpeg, .png or .webp", folder.display()
    )]
    NoPhotos { folder: PathBuf },
    #[error("{first} and {second} have the same name; rename one of them")]
    SameName { first: String, second: String },
}

/// Why one view cannot be used
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum ViewError {
    #[error("cannot read {file}: {source}")]
    Read { file: String, source: io::Error },
    #[error("{file}: {source}")]
    Photo { file: String, source: PhotoError },
    #[error("{file}: {source}")]
    Keypoints {
        file: String,
        source: KeypointsError,
    },
    #[error(
        "no keypoints: there is no {file} beside the photo or in keypoints/ (OpenPose JSON, BODY_25)"
    )]
    NoKeypointFile { file: String },
    #[error("no keypoints: {file} holds nobody")]
    Nobody { file: String },
    #[error(
        "{file} has {mask_width} x {mask_height} px, but the photo {photo_width} x {photo_height} px"
    )]
    MaskSize {
        file: String,
        mask_width: usize,
        mask_height: usize,
        photo_width: usize,
        photo_height: usize,
    },
    #[error("{file} is empty: no pixel is person")]
    EmptyMask { file: String },
}

/// A decision that was taken without being asked
#[derive(Debug, Clone, PartialEq, Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum ScanWarning {
    #[error(
        "{people_count} people in the keypoint file; took the surest one near the middle of the photo"
    )]
    SeveralPeople { view: String, people_count: usize },
    #[error(
        "{missing_count} views have no angle_deg; took their place in an even turn, which only fits if all views are evenly spread"
    )]
    AnglesMissing { missing_count: usize },
    #[error(
        "the photos were taken with different zoom ({smallest_deg:.1} to {largest_deg:.1} degrees by EXIF); took the median"
    )]
    FieldsOfViewDiffer { smallest_deg: f64, largest_deg: f64 },
    #[error("{file} was not taken as a photo; name it in scan.json to use it")]
    ImageIgnored { file: String },
}

impl ScanWarning {
    /// The view that it is about, if it is about one
    pub fn view(&self) -> Option<&str> {
        match self {
            ScanWarning::SeveralPeople { view, .. } => Some(view),
            _ => None,
        }
    }

    /// Stable name for programs
    pub fn code(&self) -> &'static str {
        match self {
            ScanWarning::SeveralPeople { .. } => "several_people",
            ScanWarning::AnglesMissing { .. } => "angles_missing",
            ScanWarning::FieldsOfViewDiffer { .. } => "fields_of_view_differ",
            ScanWarning::ImageIgnored { .. } => "image_ignored",
        }
    }
}

/// Loads a scan folder; `max_side_px` is the longer side that larger photos are shrunk to
///
/// Without a manifest, or without `views` in it, the photos are taken in the order of their names, where
/// numbers count as numbers (`2.jpg` before `10.jpg`).
///
/// # Errors
/// When the folder or its manifest cannot be read, a path leaves the folder, or there are no photos.
pub fn load_scan(folder: &Path, max_side_px: usize) -> Result<LoadedScan, ScanError> {
    if !folder.is_dir() {
        return Err(ScanError::NotAFolder {
            path: folder.to_owned(),
        });
    }
    let folder = Folder {
        path: folder,
        canonical: folder.canonicalize().map_err(|source| ScanError::Read {
            path: folder.to_owned(),
            source,
        })?,
    };
    let manifest = read_manifest(&folder)?;
    let mut warnings = Vec::new();
    let entries = match manifest.views {
        Some(views) => views,
        None => find_photos(&folder, &mut warnings)?,
    };
    folder.check_links(&entries)?;

    let missing_count = entries.iter().filter(|e| e.angle_deg.is_none()).count();
    if missing_count > 0 && missing_count < entries.len() {
        warnings.push(ScanWarning::AnglesMissing { missing_count });
    }
    let turn = |index: usize| {
        let even = 360.0 * index as f64 / entries.len() as f64;
        TurnAngle::from_degrees(entries[index].angle_deg.unwrap_or(even))
    };

    let loaded: Vec<_> = entries
        .par_iter()
        .map(|entry| load_view(&folder, entry, max_side_px))
        .collect();
    let (mut views, mut failed, mut fields_of_view) = (Vec::new(), Vec::new(), Vec::new());
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
                fields_of_view.extend(loaded.vertical_fov_radians);
                views.push(View {
                    name,
                    photo: loaded.photo,
                    input_size_px: loaded.input_size_px,
                    turn,
                    keypoints: loaded.keypoints,
                    mask: loaded.mask,
                });
            }
            Err(reason) => failed.push(FailedView {
                view: name,
                turn,
                reason,
            }),
        }
    }
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
            stature_mm: manifest.stature_mm,
            camera,
            views,
        },
        failed,
        warnings,
    })
}

/// A scan folder that nothing may lead out of
struct Folder<'a> {
    path: &'a Path,
    canonical: PathBuf,
}

impl Folder<'_> {
    fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    fn contains(&self, file: &Path) -> bool {
        // What does not exist leads nowhere; reading it then fails.
        file.canonicalize()
            .map_or(true, |canonical| canonical.starts_with(&self.canonical))
    }

    fn check_link(&self, name: &str) -> Result<(), ScanError> {
        let path = self.file(name);
        if self.contains(&path) {
            Ok(())
        } else {
            Err(ScanError::LinkLeaves { path })
        }
    }

    fn check_links(&self, entries: &[ManifestView]) -> Result<(), ScanError> {
        for entry in entries {
            self.check_link(&entry.image)?;
            for name in entry.keypoints.iter().chain(&entry.mask) {
                self.check_link(name)?;
            }
            for name in keypoint_places(&entry.image) {
                self.check_link(&name)?;
            }
        }
        Ok(())
    }

    /// The content of a plain file of at most `limit` bytes
    fn read(&self, name: &str, limit: u64) -> io::Result<Vec<u8>> {
        let path = self.file(name);
        // A pipe would block, a device never end.
        if !fs::metadata(&path)?.is_file() {
            return Err(io::Error::other("not a plain file"));
        }
        let mut bytes = Vec::new();
        fs::File::open(&path)?
            .take(limit + 1)
            .read_to_end(&mut bytes)?;
        if bytes.len() as u64 > limit {
            return Err(io::Error::from(io::ErrorKind::FileTooLarge));
        }
        Ok(bytes)
    }
}

fn read_manifest(folder: &Folder) -> Result<Manifest, ScanError> {
    let path = folder.file(manifest::FILE_NAME);
    if !path.exists() {
        return Ok(Manifest::default());
    }
    folder.check_link(manifest::FILE_NAME)?;
    match folder.read(manifest::FILE_NAME, MAX_JSON_BYTES) {
        Ok(json) => {
            manifest::parse_manifest(&json).map_err(|source| ScanError::Manifest { path, source })
        }
        Err(source) => Err(ScanError::Read { path, source }),
    }
}

/// The photos of a folder without a manifest
fn find_photos(
    folder: &Folder,
    warnings: &mut Vec<ScanWarning>,
) -> Result<Vec<ManifestView>, ScanError> {
    let read = |source| ScanError::Read {
        path: folder.path.to_owned(),
        source,
    };
    let mut files: Vec<String> = Vec::new();
    for entry in fs::read_dir(folder.path).map_err(read)? {
        // Names that are no text cannot be named in results either.
        let Ok(name) = entry.map_err(read)?.file_name().into_string() else {
            continue;
        };
        let ending = Path::new(&name).extension();
        let ending = ending.map(|e| e.to_string_lossy().to_lowercase());
        let photo = ending.is_some_and(|e| PHOTO_ENDINGS.contains(&e.as_str()));
        if !photo || name.starts_with('.') || !folder.file(&name).is_file() {
            continue;
        }
        files.push(name);
    }
    files.sort_by(|a, b| natural_order(a, b));
    let (ignored, photos): (Vec<_>, Vec<_>) = files.into_iter().partition(|name| {
        let stem = manifest::stem(name);
        NO_PHOTO_ENDS.iter().any(|end| stem.ends_with(end))
    });
    for file in ignored {
        warnings.push(ScanWarning::ImageIgnored { file });
    }
    if photos.is_empty() {
        return Err(ScanError::NoPhotos {
            folder: folder.path.to_owned(),
        });
    }
    for pair in photos.windows(2) {
        if manifest::stem(&pair[0]) == manifest::stem(&pair[1]) {
            return Err(ScanError::SameName {
                first: pair[0].clone(),
                second: pair[1].clone(),
            });
        }
    }
    let view = |image| ManifestView {
        image,
        keypoints: None,
        angle_deg: None,
        mask: None,
    };
    Ok(photos.into_iter().map(view).collect())
}

/// Compares names so that runs of digits count as numbers; `2.jpg` comes before `10.jpg`
///
/// Stems go first, so that files of one stem are neighbors.
fn natural_order(a: &str, b: &str) -> Ordering {
    let key = |name: &str| (pieces(&manifest::stem(name)), name.to_owned());
    key(a).cmp(&key(b))
}

/// A name as runs of digits and other characters; a number compares by its length without zeros, then its digits
fn pieces(name: &str) -> Vec<(bool, usize, String)> {
    let mut pieces: Vec<(bool, usize, String)> = Vec::new();
    for c in name.chars() {
        let other = !c.is_ascii_digit();
        match pieces.last_mut() {
            Some((last_other, _, text)) if *last_other == other => text.push(c),
            _ => pieces.push((other, 0, c.to_string())),
        }
    }
    for (other, length, text) in &mut pieces {
        if !*other {
            let digits = text.trim_start_matches('0');
            *length = digits.len();
            *text = digits.to_owned();
        }
    }
    // Only zeros tell `1` from `01`; the whole name then decides.
    pieces
}

struct LoadedView {
    photo: Photo,
    input_size_px: (usize, usize),
    keypoints: Keypoints,
    people_count: usize,
    mask: Option<Mask>,
    vertical_fov_radians: Option<f64>,
}

fn load_view(
    folder: &Folder,
    entry: &ManifestView,
    max_side_px: usize,
) -> Result<LoadedView, ViewError> {
    let image = &entry.image;
    let bytes = read_file(folder, image, MAX_PHOTO_BYTES)?;
    let in_photo = |source| ViewError::Photo {
        file: image.clone(),
        source,
    };
    let decoded = photo::decode_photo(&bytes).map_err(in_photo)?;
    drop(bytes);
    let (width, height) = (decoded.photo.width(), decoded.photo.height());
    let mask = match &entry.mask {
        Some(file) => Some(load_mask(folder, file, width, height)?),
        None => {
            photo::check_contrast(&decoded.photo).map_err(in_photo)?;
            None
        }
    };
    let (mut keypoints, people_count) = load_keypoints(folder, entry, width, height)?;
    let photo = photo::shrink(decoded.photo, max_side_px);
    let (shrunk_width, shrunk_height) = (photo.width(), photo.height());
    let scale = glam::DVec2::new(
        shrunk_width as f64 / width as f64,
        shrunk_height as f64 / height as f64,
    );
    keypoints = scale_keypoints(&keypoints, scale);
    let mask = mask.map(|mask| {
        let soft = mask.map(|&inside| if inside { 1.0 } else { 0.0 });
        photo::resample(&soft, shrunk_width, shrunk_height).threshold(0.5)
    });
    Ok(LoadedView {
        photo,
        input_size_px: (width, height),
        keypoints,
        people_count,
        mask,
        vertical_fov_radians: decoded.vertical_fov_radians,
    })
}

fn read_file(folder: &Folder, file: &str, limit: u64) -> Result<Vec<u8>, ViewError> {
    folder.read(file, limit).map_err(|source| ViewError::Read {
        file: file.to_owned(),
        source,
    })
}

fn load_mask(
    folder: &Folder,
    file: &str,
    photo_width: usize,
    photo_height: usize,
) -> Result<Mask, ViewError> {
    let bytes = read_file(folder, file, MAX_PHOTO_BYTES)?;
    let mask = photo::decode_mask(&bytes).map_err(|source| ViewError::Photo {
        file: file.to_owned(),
        source,
    })?;
    if (mask.width(), mask.height()) != (photo_width, photo_height) {
        return Err(ViewError::MaskSize {
            file: file.to_owned(),
            mask_width: mask.width(),
            mask_height: mask.height(),
            photo_width,
            photo_height,
        });
    }
    if mask.area() == 0 {
        return Err(ViewError::EmptyMask {
            file: file.to_owned(),
        });
    }
    Ok(mask)
}

/// Where the keypoints of a photo are looked for
fn keypoint_places(image: &str) -> [String; 2] {
    let file = format!("{}_keypoints.json", manifest::stem(image));
    let beside = Path::new(image).with_file_name(&file);
    [
        beside.to_string_lossy().into_owned(),
        format!("keypoints/{file}"),
    ]
}

/// The person's keypoints and the number of people; with a given mask a view may do without
fn load_keypoints(
    folder: &Folder,
    entry: &ManifestView,
    width_px: usize,
    height_px: usize,
) -> Result<(Keypoints, usize), ViewError> {
    let places = keypoint_places(&entry.image);
    let file = match &entry.keypoints {
        Some(file) => Some(file),
        None => places.iter().find(|place| folder.file(place).exists()),
    };
    let Some(file) = file else {
        let [file, _] = places;
        return match entry.mask {
            Some(_) => Ok((Keypoints::default(), 0)),
            None => Err(ViewError::NoKeypointFile { file }),
        };
    };
    let json = read_file(folder, file, MAX_JSON_BYTES)?;
    let detection = openpose::parse_keypoints(&json, width_px, height_px).map_err(|source| {
        ViewError::Keypoints {
            file: file.clone(),
            source,
        }
    })?;
    if detection.keypoints.found_count() == 0 && entry.mask.is_none() {
        return Err(ViewError::Nobody { file: file.clone() });
    }
    Ok((detection.keypoints, detection.people_count))
}

fn scale_keypoints(keypoints: &Keypoints, scale: glam::DVec2) -> Keypoints {
    let mut scaled = Keypoints::default();
    for (joint, mut keypoint) in keypoints.iter() {
        keypoint.position *= scale;
        scaled.set(joint, keypoint);
    }
    scaled
}

/// The median field of view that the photos' EXIF tells
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
mod tests {
    use super::*;
    use crate::skeleton::Joint;

    struct TestFolder(tempfile::TempDir);

    impl TestFolder {
        fn new() -> Self {
            Self(tempfile::tempdir().unwrap())
        }

        fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> &Self {
            let path = self.0.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
            self
        }

        fn photo(&self, name: &str, width: usize, height: usize) -> &Self {
            let photo = Photo::from_fn(width, height, |x, y| [x as u8, y as u8, 7]);
            self.write(name, photo::encode_photo_png(&photo).unwrap())
        }

        fn keypoints(&self, name: &str) -> &Self {
            self.write(name, keypoint_file(&[0.5]))
        }

        fn load(&self) -> Result<LoadedScan, ScanError> {
            load_scan(self.0.path(), DEFAULT_MAX_SIDE_PX)
        }
    }

    fn keypoint_file(confidences: &[f64]) -> String {
        let person = |confidence: &f64| {
            let joints: Vec<String> = (0..25)
                .map(|j| format!("{},{j},{confidence}", 10 + j))
                .collect();
            format!("{{\"pose_keypoints_2d\":[{}]}}", joints.join(","))
        };
        let people: Vec<String> = confidences.iter().map(person).collect();
        format!("{{\"people\":[{}]}}", people.join(","))
    }

    #[test]
    fn a_bare_folder_is_an_even_turn_in_name_order() {
        let folder = TestFolder::new();
        folder
            .photo("10.png", 40, 50)
            .photo("2.png", 40, 50)
            .photo("1.png", 40, 50);
        folder.photo("2_mask.png", 40, 50);
        folder.photo("11.png", 40, 50).write("notes.txt", "");
        folder
            .keypoints("1_keypoints.json")
            .keypoints("keypoints/2_keypoints.json");
        folder
            .keypoints("10_keypoints.json")
            .keypoints("11_keypoints.json");
        let loaded = folder.load().unwrap();
        let views = &loaded.scan.views;
        let names: Vec<&str> = views.iter().map(|v| v.name.as_str()).collect();
        assert_eq!(names, ["1", "2", "10", "11"]);
        assert!((views[3].turn.degrees() - 270.0).abs() < 1e-9);
        assert!(loaded.failed.is_empty());
        let ignored = ScanWarning::ImageIgnored {
            file: "2_mask.png".into(),
        };
        assert_eq!(loaded.warnings, [ignored]);
    }

    #[test]
    fn a_failing_view_is_named_and_keeps_its_angle() {
        let folder = TestFolder::new();
        for name in ["0", "1", "2", "3", "4", "5"] {
            folder.photo(&format!("{name}.png"), 40, 50);
            folder.keypoints(&format!("{name}_keypoints.json"));
        }
        folder.photo("1.png", 1, 1);
        folder.write("2_keypoints.json", keypoint_file(&[]));
        folder.write("3_keypoints.json", keypoint_file(&[f64::NAN]));
        fs::remove_file(folder.0.path().join("4_keypoints.json")).unwrap();
        let loaded = folder.load().unwrap();
        assert_eq!(loaded.scan.views.len(), 2);
        assert!((loaded.scan.views[1].turn.degrees() - 300.0).abs() < 1e-9);
        let reasons: Vec<String> = loaded.failed.iter().map(|f| f.reason.to_string()).collect();
        assert!(reasons[0].contains("1 x 1 px"), "{reasons:?}");
        assert!(reasons[1].contains("holds nobody"), "{reasons:?}");
        assert!(reasons[2].contains("NaN"), "{reasons:?}");
        assert!(reasons[3].contains("4_keypoints.json"), "{reasons:?}");
        assert!((loaded.failed[3].turn.degrees() - 240.0).abs() < 1e-9);
    }

    #[test]
    fn a_given_mask_needs_no_keypoints_but_the_size_of_the_photo() {
        let folder = TestFolder::new();
        let mask = |width: usize| photo::encode_mask(&Mask::filled(width, 50, true)).unwrap();
        folder
            .photo("0.png", 40, 50)
            .photo("1.png", 40, 50)
            .photo("2.png", 40, 50);
        folder
            .write("0_mask.png", mask(40))
            .write("1_mask.png", mask(41));
        folder.write(
            "2_mask.png",
            photo::encode_mask(&Mask::filled(40, 50, false)).unwrap(),
        );
        folder.write(
            "scan.json",
            r#"{ "views": [ { "image": "0.png", "mask": "0_mask.png" },
                            { "image": "1.png", "mask": "1_mask.png" },
                            { "image": "2.png", "mask": "2_mask.png" } ] }"#,
        );
        let loaded = folder.load().unwrap();
        let mask = loaded.scan.views[0].mask.as_ref().unwrap();
        assert_eq!(mask.area(), 2000);
        assert!(matches!(
            loaded.failed[0].reason,
            ViewError::MaskSize { .. }
        ));
        assert!(matches!(
            loaded.failed[1].reason,
            ViewError::EmptyMask { .. }
        ));
    }

    #[test]
    fn large_photos_are_shrunk_with_their_keypoints() {
        let folder = TestFolder::new();
        folder.photo("0.png", 80, 100).keypoints("0_keypoints.json");
        let loaded = load_scan(folder.0.path(), 50).unwrap();
        let view = &loaded.scan.views[0];
        assert_eq!((view.photo.width(), view.photo.height()), (40, 50));
        assert_eq!(view.input_size_px, (80, 100));
        let nose = view.keypoints.get(Joint::Nose).position;
        assert!((nose.x - 5.0).abs() < 1e-9);
    }

    #[test]
    fn several_people_are_told() {
        let folder = TestFolder::new();
        folder
            .photo("0.png", 40, 50)
            .write("0_keypoints.json", keypoint_file(&[0.3, 0.9]));
        let loaded = folder.load().unwrap();
        assert_eq!(loaded.warnings[0].code(), "several_people");
        let nose = loaded.scan.views[0].keypoints.get(Joint::Nose);
        assert!((nose.confidence - 0.9).abs() < 1e-12);
    }

    #[test]
    fn errors_of_the_whole_folder_say_where() {
        let folder = TestFolder::new();
        assert!(matches!(folder.load(), Err(ScanError::NoPhotos { .. })));
        let nowhere = load_scan(&folder.0.path().join("nowhere"), 100);
        assert!(matches!(nowhere, Err(ScanError::NotAFolder { .. })));
        folder.photo("0.png", 40, 50).photo("0.jpg", 40, 50);
        assert!(matches!(folder.load(), Err(ScanError::SameName { .. })));
        folder.write("scan.json", r#"{ "view": [] }"#);
        let message = folder.load().unwrap_err().to_string();
        assert!(
            message.contains("scan.json") && message.contains("`view`"),
            "{message}"
        );
    }

    #[cfg(unix)]
    #[test]
    fn links_may_not_lead_out() {
        let outside = TestFolder::new();
        outside.photo("secret.png", 40, 50).keypoints("secret.json");
        let folder = TestFolder::new();
        folder
            .photo("real.png", 40, 50)
            .keypoints("real_keypoints.json");
        let link = |from: &str, to: &Path| {
            std::os::unix::fs::symlink(to, folder.0.path().join(from)).unwrap();
        };
        link("inside.png", &folder.0.path().join("real.png"));
        link(
            "inside_keypoints.json",
            &folder.0.path().join("real_keypoints.json"),
        );
        assert_eq!(folder.load().unwrap().scan.views.len(), 2);
        link("zero.png", &outside.0.path().join("secret.png"));
        assert!(matches!(folder.load(), Err(ScanError::LinkLeaves { .. })));
        fs::remove_file(folder.0.path().join("zero.png")).unwrap();
        fs::remove_file(folder.0.path().join("real_keypoints.json")).unwrap();
        link("real_keypoints.json", &outside.0.path().join("secret.json"));
        assert!(matches!(folder.load(), Err(ScanError::LinkLeaves { .. })));
    }

    #[test]
    fn numbers_in_names_count_as_numbers() {
        let mut names = vec!["b1", "a10", "a2", "a02", "a", "10", "9", "x1y2", "x1y10"];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(
            names,
            ["9", "10", "a", "a02", "a2", "a10", "b1", "x1y2", "x1y10"]
        );
    }
}
