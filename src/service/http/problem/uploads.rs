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
            .remedy("It may have been deleted, or its time may be over: begin another.")
    }

    /// The upload was refused: nothing can be added.
    pub fn gone(id: &str) -> Problem {
        let detail = format!("The upload {id} was refused.");
        Problem::new(StatusCode::GONE, "upload.refused", "The upload was refused", detail)
            .remedy("Ask with GET why; begin another.")
    }

    /// A version of tus that is not spoken here.
    pub fn tus_version(found: Option<&str>) -> Problem {
        let detail = match found {
            Some(version) => format!("The request speaks tus {version:?}."),
            None => "The request does not say which tus it speaks.".to_owned(),
        };
        Problem::new(StatusCode::PRECONDITION_FAILED, "tus.version", "Not this version of tus", detail)
            .at("Tus-Resumable")
            .remedy("Send Tus-Resumable: 1.0.0.")
    }

    /// The process that made ray sets of an upload disappeared more often than it may.
    pub fn finishing_lost(attempts: u32) -> Problem {
        let detail = format!("The process that read this file disappeared {attempts} times.");
        let status = StatusCode::INTERNAL_SERVER_ERROR;
        Problem::new(status, "upload.finishing_lost", "The file ends the process that reads it", detail)
            .remedy("See the service's log and memory. The bytes of the file stay until the upload expires.")
    }
}

/// An upload that cannot be a piece of a final one.
fn piece(id: &str, unusable: Unusable) -> Problem {
    let (status, code, title, detail, remedy) = match unusable {
        Unusable::NotPartial => (
            StatusCode::UNPROCESSABLE_ENTITY,
            "upload.not_partial",
            "Not a partial upload",
            format!("The upload {id} was not begun as a partial one."),
            "Begin each piece with Upload-Concat: partial.",
        ),
        Unusable::Unfinished => (
            StatusCode::CONFLICT,
            "upload.partial_unfinished",
            "A partial upload is not complete",
            format!("Bytes of the partial upload {id} are missing."),
            "Send the rest of it first; HEAD tells where it goes on.",
        ),
        Unusable::Used => (
            StatusCode::CONFLICT,
            "upload.partial_used",
            "A partial upload is used already",
            format!("The partial upload {id} is a piece of another upload."),
            "GET tells which: part_of. To make another file of the same bytes, send them again.",
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
                let detail =
                    format!("The upload goes on at byte {at}, and the request does not, or another came after it.");
                Problem::new(StatusCode::CONFLICT, "upload.offset_conflict", "Not where the upload goes on", detail)
                    .at("Upload-Offset")
                    .remedy("Ask with HEAD where it goes on.")
            }
            Error::Complete => {
                let detail = "All bytes of the upload are there.";
                Problem::new(StatusCode::CONFLICT, "upload.complete", "The upload is complete", detail)
                    .remedy("Ask with GET what became of it.")
            }
            Error::Final => {
                let detail = "The upload is made of partial uploads; nothing can be added to it.";
                Problem::new(StatusCode::FORBIDDEN, "upload.final", "The upload is final", detail)
                    .remedy("Ask with GET what became of it.")
            }
            Error::Piece { id, unusable } => piece(&id, unusable),
            Error::Beyond(length) => {
                let detail = format!("The request goes beyond the announced {length} bytes.");
                let status = StatusCode::PAYLOAD_TOO_LARGE;
                Problem::new(status, "upload.beyond_length", "More bytes than announced", detail)
                    .remedy("Begin another upload, with the right Upload-Length.")
            }
            Error::Length => {
                let detail = "The upload has another length already, or more bytes than this.";
                Problem::new(StatusCode::BAD_REQUEST, "upload.length", "Not the length of the upload", detail)
                    .at("Upload-Length")
                    .remedy("Say it once, with Upload-Defer-Length: 1 at the beginning.")
            }
            Error::Checksum => {
                // tus' own status: the bytes of this request are not kept.
                let status = StatusCode::from_u16(460).unwrap_or(StatusCode::BAD_REQUEST);
                let detail = "What came has not the announced checksum; it was not kept.";
                Problem::new(status, "upload.checksum_mismatch", "The checksum does not match", detail)
                    .at("Upload-Checksum")
                    .remedy("Send these bytes again.")
            }
            Error::TooMany(limit) => {
                let detail = format!("{limit} uploads are unfinished, which is as many as may be.");
                let status = StatusCode::TOO_MANY_REQUESTS;
                let problem = Problem::new(status, "quota.unfinished_uploads", "Too many unfinished uploads", detail)
                    .remedy("Go on with one of them, or delete it.");
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
