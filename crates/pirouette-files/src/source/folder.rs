//! A folder of the file system that nothing may lead out of.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::read_bounded;

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
            // Names that are no text cannot be named in results either.
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
        // What does not exist leads nowhere; reading it then fails.
        let canonical = self.path.join(name).canonicalize();
        canonical.map_or(true, |file| file.starts_with(&self.canonical))
    }

    pub(super) fn read(&self, name: &str, limit: u64) -> io::Result<Vec<u8>> {
        let path = self.path.join(name);
        // A pipe would block, a device never end.
        if !fs::metadata(&path)?.is_file() {
            return Err(io::Error::other("not a plain file"));
        }
        read_bounded(fs::File::open(&path)?, limit)
    }
}
