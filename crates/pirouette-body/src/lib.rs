//! The posable human body: skeleton, poses and cameras, and avatars to pose and render.
//!
//! An [`Avatar`] is a closed skinned surface in a reference pose. It is built from survey statistics ([`mannequin`]) or
//! read from a skinned glTF file ([`gltf`]); [`render`] draws its silhouettes, depths and shaded pictures. This crate
//! reads no photos and opens no files.

pub mod gltf;
pub mod lens;
pub mod mannequin;
pub mod render;
pub mod survey;

mod avatar;
mod camera;
mod detector_points;
mod pose;
mod skeleton;
mod stance;
mod subject;
mod units;

pub use avatar::*;
pub use camera::*;
pub use pose::*;
pub use skeleton::*;
pub use subject::*;
pub use units::*;
