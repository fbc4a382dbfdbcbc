//! The built-in parametric mannequin.
