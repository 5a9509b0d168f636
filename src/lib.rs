//! Lampwright turns a light source's finite ray set into a continuous, physically correct source model, over HTTP.
//!
//! Two halves and one arrow: [`service`] accepts bytes, keeps them and queues jobs; its worker calls [`pipeline::run`],
//! which knows nothing of the world. [`command`] is the command line. `src/README.md` is the map.

/// Sockets, disk and time: everything asynchronous.
pub mod service;
/// The command line's verbs.
pub mod command;

/// Rays in, model and artifacts out: pure computation.
pub use lampwright_pipeline as pipeline;
