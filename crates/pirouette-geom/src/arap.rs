//! As-rigid-as-possible deformation of a planar mesh.
