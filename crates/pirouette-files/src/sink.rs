//! Where results go: files of a folder or entries in memory, each written completely or not at all.

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
use std::sync::{Mutex, PoisonError};

use thiserror::Error;

/// Why a file could not be written; whatever was there before is still there
#[derive(Debug, Error)]
pub enum WriteError {
    /// The folder cannot be made
    #[error("cannot make the folder {}: {source}{}", folder.display(), remedy(source))]
    Folder {
        /// The folder
        folder: PathBuf,
        /// What the system says
        source: io::Error,
    },
    /// Nowhere to write to
    #[error("cannot write {}: there is no folder {}; make it first", file.display(), folder.display())]
    NoFolder {
        /// The file
        file: PathBuf,
        /// The folder that is missing
        folder: PathBuf,
    },
    /// No room, or not allowed
    #[error("cannot write {}: {source}{}", file.display(), remedy(source))]
    File {
        /// The file
        file: PathBuf,
        /// What the system says
        source: io::Error,
    },
}

/// A place for the artifacts of a job, by names such as `views/000/mask.png`
#[derive(Debug)]
pub enum Sink {
    /// Files in a folder; folders within are made as needed
    #[cfg(feature = "folders")]
    Folder(PathBuf),
    /// Entries in memory
    Memory(Mutex<BTreeMap<String, Vec<u8>>>),
}

impl Sink {
    /// An empty sink in memory
    pub fn memory() -> Self {
        Self::Memory(Mutex::default())
    }

    /// Stores one artifact; can be called from any thread
    ///
    /// # Errors
    /// When a file cannot be written; what was there before is then unchanged.
    pub fn put<'a>(&self, name: &str, bytes: impl Into<Cow<'a, [u8]>>) -> Result<(), WriteError> {
        let bytes = bytes.into();
        match self {
            #[cfg(feature = "folders")]
            Self::Folder(_) => {
                let file = self.path(name);
                make_folder(file.parent().unwrap_or(Path::new(".")))?;
                write_whole(&file, &bytes)
            }
            Self::Memory(entries) => {
                let mut entries = entries.lock().unwrap_or_else(PoisonError::into_inner);
                entries.insert(name.to_owned(), bytes.into_owned());
                Ok(())
            }
        }
    }

    /// The path of an artifact, for messages
    pub fn path(&self, name: &str) -> PathBuf {
        match self {
            #[cfg(feature = "folders")]
            Self::Folder(folder) => folder.join(name),
            Self::Memory(_) => PathBuf::from(name),
        }
    }

    /// The artifacts in memory by name; none of a folder
    pub fn into_artifacts(self) -> BTreeMap<String, Vec<u8>> {
        match self {
            #[cfg(feature = "folders")]
            Self::Folder(_) => BTreeMap::new(),
            Self::Memory(entries) => entries.into_inner().unwrap_or_else(PoisonError::into_inner),
        }
    }
}

fn remedy(error: &io::Error) -> &'static str {
    use io::ErrorKind::*;
    match error.kind() {
        StorageFull | QuotaExceeded | FileTooLarge => {
            "; make room and run again, nothing partial was left behind"
        }
        PermissionDenied | ReadOnlyFilesystem => "; choose another folder with -o",
        AlreadyExists | NotADirectory => {
            "; a file stands where a folder is needed, choose another folder with -o"
        }
        _ => "",
    }
}

/// Makes a folder and those above it
///
/// # Errors
/// When the system refuses.
#[cfg(feature = "folders")]
pub fn make_folder(folder: &Path) -> Result<(), WriteError> {
    fs::create_dir_all(folder).map_err(|source| WriteError::Folder {
        folder: folder.to_owned(),
        source,
    })
}

/// Writes a file whole or not at all: into a temporary neighbor that then takes the name
///
/// # Errors
/// When there is no room or no right to write; the file is then as it was before.
#[cfg(feature = "folders")]
pub fn write_whole(file: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    write_with(file, |out| out.write_all(bytes))
}

/// Like [`write_whole`], with the content written by `write`
///
/// # Errors
/// When `write` fails, or there is no room or no right to write; the file is then as it was before.
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
        // Some file systems report a full disk only here.
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

/// A temporary file that goes away unless it is persisted, with the usual rights of a new file
#[cfg(feature = "folders")]
fn temporary_in(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".pirouette-").suffix(".part");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Less what the umask takes away; a temporary file alone would be for the owner only.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder).map_err(without_path)
}

/// The error without the temporary name that comes along, which helps nobody, where the kind tells enough
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
    fn a_file_is_replaced_whole() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.txt");
        write_whole(&file, b"one").unwrap();
        write_whole(&file, b"two").unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"two");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_full_disk_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.txt");
        write_whole(&file, b"old").unwrap();
        let error = write_with(&file, |out| {
            out.write_all(b"half of the ")?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        })
        .unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains("a.txt") && message.contains("make room"),
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
    fn a_folder_that_is_missing_is_named_and_no_temporary_name_is() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_whole(&folder.path().join("none/a.txt"), b"").unwrap_err();
        assert!(matches!(error, WriteError::NoFolder { .. }));
        let file = folder.path().join("a");
        fs::write(&file, b"").unwrap();
        let message = write_whole(&file.join("b"), b"").unwrap_err().to_string();
        assert!(message.contains("choose another"), "{message}");
        assert!(!message.contains(".part"), "{message}");
    }
}
