//! Arguments of `demo`.

use std::path::PathBuf;

use clap::Args;

use super::{MethodArgs, Pose, Sex};

/// Arguments of `demo`
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Result folder; the rendered photos are written to its `scan` subfolder
    #[arg(short, long, value_name = "OUT", default_value = "pirouette-demo")]
    pub out: PathBuf,

    /// Random seed of clothes, room, sway and noise
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub seed: u64,

    /// Number of photos over one turn
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub views: usize,

    /// Sex of the rendered person
    #[arg(long, value_enum, default_value_t = Sex::Female)]
    pub sex: Sex,

    /// Height, in mm
    #[arg(long, value_name = "MM", default_value_t = 1660.0)]
    pub stature: f64,

    /// Body mass, in kg
    #[arg(long, value_name = "KG", default_value_t = 72.0)]
    pub mass: f64,

    /// Pose of the person
    #[arg(long, value_enum, default_value_t = Pose::A)]
    pub pose: Pose,

    /// Render a video of the turn instead of photos, and scan it; requires the pose detector and the program ffmpeg
    #[arg(long, conflicts_with = "views")]
    pub video: bool,

    /// Also write report.html: all results on one self-contained page
    #[arg(long)]
    pub report: bool,

    #[command(flatten)]
    pub method: MethodArgs,
}

pub const DEMO_HELP: &str = "\
Writes photos, keypoints and ground truth to OUT/scan, and the results to OUT. If a pose detector is installed (see
`pirouette models`), the photos have no keypoint files, and the detector finds the joints. With --video, the video and the true angle of each
frame are written to OUT/video.

Examples:
  pirouette demo
  pirouette demo --sex male --stature 1810 --mass 95 --seed 7 -o big
  pirouette demo --pose t --views 12 --method three-step
  pirouette demo --video --report";
