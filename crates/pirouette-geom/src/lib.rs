//! Geometry without photos, people or files: rasters, contours, planar meshes and their
//! as-rigid-as-possible deformation, kinematic chains, triangle meshes and surface extraction.
//!
//! Images have their origin at the top left corner of the top left pixel, x to the right, y down, and
//! pixel centers at .5. Space is right-handed. All lengths are in the caller's unit.

pub mod arap;
pub mod chain;
pub mod coarsen;
pub mod contour;
pub mod coverage;
pub mod distance_map;
pub mod isosurface;
pub mod morphology;
pub mod nearest;
pub mod outline_map;
pub mod parallel;
pub mod planar_mesh;
pub mod raster;
pub mod section;
pub mod sparse;
pub mod tri_mesh;
pub mod triangle_sides;
pub mod winding;

pub use raster::{Grid, Mask, Windowed};
pub use tri_mesh::TriMesh;
