//! A folder of the file system, with a check that links do not point outside it.

use std::path::{Path, PathBuf};
use std::{fs, io};

use super::read_bounded_file;

#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    canonical: PathBuf,
}

impl Folder {
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        Ok(Self {
            path: path.to_owned(),
            canonical: path.canonicalize()?,
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn title(&self) -> String {
        let name = self.canonical.file_name();
        let name = name.unwrap_or(self.canonical.as_os_str());
        name.to_string_lossy().into_owned()
    }

    /// Lists the files at the top and in folders; links to folders are not followed
    pub(super) fn names(&self) -> io::Result<Vec<String>> {
        let (mut names, folders) = list(&self.path)?;
        for folder in folders {
            // A folder without permission contains no photos for this user.
            let Ok((inner, _)) = list(&self.path.join(&folder)) else {
                continue;
            };
            names.extend(inner.into_iter().map(|name| format!("{folder}/{name}")));
        }
        Ok(names)
    }

    pub(super) fn contains(&self, name: &str) -> bool {
        self.path.join(name).exists()
    }

    pub(super) fn is_inside(&self, name: &str) -> bool {
        // A missing file is not outside; reading it fails.
        let canonical = self.path.join(name).canonicalize();
        canonical.map_or(true, |file| file.starts_with(&self.canonical))
    }

    pub(super) fn read(&self, name: &str, limit: u64) -> io::Result<Vec<u8>> {
        read_bounded_file(&self.path.join(name), limit)
    }
}

/// Returns the names of the files and of the folders in a folder
fn list(path: &Path) -> io::Result<(Vec<String>, Vec<String>)> {
    let (mut files, mut folders) = (Vec::new(), Vec::new());
    for entry in fs::read_dir(path)? {
        let entry = entry?;
        // Results cannot contain names that are not Unicode either.
        let Ok(name) = entry.file_name().into_string() else {
            continue;
        };
        if entry.file_type()?.is_dir() {
            folders.push(name);
        } else if path.join(&name).is_file() {
            files.push(name);
        }
    }
    Ok((files, folders))
}
