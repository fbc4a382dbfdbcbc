//! From photos of a person turning on the spot to pose-normalized silhouettes, a 3D body and tape
//! measurements.

pub mod avatar;
pub mod bundle;
pub mod camera;
pub mod carve;
pub mod color;
pub mod fit;
pub mod io;
pub mod measure;
pub mod normalize;
pub mod picture;
pub mod pipeline;
pub mod pose;
pub mod scale;
pub mod scan;
pub mod segment;
pub mod sizes;
pub mod skeleton;
pub mod synthetic;
pub mod units;

pub use pirouette_geom as geom;
pub use pirouette_segment as segmentation;
