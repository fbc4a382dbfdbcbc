//! Arguments of `compare`.

use std::path::PathBuf;

use clap::Args;

/// Arguments of `compare`
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Result folder of the first scan, to whose levels tapes are locked
    #[arg(value_name = "FIRST")]
    pub first: PathBuf,

    /// Result folder of the second scan
    #[arg(value_name = "SECOND")]
    pub second: PathBuf,

    /// Folder for compare.json, and for changes.ply: the second body, red where it is larger, blue where smaller
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

pub const COMPARE_HELP: &str = "\
Prints how each measure changed from the first to the second result, with the standard deviation of the change. Girths of
the trunk are compared at the levels of the first result. Changes that are larger than two standard deviations, which chance
exceeds in 5 % of unchanged measures, are marked with *. The scale adds its uncertainty unless both statures are stated
alike. Both results need the scale in mm, and body.ply for the levels and the colored body.

Examples:
  pirouette compare anna-january anna-june
  pirouette compare anna-january anna-june -o anna-changes --json";
