//! Files: scans in, results out.
//!
//! [`job::run_job`] is all that a front end needs: it takes a [`source::Source`] (a folder, a zip file or files in memory) and
//! returns the results as bytes by name, or writes them into a folder. `examples/from_memory.rs` is a complete one.
//!
//! What other programs write is checked here, once, and converted to the frames and units of [`pirouette`];
//! the method trusts what it gets. Every file is written completely or not at all.

pub mod formats;
pub mod job;
pub mod report;
pub mod results;
pub mod scan_folder;
pub mod sink;
pub mod source;

mod warning;

pub use warning::Warning;
