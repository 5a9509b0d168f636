//! Why a ray file is not taken in.

use super::pace::TooSlow;
use crate::accounts::quota::Exceeded;
use crate::cause::Cause;
use crate::storage;
use pipeline::{Fault, Place};

/// Why a ray file is not taken in.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file has more bytes than allowed.
    #[error("more than {0} bytes")]
    TooLarge(u64),
    /// The file is empty.
    #[error("the file is empty")]
    Empty,
    /// The sender stopped before its announced end.
    #[error("the body ended early: {0}")]
    Truncated(String),
    /// The bytes broke off, for a reason that is only for the log.
    #[error("the body was interrupted: {0}")]
    Broken(String),
    /// The sender was too slow, or fell silent.
    #[error(transparent)]
    Slow(#[from] TooSlow),
    /// The file does not have the announced SHA-256.
    #[error("sha-256 of what arrived is {found}, announced was {announced}")]
    Digest {
        /// What the sender said, hex.
        announced: String,
        /// What came, hex.
        found: String,
    },
    /// The file is not a ray file, or is refused.
    #[error(transparent)]
    Unfit(#[from] pipeline::Error),
    /// The archive cannot be unpacked, or exceeds a limit.
    #[error(transparent)]
    Packed(pipeline::Error),
    /// The file exceeds the storage quota of the tenant.
    #[error(transparent)]
    Quota(#[from] Exceeded),
    /// Less room on the disk than is kept free.
    #[error("the free storage space is below the reserved limit")]
    LowSpace,
    /// The database or the object store did not answer.
    #[error(transparent)]
    Storage(#[from] storage::Error),
}

/// The same error; where it is one of what is declared of a file, in the words of the query that the file is sent with.
pub fn in_query(error: pipeline::Error) -> pipeline::Error {
    use pipeline::Error::{Refused, Unusable};
    let here = |fault: Fault| match fault.at {
        Some(Place::Channel(_, field)) => Fault { at: Some(Place::Declared(field)), ..fault },
        _ => fault,
    };
    match error {
        Refused(fault) => Refused(here(fault)),
        Unusable(fault) => {
            let fault = here(fault);
            let example = "Write it in the query of the upload, as columns=x,y,z,l,m,n,flux.";
            Unusable(Fault { remedy: format!("{} {example}", fault.remedy), ..fault })
        }
        other => other,
    }
}

impl From<&Error> for Cause {
    fn from(error: &Error) -> Cause {
        match error {
            Error::TooLarge(_)
            | Error::Empty
            | Error::Truncated(_)
            | Error::Broken(_)
            | Error::Slow(_)
            | Error::Digest { .. }
            | Error::Quota(_) => Cause::Input,
            Error::Unfit(error) | Error::Packed(error) => Cause::from(error),
            Error::LowSpace => Cause::StoreAway,
            Error::Storage(error) => Cause::from(error),
        }
    }
}
