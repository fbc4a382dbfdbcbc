//! Arguments of `pirouette check`.

use std::path::PathBuf;

use clap::Args;

use super::scan::Angles;

/// Arguments of the command
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Scan folder, or a zip file of one
    #[arg(value_name = "SCAN")]
    pub scan: PathBuf,

    /// Network of the pose detector [default: the installed one]
    #[arg(long, value_name = "FILE")]
    pub pose_model: Option<PathBuf>,

    /// `unknown` finds the turn angles in the photos, instead of using those stated
    #[arg(long, value_name = "SOURCE", value_enum)]
    pub angles: Option<Angles>,
}

pub const CHECK_HELP: &str = "\
Loads the scan, detects missing keypoints, and fits one skeleton to all photos, as `scan` does before it computes a body.
Prints a table with one line per photo, what is wrong or doubtful in it and what to do, and the warnings that concern the
complete scan. Exits with 1 if `scan` would refuse it.

Examples:
  pirouette check photos/anna
  pirouette check anna.zip --json";
