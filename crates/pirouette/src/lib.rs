//! From photos of a person turning on the spot to pose-normalized silhouettes, a 3D body and tape
//! measurements.

pub mod body_fit;
pub mod carve;
pub mod color;
pub mod measure;
pub mod normalize;
pub mod pipeline;
pub mod scale;
pub mod scan;
pub mod segment;
pub mod sizes;
pub mod skeleton_fit;
pub mod view;

mod initial_body;

pub use pirouette_body as body;
pub use pirouette_geom as geom;
pub use pirouette_segment as segmentation;
