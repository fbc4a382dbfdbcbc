//! One module per file format, for parsing and writing.

pub mod charts;
pub mod export;
pub mod keypoints;
pub mod manifest;
pub mod mesh;
pub mod photo;
pub mod points;
