//! Constrained Delaunay meshes of contours.
