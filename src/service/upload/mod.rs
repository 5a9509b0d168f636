//! Takes in a ray file, or several in a packed one: counts, hashes, judges and stores it while it streams by. Memory does not
//! grow with the file: what is not yet a stored part is at most two parts. Hashing, storing and inspecting go on side by side
//! while it comes. A packed file is stored as it comes and unpacked when all of it is there: its digest covers what was sent.

/// How much of a file has come.
mod extent;
/// Memory for parts.
mod buffers;
/// A file that is still coming, read as if it were whole.
mod arriving;
/// What the rays of a file say.
mod inspecting;
/// From bytes to parts.
mod spool;
/// What is in a packed file.
mod unpack;
/// What a client says of the bytes of one request.
pub mod checksum;
/// Uploads that can be resumed.
pub mod resume;
/// What becomes of them.
pub mod finish;
/// Uploads that are made of others.
pub mod join;

use super::access::quota::{Exceeded, Quota, Room};
use super::jobs::channels::FileDeclaration;
use super::metadata::Metadata;
use super::metrics::Metrics;
use super::pace::{Pace, Slowest, TooSlow};
use super::storage::parts::{Part, Parts};
use super::storage::ray_sets::{self, Draft, Packed, RaySet};
use super::storage::space::Space;
use super::storage::{self, Storage, new_id, ray_set_folder};
use crate::pipeline::{self, Fault, Limits, Place};
pub use buffers::Buffers;
use bytes::Bytes;
pub use extent::Digests;
use futures::Stream;
pub use inspecting::Places;
use inspecting::{Described, Inspecting, Prospect};
use serde::{Deserialize, Serialize};
pub use spool::PART_BYTES;
use spool::Spool;
use std::fmt::Display;
use std::pin::pin;
use tokio::runtime::Handle;
use tokio_util::sync::CancellationToken;

