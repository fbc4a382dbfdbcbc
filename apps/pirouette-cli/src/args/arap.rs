//! Arguments of `arap`.

use std::path::PathBuf;

use clap::Args;

/// Arguments of `arap`
#[derive(Debug, Args)]
pub struct ArapArgs {
    /// Triangle mesh in the xy plane; z is unchanged
    #[arg(long, value_name = "IN.off")]
    pub mesh: PathBuf,

    /// Points of the mesh to move: rows of x,y; a header line is allowed
    #[arg(long, value_name = "SRC.csv")]
    pub source: PathBuf,

    /// Target positions, one row per source point
    #[arg(long, value_name = "DST.csv")]
    pub target: PathBuf,

    /// Output file for the deformed mesh: .off, .obj, .ply or .stl
    #[arg(short, long, value_name = "OUT.off")]
    pub out: PathBuf,
}

pub const ARAP_HELP: &str = "\
The vertex nearest to each source point moves to the target; all others follow as rigidly as possible.
Source points far from the mesh are errors, and so are points that would move one vertex to different targets.

Examples:
  pirouette arap --mesh square.off --source from.csv --target to.csv -o deformed.off";
