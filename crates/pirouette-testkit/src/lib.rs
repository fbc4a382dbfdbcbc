//! Synthetic people with known truth, and comparisons, for the tests of pirouette.
//!
//! For `tests/` folders only: a unit test would link a second copy of its own crate's types.

pub mod golden;
pub mod people;