/// Why a ray file is not taken in.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// More bytes than allowed.
    #[error("more than {0} bytes")]
    TooLarge(u64),
    /// No bytes.
    #[error("no bytes")]
    Empty,
    /// The sender stopped before its announced end.
    #[error("the body ended early: {0}")]
    Truncated(String),
    /// The bytes broke off, for a reason that is only for the log.
    #[error("the body broke off: {0}")]
    Broken(String),
    /// The sender was too slow, or fell silent.
    #[error(transparent)]
    Slow(#[from] TooSlow),
    /// Not the bytes the sender meant.
    #[error("sha-256 of what arrived is {found}, announced was {announced}")]
    Digest {
        /// What the sender said, hex.
        announced: String,
        /// What came, hex.
        found: String,
    },
    /// Not a ray file, or one that we refuse.
    #[error(transparent)]
    Unfit(#[from] pipeline::Error),
    /// A packed file that cannot be unpacked, or may not.
    #[error(transparent)]
    Packed(pipeline::Error),
    /// A packed file without a ray file.
    #[error("no ray file in it")]
    NoRayFile(Vec<LeftOut>),
    /// The tenant has no room for it.
    #[error(transparent)]
    Quota(#[from] Exceeded),
    /// Less room on the disk than is kept free.
    #[error("the store has less room than it keeps free")]
    LowSpace,
    /// A store did not answer.
    #[error(transparent)]
    Storage(#[from] storage::Error),
}

/// A file in a packed one that is no ray set, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LeftOut {
    /// Its name in the packed file.
    pub name: String,
    /// Stable: programs may depend on it.
    pub code: String,
    /// What was found, and what to do.
    pub detail: String,
}

/// What came of an upload.
#[derive(Clone, Debug)]
pub struct Taken {
    /// The ray sets, one or more; they became known together.
    pub ray_sets: Vec<RaySet>,
    /// What else was in a packed file.
    pub left_out: Vec<LeftOut>,
}

/// One file, stored and not known yet.
pub(super) struct Stored {
    /// Of the ray set that it becomes; its blobs are in that folder.
    pub id: String,
    /// What it is called.
    pub name: String,
    /// SHA-256 of its bytes, hex.
    pub sha256: String,
    /// It is no ray file but may hold some.
    pub is_packed: bool,
    byte_count: u64,
    parts: Vec<Part>,
    /// The inspection that began while it came.
    inspecting: Option<Inspecting>,
}

/// What a sender says of a file before its bytes.
#[derive(Clone, Debug, Default)]
pub struct Announcement {
    /// What it is called.
    pub name: String,
    /// Its length, bytes, where known.
    pub byte_count: Option<u64>,
    /// Its SHA-256, hex, as often as it was said.
    pub sha256: Vec<String>,
    /// How to read it, or every file in it.
    pub declared: FileDeclaration,
    /// What its client says of the ray sets that it is to be.
    pub metadata: Metadata,
    /// Cancelled when the sender no longer waits for the answer: its rays need not be read to their end.
    pub gone: CancellationToken,
}

/// Takes files in. Cheap to clone.
#[derive(Clone)]
pub struct Intake {
    /// Where they go.
    pub storage: Storage,
    /// Largest file, bytes.
    pub max_bytes: u64,
    /// The slowest sender that is waited for.
    pub slowest: Slowest,
    /// What a tenant may keep that has no quota of its own.
    pub quota: Quota,
    /// Room on local disks.
    pub space: Space,
    /// What a ray file may ask of this machine.
    pub limits: Limits,
    /// Where parts are filled.
    pub buffers: Buffers,
    /// Threads for their digests.
    pub digests: Digests,
    /// Places for files that are read to their end.
    pub inspections: Places,
    /// Counts those files.
    pub metrics: Metrics,
}

impl Intake {
    /// Takes in one file of `tenant`, all of it or nothing; a packed one gives a ray set for each ray file in it.
    ///
    /// # Errors
    /// [`Error`]; nothing is left behind, unless the database failed as the ray sets were made known: they may then be known.
    pub async fn take<E: Display>(
        &self,
        tenant: &str,
        announcement: Announcement,
        body: impl Stream<Item = Result<Bytes, E>>,
    ) -> Result<Taken, Error> {
        let id = new_id();
        let (gone, declared) = (announcement.gone.clone(), announcement.declared.clone());
        let metadata = announcement.metadata.clone();
        let room = self.quota.room(&self.storage.records, tenant).await?;
        let stored = match self.receive(&id, announcement, room, body).await {
            Ok(stored) => stored,
            Err(error) => {
                self.forget(&id).await;
                return Err(error);
            }
        };
        let is_packed = stored.is_packed;
        let drafts = self.drafts(stored, declared, room, gone).await;
        if is_packed || drafts.is_err() {
            self.forget(&id).await;
        }
        let (mut drafts, left_out) = drafts?;
        drafts.iter_mut().for_each(|draft| draft.ray_set.metadata = metadata.clone());
        let ids: Vec<String> = drafts.iter().map(|draft| draft.ray_set.id.clone()).collect();
        // From here on the rows may be there, whatever the answer: only the sweep of garbage can tell.
        let known = ray_sets::insert(&self.storage.records, tenant, self.quota, drafts).await;
        let known = known.inspect_err(|error| {
            tracing::error!(upload = id, %error, "an upload may or may not be known; its blobs stay until they are swept");
        })?;
        if known.is_err() {
            for id in &ids {
                self.forget(id).await;
            }
        }
        Ok(Taken { ray_sets: known?, left_out })
    }

    /// The ray sets that a stored file is to be: itself, or those in it, when it is packed, as far as there is `room`. Stops
    /// when its client is `gone`.
    ///
    /// # Errors
    /// [`Error`]; of what was unpacked nothing is left behind.
    pub(super) async fn drafts(
        &self,
        stored: Stored,
        declared: FileDeclaration,
        room: Room,
        gone: CancellationToken,
    ) -> Result<(Vec<Draft>, Vec<LeftOut>), Error> {
        match stored.is_packed {
            true => self.unpack(stored, declared, room, gone).await,
            false => self.draft(stored, None, &declared, gone).await.map(|draft| (vec![draft], Vec::new())),
        }
    }

    /// Deletes the blobs of a ray set that no row names. Should this fail too, the next start sweeps them.
    pub(super) async fn forget(&self, id: &str) {
        if let Err(error) = self.storage.blobs.delete_all(&ray_set_folder(id)).await {
            tracing::warn!(ray_set = id, %error, "blobs of an unfinished upload stay until they are swept");
        }
    }

    /// Stores the parts of a file; nothing of it is known yet.
    async fn receive<E: Display>(
        &self,
        id: &str,
        announcement: Announcement,
        room: Room,
        body: impl Stream<Item = Result<Bytes, E>>,
    ) -> Result<Stored, Error> {
        room.admit(announcement.byte_count.unwrap_or(1))?;
        let spool = Spool::new(self, id, announcement.byte_count);
        let mut spool = spool.inspected(Prospect::of(&announcement));
        if let Err(error) = self.fill(&mut spool, room, body).await {
            // What is on its way must be there before it is deleted; the first error is told.
            let _ = spool.settle().await;
            return Err(error);
        }
        let stored = spool.end(announcement.name).await?;
        match announcement.sha256.into_iter().find(|announced| *announced != stored.sha256) {
            Some(announced) => Err(Error::Digest { announced, found: stored.sha256 }),
            None => Ok(stored),
        }
    }

    /// Takes all of a body.
    async fn fill<E: Display>(
        &self,
        spool: &mut Spool<'_>,
        room: Room,
        body: impl Stream<Item = Result<Bytes, E>>,
    ) -> Result<(), Error> {
        let (mut body, mut pace) = (pin!(body), Pace::new(self.slowest));
        while let Some(chunk) = pace.next(&mut body).await? {
            spool.push(&chunk.map_err(|error| Error::Broken(error.to_string()))?).await?;
            room.admit(spool.byte_count())?;
        }
        Ok(())
    }

    /// The ray set that a stored file is to be, with what the whole file says of itself.
    pub(super) async fn draft(
        &self,
        mut stored: Stored,
        packed: Option<Packed>,
        declared: &FileDeclaration,
        gone: CancellationToken,
    ) -> Result<Draft, Error> {
        let Described { header, inspection } = self.describe(&mut stored, declared, gone).await?;
        let declared = declared.clone();
        let Stored { id, name, sha256, byte_count, parts, .. } = stored;
        let metadata = Metadata::default();
        let ray_set = RaySet { id, name, byte_count, sha256, header, declared, packed, metadata, created_ms: 0 };
        Ok(Draft { ray_set, parts, inspection })
    }

    /// The bytes of a stored file.
    pub(super) fn read(&self, stored: &Stored) -> Parts {
        Parts::new(self.storage.blobs.clone(), stored.parts.clone(), Handle::current())
    }
}

/// The same error; where it is one of what is declared of a file, in the words of the query that the file is sent with.
pub(super) fn in_query(error: pipeline::Error) -> pipeline::Error {
    use pipeline::Error::{Refused, Unusable};
    let here = |fault: Fault| match fault.at {
        Some(Place::Channel(_, field)) => Fault { at: Some(Place::Declared(field)), ..fault },
        _ => fault,
    };
    match error {
        Refused(fault) => Refused(here(fault)),
        Unusable(fault) => {
            let fault = here(fault);
            let example = "In the query of the upload: columns=x,y,z,l,m,n,flux.";
            Unusable(Fault { remedy: format!("{} {example}", fault.remedy), ..fault })
        }
        other => other,
    }
}
