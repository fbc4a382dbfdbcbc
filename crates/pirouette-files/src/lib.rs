//! Input and output: scans, results and file formats.
//!
//! [`job::run_job`] is the entry point for front ends: it takes a [`source::Source`] (a folder, a zip file or files in
//! memory) and returns the results as bytes by name, or writes them into a folder. `examples/from_memory.rs` is a
//! complete front end.
//!
//! Files from other programs are validated here, once, and converted to the frames and units of [`pirouette`], which
//! relies on it. Every file is written completely or not at all.

#[cfg(feature = "folders")]
pub mod compare;
pub mod formats;
pub mod job;
pub mod keypoint_files;
#[cfg(feature = "folders")]
pub mod models;
pub mod report;
pub mod results;
pub mod scan_folder;
pub mod sink;
pub mod source;
#[cfg(feature = "folders")]
pub mod video;

mod warning;

pub use warning::Warning;

/// Compiles the code in the README
#[cfg(all(doctest, feature = "folders"))]
#[doc = include_str!("../../../README.md")]
struct Readme;
