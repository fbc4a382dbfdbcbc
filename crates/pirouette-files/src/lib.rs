//! Files: scans in, results out.
//!
//! What other programs write is checked here, once, and converted to the frames and units of [`pirouette`];
//! the method trusts what it gets. Every file is written completely or not at all.

pub mod formats;
pub mod report;
pub mod results;
pub mod scan_folder;
pub mod sink;

mod warning;

pub use warning::Warning;
