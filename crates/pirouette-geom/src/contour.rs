//! Contours of masks: border following, sub-pixel outlines, simplification.
