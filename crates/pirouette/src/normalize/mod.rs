//! Stage 2: from silhouettes to pose-normalized silhouettes.
