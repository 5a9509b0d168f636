//! Uploads that come in several requests (tus): append, finish, outcome.

/// Appending bytes to uploads.
pub mod append;
/// Checksums of the bytes of one request.
pub mod checksum;
/// Finishing complete uploads: making ray sets of them, or refusing them.
pub mod finish;
/// Final uploads, which are made of partial ones.
pub mod join;
/// Rows of final uploads.
pub mod join_rows;
/// Rows of uploads that end: as ray sets, refused, deleted or expired.
pub mod outcome;
/// Rows of resumable uploads.
pub mod rows;
/// Signals between requests and the finishing of uploads.
pub mod signals;

use crate::accounts::quota::Exceeded;
use crate::failure::Refusal;
use crate::ray_sets::announcement::Announcement;
use crate::ray_sets::error::Error as FileError;
use crate::ray_sets::extent::Extent;
use crate::ray_sets::intake::Intake;
use crate::storage;
use crate::storage::keys::new_id;
use outcome::Gone;
use rows::{Concat, New, NoRoom, State, Upload};
use signals::UploadSignals;
use std::sync::Arc;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// Why a request for an upload is refused.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// There is no such upload.
    #[error("there is no upload {0}")]
    Missing(String),
    /// The offset of the request is not that of the upload.
    #[error("the upload has {at} bytes")]
    Offset {
        /// Number of bytes that the upload has.
        at: u64,
    },
    /// The upload has all of its bytes.
    #[error("the upload is complete")]
    Complete,
    /// The upload is final: no bytes can be added to it.
    #[error("the upload is made of partial uploads")]
    Final,
    /// An upload that cannot be a piece of another.
    #[error("the upload {id} cannot be part of a final upload: {unusable:?}")]
    Piece {
        /// The upload.
        id: String,
        /// Why the upload cannot be used.
        unusable: Unusable,
    },
    /// The upload was refused, for this reason.
    #[error("{}", .0.detail)]
    Refused(Box<Refusal>),
    /// The request has more bytes than the announced length allows.
    #[error("the upload goes beyond its announced {0} bytes")]
    Beyond(u64),
    /// The upload has a different length, or more bytes than the length of the request.
    #[error("the upload has a different length, or more bytes than this length")]
    Length,
    /// The bytes do not have the announced checksum.
    #[error("the checksum does not match")]
    Checksum,
    /// The tenant has too many unfinished uploads.
    #[error("{0} uploads are unfinished")]
    TooMany(u64),
    /// The service is stopping.
    #[error("the service is stopping")]
    Stopping,
    /// The file cannot be stored, or is not a ray file.
    #[error(transparent)]
    File(#[from] FileError),
}

impl From<storage::Error> for Error {
    fn from(error: storage::Error) -> Error {
        Error::File(error.into())
    }
}

impl From<Exceeded> for Error {
    fn from(exceeded: Exceeded) -> Error {
        Error::File(exceeded.into())
    }
}

/// Receives and finishes resumable uploads. Cheap to clone.
#[derive(Clone)]
pub struct Uploads {
    /// Stores and reads files of any upload.
    pub intake: Intake,
    /// Time until an upload expires to which no bytes are added, or which has ended.
    pub expiry: Duration,
    /// Time without a renewal of its lease after which another process finishes an upload.
    pub lease: Duration,
    /// Number of attempts to finish an upload whose process ends unexpectedly, before the upload is refused.
    pub max_attempts: u32,
    /// The words for a refusal, which are stored with the upload.
    pub refusal_of: fn(Reason) -> Refusal,
    /// What this process's requests and its finishing tell each other.
    pub ends: Arc<UploadSignals>,
    /// Requests end where they are, and what is being finished is left to others.
    pub stopping: CancellationToken,
}

