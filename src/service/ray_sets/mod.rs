//! Stores an uploaded ray file, or the ray files in an archive: counts, hashes, checks and stores the bytes while they arrive.
//! Memory does not grow with the file: what is not yet a stored part is at most two parts. Hashing, storing and inspecting go on
//! side by side while it comes. An archive is stored while it arrives and unpacked when it is complete: its digest is that of the
//! archive.

/// Length and digest of the bytes that have arrived.
pub mod extent;
/// Memory for parts.
mod buffers;
/// A file that is still coming, read as if it were whole.
mod arriving;
/// Inspects files, while they come or when they are stored.
mod inspecting;
/// Cutting a stream of bytes into stored parts.
pub mod spool;
/// What is in a packed file.
mod unpack;
/// What a client declares of a ray file, as sent and as stored.
pub mod declaration;
/// Fetches a ray file.
pub mod fetch;
/// Rows of inspections.
pub mod inspections;
/// Minimum speed of uploads.
pub mod pace;
/// Rows of ray sets.
pub mod rows;
/// What the client announces about a file before its bytes.
pub mod announcement;
/// Why a ray file is not taken in.
pub mod error;
/// The parts of the service that an upload needs.
pub mod intake;

use crate::accounts::quota::Room;
use crate::metadata::Metadata;
use crate::storage::keys::{new_id, ray_set_folder};
pub use crate::storage::parts::PART_BYTES;
use crate::storage::parts::Parts;
use announcement::Announcement;
pub use buffers::Buffers;
use bytes::Bytes;
use declaration::FileDeclaration;
pub use error::Error;
use error::in_query;
pub use extent::Digests;
use futures::Stream;
pub use inspecting::Places;
use inspecting::{Described, ExpectedFile};
use intake::Intake;
use pace::Pace;
use pipeline::Input;
pub use rows::LeftOut;
use rows::{Draft, Packed, RaySet};
use spool::Spool;
use spool::Stored;
use std::fmt::Display;
use std::pin::pin;
use std::sync::Arc;
use tokio::runtime::Handle;
use tokio_util::sync::CancellationToken;

/// The result of an upload.
#[derive(Clone, Debug)]
pub struct Taken {
    /// The ray sets, one or more.
    pub ray_sets: Vec<RaySet>,
    /// Other files in the archive, and why they were left out.
    pub left_out: Vec<LeftOut>,
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
                self.delete_blobs(&id).await;
                return Err(error);
            }
        };
        let is_packed = stored.is_packed;
        let drafts = self.drafts(stored, declared, room, gone).await;
        if is_packed || drafts.is_err() {
            self.delete_blobs(&id).await;
        }
        let (mut drafts, left_out) = drafts?;
        drafts.iter_mut().for_each(|draft| draft.ray_set.metadata = metadata.clone());
        let ids: Vec<String> = drafts.iter().map(|draft| draft.ray_set.id.clone()).collect();
        // From here on the rows may be there, whatever the answer: only the sweep of garbage can tell.
        let known = rows::insert(&self.storage.records, tenant, self.quota, drafts).await;
        let known = known.inspect_err(|error| {
            tracing::error!(upload = id, %error, "the database failed while it stored an upload; its blobs stay until the garbage collection");
        })?;
        if known.is_err() {
            for id in &ids {
                self.delete_blobs(id).await;
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
    pub(super) async fn delete_blobs(&self, id: &str) {
        if let Err(error) = self.storage.blobs.delete_all(&ray_set_folder(id)).await {
            tracing::warn!(ray_set = id, %error, "cannot delete the blobs of an unfinished upload; the garbage collection will");
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
        room.check(announcement.byte_count.unwrap_or(1))?;
        let spool = Spool::new(self, id, announcement.byte_count);
        let mut spool = spool.inspected(ExpectedFile::of(&announcement));
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
            room.check(spool.byte_count())?;
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

    /// What a stored file turns out to be, until its client is `gone`: found while it came, or now.
    pub(super) async fn describe(
        &self,
        stored: &mut Stored,
        declared: &FileDeclaration,
        gone: CancellationToken,
    ) -> Result<Described, Error> {
        if let Some(inspecting) = stored.inspecting.take()
            && let Some(described) = inspecting.described().await
        {
            self.metrics.inspected(true);
            return described;
        }
        let input = Input {
            name: stored.name.clone(),
            sha256: stored.sha256.clone(),
            bytes: Arc::new(self.read(stored)),
            declared: declared.resolve().map_err(in_query)?,
            notices: Vec::new(),
        };
        let described = self.inspections.inspect(input, self.limits, gone).await?;
        self.metrics.inspected(false);
        Ok(described?)
    }

    /// The bytes of a stored file.
    pub(super) fn read(&self, stored: &Stored) -> Parts {
        Parts::new(self.storage.blobs.clone(), stored.parts.clone(), Handle::current())
    }
}
