//! What can go wrong with an upload that is to be resumed.

use super::{Problem, QUEUE_WAIT_S};
use crate::failure::Refusal;
use crate::uploads::{Error, Reason, Unusable};
use axum::http::StatusCode;
use std::num::NonZeroU32;

impl Problem {
    /// No such upload.
    pub fn no_upload(id: &str) -> Problem {
        let detail = format!("There is no upload {id:?}.");
        Problem::new(StatusCode::NOT_FOUND, "upload.not_found", "No such upload", detail)
            .remedy("The upload may have been deleted or have expired: begin a new upload.")
    }

    /// The upload was refused: nothing can be added.
    pub fn gone(id: &str) -> Problem {
        let detail = format!("The upload {id} was refused and accepts no more bytes.");
        Problem::new(StatusCode::GONE, "upload.refused", "The upload was refused", detail)
            .remedy("GET the upload to see why it was refused; then begin a new upload.")
    }

    /// A version of tus that is not spoken here.
    pub fn tus_version(found: Option<&str>) -> Problem {
        let detail = match found {
            Some(version) => format!("The request uses version {version:?} of tus."),
            None => "The request does not name its version of tus.".to_owned(),
        };
        Problem::new(StatusCode::PRECONDITION_FAILED, "tus.version", "Unsupported version of tus", detail)
            .at("Tus-Resumable")
            .remedy("Send Tus-Resumable: 1.0.0.")
    }

    /// The process that made ray sets of an upload disappeared more often than it may.
    pub fn finishing_lost(attempts: u32) -> Problem {
        let detail = format!("The process that read this file ended unexpectedly {attempts} times.");
        let status = StatusCode::INTERNAL_SERVER_ERROR;
        Problem::new(status, "upload.finishing_lost", "The process that reads the file ends unexpectedly", detail)
            .remedy("Ask the operator to look at the log and the memory of the service. The bytes of the file are kept until the upload expires.")
    }
}

/// An upload that cannot be a piece of a final one.
fn piece(id: &str, unusable: Unusable) -> Problem {
    let (status, code, title, detail, remedy) = match unusable {
        Unusable::NotPartial => (
            StatusCode::UNPROCESSABLE_ENTITY,
            "upload.not_partial",
            "Not a partial upload",
            format!("The upload {id} is not a partial upload."),
            "Begin the upload of each piece with Upload-Concat: partial.",
        ),
        Unusable::Unfinished => (
            StatusCode::CONFLICT,
            "upload.partial_unfinished",
            "A partial upload is not complete",
            format!("The partial upload {id} is not complete."),
            "Send the rest of its bytes first; HEAD returns the offset to continue at.",
        ),
        Unusable::Used => (
            StatusCode::CONFLICT,
            "upload.partial_used",
            "A partial upload is used already",
            format!("The partial upload {id} belongs to another upload already."),
            "GET the partial upload: `part_of` names the other upload. To make another file of the same bytes, upload them again.",
        ),
    };
    Problem::new(status, code, title, detail).at("Upload-Concat").remedy(remedy)
}

impl From<Error> for Problem {
    fn from(error: Error) -> Problem {
        match error {
            Error::Missing(id) => Problem::no_upload(&id),
            Error::Refused(refusal) => Problem::from(*refusal),
            Error::Offset { at } => {
                let detail = format!(
                    "The upload has {at} bytes, and Upload-Offset of the request is different, or a newer request took its place."
                );
                Problem::new(StatusCode::CONFLICT, "upload.offset_conflict", "Wrong upload offset", detail)
                    .at("Upload-Offset")
                    .remedy("Get the present offset with HEAD, and continue there.")
            }
            Error::Complete => {
                let detail = "The upload has all of its bytes.";
                Problem::new(StatusCode::CONFLICT, "upload.complete", "The upload is complete", detail)
                    .remedy("GET the upload to see its result.")
            }
            Error::Final => {
                let detail = "The upload is made of partial uploads; no bytes can be added to it.";
                Problem::new(StatusCode::FORBIDDEN, "upload.final", "The upload is final", detail)
                    .remedy("GET the upload to see its result.")
            }
            Error::Piece { id, unusable } => piece(&id, unusable),
            Error::Beyond(length) => {
                let detail = format!("The request goes beyond the announced length of {length} bytes.");
                let status = StatusCode::PAYLOAD_TOO_LARGE;
                Problem::new(status, "upload.beyond_length", "More bytes than announced", detail)
                    .remedy("Begin a new upload with the right Upload-Length.")
            }
            Error::Length => {
                let detail = "The upload has a different length already, or more bytes than this length.";
                Problem::new(StatusCode::BAD_REQUEST, "upload.length", "Wrong upload length", detail)
                    .at("Upload-Length")
                    .remedy("Give the length once: at the beginning, or later if the upload began with Upload-Defer-Length: 1.")
            }
            Error::Checksum => {
                // tus' own status: the bytes of this request are not kept.
                let status = StatusCode::from_u16(460).unwrap_or(StatusCode::BAD_REQUEST);
                let detail = "The received bytes do not have the announced checksum; they were not stored.";
                Problem::new(status, "upload.checksum_mismatch", "The checksum does not match", detail)
                    .at("Upload-Checksum")
                    .remedy("Send these bytes again.")
            }
            Error::TooMany(limit) => {
                let detail = format!("{limit} uploads of the tenant are unfinished, which is the limit.");
                let status = StatusCode::TOO_MANY_REQUESTS;
                let problem = Problem::new(status, "quota.unfinished_uploads", "Too many unfinished uploads", detail)
                    .remedy("Finish one of the uploads, or delete one.");
                Problem { retry_after_s: NonZeroU32::new(QUEUE_WAIT_S), ..problem }
            }
            Error::Stopping => Problem::draining(),
            Error::File(error) => error.into(),
        }
    }
}

impl From<Refusal> for Problem {
    fn from(refusal: Refusal) -> Problem {
        let Refusal { kind, title, status, detail, code, at, remedy } = refusal;
        let (at, remedy) = (at.map(Into::into), remedy.map(Into::into));
        let (kind, title, detail, code) = (kind.into(), title.into(), detail.into(), code.into());
        Problem { kind, title, status, detail, code, at, remedy, retry_after_s: None }
    }
}

/// What is stored with an upload that is refused: what a single request with its bytes would have been answered.
pub fn refusal_of(reason: Reason) -> Refusal {
    let problem = match reason {
        Reason::File(error) => Problem::from(error),
        Reason::FinishingLost(attempts) => Problem::finishing_lost(attempts),
    };
    let Problem { kind, title, status, detail, code, at, remedy, .. } = problem;
    let (at, remedy) = (at.map(Into::into), remedy.map(Into::into));
    Refusal { kind: kind.into(), title: title.into(), status, detail: detail.into(), code: code.into(), at, remedy }
}
