//! What every verb shares: arguments, failures, progress, tables on a terminal.

/// Values that several verbs read from their arguments.
pub mod argument;
/// What goes wrong, told to a person at a terminal.
pub mod failure;
/// What goes again when a verb is interrupted.
mod interruption;
/// Where a verb writes.
pub mod destination;
/// Sizes, times and counts as an operator writes them.
pub mod measure;
/// What a verb answers.
pub mod output;
/// Who watches a run from a terminal: the bar and the clock.
pub mod progress;
/// Aligned text for people.
pub mod table;
