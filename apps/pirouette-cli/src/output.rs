//! Standard output: text for people, or one line of JSON for programs.

use std::io::{self, Write};

use anyhow::{Context, Result};
use serde_json::Value;

/// Kind of standard output
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Output {
    /// Text for people
    Text,
    /// One line of JSON per run
    Json,
    /// No output
    Quiet,
}

impl Output {
    /// Returns the output for the flags `--json` and `--quiet`
    pub fn new(json: bool, quiet: bool) -> Self {
        match (json, quiet) {
            (true, _) => Output::Json,
            (false, true) => Output::Quiet,
            (false, false) => Output::Text,
        }
    }

    /// Prints the result of a run
    pub fn done(self, text: &str, json: impl FnOnce() -> Value) -> Result<()> {
        match self {
            Output::Text => print(format!("{text}\n").as_bytes()),
            Output::Json => print(format!("{}\n", json()).as_bytes()),
            Output::Quiet => Ok(()),
        }
    }

    /// Prints the failure of a run as JSON; the text goes to standard error
    pub fn failed(self, message: &str) {
        if self == Output::Json {
            let line = serde_json::json!({ "ok": false, "error": message });
            // The failure was already reported on standard error; a second one is ignored.
            let _ = print(format!("{line}\n").as_bytes());
        }
    }
}

/// Writes to standard output; a closed pipe is not an error
pub fn print(bytes: &[u8]) -> Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(bytes).and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(error).context("cannot write to standard output")
        }
        _ => Ok(()),
    }
}
