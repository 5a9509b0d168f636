//! Takes in a ray file: counts, hashes, judges and stores it while it streams by. Memory does not grow with the file: what
//! is not yet a stored part is at most one part.

use super::jobs::worker::hex;
use super::pace::{Pace, Slowest, TooSlow};
use super::storage::parts::{Part, Parts};
use super::storage::ray_sets::{self, RaySet};
use super::storage::{self, Storage, new_id, ray_set_folder};
use crate::pipeline::{self, Declared, Input, Limits};
use bytes::{Bytes, BytesMut};
use futures::Stream;
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
    /// A store did not answer.
    #[error(transparent)]
    Storage(#[from] storage::Error),
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
    /// What a ray file may ask of this machine.
    pub limits: Limits,
}

impl Intake {
    /// Takes in one file, all of it or nothing.
    ///
    /// # Errors
    /// [`Error`]; nothing is left behind, unless the database failed as the ray set was made known: it may then be known.
    pub async fn take<E: Display>(
        &self,
        announcement: Announcement,
        body: impl Stream<Item = Result<Bytes, E>>,
    ) -> Result<RaySet, Error> {
        let id = new_id();
        let (ray_set, parts) = match self.receive(&id, announcement, body).await {
            Ok(received) => received,
            Err(error) => {
                self.forget(&id).await;
                return Err(error);
            }
        };
        // From here on the row may be there, whatever the answer: only the sweep of the next start can tell.
        let known = ray_sets::insert(&self.storage.records, ray_set, &parts).await;
        Ok(known.inspect_err(|error| {
            tracing::error!(ray_set = id, %error, "an upload may or may not be known; its blobs stay until the next start");
        })?)
    }

    /// Deletes the blobs of a ray set that no row names. Should this fail too, the next start sweeps them.
    async fn forget(&self, id: &str) {
        if let Err(error) = self.storage.blobs.delete_all(&ray_set_folder(id)).await {
            tracing::warn!(ray_set = id, %error, "blobs of an unfinished upload stay until the next start");
        }
    }

    /// Stores the parts of a file; nothing of it is known yet.
    async fn receive<E: Display>(
        &self,
        id: &str,
        announcement: Announcement,
        body: impl Stream<Item = Result<Bytes, E>>,
    ) -> Result<(RaySet, Vec<Part>), Error> {
        let mut body = pin!(body);
        let mut spool = Spool::new(self, id, announcement.byte_count);
        let mut pace = Pace::new(self.slowest);
        while let Some(chunk) = pace.next(&mut body).await? {
            spool.push(&chunk.map_err(|error| Error::Truncated(error.to_string()))?).await?;
        }
        let (parts, byte_count, sha256) = spool.end().await?;
        if let Some(announced) = announcement.sha256.into_iter().find(|announced| *announced != sha256) {
            return Err(Error::Digest { announced, found: sha256 });
        }
        let bytes = Parts::new(self.storage.blobs.clone(), parts.clone(), Handle::current());
        let input = Input {
            name: announcement.name.clone(),
            sha256: sha256.clone(),
            bytes: Arc::new(bytes),
            declared: Declared::default(),
        };
        let header = self.header(input).await?;
        let ray_set = RaySet { id: id.to_owned(), name: announcement.name, byte_count, sha256, header, created_ms: 0 };
        Ok((ray_set, parts))
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
struct Spool<'a> {
    intake: &'a Intake,
    id: &'a str,
    announced: Option<u64>,
    buffer: BytesMut,
    parts: Vec<Part>,
    byte_count: u64,
    sha256: Sha256,
    judged: bool,
}

impl<'a> Spool<'a> {
    fn new(intake: &'a Intake, id: &'a str, announced: Option<u64>) -> Spool<'a> {
        let buffer = BytesMut::new();
        Spool { intake, id, announced, buffer, parts: Vec::new(), byte_count: 0, sha256: Sha256::new(), judged: false }
    }

    async fn push(&mut self, chunk: &[u8]) -> Result<(), Error> {
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

    async fn end(mut self) -> Result<(Vec<Part>, u64, String), Error> {
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
        Ok((self.parts, self.byte_count, hex(&self.sha256.finalize())))
    }

    /// Looks at the beginning, once: a wrong file is refused before its gigabytes are sent.
    fn judge(&mut self) -> Result<(), Error> {
        if !self.judged {
            let prefix = self.buffer.get(..PREFIX_BYTES).unwrap_or(&self.buffer);
            pipeline::peek(prefix, self.announced, &self.intake.limits)?;
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
