//! Takes in a ray file, or several in a packed one: counts, hashes, judges and stores it while it streams by. Memory does not
//! grow with the file: what is not yet a stored part is at most one part. A packed file is stored as it comes and unpacked
//! when all of it is there: its digest covers what was sent.

use super::access::quota::{Exceeded, Quota, Room};
use super::jobs::worker::hex;
use super::pace::{Pace, Slowest, TooSlow};
use super::storage::parts::{Part, Parts};
use super::storage::ray_sets::{self, Packed, RaySet};
use super::storage::{self, Storage, new_id, ray_set_folder};
use crate::pipeline::{self, Declared, Input, Limits};
use bytes::{Bytes, BytesMut};
use futures::Stream;
use serde::Serialize;
use sha2::{Digest, Sha256};
use std::fmt::Display;
use std::pin::pin;
use std::sync::Arc;
use tokio::runtime::Handle;
use tokio::task::spawn_blocking;

/// Length of every part but the last, bytes.
pub const PART_BYTES: usize = 8 << 20;
/// How much of a file is judged as soon as it is there, bytes.
const PREFIX_BYTES: usize = 64 << 10;

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
    /// A store did not answer.
    #[error(transparent)]
    Storage(#[from] storage::Error),
}

/// A file in a packed one that is no ray set, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, utoipa::ToSchema)]
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

/// A ray set and its stored parts, not known yet.
pub(super) type Draft = (RaySet, Vec<Part>);

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
    /// What a ray file may ask of this machine.
    pub limits: Limits,
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
        let room = self.quota.room(&self.storage.records, tenant).await?;
        let stored = self.receive(&id, announcement, room, body).await;
        let is_packed = stored.as_ref().is_ok_and(|stored| stored.is_packed);
        let drafts = match stored {
            Ok(packed) if is_packed => self.unpack(packed).await,
            Ok(stored) => self.draft(stored, None).await.map(|draft| (vec![draft], Vec::new())),
            Err(error) => Err(error),
        };
        if is_packed || drafts.is_err() {
            self.forget(&id).await;
        }
        let (drafts, left_out) = drafts?;
        // From here on the rows may be there, whatever the answer: only the sweep of the next start can tell.
        let ids: Vec<String> = drafts.iter().map(|(ray_set, _)| ray_set.id.clone()).collect();
        let known = ray_sets::insert(&self.storage.records, tenant, self.quota, drafts).await;
        let known = known.inspect_err(|error| {
            tracing::error!(upload = id, %error, "an upload may or may not be known; its blobs stay until the next start");
        })?;
        if known.is_err() {
            for id in &ids {
                self.forget(id).await;
            }
        }
        Ok(Taken { ray_sets: known?, left_out })
    }

    /// Deletes the blobs of a ray set that no row names. Should this fail too, the next start sweeps them.
    pub(super) async fn forget(&self, id: &str) {
        if let Err(error) = self.storage.blobs.delete_all(&ray_set_folder(id)).await {
            tracing::warn!(ray_set = id, %error, "blobs of an unfinished upload stay until the next start");
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
        let mut body = pin!(body);
        let mut spool = Spool::new(self, id, announcement.byte_count);
        let mut pace = Pace::new(self.slowest);
        while let Some(chunk) = pace.next(&mut body).await? {
            spool.push(&chunk.map_err(|error| Error::Truncated(error.to_string()))?).await?;
            room.admit(spool.byte_count)?;
        }
        let stored = spool.end(announcement.name).await?;
        match announcement.sha256.into_iter().find(|announced| *announced != stored.sha256) {
            Some(announced) => Err(Error::Digest { announced, found: stored.sha256 }),
            None => Ok(stored),
        }
    }

    /// The ray set that a stored file is to be, with what the whole file says of itself.
    pub(super) async fn draft(&self, stored: Stored, packed: Option<Packed>) -> Result<Draft, Error> {
        let input = Input {
            name: stored.name.clone(),
            sha256: stored.sha256.clone(),
            bytes: Arc::new(self.read(&stored)),
            declared: Declared::default(),
        };
        let header = self.header(input).await?;
        let Stored { id, name, sha256, byte_count, parts, .. } = stored;
        Ok((RaySet { id, name, byte_count, sha256, header, packed, created_ms: 0 }, parts))
    }

    /// The bytes of a stored file.
    pub(super) fn read(&self, stored: &Stored) -> Parts {
        Parts::new(self.storage.blobs.clone(), stored.parts.clone(), Handle::current())
    }

    /// What the whole file says of itself, as JSON.
    async fn header(&self, input: Input) -> Result<String, Error> {
        let limits = self.limits;
        let header = spawn_blocking(move || {
            let header = pipeline::header(&input, &limits)?;
            serde_json::to_string(&header).map_err(|error| pipeline::Error::Unreadable(error.into()))
        });
        Ok(header.await.map_err(|error| pipeline::Error::Unreadable(std::io::Error::other(error)))??)
    }
}

