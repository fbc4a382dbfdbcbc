//! Definitions of the scores.
//!
//! - Overlap of masks: intersection over union; of normalized silhouettes after the best shift ([`masks`]).
//! - Surface error: distances from points to triangles, in both directions, after a shift and a turn about the
//!   vertical ([`surface`]).
//! - Girths of a body at given heights ([`girth`]).

pub mod girth;
pub mod masks;
pub mod surface;
pub mod volume;
