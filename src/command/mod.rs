//! The verbs of the command line, one file each. A verb reads files and prints; the work is [`pipeline`]'s and
//! [`service`]'s.

/// A file on disk as the pipeline wants its bytes.
mod ray_file;
/// The variables that stand for arguments.
pub mod environment;
/// A ray file with declarations about it, as one argument.
mod channel_argument;
/// The stores of a service, for the commands of its operator.
mod stores;
/// `serve`: the service.
pub mod serve;
/// `build`: the pipeline without a server.
pub mod build;
/// The pipeline's options as flags.
mod choices;
/// `inspect`: the header of a ray file and an inspection of its rays.
pub mod inspect;
/// `convert`: writes a ray file in another format.
pub mod convert;
/// `rays`: new rays from a model.
pub mod rays;
/// `evaluate`: intensity, irradiance, luminance of a model.
pub mod evaluate;
/// A model with what is changed of it, as one argument.
mod model_argument;
/// `combine`: models changed, and several as one.
pub mod combine;
/// `adapter`: a model as a renderer opens it.
pub mod adapter;
/// `sample`: known sources as ray files.
pub mod sample;
/// `openapi`: the contract.
pub mod openapi;
/// `keys`: the API keys of a service.
pub mod keys;
/// `tenants`: usage and quotas of tenants.
pub mod tenants;
/// `backup`: a copy of the database and the blobs.
pub mod backup;
/// `health`: checks a running service.
pub mod health;
/// What all commands share: arguments, failures, progress, tables on a terminal.
mod terminal;

pub use terminal::failure::Failure;
pub use terminal::measure::number;
