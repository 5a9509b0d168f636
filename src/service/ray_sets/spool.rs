//! Cuts a file that streams by into parts, judges its beginning, and stores it part by part. While one part is hashed and
//! stored, the next is filled.

use super::buffers::Buffer;
use super::error::Error;
use super::extent::{Digests, Extent};
use super::inspecting::ExpectedFile;
use super::inspecting::Inspecting;
use super::intake::Intake;
use crate::storage::blobs::Blobs;
use crate::storage::keys::ray_set_folder;
use crate::storage::parts::Part;
use crate::{crash, storage};
use bytes::Bytes;
use std::mem;
use tokio::task::JoinHandle;
/// How much of a file is judged as soon as it is there, bytes.
pub const PREFIX_BYTES: usize = 64 << 10;

/// The part being filled, and what is known of those before it.
pub struct Spool<'a> {
    intake: &'a Intake,
    id: &'a str,
    announced: Option<u64>,
    /// Part of the keys of its blobs, which tells them from blobs of another request for the same file; empty where there is no
    /// other.
    mark: String,
    /// Number of the part being filled.
    number: usize,
    buffer: Buffer,
    /// How many of its bytes are in the digest of `stored` already: those of a short part that is stored again.
    digested: usize,
    /// Bytes of the file that have come.
    came: u64,
    /// The full part before, on its way to the store.
    underway: Option<Underway>,
    parts: Vec<Part>,
    /// What is stored: all parts before those on their way.
    stored: Extent,
    judged: bool,
    is_packed: bool,
    /// What an inspection needs that begins before the file is there, until it does.
    expected: Option<ExpectedFile>,
    inspecting: Option<Inspecting>,
}

/// A file whose bytes are stored, but not its rows.
pub struct Stored {
    /// Identifier of the ray set that is made of the file; also the folder of its blobs.
    pub id: String,
    /// Name of the file.
    pub name: String,
    /// SHA-256 of the file, hex.
    pub sha256: String,
    /// Whether the file is an archive.
    pub is_packed: bool,
    /// Length of the file, bytes.
    pub byte_count: u64,
    /// Parts of the file, in order.
    pub parts: Vec<Part>,
    /// The inspection that began while the file arrived.
    pub inspecting: Option<Inspecting>,
}

/// A part that is being hashed and stored.
struct Underway {
    part: Part,
    done: JoinHandle<Result<Extent, storage::Error>>,
}

