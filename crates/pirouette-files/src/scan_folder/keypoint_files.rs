//! Which keypoint file belongs to which photo: one file per photo, or one file for all photos.

#[cfg(feature = "folders")]
use std::path::Path;
use std::path::PathBuf;

use super::{MAX_JSON_BYTES, ScanError, ViewError, check_link, view::read_file};
use crate::formats::keypoints::{Detection, KeypointFile};
use crate::formats::manifest::{self, ManifestView};
use crate::source::Source;

/// Files for all photos, in the order of preference
const COMMON_FILES: [&str; 2] = ["keypoints.json", "alphapose-results.json"];

/// Keypoint files given separately from the scan; they replace those in the scan
#[derive(Debug)]
#[non_exhaustive]
pub enum GivenKeypoints {
    /// One file for all photos
    File {
        /// Path of the file, for messages
        path: PathBuf,
        /// Content of the file
        bytes: Vec<u8>,
    },
    /// A folder with one file per photo, named after it, or one for all photos (`keypoints.json`)
    Folder(Source),
}

impl GivenKeypoints {
    /// Opens a file, or a folder of files
    ///
    /// # Errors
    /// When it cannot be read or is too large.
    #[cfg(feature = "folders")]
    pub fn open(path: &Path) -> Result<Self, ScanError> {
        if path.is_dir() {
            return super::open_source(path).map(GivenKeypoints::Folder);
        }
        let bytes = crate::source::read_bounded_file(path, MAX_JSON_BYTES);
        let path = path.to_owned();
        match bytes {
            Ok(bytes) => Ok(GivenKeypoints::File { path, bytes }),
            Err(source) => Err(ScanError::Read { path, source }),
        }
    }
}

/// Returns the paths of a photo's keypoint file in a scan, in the order of preference
pub(super) fn paths_in_scan(image: &str) -> Vec<String> {
    let stem = manifest::stem(image);
    let folder = image.rsplit_once('/').map(|(folder, _)| folder);
    let sibling = |file: String| match folder {
        Some(folder) => format!("{folder}/{file}"),
        None => file,
    };
    let mut paths = vec![
        sibling(format!("{stem}_keypoints.json")),
        format!("keypoints/{stem}_keypoints.json"),
        sibling(format!("{stem}.json")),
        format!("keypoints/{stem}.json"),
        format!("keypoints/{stem}.txt"),
        format!("labels/{stem}.txt"),
    ];
    paths.retain(|path| path != manifest::FILE_NAME);
    paths
}

/// Returns the paths of a photo's keypoint file in a folder of keypoints, in the order of preference
fn paths_in_folder(image: &str) -> [String; 4] {
    let stem = manifest::stem(image);
    [
        format!("{stem}_keypoints.json"),
        format!("{stem}.json"),
        format!("{stem}.txt"),
        // OpenPose appends the number of the video frame.
        format!("{stem}_000000000000_keypoints.json"),
    ]
}

/// Rejects links to keypoint files outside the scan
pub(super) fn check_common_links(source: &Source) -> Result<(), ScanError> {
    COMMON_FILES
        .iter()
        .try_for_each(|name| check_link(source, name))
}

/// The keypoint files of a scan, assigned to its photos
pub(super) struct AssignedFiles<'a> {
    source: &'a Source,
    common: Vec<CommonFile>,
    /// File of each photo
    files: Vec<Assigned>,
    /// Whether photos without a file must not be searched by the detector
    given: bool,
}

/// A parsed file for several photos
struct CommonFile {
    name: String,
    content: KeypointFile,
}

#[derive(Clone)]
enum Assigned {
    Missing,
    /// Path in the source
    Own(String),
    /// Index of the file, and of the photo in it
    Common(usize, Option<usize>),
}

impl<'a> AssignedFiles<'a> {
    /// Assigns files to photos, and parses those for several photos
    pub(super) fn new(
        scan: &'a Source,
        entries: &[ManifestView],
        given: Option<&'a GivenKeypoints>,
    ) -> Result<Self, ScanError> {
        let mut files = Self {
            source: scan,
            common: Vec::new(),
            files: vec![Assigned::Missing; entries.len()],
            given: given.is_some(),
        };
        let all = || (0..entries.len()).collect::<Vec<usize>>();
        match given {
            Some(GivenKeypoints::File { path, bytes }) => {
                files.assign_common(path.clone(), bytes, entries, &all())?;
            }
            Some(GivenKeypoints::Folder(source)) => {
                files.source = source;
                files.assign_own(entries, |entry| paths_in_folder(&entry.image).to_vec());
                files.assign_from_source(&COMMON_FILES, entries)?;
            }
            None => {
                files.assign_own(entries, |entry| match &entry.keypoints {
                    Some(_) => vec![],
                    None => paths_in_scan(&entry.image),
                });
                files.assign_named(entries)?;
                files.assign_from_source(&COMMON_FILES, entries)?;
            }
        }
        Ok(files)
    }

