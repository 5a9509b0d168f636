//! Uploads that come in several requests (tus): append, finish, outcome.

/// Uploads that can be resumed.
pub mod append;
/// What a client says of the bytes of one request.
pub mod checksum;
/// What becomes of them.
pub mod finish;
/// Uploads that are made of others.
pub mod join;
/// How several become one.
pub mod join_rows;
/// How those end.
pub mod outcome;
/// Rows of uploads that can be resumed.
pub mod rows;
/// What requests and the finishing of uploads tell each other.
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

/// Why nothing, or not all, of a request is kept.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// There is no such upload.
    #[error("there is no upload {0}")]
    Missing(String),
    /// The request goes on from elsewhere than the upload does.
    #[error("the upload has {at} bytes")]
    Offset {
        /// Where the upload goes on, bytes.
        at: u64,
    },
    /// All bytes are there.
    #[error("the upload is complete")]
    Complete,
    /// The upload is made of others: nothing can be added to it.
    #[error("the upload is made of partial uploads")]
    Final,
    /// An upload that cannot be a piece of another.
    #[error("the upload {id} cannot be part of a final upload: {unusable:?}")]
    Piece {
        /// The upload.
        id: String,
        /// Why.
        unusable: Unusable,
    },
    /// The upload was refused; this was said.
    #[error("{}", .0.detail)]
    Refused(Box<Refusal>),
    /// More bytes than announced.
    #[error("the upload goes beyond its announced {0} bytes")]
    Beyond(u64),
    /// A length is announced where one was before, or less than is there.
    #[error("the upload has a different length, or more bytes than this length")]
    Length,
    /// Not the bytes that the sender meant.
    #[error("the checksum does not match")]
    Checksum,
    /// The tenant has too many unfinished uploads.
    #[error("{0} uploads are unfinished")]
    TooMany(u64),
    /// The service stops.
    #[error("the service is stopping")]
    Stopping,
    /// What can happen to any file.
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

/// Takes uploads that can be resumed. Cheap to clone.
#[derive(Clone)]
pub struct Uploads {
    /// What is done with any file.
    pub intake: Intake,
    /// How long an upload is kept to which nothing is added, and one that has ended.
    pub expiry: Duration,
    /// How long a process that finishes an upload may be silent before another does.
    pub lease: Duration,
    /// How often an upload may be begun to be finished before it counts as what kills its process.
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

    /// The same for one whose sender never heard of it, unless it has become ray sets.
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

    /// Whether a file may be so long.
    pub(super) fn fits(&self, whole: u64) -> Result<(), FileError> {
        match whole {
            0 => Err(FileError::Empty),
            _ if whole > self.intake.max_bytes => Err(FileError::TooLarge(self.intake.max_bytes)),
            _ => Ok(()),
        }
    }
}

/// What was said when `upload` was refused; `None` where it was not, or what was said cannot be read.
pub fn refusal(upload: &Upload) -> Option<Refusal> {
    upload.result.as_deref().and_then(|result| serde_json::from_str(result).ok())
}

/// Why an upload is refused.
pub enum Reason {
    /// What can happen to any file.
    File(FileError),
    /// The process that made ray sets of it disappeared as often as that may happen.
    FinishingLost(u32),
}

/// How an upload's digest goes on in another request.
pub fn state(extent: &Extent) -> Result<String, storage::Error> {
    extent.state().ok_or_else(|| storage::Error::fault("the digest of an upload cannot go on"))
}

/// What is wrong with a piece that is named.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unusable {
    /// It is an upload, and not a partial one.
    NotPartial,
    /// Bytes of it are missing.
    Unfinished,
    /// It is a piece of another final upload.
    Used,
}

/// The error of a request for an upload that was refused.
pub fn refused(upload: &Upload) -> Error {
    match refusal(upload) {
        Some(refusal) => Error::Refused(Box::new(refusal)),
        None => storage::Error::fault("what was said of a refused upload cannot be read").into(),
    }
}
