//! Finds the photos and keypoint files of a scan by their names.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::Path;

use super::keypoint_files::paths_in_scan;
use super::{ScanError, ScanWarning};
use crate::formats::manifest::{self, ManifestView};
use crate::source::Source;

/// File extensions of photos, in lower case
pub(crate) const PHOTO_EXTENSIONS: [&str; 4] = ["jpg", "jpeg", "png", "webp"];

/// File extensions of photos that cannot be read; their views fail with the reason, at their turn angles
const OTHER_PHOTO_EXTENSIONS: [&str; 7] = ["heic", "heif", "avif", "tif", "tiff", "bmp", "dng"];

/// Suffixes of the stems of images that are not photos: masks and images rendered by OpenPose
const NO_PHOTO_SUFFIXES: [&str; 2] = ["_mask", "_rendered"];

/// Stems of images that are not photos: those of results that were written into the scan folder
const RESULT_STEMS: [&str; 6] = [
    "contact",
    "tapes",
    "residuals",
    "overlay",
    "normalized",
    "mask",
];

/// Stem of a photo of the room without the person
const BACKGROUND_STEM: &str = "background";

/// Folders whose images are not photos of a scan: results, and ground truth
const NO_PHOTO_FOLDERS: [&str; 3] = ["views", "truth", "keypoints"];

/// Endings of keypoint files behind the name of the photo, with or without its extension, in lower case
const KEYPOINT_ENDINGS: [&str; 7] = [
    "",
    "_keypoints",
    "-keypoints",
    ".keypoints",
    "_pose",
    "_openpose",
    "_000000000000_keypoints",
];

/// JSON files that are not the keypoints of one photo: the manifest, results, and the keypoints of all photos
const NO_KEYPOINT_STEMS: [&str; 7] = [
    "scan",
    "result",
    "view",
    "measurements",
    "measurements.flat",
    "keypoints",
    "alphapose-results",
];

/// Names of the files at the top of a source and in its folders
pub(super) struct Listing {
    /// Names by folder; the top is the empty name
    names: BTreeMap<String, Vec<String>>,
}

/// Where the photos of a scan without a list of views are
pub(super) enum PhotoFolder {
    /// At the top, or nowhere
    Top,
    /// In one folder
    Below(String),
    /// In at least these folders
    Several(String, String),
}

impl Listing {
    /// Lists a source, without hidden files
    pub(super) fn of(source: &Source) -> Result<Self, ScanError> {
        let all = source.names().map_err(|error| ScanError::Read {
            path: source.path(),
            source: error,
        })?;
        let mut names: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for name in all {
            let (folder, file) = name.rsplit_once('/').unwrap_or(("", &name));
            // macOS adds files such as `._000.jpg` on other disks.
            if !file.starts_with('.') && !folder.starts_with('.') && folder != "__MACOSX" {
                names.entry(folder.to_owned()).or_default().push(name);
            }
        }
        Ok(Self { names })
    }

    /// Returns where the photos are
    pub(super) fn photo_folder(&self) -> PhotoFolder {
        let is_photo = |name: &String| has_extension(name, &PHOTO_EXTENSIONS) && !is_no_photo(name);
        let with_photos = |(folder, names): (&String, &Vec<String>)| {
            let shown = !NO_PHOTO_FOLDERS.contains(&folder.as_str()) && names.iter().any(is_photo);
            shown.then(|| folder.clone())
        };
        let mut folders = self.names.iter().filter_map(with_photos);
        match (folders.next(), folders.next()) {
            (Some(first), _) if first.is_empty() => PhotoFolder::Top,
            (Some(first), Some(second)) => PhotoFolder::Several(first, second),
            (Some(only), None) => PhotoFolder::Below(only),
            (None, _) => PhotoFolder::Top,
        }
    }

    /// Finds the photos of a scan without a list of views
    pub(super) fn find_photos(
        &self,
        source: &Source,
        warnings: &mut Vec<ScanWarning>,
    ) -> Result<Vec<ManifestView>, ScanError> {
        let folder = match self.photo_folder() {
            PhotoFolder::Top => String::new(),
            PhotoFolder::Below(folder) => {
                warnings.push(ScanWarning::PhotosInFolder {
                    folder: folder.clone(),
                });
                folder
            }
            PhotoFolder::Several(first, second) => {
                return Err(ScanError::SeveralFolders {
                    folder: source.path(),
                    first,
                    second,
                });
            }
        };
        let files = self.names.get(&folder).map_or(&[][..], Vec::as_slice);
        let (mut ignored, mut photos): (Vec<_>, Vec<_>) = files
            .iter()
            .filter(|name| has_extension(name, &PHOTO_EXTENSIONS))
            .cloned()
            .partition(|name| is_no_photo(name));
        ignored.retain(|name| !is_background(name));
        let readable_count = photos.len();
        // A phone may deliver the same photo in two formats.
        let unreadable = files.iter().filter(|name| {
            has_extension(name, &OTHER_PHOTO_EXTENSIONS)
                && !is_no_photo(name)
                && !photos.iter().any(|p| same_stem(p, name))
        });
        let unreadable: Vec<String> = unreadable.cloned().collect();
        if readable_count == 0 {
            let folder = source.path();
            return Err(match unreadable.first() {
                Some(first) => ScanError::NoReadablePhotos {
                    folder,
                    count: unreadable.len(),
                    first: first.clone(),
                },
                None => ScanError::NoPhotos { folder },
            });
        }
        photos.extend(unreadable);
        photos.sort_by(|a, b| natural_order(a, b));
        ignored.sort_by(|a, b| natural_order(a, b));
        warnings.extend(
            ignored
                .into_iter()
                .map(|file| ScanWarning::ImageIgnored { file }),
        );
        for pair in photos.windows(2) {
            if manifest::stem(&pair[0]) == manifest::stem(&pair[1]) {
                return Err(ScanError::SameName {
                    first: pair[0].clone(),
                    second: pair[1].clone(),
                });
            }
        }
        let view = |image| ManifestView {
            time_s: None,
            image,
            keypoints: None,
            angle_deg: None,
            mask: None,
        };
        Ok(photos.into_iter().map(view).collect())
    }

