//! Stage 1: from photos and the posed avatar to silhouettes.
