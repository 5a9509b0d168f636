//! What can go wrong with a job.

use super::State;
use super::memory_budget::TooLarge;
use crate::accounts::quota::Exceeded;
use crate::storage;

/// Why a request about a job cannot be carried out.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// There is no such job.
    #[error("there is no job {0}")]
    Missing(String),
    /// There is no such ray set.
    #[error("there is no ray set {0}")]
    MissingRaySet(String),
    /// There is no such spectrum.
    #[error("there is no spectrum {0}")]
    MissingSpectrum(String),
    /// The state of the job does not allow this change.
    #[error("the job is {}", .0.name())]
    State(State),
    /// The tenant has too many queued jobs, or no storage for the artifacts.
    #[error(transparent)]
    Quota(#[from] Exceeded),
    /// The options, or the channels together, are not valid.
    #[error(transparent)]
    Unfit(#[from] pipeline::Error),
    /// The job needs more memory than this service has.
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
    /// The Idempotency-Key was used for a different request.
    #[error("the key {0:?} was used for another request")]
    KeyReused(String),
    /// The job that was made with the Idempotency-Key was deleted.
    #[error("the job of the key {0:?} was deleted")]
    KeySpent(String),
    /// The database or the object store did not answer.
    #[error(transparent)]
    Storage(#[from] storage::Error),
}
