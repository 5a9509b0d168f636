//! The pipeline against answers found elsewhere, through its public doors only.

#![expect(clippy::unwrap_used, clippy::panic, reason = "what a test stumbles over is its finding")]

mod adapters;
mod bad_input;
mod channels;
mod combination;
mod declarations;
mod emission;
mod inspection;
mod known_sources;
mod models;
mod prefixes;
mod new_rays;
mod packed;
mod rays;
mod read_back;
mod real_files;
mod same_rays;
mod schemas;
mod text_files;
mod writers;
