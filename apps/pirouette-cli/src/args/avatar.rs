//! Arguments of `avatar`.

use std::path::PathBuf;

use clap::Args;

use super::{Pose, Sex};

/// Arguments of `avatar`
#[derive(Debug, Args)]
pub struct AvatarArgs {
    /// The reference pose
    #[arg(long, value_enum, default_value_t = Pose::A)]
    pub pose: Pose,

    /// How far the figure has turned to its own left, in degrees; for .png
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub angle: f64,

    /// Whose proportions; half way between the two when not given
    #[arg(long, value_enum)]
    pub sex: Option<Sex>,

    /// Height, in mm [default: average, or that of the given figure]
    #[arg(long, value_name = "MM")]
    pub stature: Option<f64>,

    /// Body mass, in kg [default: usual for the height]
    #[arg(long, value_name = "KG")]
    pub mass: Option<f64>,

    /// Skinned glTF or VRM figure to use instead of the built-in one
    #[arg(long, value_name = "FILE.glb|.vrm", conflicts_with_all = ["sex", "mass"])]
    pub avatar: Option<PathBuf>,

    /// Draw a shaded picture instead of the silhouette; for .png
    #[arg(long)]
    pub shaded: bool,

    /// Output; the ending says what: .png a picture, .glb .ply .obj .stl .off a mesh
    #[arg(short, long, value_name = "FILE", default_value = "avatar.png")]
    pub out: PathBuf,
}

pub const AVATAR_HELP: &str = "\
Examples:
  pirouette avatar -o silhouette.png
  pirouette avatar --sex female --stature 1650 --mass 62 -o woman.glb
  pirouette avatar --pose t --angle 45 --shaded -o t45.png
  pirouette avatar --avatar me.vrm --pose a -o me.ply";
