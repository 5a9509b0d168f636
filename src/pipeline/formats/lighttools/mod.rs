//! LightTools ray files, binary and text.

/// LightTools binary ray files.
pub mod binary;
/// LightTools text ray files.
pub mod text;
/// Writing LightTools binary ray files.
pub mod writer;
