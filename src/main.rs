//! The command line: reads arguments and nothing else. `lampwright --help` is its documentation.

use clap::{Parser, Subcommand};
use lampwright::command::{Failure, build, health, inspect, sample};
use std::process::ExitCode;

/// Turns a light source's ray file into a continuous source model: hull mesh with spectra, zonal goniograms, IES files.
///
/// Exit codes: 0 done, 1 input refused or failed, 2 wrong usage.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Build a model from ray files, without a server.
    Build(build::Arguments),
    /// Say what a ray file says of itself, and what its rays say.
    Inspect(inspect::Arguments),
    /// Write a known source as an IES TM-25 ray file.
    Sample(sample::Arguments),
    /// Ask a running service whether it is well; for container health checks.
    Health(health::Arguments),
}

fn main() -> ExitCode {
    let done = match Arguments::parse().verb {
        Verb::Build(arguments) => build::run(&arguments),
        Verb::Inspect(arguments) => inspect::run(&arguments),
        Verb::Sample(arguments) => sample::run(&arguments),
        Verb::Health(arguments) => health::run(&arguments),
    };
    done.map_or_else(Failure::report, |()| ExitCode::SUCCESS)
}
