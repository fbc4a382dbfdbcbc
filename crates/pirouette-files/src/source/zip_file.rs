//! Zip files, read entry by entry; their headers are untrusted.
//!
//! Names, kinds, methods and claimed sizes of all entries are checked once, when the file is opened. Reading an entry
//! stops at its claimed size, so that the checked sum bounds what is inflated even when headers lie.

use std::collections::BTreeMap;
use std::fmt;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use zip::{CompressionMethod, ZipArchive};

use super::{SourceError, plain_name, read_bounded};

/// Maximum number of files and folders in a zip file; 72 views with photo, keypoints and mask are 217
pub const MAX_ENTRY_COUNT: usize = 10_000;

/// Maximum uncompressed size of one entry, in bytes; also the maximum size of a photo file
pub const MAX_ENTRY_BYTES: u64 = 512 << 20;

/// Maximum uncompressed size of all entries, in bytes; 72 photos of 50 MB have 3.6 GB
pub const MAX_TOTAL_BYTES: u64 = 4 << 30;

/// Maximum ratio of uncompressed to compressed size of an entry
///
/// Deflate reaches 1032, on zeros. In the zip file of a rendered scan, the ratio is 1.0 for photos, 1.8 for keypoint
/// files,
/// 2.2 for masks and 4.3 for manifests.
pub const MAX_RATIO: u64 = 200;

/// Entries up to this size, in bytes, may have any ratio: short repetitive text compresses well and is harmless
const SMALL_BYTES: u64 = 1 << 20;

/// First bytes of a zip file: the first entry's header, or the end record of an empty archive
const SIGNATURES: [[u8; 4]; 2] = [*b"PK\x03\x04", *b"PK\x05\x06"];

/// Bytes with random access
pub(super) trait Bytes: Read + Seek + Send + fmt::Debug {}

impl<T: Read + Seek + Send + fmt::Debug> Bytes for T {}

/// An open zip file
pub(super) struct ZipFile {
    name: String,
    /// Locked, since reading moves the position; decoding photos takes most of the time and happens outside the lock
    archive: Mutex<ZipArchive<Box<dyn Bytes>>>,
    /// Index and size of each file in the archive by its name in the scan
    files: BTreeMap<String, Entry>,
}

#[derive(Clone, Copy)]
struct Entry {
    index: usize,
    bytes: u64,
}

impl fmt::Debug for ZipFile {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "ZipFile({:?}, {} files)", self.name, self.files.len())
    }
}

