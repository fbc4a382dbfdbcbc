//! The command line: subcommands, switches and their help.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

/// From photos of a turning person to silhouettes, a 3D body and tape measurements
#[derive(Debug, Parser)]
#[command(
    name = "pirouette",
    version,
    arg_required_else_help = true,
    propagate_version = true,
    after_help = "\
Examples:
  pirouette segment photos/anna -o anna  silhouettes of a scan folder

Exit codes: 0 done, 1 failed, 2 wrong usage."
)]
pub struct Cli {
    /// The job
    #[command(subcommand)]
    pub command: Command,

    /// Print one machine-readable line on standard output instead of text
    #[arg(long, global = true)]
    pub json: bool,

    /// Print nothing but errors
    #[arg(long, short, global = true)]
    pub quiet: bool,

    /// Threads to use [default: one per processor]
    #[arg(long, short, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
}

/// What to do
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Only find the silhouettes; works with a single photo too
    #[command(after_help = SEGMENT_HELP)]
    Segment(ScanArgs),
    /// Deform a planar mesh as rigidly as possible
    #[command(after_help = ARAP_HELP)]
    Arap(ArapArgs),
    /// Print completions for a shell
    #[command(after_help = COMPLETIONS_HELP)]
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
}

/// Arguments of the main job and its stages
#[derive(Debug, Args)]
pub struct ScanArgs {
    /// Folder of photos with keypoint files, perhaps a scan.json
    #[arg(value_name = "SCAN")]
    pub scan: PathBuf,

    /// Result folder; an existing one is replaced file by file, never emptied
    #[arg(short, long, value_name = "OUT", default_value = "out")]
    pub out: PathBuf,

    #[command(flatten)]
    pub method: MethodArgs,
}

/// How the job is done
#[derive(Debug, Args)]
pub struct MethodArgs {
    /// `fit` aligns all views with one shared skeleton; `three-step` is the published method, view by view
    #[arg(long, value_enum, default_value_t = Method::Fit)]
    pub method: Method,

    /// Skinned glTF or VRM figure to use as the reference instead of the built-in one
    #[arg(long, value_name = "FILE.glb|.vrm")]
    pub avatar: Option<PathBuf>,

    /// Fit each view's silhouette to that of the reference by a rigid motion [default with three-step]
    #[arg(long, overrides_with = "no_register")]
    pub register: bool,

    /// Leave the registration out [default with fit]
    #[arg(long)]
    pub no_register: bool,

    /// Refine arms and legs against the reference [default with three-step]
    #[arg(long, overrides_with = "no_refine")]
    pub refine: bool,

    /// Leave the refinement out [default with fit]
    #[arg(long)]
    pub no_refine: bool,
}

/// Arguments of `arap`
#[derive(Debug, Args)]
pub struct ArapArgs {
    /// Planar triangle mesh; z is ignored
    #[arg(long, value_name = "IN.off")]
    pub mesh: PathBuf,

    /// Points of the mesh to move: rows of x,y, a header line is fine
    #[arg(long, value_name = "SRC.csv")]
    pub source: PathBuf,

    /// Where they go, row by row
    #[arg(long, value_name = "DST.csv")]
    pub target: PathBuf,

    /// The deformed mesh
    #[arg(short, long, value_name = "OUT.off")]
    pub out: PathBuf,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Method {
    Fit,
    ThreeStep,
}

const SEGMENT_HELP: &str = "\
Writes result.json and, per view, mask.png, overlay.jpg and view.json.

Examples:
  pirouette segment photos/anna -o anna
  pirouette segment one_photo -o out       a folder with one photo and its keypoints";

const ARAP_HELP: &str = "\
Each source point takes the nearest vertex along to its target; the rest follows as rigidly as possible.

Examples:
  pirouette arap --mesh square.off --source from.csv --target to.csv -o deformed.off";

const COMPLETIONS_HELP: &str = "\
Examples:
  pirouette completions bash > ~/.local/share/bash-completion/completions/pirouette
  pirouette completions zsh > ~/.zfunc/_pirouette
  pirouette completions fish > ~/.config/fish/completions/pirouette.fish";

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn the_last_of_two_opposite_switches_counts() {
        let parse = |args: &[&str]| {
            let all = ["pirouette", "segment", "x"].iter().chain(args);
            match Cli::try_parse_from(all).unwrap().command {
                Command::Segment(args) => args.method,
                _ => unreachable!("it was asked for"),
            }
        };
        assert!(parse(&["--no-register", "--register"]).register);
        assert!(!parse(&["--no-register", "--register"]).no_register);
    }
}
