//! Sources of scans: a folder, a zip file, or files in memory.
//!
//! A source lists file names, reads one file up to a size limit, and provides file paths for messages. Names are
//! relative, separated by `/`, and never point outside the source. A zip file is not unpacked: files are read from it
//! one by one.

#[cfg(feature = "folders")]
mod folder;
mod zip_file;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, Read};
#[cfg(feature = "folders")]
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;

use thiserror::Error;

#[cfg(feature = "folders")]
use folder::Folder;
use zip_file::ZipFile;

pub use zip_file::{MAX_ENTRY_BYTES, MAX_ENTRY_COUNT, MAX_RATIO, MAX_TOTAL_BYTES};

/// The files of one scan
#[derive(Debug)]
pub struct Source {
    files: Files,
}

#[derive(Debug)]
enum Files {
    #[cfg(feature = "folders")]
    Folder(Folder),
    Memory(Memory),
    Zip(ZipFile),
}

/// Files in memory under a common name
#[derive(Debug)]
struct Memory {
    name: String,
    files: BTreeMap<String, Arc<[u8]>>,
}

/// Why the files of a scan cannot be used
#[derive(Debug, Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages document the variants")]
pub enum SourceError {
    #[error(
        "neither a folder nor a zip file nor a video; a scan is a folder of photos, a zip file of one, or a video"
    )]
    Neither,
    #[error("cannot be read: {0}")]
    Read(#[source] io::Error),
    #[error("damaged zip file: {0}; create it again")]
    Damaged(#[source] io::Error),
    #[error(
        "the name {name:?} points outside the scan; names are relative, with \"/\" between folders and without \"..\""
    )]
    NameLeaves { name: String },
    #[error("{name} occurs twice; remove one of them")]
    SameName { name: String },
    #[error("{name} is a link; replace it with the file that it points to")]
    Link { name: String },
    #[error("{name} is encrypted; create the zip file without a password")]
    Encrypted { name: String },
    #[error(
        "{name} is compressed by {method}; create the zip file with the usual method (deflate)"
    )]
    Method { name: String, method: String },
    #[error("{count} files and folders; at most {MAX_ENTRY_COUNT} are accepted")]
    TooMany { count: usize },
    #[error("{name} has {bytes} bytes uncompressed; at most {MAX_ENTRY_BYTES} are accepted")]
    TooLarge { name: String, bytes: u64 },
    #[error("more than {MAX_TOTAL_BYTES} bytes uncompressed; smaller photos suffice")]
    TotalTooLarge,
    #[error(
        "{name} is {ratio} times larger uncompressed; photos and keypoints stay below {MAX_RATIO} times"
    )]
    Ratio { name: String, ratio: u64 },
}

impl Default for Source {
    /// Creates a source without files
    fn default() -> Self {
        let (name, files) = (String::new(), BTreeMap::new());
        Self {
            files: Files::Memory(Memory { name, files }),
        }
    }
}

