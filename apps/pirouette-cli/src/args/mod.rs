//! The command line: subcommands, switches and their help; one module per command.

mod arap;
mod avatar;
mod demo;
mod eval;
mod scan;
mod size;

use clap::{Parser, Subcommand, ValueEnum};

pub use arap::ArapArgs;
pub use avatar::AvatarArgs;
pub use demo::DemoArgs;
pub use eval::{
    EvalAblationArgs, EvalArgs, EvalBodiesArgs, EvalPhotosArgs, EvalPublishedArgs, EvalScansArgs,
    EvalTable, EvalTapesArgs,
};
pub use scan::{Method, MethodArgs, ScanArgs};
pub use size::SizeArgs;

/// From photos of a turning person to silhouettes, a 3D body and tape measurements
#[derive(Debug, Parser)]
#[command(
    name = "pirouette",
    version,
    arg_required_else_help = true,
    propagate_version = true,
    after_help = "\
Examples:
  pirouette demo                      renders a turning person and scans it: needs no input
  pirouette scan photos/anna -o anna  silhouettes, body and measurements of a scan folder
  pirouette scan --help               what a scan folder looks like

Exit codes: 0 done, 1 failed, 2 wrong usage."
)]
pub struct Cli {
    /// The job
    #[command(subcommand)]
    pub command: Command,

    /// Print one machine-readable line on standard output instead of text
    #[arg(long, global = true, display_order = 100)]
    pub json: bool,

    /// Print nothing but errors
    #[arg(long, short, global = true, display_order = 101)]
    pub quiet: bool,

    /// Threads to use [default: one per processor]
    #[arg(long, short, global = true, display_order = 102, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
}

/// What to do
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Scan a folder of photos: segment, normalize, carve, measure
    #[command(after_help = scan::SCAN_HELP)]
    Scan(ScanArgs),
    /// Render a turning person whose measures are known, scan it, and compare
    #[command(after_help = demo::DEMO_HELP)]
    Demo(DemoArgs),
    /// Find the silhouettes only; works with a single photo too
    #[command(after_help = scan::SEGMENT_HELP)]
    Segment(ScanArgs),
    /// Find the silhouettes and bring them to the reference pose
    #[command(after_help = scan::NORMALIZE_HELP)]
    Normalize(ScanArgs),
    /// Find silhouettes, bring them to the reference pose and carve the body
    #[command(after_help = scan::RECONSTRUCT_HELP)]
    Reconstruct(ScanArgs),
    /// Do what `scan` does: silhouettes, body, measurements
    #[command(after_help = scan::MEASURE_HELP)]
    Measure(ScanArgs),
    /// Tell sizes of garments from a result folder
    #[command(after_help = size::SIZE_HELP)]
    Size(SizeArgs),
    /// Write the reference figure: a PNG silhouette or a mesh
    #[command(after_help = avatar::AVATAR_HELP)]
    Avatar(AvatarArgs),
    /// Deform a planar mesh as rigidly as possible
    #[command(after_help = arap::ARAP_HELP)]
    Arap(ArapArgs),
    /// Tell how accurate pirouette is: studies on rendered people, scores against truth
    #[command(after_help = eval::EVAL_HELP)]
    Eval(EvalArgs),
    /// Print completions for a shell
    #[command(after_help = COMPLETIONS_HELP)]
    Completions {
        /// The shell
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
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn the_last_of_two_opposite_switches_counts() {
        let parse = |args: &[&str]| {
            let all = ["pirouette", "scan", "x"].iter().chain(args);
            match Cli::try_parse_from(all).unwrap().command {
                Command::Scan(args) => args.method,
                _ => unreachable!("scan was asked for"),
            }
        };
        assert!(parse(&["--no-register", "--register"]).register);
        assert!(!parse(&["--no-register", "--register"]).no_register);
    }
}
