//! What goes to standard output: text for people, or one line for programs.

use std::io::Write;

use serde_json::Value;

/// Who reads standard output
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Output {
    /// People
    Text,
    /// Programs: one JSON line per run
    Json,
    /// Nobody
    Quiet,
}

impl Output {
    /// By the switches `--json` and `--quiet`
    pub fn new(json: bool, quiet: bool) -> Self {
        match (json, quiet) {
            (true, _) => Output::Json,
            (false, true) => Output::Quiet,
            (false, false) => Output::Text,
        }
    }

    /// Prints the result of a run
    pub fn done(self, text: &str, json: impl FnOnce() -> Value) {
        match self {
            Output::Text => print_line(text),
            Output::Json => print_line(&json().to_string()),
            Output::Quiet => {}
        }
    }

    /// Prints the failure of a run, for programs; people read standard error
    pub fn failed(self, message: &str) {
        if self == Output::Json {
            print_line(&serde_json::json!({ "ok": false, "error": message }).to_string());
        }
    }
}

/// Prints a line; a reader that went away is no error of ours
fn print_line(line: &str) {
    let _ = writeln!(std::io::stdout(), "{line}");
}
