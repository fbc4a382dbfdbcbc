//! Videos, decoded and encoded by the program `ffmpeg`.

mod ffmpeg;
mod ppm;
mod scan;
mod writer;

pub use ffmpeg::{FfmpegVideo, VideoError};
pub use scan::{VideoFile, VideoOptions, VideoScan, VideoScanError, scan_of_video};
pub use writer::VideoWriter;
