//! Temporary folders, rendered scans and runs of the command.

#![allow(dead_code, reason = "each test program uses a part")]
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::OnceLock;

use pirouette_files::scan_folder::write_scan;
use pirouette_synthetic::{SyntheticScan, people};
use serde_json::Value;

/// A temporary scan folder and a path for its results
pub struct Folders {
    temporary: tempfile::TempDir,
}

impl Folders {
    pub fn empty() -> Self {
        let temporary = tempfile::tempdir().unwrap();
        std::fs::create_dir(temporary.path().join("scan")).unwrap();
        Self { temporary }
    }

    /// Creates a scan folder with the first views of a rendered person
    pub fn with_views(view_count: usize) -> Self {
        let folders = Self::empty();
        let mut person = person().clone();
        person.scan.views.truncate(view_count);
        write_scan(&folders.scan(), &person.scan).expect("test folders can be written");
        folders
    }

    pub fn scan(&self) -> PathBuf {
        self.temporary.path().join("scan")
    }

    pub fn out(&self) -> PathBuf {
        self.temporary.path().join("out")
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.temporary.path().join(name)
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    /// Writes the scan folder to a zip file in the layout of desktop programs
    pub fn zip(&self) -> PathBuf {
        use std::io::Write;

        let file = self.path("anna.zip");
        let mut writer = zip::ZipWriter::new(std::fs::File::create(&file).unwrap());
        let options = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Deflated);
        for entry in std::fs::read_dir(self.scan()).unwrap() {
            let entry = entry.unwrap();
            let name = format!("anna/{}", entry.file_name().to_str().unwrap());
            writer.start_file(name, options).unwrap();
            writer
                .write_all(&std::fs::read(entry.path()).unwrap())
                .unwrap();
        }
        writer.finish().unwrap();
        file
    }

    /// Runs a command that reads the scan folder and writes the result folder
    pub fn run(&self, command: &str, flags: &[&str]) -> Run {
        let mut all = vec![command];
        let (scan, out) = (self.scan(), self.out());
        all.extend([text(&scan), "-o", text(&out)]);
        all.extend(flags);
        pirouette(&all)
    }

    pub fn json(&self, name: &str) -> Value {
        let bytes = std::fs::read(self.out().join(name)).unwrap();
        serde_json::from_slice(&bytes).unwrap()
    }
}

pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Returns four views of one rendered person, rendered once per test program
pub fn person() -> &'static SyntheticScan {
    static PERSON: OnceLock<SyntheticScan> = OnceLock::new();
    PERSON.get_or_init(|| people::turning_woman(4))
}

/// A finished run of the command
pub struct Run {
    output: Output,
}

/// Runs the command, without any pose detector that is installed on the machine
pub fn pirouette(args: &[&str]) -> Run {
    let output = assert_cmd::Command::cargo_bin("pirouette")
        .unwrap()
        .args(args)
        .env_remove("PIROUETTE_POSE_MODEL")
        .env("XDG_DATA_HOME", "/nonexistent")
        .output()
        .unwrap();
    Run { output }
}

impl Run {
    pub fn stdout(&self) -> String {
        String::from_utf8(self.output.stdout.clone()).unwrap()
    }

    pub fn stderr(&self) -> String {
        String::from_utf8(self.output.stderr.clone()).unwrap()
    }

    #[track_caller]
    pub fn exits_with(self, code: i32) -> Self {
        let found = self.output.status.code();
        assert_eq!(found, Some(code), "{}{}", self.stdout(), self.stderr());
        self
    }

    /// Parses the line of JSON
    #[track_caller]
    pub fn json_line(&self) -> Value {
        let stdout = self.stdout();
        assert_eq!(stdout.lines().count(), 1, "{stdout}");
        serde_json::from_str(&stdout).unwrap()
    }
}

/// Returns the flags that name the network, or reports that the test is skipped
pub fn network(test: &str) -> Option<[String; 2]> {
    let Some(model) = std::env::var_os("PIROUETTE_POSE_MODEL") else {
        eprintln!("{test}: skipped, PIROUETTE_POSE_MODEL names no network");
        return None;
    };
    Some(["--pose-model".to_owned(), model.into_string().unwrap()])
}
