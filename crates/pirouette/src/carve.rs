//! Carving: from silhouettes to the visual hull.