impl<'a> Spool<'a> {
    /// Nothing stored yet; `announced` is the file's length, where known.
    pub fn new(intake: &'a Intake, id: &'a str, announced: Option<u64>) -> Spool<'a> {
        Spool {
            intake,
            id,
            announced,
            mark: String::new(),
            number: 0,
            buffer: intake.buffers.take(),
            digested: 0,
            came: 0,
            underway: None,
            parts: Vec::new(),
            stored: Extent::of_one_request(),
            judged: false,
            is_packed: false,
            expected: None,
            inspecting: None,
        }
    }

    /// Goes on after `came`, of which the last bytes are `continued`: they are stored again with those that follow, as part
    /// `number`. `session` is a name that no other request has.
    pub fn resumed(mut self, session: &str, came: Extent, number: usize, continued: &[u8]) -> Spool<'a> {
        let judged = came.byte_count >= PREFIX_BYTES as u64;
        self.buffer.fill(continued);
        let (mark, digested) = (format!(".{session}"), continued.len());
        Spool { mark, number, digested, came: came.byte_count, stored: came, judged, ..self }
    }

    /// Inspects the file while it comes, where that is possible.
    pub fn inspected(self, expected: ExpectedFile) -> Spool<'a> {
        Spool { expected: Some(expected), ..self }
    }

    /// Judges nothing: a piece of a file begins anywhere in it.
    pub fn unjudged(self) -> Spool<'a> {
        Spool { judged: true, ..self }
    }

    /// How much has come, bytes.
    pub fn byte_count(&self) -> u64 {
        self.came
    }

    /// The parts stored since this was last asked, and how much of the file is stored with them.
    pub fn stored(&mut self) -> (Vec<Part>, Extent) {
        (mem::take(&mut self.parts), self.stored.clone())
    }

    /// Whether there are such parts.
    pub fn has_stored(&self) -> bool {
        !self.parts.is_empty()
    }

    /// Whether a part is on its way to the store.
    pub fn is_underway(&self) -> bool {
        self.underway.is_some()
    }

    /// Takes the next bytes.
    ///
    /// # Errors
    /// [`Error::TooLarge`], [`Error::Unfit`], [`Error::LowSpace`], [`Error::Storage`].
    pub async fn push(&mut self, chunk: &[u8]) -> Result<(), Error> {
        if self.came + chunk.len() as u64 > self.intake.max_bytes {
            return Err(Error::TooLarge(self.intake.max_bytes));
        }
        let mut rest = chunk;
        while !rest.is_empty() {
            let later = self.buffer.fill(rest);
            self.came += (rest.len() - later.len()) as u64;
            rest = later;
            if self.buffer.len() >= PREFIX_BYTES {
                self.judge()?;
            }
            if self.buffer.is_full() {
                self.store().await?;
            }
        }
        Ok(())
    }

    /// Stores what is left of the last part, and waits until all parts are stored.
    ///
    /// # Errors
    /// [`Error::LowSpace`], [`Error::Storage`].
    pub async fn store_rest(&mut self) -> Result<(), Error> {
        if self.buffer.len() > self.digested {
            self.store().await?;
        }
        self.settle().await
    }

    /// Waits until no part is on its way to the store. To be called before what is stored is deleted, too: a part on its way
    /// would come after. May be given up and called again.
    ///
    /// # Errors
    /// [`Error::Storage`]: that part is not stored.
    pub async fn settle(&mut self) -> Result<(), Error> {
        let Some(underway) = &mut self.underway else { return Ok(()) };
        let done = (&mut underway.done).await;
        let Some(Underway { part, .. }) = self.underway.take() else { return Ok(()) };
        self.stored = done.map_err(|error| storage::Error::Blobs(Box::new(error)))??;
        crash::point("upload.part_stored");
        if let Some(inspecting) = &self.inspecting {
            inspecting.is_stored(part.clone());
        }
        self.parts.push(part);
        Ok(())
    }

    /// Stores the last part of a whole file. When it fails, no part is on its way any more.
    ///
    /// # Errors
    /// As [`Spool::push`]; [`Error::Truncated`], [`Error::Empty`].
    pub async fn end(mut self, name: String) -> Result<Stored, Error> {
        self.settle().await?;
        let byte_count = self.came;
        if self.announced.is_some_and(|announced| announced != byte_count) {
            return Err(Error::Truncated(format!("{byte_count} bytes arrived")));
        }
        if byte_count == 0 {
            return Err(Error::Empty);
        }
        self.announced = Some(byte_count);
        self.judge()?;
        self.store_rest().await?;
        let sha256 = self.stored.sha256();
        let Spool { id, parts, is_packed, inspecting, .. } = self;
        Ok(Stored { id: id.to_owned(), name, sha256, is_packed, byte_count, parts, inspecting })
    }

    /// Looks at the beginning, once: a wrong file is refused before its gigabytes are sent.
    fn judge(&mut self) -> Result<(), Error> {
        if !self.judged {
            let prefix = self.buffer.get(..PREFIX_BYTES).unwrap_or(&self.buffer);
            self.is_packed = self.intake.judge(prefix, self.announced)?;
            self.judged = true;
        }
        Ok(())
    }

    /// Begins to store the part at hand, which is then filled no more. Parts are stored one after the other: the digest of
    /// each goes on from the one before.
    async fn store(&mut self) -> Result<(), Error> {
        self.settle().await?;
        let byte_count = self.buffer.len() as u64;
        if !self.intake.space.has_room_for(byte_count) {
            return Err(Error::LowSpace);
        }
        let ahead = self.intake.buffers.ahead();
        let waits = ahead.is_none();
        let bytes = mem::replace(&mut self.buffer, self.intake.buffers.take()).into_bytes(ahead);
        self.inspect(&bytes);
        let new = bytes.slice(mem::take(&mut self.digested)..);
        let blob = format!("{}/{:06}{}", ray_set_folder(self.id), self.number, self.mark);
        let Intake { storage, digests, .. } = self.intake;
        let stored = keep(storage.blobs.clone(), digests.clone(), blob.clone(), bytes, new, self.stored.clone());
        self.underway = Some(Underway { part: Part { blob, byte_count }, done: tokio::spawn(stored) });
        self.number += 1;
        if waits { self.settle().await } else { Ok(()) }
    }

    /// Hands a part to the inspection of the arriving file; the first part starts the inspection if more parts follow.
    fn inspect(&mut self, bytes: &Bytes) {
        if let (Some(expected), false, Some(announced)) = (self.expected.take(), self.is_packed, self.announced)
            && announced > bytes.len() as u64
        {
            let Intake { inspections, storage, limits, .. } = self.intake;
            self.inspecting = inspections.inspect_as_it_comes(expected, storage.blobs.clone(), announced, *limits);
        }
        if let Some(inspecting) = &self.inspecting {
            inspecting.has_come(bytes.clone());
        }
    }
}

/// Stores `bytes` as `blob`, durably, and computes meanwhile how far the file has come with the `new` ones among them.
async fn keep(
    blobs: Blobs,
    digests: Digests,
    blob: String,
    bytes: Bytes,
    new: Bytes,
    before: Extent,
) -> Result<Extent, storage::Error> {
    let (put, extent) = tokio::join!(blobs.put(&blob, bytes), digests.extend(before, new));
    put?;
    extent.map_err(|error| storage::Error::Blobs(Box::new(error)))
}

impl Intake {
    /// Whether a file that begins so is a packed one. What is in a packed one is judged when it is unpacked.
    ///
    /// # Errors
    /// [`Error::Unfit`]: it is no ray file, or one that is refused.
    pub fn judge(&self, prefix: &[u8], byte_count: Option<u64>) -> Result<bool, Error> {
        if pipeline::packing(prefix).is_some() {
            return Ok(true);
        }
        pipeline::peek(prefix, byte_count, &self.limits)?;
        Ok(false)
    }
}
