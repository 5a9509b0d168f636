//! Zemax / OpticStudio source files, binary and text.

/// Zemax / OpticStudio binary source files.
pub mod binary;
/// Zemax text ray files.
pub mod text;
/// Writing Zemax binary source files.
pub mod writer;
