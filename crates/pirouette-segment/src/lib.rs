//! GrabCut: from photos and what is known beforehand to silhouettes.
//!
//! Knows pixels and [`seeds`], nothing of persons. [`grabcut`] cuts one photo by itself; [`scene`] cuts
//! several photos of one person before one background together, with shared color models, a background
//! plate and a border finer than a pixel.
//!
//! Guarantees: sure seeds are never changed, the same input gives the same mask on every machine, colors
//! and seeds of any kind give a mask or a typed error. Does not find persons, and does not shrink large
//! photos.

pub mod band;
pub mod border;
pub mod color_model;
mod color_table;
pub mod grabcut;
pub mod links;
mod log_domain;
pub mod max_flow;
pub mod plate;
pub mod scene;
mod scene_view;
pub mod seeds;
mod view_cut;