/// The part being filled, and what is known of those before it.
pub(super) struct Spool<'a> {
    intake: &'a Intake,
    id: &'a str,
    announced: Option<u64>,
    buffer: BytesMut,
    parts: Vec<Part>,
    byte_count: u64,
    sha256: Sha256,
    judged: bool,
    is_packed: bool,
}

impl<'a> Spool<'a> {
    /// Nothing stored yet; `announced` is the file's length, where known.
    pub fn new(intake: &'a Intake, id: &'a str, announced: Option<u64>) -> Spool<'a> {
        Spool {
            intake,
            id,
            announced,
            buffer: BytesMut::new(),
            parts: Vec::new(),
            byte_count: 0,
            sha256: Sha256::new(),
            judged: false,
            is_packed: false,
        }
    }

    /// Takes the next bytes.
    ///
    /// # Errors
    /// [`Error::TooLarge`], [`Error::Unfit`], [`Error::Storage`].
    pub async fn push(&mut self, chunk: &[u8]) -> Result<(), Error> {
        self.byte_count += chunk.len() as u64;
        if self.byte_count > self.intake.max_bytes {
            return Err(Error::TooLarge(self.intake.max_bytes));
        }
        self.sha256.update(chunk);
        let mut rest = chunk;
        while !rest.is_empty() {
            let (now, later) = rest.split_at(rest.len().min(PART_BYTES - self.buffer.len()));
            self.buffer.extend_from_slice(now);
            rest = later;
            if self.buffer.len() >= PREFIX_BYTES {
                self.judge()?;
            }
            if self.buffer.len() == PART_BYTES {
                self.store().await?;
            }
        }
        Ok(())
    }

    /// Stores the last part.
    ///
    /// # Errors
    /// As [`Spool::push`]; [`Error::Truncated`], [`Error::Empty`].
    pub async fn end(mut self, name: String) -> Result<Stored, Error> {
        if self.announced.is_some_and(|announced| announced != self.byte_count) {
            return Err(Error::Truncated(format!("{} bytes came", self.byte_count)));
        }
        if self.byte_count == 0 {
            return Err(Error::Empty);
        }
        self.announced = Some(self.byte_count);
        self.judge()?;
        if !self.buffer.is_empty() {
            self.store().await?;
        }
        let sha256 = hex(&self.sha256.finalize());
        let Spool { id, byte_count, parts, is_packed, .. } = self;
        Ok(Stored { id: id.to_owned(), name, sha256, is_packed, byte_count, parts })
    }

    /// Looks at the beginning, once: a wrong file is refused before its gigabytes are sent. What is in a packed one is judged
    /// when it is unpacked.
    fn judge(&mut self) -> Result<(), Error> {
        if !self.judged {
            let prefix = self.buffer.get(..PREFIX_BYTES).unwrap_or(&self.buffer);
            self.is_packed = pipeline::packing(prefix).is_some();
            if !self.is_packed {
                pipeline::peek(prefix, self.announced, &self.intake.limits)?;
            }
            self.judged = true;
        }
        Ok(())
    }

    async fn store(&mut self) -> Result<(), Error> {
        let bytes = self.buffer.split().freeze();
        let part = Part {
            blob: format!("{}/{:06}", ray_set_folder(self.id), self.parts.len()),
            byte_count: bytes.len() as u64,
        };
        self.intake.storage.blobs.put(&part.blob, bytes).await?;
        self.parts.push(part);
        Ok(())
    }
}
