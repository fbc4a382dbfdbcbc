//! Arguments of `pirouette models`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use pirouette_files::models::PoseNetwork;

/// Arguments of the command
#[derive(Debug, Args)]
pub struct ModelsArgs {
    /// Action
    #[command(subcommand)]
    pub action: ModelsAction,
}

/// Actions on the networks of the pose detector
#[derive(Debug, Subcommand)]
pub enum ModelsAction {
    /// Install a network of the pose detector from npm or PyPI
    Install {
        /// Network to install
        #[arg(value_enum, default_value = "full")]
        network: Network,

        /// Take it from a downloaded file (tgz of npm, wheel of PyPI, or tflite) instead of the registry
        #[arg(long, value_name = "FILE")]
        from: Option<PathBuf>,
    },
    /// List the networks and where they are installed
    List,
}

/// A network of the pose detector
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Network {
    /// 2.8 MB, fastest
    Lite,
    /// 6.4 MB
    Full,
    /// 27.7 MB, most accurate
    Heavy,
}

impl Network {
    /// Returns the corresponding value of the library
    pub fn of_file(self) -> PoseNetwork {
        match self {
            Network::Lite => PoseNetwork::Lite,
            Network::Full => PoseNetwork::Full,
            Network::Heavy => PoseNetwork::Heavy,
        }
    }
}

pub const MODELS_HELP: &str = "\
The pose detector finds the joints of the person in photos that have no keypoint file. Its network is part of MediaPipe
(Google, Apache License 2.0). `models install` downloads the package that contains it with npm or pip, takes the one file
out, and verifies its SHA-256; no code of the package is run.

Order in which a network is selected: --pose-model FILE, the environment variable PIROUETTE_POSE_MODEL, the one that is
embedded in this program (a feature of the build), the most accurate one that is installed.

Examples:
  pirouette models install
  pirouette models install heavy
  pirouette models install --from mediapipe-pose-0.5.1675469404.tgz";
