//! The pipeline against answers found elsewhere, through its public doors only.

mod bad_input;
mod known_sources;
mod rays;
#[path = "../support/statistics.rs"]
mod statistics;
