//! Warnings of loading a scan and of the job on it, as results list them.

use pirouette::pipeline;
use thiserror::Error;

use crate::scan_folder::ScanWarning;

/// Something that the user should know, though there is a result
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Warning {
    /// While the scan was loaded
    #[error("{0}")]
    Scan(ScanWarning),
    /// While the job ran
    #[error("{0}")]
    Job(pipeline::Warning),
}

impl Warning {
    /// The view that it is about, if it is about one
    pub fn view(&self) -> Option<&str> {
        match self {
            Warning::Scan(warning) => warning.view(),
            Warning::Job(warning) => warning.view(),
        }
    }

    /// Stable name for programs
    pub fn code(&self) -> &'static str {
        match self {
            Warning::Scan(warning) => warning.code(),
            Warning::Job(warning) => warning.code(),
        }
    }
}
