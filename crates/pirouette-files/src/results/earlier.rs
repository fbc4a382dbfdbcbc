//! The result of an earlier job in a folder.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::source::stays_inside;

/// Files that other programs read the result from; removed first
const SUMMARY: [&str; 2] = ["result.json", "measurements.json"];

/// Maximum size of an earlier `result.json`, in bytes; a larger one is not ours
const MAX_RESULT_BYTES: u64 = 64 << 20;

/// The files of an earlier result
#[derive(Debug)]
pub(super) struct EarlierResult {
    folder: PathBuf,
    /// Names by which `result.json` lists them
    files: Vec<String>,
}

impl EarlierResult {
    /// Reads the list of files of a result; empty if there is none
    pub(super) fn of(folder: &Path) -> Self {
        let result = folder.join("result.json");
        let small = fs::metadata(&result).is_ok_and(|file| file.len() <= MAX_RESULT_BYTES);
        let bytes = small.then(|| fs::read(&result).ok()).flatten();
        let value: Option<Value> = bytes.and_then(|bytes| serde_json::from_slice(&bytes).ok());
        let listed = value.as_ref().and_then(|value| value["files"].as_array());
        let names = listed.into_iter().flatten().filter_map(Value::as_str);
        Self {
            folder: folder.to_owned(),
            files: names
                .filter(|name| stays_inside(name))
                .map(str::to_owned)
                .collect(),
        }
    }

    /// Removes the files from which other programs read the result
    pub(super) fn remove_summary(&self) {
        for name in SUMMARY {
            if self.files.iter().any(|file| file == name) {
                self.remove(name);
            }
        }
    }

    /// Removes the files of the result, except for those of other names, and folders that are then empty
    pub(super) fn remove_except(&self, kept: &[String]) {
        for name in self.files.iter().filter(|name| !kept.contains(name)) {
            self.remove(name);
            let mut parent = Path::new(name).parent();
            while let Some(folder) = parent.filter(|folder| !folder.as_os_str().is_empty()) {
                // Fails if other files are in it.
                if fs::remove_dir(self.folder.join(folder)).is_err() {
                    break;
                }
                parent = folder.parent();
            }
        }
    }

    /// Removes a file, unless it is a link or behind a link to another folder
    fn remove(&self, name: &str) {
        let file = self.folder.join(name);
        let plain = fs::symlink_metadata(&file).is_ok_and(|file| file.is_file());
        let (Ok(folder), Some(parent)) = (self.folder.canonicalize(), file.parent()) else {
            return;
        };
        let inside = parent
            .canonicalize()
            .is_ok_and(|parent| parent.starts_with(&folder));
        if plain && inside {
            // A file that cannot be removed cannot be replaced either, which is reported there.
            let _ = fs::remove_file(&file);
        }
    }
}

/// Removes the result of an earlier job from a folder: the files that its `result.json` lists, and folders that are then
/// empty
///
/// For a job that failed: measurements of an earlier scan are not those of this one.
pub fn remove_results(folder: &Path) {
    EarlierResult::of(folder).remove_except(&[]);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &Path, name: &str, text: &str) {
        let file = folder.join(name);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, text).unwrap();
    }

    #[test]
    fn only_listed_files_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let (folder, outside) = (folder.path().join("out"), folder.path().join("b.txt"));
        write(&folder, "../b.txt", "mine");
        for name in [
            "measurements.json",
            "views/0/mask.png",
            "views/1/mask.png",
            "body.ply",
        ] {
            write(&folder, name, "old");
        }
        write(&folder, "views/1/notes.txt", "mine");
        write(&folder, "hull.ply", "mine");
        let listed = r#"{ "files": ["measurements.json", "result.json", "views/0/mask.png", "views/1/mask.png",
                          "body.ply", "../b.txt", 3, "none.txt"] }"#;
        write(&folder, "result.json", listed);
        let earlier = EarlierResult::of(&folder);
        earlier.remove_summary();
        assert!(!folder.join("measurements.json").exists());
        assert!(folder.join("body.ply").exists());
        earlier.remove_except(&["body.ply".to_owned()]);
        for gone in ["result.json", "views/0", "views/1/mask.png"] {
            assert!(!folder.join(gone).exists(), "{gone}");
        }
        for kept in ["body.ply", "hull.ply", "views/1/notes.txt"] {
            assert!(folder.join(kept).exists(), "{kept}");
        }
        assert!(outside.exists());
    }

    #[cfg(unix)]
    #[test]
    fn links_are_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (out, other) = (folder.path().join("out"), folder.path().join("other"));
        write(&other, "mask.png", "mine");
        write(
            &out,
            "result.json",
            r#"{ "files": ["views/mask.png", "body.ply"] }"#,
        );
        std::os::unix::fs::symlink(&other, out.join("views")).unwrap();
        std::os::unix::fs::symlink(other.join("mask.png"), out.join("body.ply")).unwrap();
        EarlierResult::of(&out).remove_except(&[]);
        assert!(other.join("mask.png").exists() && out.join("body.ply").exists());
    }

    #[test]
    fn any_content_of_result_json_is_accepted() {
        let folder = tempfile::tempdir().unwrap();
        for text in ["", "{", "[]", "{ \"files\": 3 }", "{ \"files\": [[]] }"] {
            write(folder.path(), "result.json", text);
            let earlier = EarlierResult::of(folder.path());
            assert!(earlier.files.is_empty());
            earlier.remove_except(&[]);
            assert!(folder.path().join("result.json").exists());
        }
    }
}
