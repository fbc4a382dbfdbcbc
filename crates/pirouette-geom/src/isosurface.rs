//! Surface extraction from a scalar field on an adaptive grid.
