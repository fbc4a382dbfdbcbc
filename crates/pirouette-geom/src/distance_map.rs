//! Exact Euclidean distance maps.
