//! One module per file format: bytes in, types out, and back.

pub mod charts;
pub mod export;
pub mod manifest;
pub mod mesh;
pub mod openpose;
pub mod photo;
pub mod points;
