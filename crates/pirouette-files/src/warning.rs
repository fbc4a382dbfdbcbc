//! Warnings from loading a scan and from the job on it, as listed in the results.

use pirouette::pipeline;
use thiserror::Error;

use crate::scan_folder::ScanWarning;

/// A problem that does not prevent a result
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Warning {
    /// From loading the scan
    #[error("{0}")]
    Scan(ScanWarning),
    /// From the computation
    #[error("{0}")]
    Job(pipeline::Warning),
}

impl Warning {
    /// Returns the name of the affected view, if it concerns one
    pub fn view(&self) -> Option<&str> {
        match self {
            Warning::Scan(warning) => warning.view(),
            Warning::Job(warning) => warning.view(),
        }
    }

    /// Returns the stable, machine-readable code
    pub fn code(&self) -> &'static str {
        match self {
            Warning::Scan(warning) => warning.code(),
            Warning::Job(warning) => warning.code(),
        }
    }
}
