//! The pipeline against answers found elsewhere, through its public doors only.

#![expect(clippy::unwrap_used, reason = "what a test stumbles over is its finding")]

mod bad_input;
mod known_sources;
mod packed;
#[path = "../support/packing.rs"]
mod packing;
mod rays;
#[path = "../support/statistics.rs"]
mod statistics;
