//! Detection of 33 body landmarks of a person in a photo.
//!
//! Runs the BlazePose networks of MediaPipe, `pose_landmark_{lite,full,heavy}.tflite`, as they are distributed. The
//! crate contains no network: [`PoseModel::parse`] takes the bytes of a file. It reads and writes no files itself.
//!
//! Guarantees: any bytes give a model or a typed error, with limits on memory and work; detection on a model cannot
//! fail or panic; equal input gives equal results on one machine. Finds one person per photo, always returns all
//! landmarks (check their visibility), and does not track persons across photos.
//!
//! ```no_run
//! use pirouette_pose::{Photo, PoseModel};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let model = PoseModel::parse(&std::fs::read("pose_landmark_full.tflite")?)?;
//! let pixels = vec![[0u8; 3]; 800 * 1000];
//! let photo = Photo::new(800, 1000, &pixels)?;
//! if let Some(region) = model.search(&photo) {
//!     let detection = model.detect(&photo, &region, 2, false);
//!     let nose = &detection.landmarks[0];
//!     println!("nose at {:?} px, visible with probability {}", nose.position, nose.visibility);
//! }
//! # Ok(())
//! # }
//! ```
//!
//! # Source
//! V. Bazarevsky et al. 2020, "BlazePose: On-device Real-time Body Pose tracking"; MediaPipe 0.10,
//! `modules/pose_landmark`

mod crop;
mod error;
mod flatbuffer;
mod graph;
mod half;
mod kernels;
mod landmarks;
mod model;
mod photo;
mod search;
mod tflite;

pub use error::ModelError;
pub use landmarks::{LANDMARK_COUNT, Landmark};
pub use model::{Detection, PersonMask, PoseModel};
pub use photo::{Photo, PhotoError, Region};
