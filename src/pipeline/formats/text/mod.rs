//! Text files: lines, rows of numbers, and free columns.

/// What stands behind the last row.
pub mod tail;
/// Units, wherever people write them: in names, in a row of their own, in lines of words.
mod units;
/// What people call the columns of a ray.
mod column_names;
/// What columns can be: declared by a user, or named by a file.
pub mod column_rules;
/// What stands before the first row.
mod head;
/// Rays in columns of numbers, named or not: CSV and the like.
pub mod columns;
/// Text: lines at random access, shared by every text format.
pub mod lines;
/// Rows of numbers at random access, shared by every text format.
pub mod rows;
