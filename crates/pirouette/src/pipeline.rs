//! The whole job: stages in order, events, cancellation.
