//! The model evaluated.