    /// Assigns to each photo the first of its paths that exists
    fn assign_own(
        &mut self,
        entries: &[ManifestView],
        paths: impl Fn(&ManifestView) -> Vec<String>,
    ) {
        for (file, entry) in self.files.iter_mut().zip(entries) {
            let path = paths(entry)
                .into_iter()
                .find(|path| self.source.contains(path));
            if let Some(path) = path {
                *file = Assigned::Own(path);
            }
        }
    }

    /// Assigns the files that the manifest names; one that it names for several photos is for all of them
    fn assign_named(&mut self, entries: &[ManifestView]) -> Result<(), ScanError> {
        for (index, entry) in entries.iter().enumerate() {
            let Some(path) = &entry.keypoints else {
                continue;
            };
            let same = |other: &usize| entries[*other].keypoints.as_ref() == Some(path);
            let users: Vec<usize> = (0..entries.len()).filter(same).collect();
            if users.len() == 1 || !self.source.contains(path) {
                self.files[index] = Assigned::Own(path.clone());
            } else if users.first() == Some(&index) {
                self.assign_common_of_source(path, entries, &users)?;
            }
        }
        Ok(())
    }

    /// Assigns the first common file that exists to the photos without one
    fn assign_from_source(
        &mut self,
        names: &[&str],
        entries: &[ManifestView],
    ) -> Result<(), ScanError> {
        let missing = |index: &usize| matches!(self.files[*index], Assigned::Missing);
        let users: Vec<usize> = (0..entries.len()).filter(missing).collect();
        let name = names.iter().find(|name| self.source.contains(name));
        match name.filter(|_| !users.is_empty()) {
            Some(name) => self.assign_common_of_source(name, entries, &users),
            None => Ok(()),
        }
    }

    fn assign_common_of_source(
        &mut self,
        name: &str,
        entries: &[ManifestView],
        users: &[usize],
    ) -> Result<(), ScanError> {
        let path = self.source.path_of(name);
        match self.source.read(name, MAX_JSON_BYTES) {
            Ok(bytes) => self.assign_common(path, &bytes, entries, users),
            Err(source) => Err(ScanError::Read { path, source }),
        }
    }

    fn assign_common(
        &mut self,
        path: PathBuf,
        bytes: &[u8],
        entries: &[ManifestView],
        users: &[usize],
    ) -> Result<(), ScanError> {
        let name = path
            .file_name()
            .map(|name| name.to_string_lossy().into_owned());
        let content = KeypointFile::parse(bytes);
        let content = content.map_err(|source| ScanError::Keypoints { path, source })?;
        let photos: Vec<&str> = users.iter().map(|&user| &entries[user].image[..]).collect();
        for (&user, index) in users.iter().zip(content.match_photos(&photos)) {
            self.files[user] = Assigned::Common(self.common.len(), index);
        }
        let name = name.unwrap_or_default();
        self.common.push(CommonFile { name, content });
        Ok(())
    }

    /// Reads the keypoints of a photo; `None` without a file
    pub(super) fn read(
        &self,
        view: usize,
        entry: &ManifestView,
        width_px: usize,
        height_px: usize,
    ) -> Result<Option<Detection>, ViewError> {
        let (file, detection) = match &self.files[view] {
            Assigned::Missing if self.given && entry.mask.is_none() => {
                return Err(ViewError::NoGivenFile {
                    files: paths_in_folder(&entry.image)[..3].join(", "),
                    folder: self.source.path(),
                });
            }
            Assigned::Missing => return Ok(None),
            Assigned::Common(_, None) if entry.mask.is_some() => return Ok(None),
            Assigned::Own(file) => {
                let bytes = read_file(self.source, file, MAX_JSON_BYTES)?;
                let parsed = KeypointFile::parse(&bytes);
                let detection = parsed.and_then(|content| {
                    let index = content.match_photos(&[&entry.image]);
                    content.detection(index.first().copied().flatten(), width_px, height_px)
                });
                (file, detection)
            }
            Assigned::Common(common, index) => {
                let CommonFile { name, content } = &self.common[*common];
                (name, content.detection(*index, width_px, height_px))
            }
        };
        let detection = detection.map_err(|source| ViewError::Keypoints {
            file: file.clone(),
            source,
        })?;
        if detection.keypoints.found_count() == 0 && entry.mask.is_none() {
            return Err(ViewError::NoPerson { file: file.clone() });
        }
        Ok(Some(detection))
    }
}
