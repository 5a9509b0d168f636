//! What can go wrong with a job.

use super::State;
use super::memory_budget::TooLarge;
use crate::accounts::quota::Exceeded;
use crate::storage;

/// Why a job cannot be changed so.
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
    /// The job is in a state from which this is not legal.
    #[error("the job is {}", .0.name())]
    State(State),
    /// The tenant has too many jobs waiting, or no room for what it would give.
    #[error(transparent)]
    Quota(#[from] Exceeded),
    /// Its options, or its channels together, cannot be meant.
    #[error(transparent)]
    Unfit(#[from] pipeline::Error),
    /// It can never be begun with the memory there is.
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
    /// The key stands for another request.
    #[error("the key {0:?} was used for another request")]
    KeyReused(String),
    /// The job that the key made was deleted.
    #[error("the job of the key {0:?} was deleted")]
    KeySpent(String),
    /// A store did not answer.
    #[error(transparent)]
    Storage(#[from] storage::Error),
}
