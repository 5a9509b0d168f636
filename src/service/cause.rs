//! The cause of an error: the one place that decides it for jobs, uploads and requests. The cause decides what is tried again,
//! what the log reports as a fault, and what a client sees: everything about its own input, nothing about the insides of the
//! service.

use crate::failure::Failure;
use crate::priority::Lost;
use crate::storage;

/// The cause of an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The file or the request. The client sees the whole error; the same request would fail again.
    Input,
    /// The work was stopped because its result is not needed any more.
    Stopped,
    /// The database or the object store does not answer, or is full. Another attempt may succeed.
    StoreAway,
    /// A store has lost what a row names. Another attempt would find the same; an operator has to know.
    StoreDamaged,
    /// An error in this program. Another attempt would most likely fail again; the log has the details.
    Ours,
}

impl From<&storage::Error> for Cause {
    fn from(error: &storage::Error) -> Cause {
        use storage::Error;
        match error {
            Error::Records(_) | Error::Blobs(_) | Error::Full => Cause::StoreAway,
            Error::MissingBlob(_) | Error::DamagedBlob { .. } => Cause::StoreDamaged,
            // Only seen while stores are opened, which no client has a part in.
            Error::Fault(_) | Error::Unsupported(..) | Error::Unusable(_) => Cause::Ours,
        }
    }
}

impl From<&pipeline::Error> for Cause {
    fn from(error: &pipeline::Error) -> Cause {
        use pipeline::Error;
        match error {
            Error::Malformed(_) | Error::Refused(_) | Error::Unusable(_) => Cause::Input,
            Error::Cancelled => Cause::Stopped,
            // What the pipeline reads comes from a store, whoever else handed the error on.
            Error::Unreadable(_) => stored(error).map_or(Cause::StoreAway, Cause::from),
            Error::Internal(_) => Cause::Ours,
        }
    }
}

impl From<Lost> for pipeline::Error {
    fn from(lost: Lost) -> pipeline::Error {
        match lost {
            Lost::Panicked(message) => pipeline::Error::Internal(format!("a computation panicked: {message}")),
            // As with a store that is away: there may be one later.
            Lost::NoThread(error) => pipeline::Error::Unreadable(error),
        }
    }
}

/// The error of a store that kept the pipeline from reading.
pub fn stored(error: &pipeline::Error) -> Option<&storage::Error> {
    match error {
        pipeline::Error::Unreadable(error) => error.get_ref()?.downcast_ref(),
        _ => None,
    }
}

impl From<&storage::Error> for Failure {
    fn from(error: &storage::Error) -> Failure {
        use storage::Error;
        match error {
            Error::Full => Failure::store_full(),
            Error::Records(_) | Error::Blobs(_) => Failure::store_away(),
            Error::MissingBlob(key) => Failure::blob_missing(&owner(key)),
            Error::DamagedBlob { blob, .. } => Failure::blob_damaged(&owner(blob)),
            Error::Fault(_) | Error::Unsupported(..) | Error::Unusable(_) => Failure::internal(),
        }
    }
}

impl From<&pipeline::Error> for Failure {
    fn from(error: &pipeline::Error) -> Failure {
        use pipeline::Error;
        match error {
            Error::Malformed(fault) => Failure::of("The file is malformed", fault),
            Error::Refused(fault) => Failure::of(refused(fault.code), fault),
            Error::Unusable(fault) => Failure::of("The request is not valid", fault),
            Error::Cancelled => Failure::stopped(),
            Error::Unreadable(_) => stored(error).map_or_else(Failure::store_away, Failure::from),
            Error::Internal(_) => Failure::internal(),
        }
    }
}

/// What is refused, by the part of the pipeline that refuses it: what is asked of a model is no file.
fn refused(code: &str) -> &'static str {
    match code.split('.').next() {
        Some("evaluation") => "The evaluation is refused",
        Some("combination") => "The combination is refused",
        Some("model") => "The model is refused",
        _ => "The file is refused",
    }
}

/// Whose bytes a blob holds, in a client's words: a ray set or a job, by the id that the client knows.
fn owner(key: &str) -> String {
    let mut parts = key.split('/');
    match (parts.next(), parts.next()) {
        (Some("ray-sets"), Some(id)) => format!("the ray set {id}"),
        (Some("artifacts"), Some(id)) => format!("the artifacts of the job {id}"),
        _ => "the requested resource".to_owned(),
    }
}
