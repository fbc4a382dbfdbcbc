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

    pub(super) fn top_names(&self) -> io::Result<Vec<String>> {
        let mut names = Vec::new();
        for entry in fs::read_dir(&self.path)? {
            // Results cannot contain names that are not Unicode either.
            let Ok(name) = entry?.file_name().into_string() else {
                continue;
            };
            if self.path.join(&name).is_file() {
                names.push(name);
            }
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
