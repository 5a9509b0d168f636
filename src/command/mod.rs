//! The verbs of the command line, one file each. A verb reads files and prints; the work is [`crate::pipeline`]'s and
//! [`crate::service`]'s.

/// What goes wrong, told to a person at a terminal.
mod failure;
/// A file on disk as the pipeline wants its bytes.
mod file;
/// Who watches a run from a terminal: the bar and the clock.
mod progress;
/// Aligned text for people.
mod table;
/// `build`: the pipeline without a server.
pub mod build;
/// `health`: is a running service well?
pub mod health;

pub use failure::Failure;