impl ZipFile {
    pub(super) fn open(name: String, mut bytes: Box<dyn Bytes>) -> Result<Self, SourceError> {
        let mut signature = [0; 4];
        match bytes.read_exact(&mut signature) {
            Err(error) if error.kind() != io::ErrorKind::UnexpectedEof => {
                return Err(SourceError::Read(error));
            }
            // Also avoids searching for the end record in large files of other kinds.
            _ if !SIGNATURES.contains(&signature) => return Err(SourceError::Neither),
            _ => {}
        }
        let damaged = |error: zip::result::ZipError| SourceError::Damaged(error.into());
        bytes.seek(SeekFrom::Start(0)).map_err(SourceError::Read)?;
        let archive = ZipArchive::new(bytes).map_err(damaged)?;
        Ok(Self {
            name,
            files: without_top_folder(checked_files(&archive)?),
            archive: Mutex::new(archive),
        })
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    pub(super) fn title(&self) -> String {
        let stem = Path::new(&self.name).file_stem();
        stem.map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &String> {
        self.files.keys()
    }

    pub(super) fn contains(&self, name: &str) -> bool {
        self.files.contains_key(name)
    }

    pub(super) fn read(&self, name: &str, limit: u64) -> io::Result<Vec<u8>> {
        let Some(&Entry { index, bytes }) = self.files.get(name) else {
            return Err(io::Error::from(io::ErrorKind::NotFound));
        };
        if bytes > limit {
            return Err(io::Error::from(io::ErrorKind::FileTooLarge));
        }
        let mut archive = self.archive.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = archive.by_index(index)?;
        let content = read_bounded(entry, bytes).map_err(|error| match error.kind() {
            io::ErrorKind::FileTooLarge => io::Error::new(
                io::ErrorKind::InvalidData,
                "more bytes than stated in its header",
            ),
            _ => error,
        })?;
        if (content.len() as u64) < bytes {
            let fewer = "fewer bytes than stated in its header";
            return Err(io::Error::new(io::ErrorKind::InvalidData, fewer));
        }
        Ok(content)
    }
}

/// Checks all limits and returns the files of an archive by name
fn checked_files(
    archive: &ZipArchive<Box<dyn Bytes>>,
) -> Result<BTreeMap<String, Entry>, SourceError> {
    let count = archive.len();
    if count > MAX_ENTRY_COUNT {
        return Err(SourceError::TooMany { count });
    }
    let damaged = |error: zip::result::ZipError| SourceError::Damaged(error.into());
    let mut files = BTreeMap::new();
    let mut total_bytes = 0_u64;
    for index in 0..count {
        let entry = archive.by_index_data(index).map_err(damaged)?;
        let name = entry.name().map_err(damaged)?.into_owned();
        let plain = plain_name(&name).ok_or(SourceError::NameLeaves { name })?;
        if entry.is_symlink() {
            return Err(SourceError::Link { name: plain });
        }
        if entry.is_dir() || is_clutter(&plain) {
            continue;
        }
        if entry.encrypted() {
            return Err(SourceError::Encrypted { name: plain });
        }
        let method = entry.compression();
        if !matches!(
            method,
            CompressionMethod::Stored | CompressionMethod::Deflated
        ) {
            let method = method.to_string();
            return Err(SourceError::Method {
                name: plain,
                method,
            });
        }
        let bytes = entry.size();
        check_size(&plain, bytes, entry.compressed_size())?;
        total_bytes = total_bytes.saturating_add(bytes);
        if total_bytes > MAX_TOTAL_BYTES {
            return Err(SourceError::TotalTooLarge);
        }
        if files
            .insert(plain.clone(), Entry { index, bytes })
            .is_some()
        {
            return Err(SourceError::SameName { name: plain });
        }
    }
    if archive.has_duplicate_names() {
        // The archive keeps only the last entry of each name.
        return Err(SourceError::SameName {
            name: "a file".to_owned(),
        });
    }
    Ok(files)
}

fn check_size(name: &str, bytes: u64, compressed_bytes: u64) -> Result<(), SourceError> {
    let name = || name.to_owned();
    if bytes > MAX_ENTRY_BYTES {
        return Err(SourceError::TooLarge {
            name: name(),
            bytes,
        });
    }
    let ratio = bytes / compressed_bytes.max(1);
    if bytes > SMALL_BYTES && ratio > MAX_RATIO {
        return Err(SourceError::Ratio {
            name: name(),
            ratio,
        });
    }
    Ok(())
}

/// Returns whether macOS added a file to the archive as metadata
fn is_clutter(name: &str) -> bool {
    name.starts_with("__MACOSX/") || name.rsplit('/').next() == Some(".DS_Store")
}

/// Strips the top folder from all names if it contains all files
///
/// Desktop programs include the name of a zipped folder.
fn without_top_folder(files: BTreeMap<String, Entry>) -> BTreeMap<String, Entry> {
    let mut tops = files.keys().map(|name| name.split_once('/'));
    let first = tops.next().flatten().map(|(top, _)| top.to_owned());
    let same = |found: Option<(&str, &str)>| found.map(|(top, _)| top) == first.as_deref();
    if first.is_none() || !tops.all(same) {
        return files;
    }
    let below = |(name, entry): (String, Entry)| {
        let (_, rest) = name.split_once('/')?;
        Some((rest.to_owned(), entry))
    };
    files.into_iter().filter_map(below).collect()
}
