//! Arguments of `avatar`.

use std::path::PathBuf;

use clap::Args;

use super::{Pose, Sex};

/// Arguments of `avatar`
#[derive(Debug, Args)]
pub struct AvatarArgs {
    /// Reference pose
    #[arg(long, value_enum, default_value_t = Pose::A)]
    pub pose: Pose,

    /// Turn angle to the avatar's left, in degrees; for .png
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub angle: f64,

    /// Body proportions [default: the mean of both]
    #[arg(long, value_enum)]
    pub sex: Option<Sex>,

    /// Height, in mm [default: average, or that of the given avatar]
    #[arg(long, value_name = "MM")]
    pub stature: Option<f64>,

    /// Body mass, in kg [default: average for the height]
    #[arg(long, value_name = "KG")]
    pub mass: Option<f64>,

    /// Skinned glTF or VRM avatar to use instead of the built-in one
    #[arg(long, value_name = "FILE.glb|.vrm", conflicts_with_all = ["sex", "mass"])]
    pub avatar: Option<PathBuf>,

    /// Render a shaded image instead of the silhouette; for .png
    #[arg(long)]
    pub shaded: bool,

    /// Output file: an image (.png) or a mesh (.glb, .ply, .obj, .stl, .off)
    #[arg(short, long, value_name = "FILE", default_value = "avatar.png")]
    pub out: PathBuf,
}

pub const AVATAR_HELP: &str = "\
Examples:
  pirouette avatar -o silhouette.png
  pirouette avatar --sex female --stature 1650 --mass 62 -o woman.glb
  pirouette avatar --pose t --angle 45 --shaded -o t45.png
  pirouette avatar --avatar me.vrm --pose a -o me.ply";
