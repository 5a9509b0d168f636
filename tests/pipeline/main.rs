//! The pipeline against answers found elsewhere, through its public doors only.

#![expect(clippy::unwrap_used, clippy::panic, reason = "what a test stumbles over is its finding")]

mod bad_input;
mod channels;
#[path = "../support/formats.rs"]
mod formats;
mod inspection;
mod known_sources;
mod prefixes;
mod packed;
#[path = "../support/packing.rs"]
mod packing;
mod rays;
mod real_files;
mod same_rays;
#[path = "../support/statistics.rs"]
mod statistics;
mod text_files;
mod writers;
