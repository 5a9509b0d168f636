//! Text files: lines, rows of numbers, and free columns.

/// What people call the columns of a ray.
mod column_names;
/// Rays in columns of numbers, named or not: CSV and the like.
pub mod columns;
/// Text: lines at random access, shared by every text format.
pub mod lines;
/// Rows of numbers at random access, shared by every text format.
pub mod rows;