    /// Returns the photo of the room without the person, beside the photos
    pub(super) fn background_file(&self) -> Option<String> {
        let folder = match self.photo_folder() {
            PhotoFolder::Below(folder) => folder,
            PhotoFolder::Top | PhotoFolder::Several(..) => String::new(),
        };
        let mut files = self.names.get(&folder)?.iter();
        let is_photo =
            |name: &&String| has_extension(name, &PHOTO_EXTENSIONS) && is_background(name);
        files.find(is_photo).cloned()
    }

    /// Sets the keypoint files of views that have none at the usual places, if only one JSON file has the photo's name
    pub(super) fn find_keypoint_files(
        &self,
        source: &Source,
        entries: &mut [ManifestView],
        warnings: &mut Vec<ScanWarning>,
    ) {
        let files: Vec<&String> = self
            .names
            .iter()
            .filter(|(folder, _)| !matches!(folder.as_str(), "views" | "truth"))
            .flat_map(|(_, names)| names)
            .filter(|name| {
                let stem = manifest::stem(name).to_lowercase();
                has_extension(name, &["json"]) && !NO_KEYPOINT_STEMS.contains(&stem.as_str())
            })
            .collect();
        let mut found = Vec::new();
        let mut missing = false;
        for entry in entries.iter_mut().filter(|entry| entry.keypoints.is_none()) {
            let mut usual = paths_in_scan(&entry.image).into_iter();
            if usual.any(|path| source.contains(&path)) {
                continue;
            }
            let mut named = files
                .iter()
                .filter(|file| is_keypoint_file(file, &entry.image));
            match (named.next(), named.next()) {
                (Some(&only), None) => {
                    entry.keypoints = Some(only.clone());
                    found.push(only.clone());
                }
                (Some(&first), Some(&second)) => warnings.push(ScanWarning::KeypointFileUnclear {
                    view: manifest::stem(&entry.image),
                    first: first.clone(),
                    second: second.clone(),
                }),
                (None, _) => missing = true,
            }
        }
        if let Some(first) = found.first() {
            warnings.push(ScanWarning::KeypointFilesFound {
                count: found.len(),
                first: first.clone(),
            });
        }
        let of_view = |file: &str| {
            entries.iter().any(|entry| {
                let usual = paths_in_scan(&entry.image);
                let given = entry.keypoints.as_deref();
                given == Some(file) || usual.iter().any(|usual| usual == file)
            })
        };
        let mut unused = files.iter().filter(|file| !of_view(file));
        if missing && let Some(first) = unused.next() {
            warnings.push(ScanWarning::JsonFilesUnused {
                count: 1 + unused.count(),
                first: (*first).clone(),
            });
        }
    }
}

/// Makes the paths of a view relative to the source instead of a folder in it, which is empty or ends with a slash
pub(super) fn put_into(view: &mut ManifestView, folder: &str) {
    view.image.insert_str(0, folder);
    for path in [&mut view.keypoints, &mut view.mask].into_iter().flatten() {
        path.insert_str(0, folder);
    }
}

fn has_extension(name: &str, extensions: &[&str]) -> bool {
    let extension = Path::new(name).extension();
    let extension = extension.map(|e| e.to_string_lossy().to_lowercase());
    extension.is_some_and(|e| extensions.contains(&e.as_str()))
}

/// Returns whether an image is not a photo by its name
fn is_no_photo(name: &str) -> bool {
    let stem = manifest::stem(name);
    RESULT_STEMS.contains(&stem.as_str())
        || is_background(name)
        || NO_PHOTO_SUFFIXES.iter().any(|end| stem.ends_with(end))
}

/// Returns whether an image shows the room without the person by its name
fn is_background(name: &str) -> bool {
    manifest::stem(name).eq_ignore_ascii_case(BACKGROUND_STEM)
}

fn same_stem(a: &str, b: &str) -> bool {
    manifest::stem(a).eq_ignore_ascii_case(&manifest::stem(b))
}

/// Returns whether a JSON file has the name of a photo, with an ending of keypoint files
fn is_keypoint_file(file: &str, image: &str) -> bool {
    let stem = manifest::stem(file).to_lowercase();
    let image_name = image.rsplit('/').next().unwrap_or(image).to_lowercase();
    let image_stem = manifest::stem(image).to_lowercase();
    [image_name, image_stem].iter().any(|photo| {
        let ending = stem.strip_prefix(photo.as_str());
        ending.is_some_and(|ending| KEYPOINT_ENDINGS.contains(&ending))
    })
}

/// Compares names with runs of digits as numbers; `2.jpg` comes before `10.jpg`
///
/// Stems are compared first, so that files with the same stem are adjacent.
pub(super) fn natural_order(a: &str, b: &str) -> Ordering {
    let key = |name: &str| (pieces(&manifest::stem(name)), name.to_owned());
    key(a).cmp(&key(b))
}

/// Splits a name into runs of digits and other characters; a number is compared by its length without leading zeros,
/// then by its digits
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
    // `1` and `01` differ only in zeros; the complete name then decides.
    pieces
}