impl Uploads {
    /// Begins an upload of `tenant`, of a whole file or, partial, of a piece of one.
    ///
    /// # Errors
    /// [`Error::TooMany`], [`Error::File`].
    pub async fn create(
        &self,
        tenant: &str,
        metadata: String,
        whole: Announcement,
        is_partial: bool,
    ) -> Result<Upload, Error> {
        if let Some(byte_count) = whole.byte_count {
            self.fits(byte_count)?;
        }
        if !self.intake.space.has_room_for(whole.byte_count.unwrap_or(0)) {
            return Err(FileError::LowSpace.into());
        }
        let Announcement { name, byte_count, sha256: announced, declared, metadata: client_metadata, .. } = whole;
        let sha256_state = state(&Extent::default())?;
        let id = new_id();
        let new =
            New { id, name, metadata, declared, client_metadata, announced, byte_count, sha256_state, is_partial };
        let Intake { storage, quota, .. } = &self.intake;
        match rows::insert(&storage.records, tenant, *quota, &new, self.expiry).await? {
            Ok(upload) => Ok(upload),
            Err(NoRoom::Quota(exceeded)) => Err(exceeded.into()),
            Err(NoRoom::TooMany) => Err(Error::TooMany(rows::MAX_UNFINISHED)),
        }
    }

    /// Deletes an upload of `tenant`; ray sets that it has become stay.
    ///
    /// # Errors
    /// [`Error::Missing`], [`Error::File`].
    pub async fn delete(&self, tenant: &str, id: &str) -> Result<(), Error> {
        let was = outcome::delete(&self.intake.storage.records, tenant, id).await?;
        self.delete_unless_taken(&was.ok_or_else(|| Error::Missing(id.to_owned()))?).await;
        Ok(())
    }

    /// Deletes an upload whose client never learned of it, unless ray sets were made of it.
    pub async fn abandon(&self, tenant: &str, id: &str) {
        match outcome::abandon(&self.intake.storage.records, tenant, id).await {
            Ok(Some(was)) => self.delete_unless_taken(&was).await,
            Ok(None) => {}
            Err(error) => {
                tracing::warn!(upload = id, %error, "cannot delete an upload whose client went away; it stays until it expires");
            }
        }
    }

    /// Deletes the blobs of an upload whose row is gone. Of one that was taken they are a ray set's, of one that was joined they
    /// are another upload's.
    pub(super) async fn delete_unless_taken(&self, gone: &Gone) {
        if !matches!(gone.was, State::Taken | State::Joined) {
            self.delete_upload_blobs(&gone.id, &gone.concat).await;
        }
    }

    /// Deletes the blobs of an upload: its own, and those of its pieces, which are its own too.
    pub(super) async fn delete_upload_blobs(&self, id: &str, concat: &Concat) {
        self.intake.delete_blobs(id).await;
        for piece in concat.partials() {
            self.intake.delete_blobs(piece).await;
        }
    }

    /// Checks the length of a file against the limits.
    pub(super) fn fits(&self, whole: u64) -> Result<(), FileError> {
        match whole {
            0 => Err(FileError::Empty),
            _ if whole > self.intake.max_bytes => Err(FileError::TooLarge(self.intake.max_bytes)),
            _ => Ok(()),
        }
    }
}

/// The stored refusal of `upload`; `None` if it was not refused, or the refusal cannot be read.
pub fn refusal(upload: &Upload) -> Option<Refusal> {
    upload.result.as_deref().and_then(|result| serde_json::from_str(result).ok())
}

/// The reason for which an upload is refused.
pub enum Reason {
    /// The file cannot be stored, or is not a ray file.
    File(FileError),
    /// The process that made ray sets of it disappeared as often as that may happen.
    FinishingLost(u32),
}

/// How an upload's digest goes on in another request.
pub fn state(extent: &Extent) -> Result<String, storage::Error> {
    extent.state().ok_or_else(|| storage::Error::fault("the digest of an upload cannot go on"))
}

/// Why an upload cannot be part of a final upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unusable {
    /// The upload is not a partial one.
    NotPartial,
    /// The partial upload is not complete.
    Unfinished,
    /// The partial upload belongs to another final upload.
    Used,
}

/// The error of a request for an upload that was refused.
pub fn refused(upload: &Upload) -> Error {
    match refusal(upload) {
        Some(refusal) => Error::Refused(Box::new(refusal)),
        None => storage::Error::fault("the stored refusal of an upload cannot be read").into(),
    }
}
