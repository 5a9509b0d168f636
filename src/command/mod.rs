//! The verbs of the command line, one file each. A verb reads files and prints; the work is [`crate::pipeline`]'s and
//! [`crate::service`]'s.

/// What goes wrong, told to a person at a terminal.
mod failure;
/// What a verb answers.
mod output;
/// A file on disk as the pipeline wants its bytes.
mod file;
/// Who watches a run from a terminal: the bar and the clock.
mod progress;
/// Values that several verbs read from their arguments.
mod argument;
/// Sizes, times and counts as an operator writes them.
mod measure;
/// The variables that stand for arguments.
pub mod environment;
/// A ray file and what its user says of it, as one argument.
mod declaration;
/// Aligned text for people.
mod table;
/// The stores of a service, for who looks after it.
mod stores;
/// What clients may ask of a service.
mod bounds;
/// What a service may ask elsewhere.
mod elsewhere;
/// `serve`: the service.
pub mod serve;
/// `build`: the pipeline without a server.
pub mod build;
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

pub use failure::Failure;
