//! The pipeline against answers found elsewhere, through its public doors only.

#![expect(clippy::unwrap_used, reason = "what a test stumbles over is its finding")]

mod bad_input;
mod channels;
mod known_sources;
mod rays;
#[path = "../support/statistics.rs"]
mod statistics;
