//! Erosion, dilation, connected components and holes of masks.
