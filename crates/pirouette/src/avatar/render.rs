//! Silhouettes, limb visibility and shaded pictures of posed bodies.
