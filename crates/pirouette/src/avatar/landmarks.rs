//! Tape loops and landmarks found by the geometry of a body.
