//! Arguments of `pirouette keypoints`.

use std::path::PathBuf;

use clap::Args;

/// Arguments of the command
#[derive(Debug, Args)]
pub struct KeypointsArgs {
    /// Folders of photos, zip files of them, or single photos
    #[arg(value_name = "PHOTOS", required = true)]
    pub photos: Vec<PathBuf>,

    /// Folder of the keypoint files; files in an existing one are replaced, other files are kept
    #[arg(short, long, value_name = "OUT", default_value = "out")]
    pub out: PathBuf,

    /// Network of the pose detector [default: the installed one]
    #[arg(long, value_name = "FILE")]
    pub pose_model: Option<PathBuf>,
}

pub const KEYPOINTS_HELP: &str = "\
Runs the pose detector on each photo, also on photos that have a keypoint file, and writes for a photo 000.jpg
  000_keypoints.json  OpenPose JSON, BODY_25, in pixels of the photo
  000_rendered.jpg    the photo with the skeleton and the names of the joints
Copied next to the photo or to the folder `keypoints` of the scan, the JSON file is used by `scan`, after corrections if
needed. A photo without a person is reported and has no files. Photos of one folder are assumed to be from one static
camera.

Examples:
  pirouette keypoints photos/anna -o photos/anna/keypoints
  pirouette keypoints anna.zip -o anna
  pirouette keypoints photos/anna/000.jpg photos/anna/001.jpg -o out";
