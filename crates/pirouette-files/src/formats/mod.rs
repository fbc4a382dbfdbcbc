//! One module per file format, for parsing and writing.

pub mod charts;
pub mod export;
pub mod json;
pub mod keypoints;
pub mod manifest;
pub mod mask;
pub mod mesh;
pub mod photo;
pub mod points;
