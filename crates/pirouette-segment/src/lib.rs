//! GrabCut segmentation: from photos and prior knowledge per pixel to silhouettes.
//!
//! Works on pixels and [`seeds`], without knowledge of persons. [`grabcut`] cuts one photo; [`scene`] cuts several
//! photos of one person in front of one background together, with shared color models, a clean plate and a border of
//! subpixel accuracy.
//!
//! Guarantees: definite seeds are never changed, equal input gives equal masks on every machine, any colors and seeds
//! give a mask or a typed error. Does not detect persons, and does not shrink large photos.

pub mod band;
pub mod border;
pub mod clean_plate;
pub mod color_model;
mod color_table;
pub mod grabcut;
pub mod links;
mod log_domain;
pub mod max_flow;
pub mod scene;
mod scene_view;
pub mod seeds;
mod view_cut;
