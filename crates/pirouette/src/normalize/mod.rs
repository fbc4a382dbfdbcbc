//! Stage 2: from silhouettes to pose-normalized silhouettes.

pub mod refine;
pub mod register;
