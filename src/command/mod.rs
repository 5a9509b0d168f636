//! The verbs of the command line, one file each. A verb reads files and prints; the work is [`pipeline`]'s and
//! [`service`]'s.

/// A file on disk as the pipeline wants its bytes.
mod ray_file;
/// The variables that stand for arguments.
pub mod environment;
/// A ray file and what its user says of it, as one argument.
mod channel_argument;
/// The stores of a service, for who looks after it.
mod stores;
/// `serve`: the service.
pub mod serve;
/// `build`: the pipeline without a server.
pub mod build;
/// The pipeline's options as flags.
mod choices;
/// `inspect`: what a file says, and what its rays say.
pub mod inspect;
/// `convert`: a ray file as another.
pub mod convert;
/// `sample`: known sources as ray files.
pub mod sample;
/// `openapi`: the contract.
pub mod openapi;
/// `keys`: who may use the service.
pub mod keys;
/// `tenants`: how much each may use.
pub mod tenants;
/// `backup`: a copy of everything.
pub mod backup;
/// `health`: is a running service well?
pub mod health;
/// What every verb shares: arguments, failures, progress, tables on a terminal.
mod terminal;

pub use terminal::failure::Failure;
