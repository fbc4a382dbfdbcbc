//! Plane sections of triangle meshes and convex hulls of them.