impl Source {
    /// Opens a folder or a zip file
    ///
    /// # Errors
    /// When the path is neither of them, it cannot be read, or a zip file exceeds a limit of this module.
    #[cfg(feature = "folders")]
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        let files = if path.is_dir() {
            Files::Folder(Folder::open(path).map_err(SourceError::Read)?)
        } else if path.is_file() {
            let file = std::fs::File::open(path).map_err(SourceError::Read)?;
            let file = io::BufReader::new(file);
            Files::Zip(ZipFile::open(path.display().to_string(), Box::new(file))?)
        } else {
            return Err(SourceError::Neither);
        };
        Ok(Self { files })
    }

    /// Creates a source from files in memory; `name` identifies them in messages
    ///
    /// # Errors
    /// When a name points outside the scan or occurs twice.
    pub fn from_files<N: Into<String>, B: Into<Arc<[u8]>>>(
        name: &str,
        files: impl IntoIterator<Item = (N, B)>,
    ) -> Result<Self, SourceError> {
        let mut all = BTreeMap::new();
        for (name, bytes) in files {
            let name = name.into();
            let plain = plain_name(&name).ok_or(SourceError::NameLeaves { name })?;
            if all.insert(plain.clone(), bytes.into()).is_some() {
                return Err(SourceError::SameName { name: plain });
            }
        }
        Ok(Self {
            files: Files::Memory(Memory {
                name: name.to_owned(),
                files: all,
            }),
        })
    }

    /// Opens a zip file in memory; `name` identifies it in messages
    ///
    /// # Errors
    /// When the bytes are not a zip file, or exceed a limit of this module.
    pub fn from_zip(name: &str, bytes: impl Into<Arc<[u8]>>) -> Result<Self, SourceError> {
        let bytes: Arc<[u8]> = bytes.into();
        let bytes = Box::new(io::Cursor::new(bytes));
        Ok(Self {
            files: Files::Zip(ZipFile::open(name.to_owned(), bytes)?),
        })
    }

    /// Returns the title of the scan: the name of the folder, or of the zip file without its extension
    pub fn title(&self) -> String {
        match &self.files {
            #[cfg(feature = "folders")]
            Files::Folder(folder) => folder.title(),
            Files::Memory(memory) => memory.name.clone(),
            Files::Zip(zip) => zip.title(),
        }
    }

    /// Returns the path of the source, for messages
    pub fn path(&self) -> PathBuf {
        match &self.files {
            #[cfg(feature = "folders")]
            Files::Folder(folder) => folder.path().to_owned(),
            Files::Memory(memory) => PathBuf::from(&memory.name),
            Files::Zip(zip) => PathBuf::from(zip.name()),
        }
    }

    /// Returns the path of a file, for messages
    pub fn path_of(&self, name: &str) -> PathBuf {
        self.path().join(name)
    }

    /// Returns the names of the files at the top level of the source and in its folders, in unspecified order
    ///
    /// # Errors
    /// When a folder cannot be listed.
    pub fn names(&self) -> io::Result<Vec<String>> {
        let shallow = |name: &&String| name.matches('/').count() <= 1;
        Ok(match &self.files {
            #[cfg(feature = "folders")]
            Files::Folder(folder) => folder.names()?,
            Files::Memory(memory) => memory.files.keys().filter(shallow).cloned().collect(),
            Files::Zip(zip) => zip.names().filter(shallow).cloned().collect(),
        })
    }

    /// Returns whether a file of this name exists
    pub fn contains(&self, name: &str) -> bool {
        let plain = plain_name(name);
        match &self.files {
            #[cfg(feature = "folders")]
            Files::Folder(folder) => folder.contains(name),
            Files::Memory(memory) => plain.is_some_and(|name| memory.files.contains_key(&name)),
            Files::Zip(zip) => plain.is_some_and(|name| zip.contains(&name)),
        }
    }

    /// Returns whether a file lies inside the source after following links; true for missing files
    pub fn is_inside(&self, name: &str) -> bool {
        match &self.files {
            #[cfg(feature = "folders")]
            Files::Folder(folder) => folder.is_inside(name),
            Files::Memory(_) | Files::Zip(_) => plain_name(name).is_some(),
        }
    }

    /// Reads a file of at most `limit` bytes
    ///
    /// # Errors
    /// When the file does not exist, is not a regular file, is larger than `limit`, or cannot be read.
    pub fn read(&self, name: &str, limit: u64) -> io::Result<Cow<'_, [u8]>> {
        let plain = || plain_name(name).ok_or_else(|| io::Error::from(io::ErrorKind::NotFound));
        match &self.files {
            #[cfg(feature = "folders")]
            Files::Folder(folder) => folder.read(name, limit).map(Cow::Owned),
            Files::Memory(memory) => match memory.files.get(&plain()?) {
                Some(bytes) if bytes.len() as u64 > limit => {
                    Err(io::Error::from(io::ErrorKind::FileTooLarge))
                }
                Some(bytes) => Ok(Cow::Borrowed(bytes)),
                None => Err(io::Error::from(io::ErrorKind::NotFound)),
            },
            Files::Zip(zip) => zip.read(&plain()?, limit).map(Cow::Owned),
        }
    }
}

/// Returns whether a path is relative and stays inside its base, judged by its text alone
///
/// Roots, drives and streams are rejected in the notation of every system.
pub fn stays_inside(path: &str) -> bool {
    plain_name(path).is_some()
}

/// Removes `.` and empty parts from a path; `None` if it points outside
fn plain_name(path: &str) -> Option<String> {
    if path.starts_with('/') || path.contains(['\\', ':', '\0']) {
        return None;
    }
    let parts = path.split('/').filter(|part| !matches!(*part, "" | "."));
    let parts: Vec<&str> = parts.collect();
    (!parts.is_empty() && !parts.contains(&"..")).then(|| parts.join("/"))
}

/// Reads a regular file of at most `limit` bytes
#[cfg(feature = "folders")]
pub(crate) fn read_bounded_file(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    // Opening a pipe would block; a device may be endless.
    if !std::fs::metadata(path)?.is_file() {
        return Err(io::Error::other("not a regular file"));
    }
    read_bounded(std::fs::File::open(path)?, limit)
}

/// Reads at most `limit` bytes; more are an error
fn read_bounded(reader: impl Read, limit: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    reader
        .take(limit.saturating_add(1))
        .read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit {
        return Err(io::Error::from(io::ErrorKind::FileTooLarge));
    }
    Ok(bytes)
}

#[cfg(test)]
#[cfg(feature = "folders")]
mod tests;
