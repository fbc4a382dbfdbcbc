//! Destinations of results: files of a folder or entries in memory, each written completely or not at all.

use std::borrow::Cow;
use std::collections::BTreeMap;
#[cfg(feature = "folders")]
use std::fs;
use std::io;
#[cfg(feature = "folders")]
use std::io::Write;
#[cfg(feature = "folders")]
use std::path::Path;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use thiserror::Error;

/// Why a file could not be written; an existing file is unchanged
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The folder cannot be created
    #[error("cannot create the folder {}: {source}{}", folder.display(), remedy(source))]
    Folder {
        /// The folder
        folder: PathBuf,
        /// Error of the system
        source: io::Error,
    },
    /// The folder does not exist
    #[error("cannot write {}: there is no folder {}; create it first", file.display(), folder.display())]
    NoFolder {
        /// The file
        file: PathBuf,
        /// The missing folder
        folder: PathBuf,
    },
    /// Writing fails, for example on a full disk or without permission
    #[error("cannot write {}: {source}{}", file.display(), remedy(source))]
    File {
        /// The file
        file: PathBuf,
        /// Error of the system
        source: io::Error,
    },
}

/// A destination for the artifacts of a job, by names such as `views/000/mask.png`
#[derive(Debug)]
pub struct Sink {
    place: Place,
    /// Names of the stored artifacts; in memory with their bytes
    entries: Mutex<BTreeMap<String, Vec<u8>>>,
}

#[derive(Debug)]
enum Place {
    /// Files in a folder; subfolders are created as needed
    #[cfg(feature = "folders")]
    Folder(PathBuf),
    /// Entries in memory
    Memory,
}

impl Sink {
    /// Creates an empty sink in memory
    pub fn memory() -> Self {
        Self {
            place: Place::Memory,
            entries: Mutex::default(),
        }
    }

    /// Creates a sink that writes into a folder; subfolders are created as needed
    #[cfg(feature = "folders")]
    pub fn folder(folder: PathBuf) -> Self {
        Self {
            place: Place::Folder(folder),
            entries: Mutex::default(),
        }
    }

    /// Stores one artifact; can be called from any thread
    ///
    /// # Errors
    /// When a file cannot be written; an existing file is then unchanged.
    pub fn put<'a>(&self, name: &str, bytes: impl Into<Cow<'a, [u8]>>) -> Result<(), WriteError> {
        let bytes = bytes.into();
        let kept = match &self.place {
            #[cfg(feature = "folders")]
            Place::Folder(_) => {
                let file = self.path(name);
                make_folder(file.parent().unwrap_or(Path::new(".")))?;
                write_atomic(&file, &bytes)?;
                Vec::new()
            }
            Place::Memory => bytes.into_owned(),
        };
        self.entries().insert(name.to_owned(), kept);
        Ok(())
    }

    /// Returns the path of an artifact, for messages
    pub fn path(&self, name: &str) -> PathBuf {
        match &self.place {
            #[cfg(feature = "folders")]
            Place::Folder(folder) => folder.join(name),
            Place::Memory => PathBuf::from(name),
        }
    }

    /// Returns the names of the artifacts stored so far, sorted
    pub fn names(&self) -> Vec<String> {
        self.entries().keys().cloned().collect()
    }

    /// Returns the artifacts in memory by name; for a folder, their bytes are empty
    pub fn into_artifacts(self) -> BTreeMap<String, Vec<u8>> {
        let entries = self.entries.into_inner();
        entries.unwrap_or_else(PoisonError::into_inner)
    }

    fn entries(&self) -> MutexGuard<'_, BTreeMap<String, Vec<u8>>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn remedy(error: &io::Error) -> &'static str {
    use io::ErrorKind::*;
    match error.kind() {
        StorageFull | QuotaExceeded | FileTooLarge => {
            "; free disk space and run again; no partial file was written"
        }
        PermissionDenied | ReadOnlyFilesystem => "; choose another folder with -o",
        AlreadyExists | NotADirectory => {
            "; a file exists at the path of a folder, choose another folder with -o"
        }
        _ => "",
    }
}

/// Creates a folder and its parents
///
/// # Errors
/// When the system reports an error.
#[cfg(feature = "folders")]
pub fn make_folder(folder: &Path) -> Result<(), WriteError> {
    fs::create_dir_all(folder).map_err(|source| WriteError::Folder {
        folder: folder.to_owned(),
        source,
    })
}

/// Writes a file atomically: into a temporary file in the same folder, which is then renamed
///
/// # Errors
/// When the disk is full or permission is denied; an existing file is then unchanged.
#[cfg(feature = "folders")]
pub fn write_atomic(file: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    write_with(file, |out| out.write_all(bytes))
}

/// Like [`write_atomic`], with the content written by `write`
///
/// # Errors
/// When `write` fails, the disk is full or permission is denied; an existing file is then unchanged.
#[cfg(feature = "folders")]
pub fn write_with(
    file: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), WriteError> {
    let folder = match file.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let attempt = || -> io::Result<()> {
        let mut temporary = temporary_in(folder)?;
        {
            let mut buffered = io::BufWriter::new(temporary.as_file_mut());
            write(&mut buffered)?;
            buffered.flush()?;
        }
        // Some file systems report a full disk only at this call.
        temporary.as_file().sync_data()?;
        temporary.persist(file).map_err(|error| error.error)?;
        Ok(())
    };
    attempt().map_err(|source| {
        let file = file.to_owned();
        if source.kind() == io::ErrorKind::NotFound && !folder.exists() {
            let folder = folder.to_owned();
            return WriteError::NoFolder { file, folder };
        }
        WriteError::File { file, source }
    })
}

/// Creates a temporary file that is deleted unless it is persisted, with the default permissions of a new file
#[cfg(feature = "folders")]
fn temporary_in(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".pirouette-").suffix(".part");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Reduced by the umask; the default of a temporary file is access for the owner only.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder).map_err(without_path)
}

/// Removes the temporary path from an error if its kind is sufficient for the message
#[cfg(feature = "folders")]
fn without_path(error: io::Error) -> io::Error {
    if remedy(&error).is_empty() {
        error
    } else {
        error.kind().into()
    }
}

#[cfg(test)]
#[cfg(feature = "folders")]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_completely() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.txt");
        write_atomic(&file, b"one").unwrap();
        write_atomic(&file, b"two").unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"two");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_full_disk_leaves_only_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.txt");
        write_atomic(&file, b"old").unwrap();
        let error = write_with(&file, |out| {
            out.write_all(b"half of the ")?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        })
        .unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains("a.txt") && message.contains("free disk space"),
            "{message}"
        );
        assert_eq!(fs::read(&file).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_under_a_file_cannot_be_made() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a");
        fs::write(&file, b"").unwrap();
        let error = make_folder(&file.join("out")).unwrap_err();
        assert!(matches!(error, WriteError::Folder { .. }));
        assert!(error.to_string().contains("choose another"), "{error}");
    }

    #[test]
    fn a_missing_folder_is_reported_without_the_temporary_name() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_atomic(&folder.path().join("none/a.txt"), b"").unwrap_err();
        assert!(matches!(error, WriteError::NoFolder { .. }));
        let file = folder.path().join("a");
        fs::write(&file, b"").unwrap();
        let message = write_atomic(&file.join("b"), b"").unwrap_err().to_string();
        assert!(message.contains("choose another"), "{message}");
        assert!(!message.contains(".part"), "{message}");
    }
}
