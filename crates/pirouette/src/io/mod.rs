//! Files: scans in, results out; the only module that opens files.
//!
//! What other programs write is checked here, once, and converted to the frames and units of this crate;
//! the rest of the library trusts what it gets. Every file goes out whole or not at all.

pub mod atomic;
pub mod export;
pub mod manifest;
pub mod mesh;
pub mod openpose;
mod page;
pub mod photo;
mod pictures;
pub mod points;
pub mod results;
pub mod scan_folder;

pub use page::escape_html;
