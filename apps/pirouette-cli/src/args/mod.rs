//! Command line arguments: subcommands, flags and their help; one module per command.

mod arap;
mod avatar;
mod check;
mod compare;
mod demo;
mod eval;
mod keypoints;
mod models;
mod scan;
mod size;

use clap::{Parser, Subcommand, ValueEnum};

pub use arap::ArapArgs;
pub use avatar::AvatarArgs;
pub use check::CheckArgs;
pub use compare::CompareArgs;
pub use demo::DemoArgs;
pub use eval::{
    EvalAblationArgs, EvalAnglesArgs, EvalArgs, EvalBodiesArgs, EvalClothesArgs, EvalFaultsArgs,
    EvalPhotosArgs, EvalPublishedArgs, EvalScansArgs, EvalTable, EvalTapesArgs, EvalVideosArgs,
};
pub use keypoints::KeypointsArgs;
pub use models::{ModelsAction, ModelsArgs};
pub use scan::{Angles, KeypointInput, Looseness, MeasureArgs, Method, MethodArgs, ScanArgs};
pub use size::SizeArgs;

/// Silhouettes, a 3D body and tape measurements from photos of a turning person
#[derive(Debug, Parser)]
#[command(
    name = "pirouette",
    version,
    arg_required_else_help = true,
    propagate_version = true,
    after_help = "\
Examples:
  pirouette demo                      render a turning person and scan it; needs no input
  pirouette scan photos/anna -o anna  compute silhouettes, body and measurements
  pirouette scan --help               describe the layout of a scan folder

Exit codes: 0 success, 1 failure, 2 invalid usage."
)]
pub struct Cli {
    /// Command to run
    #[command(subcommand)]
    pub command: Command,

    /// Print the result as one line of JSON instead of text
    #[arg(long, global = true, display_order = 100)]
    pub json: bool,

    /// Print errors only
    #[arg(long, short, global = true, display_order = 101)]
    pub quiet: bool,

    /// Number of threads [default: one per processor]
    #[arg(long, short, global = true, display_order = 102, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
}

/// Commands
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Compute silhouettes, body and measurements from a scan folder or zip file
    #[command(after_help = scan::SCAN_HELP)]
    Scan(ScanArgs),
    /// Render a turning person with known measurements, scan it, and compare
    #[command(after_help = demo::DEMO_HELP)]
    Demo(DemoArgs),
    /// Compute the silhouettes only; also accepts a single photo
    #[command(after_help = scan::SEGMENT_HELP)]
    Segment(ScanArgs),
    /// Compute the silhouettes and transform them to the reference pose
    #[command(after_help = scan::NORMALIZE_HELP)]
    Normalize(ScanArgs),
    /// Compute the silhouettes, transform them to the reference pose and compute the body
    #[command(after_help = scan::RECONSTRUCT_HELP)]
    Reconstruct(ScanArgs),
    /// Check a scan without computing a body: what is wrong or doubtful, per photo
    #[command(after_help = check::CHECK_HELP)]
    Check(CheckArgs),
    /// Run the pose detector alone and write a keypoint file and a picture for each photo
    #[command(after_help = keypoints::KEYPOINTS_HELP)]
    Keypoints(KeypointsArgs),
    /// Measure a mesh of a person; with photos, same as `scan`
    #[command(after_help = scan::MEASURE_HELP)]
    Measure(MeasureArgs),
    /// Compare two results of one person: what changed beyond chance
    #[command(after_help = compare::COMPARE_HELP)]
    Compare(CompareArgs),
    /// Recommend garment sizes for a result folder
    #[command(after_help = size::SIZE_HELP)]
    Size(SizeArgs),
    /// Write the reference avatar as an image or a mesh
    #[command(after_help = avatar::AVATAR_HELP)]
    Avatar(AvatarArgs),
    /// Apply an as-rigid-as-possible deformation to a planar mesh
    #[command(after_help = arap::ARAP_HELP)]
    Arap(ArapArgs),
    /// Evaluate accuracy on rendered people or against ground truth
    #[command(after_help = eval::EVAL_HELP)]
    Eval(EvalArgs),
    /// Install or list the networks of the pose detector
    #[command(after_help = models::MODELS_HELP)]
    Models(ModelsArgs),
    /// Print shell completions
    #[command(after_help = COMPLETIONS_HELP)]
    Completions {
        /// Shell to complete for
        shell: clap_complete::Shell,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Pose {
    A,
    T,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Sex {
    Female,
    Male,
}

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
    fn command_line_definition_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn last_of_two_opposite_flags_wins() {
        let parse = |args: &[&str]| {
            let all = ["pirouette", "scan", "x"].iter().chain(args);
            match Cli::try_parse_from(all).unwrap().command {
                Command::Scan(args) => args.method,
                _ => unreachable!("the command is scan"),
            }
        };
        assert!(parse(&["--no-register", "--register"]).register);
        assert!(!parse(&["--no-register", "--register"]).no_register);
    }
}
