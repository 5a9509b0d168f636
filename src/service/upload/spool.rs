//! Cuts a file that streams by into parts, judges its beginning, and stores it part by part.

use super::super::crash;
use super::super::storage::parts::Part;
use super::super::storage::ray_set_folder;
use super::buffers::Buffer;
use super::extent::Extent;
use super::{Error, Intake, Stored};
use crate::pipeline;
use std::mem;

/// Longest part, bytes: every upload at hand holds as much in memory, and eight at once are to stay below 64 MB with all they need.
/// Less would be more rows, more requests to a store, and more waiting for a disk.
pub const PART_BYTES: usize = 5 << 19;
/// How much of a file is judged as soon as it is there, bytes.
pub(super) const PREFIX_BYTES: usize = 64 << 10;

/// The part being filled, and what is known of those before it.
pub(super) struct Spool<'a> {
    intake: &'a Intake,
    id: &'a str,
    announced: Option<u64>,
    /// Tells its blobs from those of another request that adds to the same file; empty where there is no other.
    mark: String,
    /// Number of the part being filled.
    number: usize,
    buffer: Buffer,
    parts: Vec<Part>,
    came: Extent,
    stored: Extent,
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
            mark: String::new(),
            number: 0,
            buffer: intake.buffers.take(),
            parts: Vec::new(),
            came: Extent::default(),
            stored: Extent::default(),
            judged: false,
            is_packed: false,
        }
    }

    /// Goes on after `came`, of which the last bytes are `continued`: they are stored again with those that follow, as part
    /// `number`. `session` is a name that no other request has.
    pub fn resumed(mut self, session: &str, came: Extent, number: usize, continued: &[u8]) -> Spool<'a> {
        let judged = came.byte_count >= PREFIX_BYTES as u64;
        self.buffer.fill(continued);
        let (mark, stored) = (format!(".{session}"), came.clone());
        Spool { mark, number, stored, came, judged, ..self }
    }

    /// Judges nothing: a piece of a file begins anywhere in it.
    pub fn unjudged(self) -> Spool<'a> {
        Spool { judged: true, ..self }
    }

    /// How much has come, bytes.
    pub fn byte_count(&self) -> u64 {
        self.came.byte_count
    }

    /// The parts stored since this was last asked, and how much of the file is stored with them.
    pub fn stored(&mut self) -> (Vec<Part>, Extent) {
        (mem::take(&mut self.parts), self.stored.clone())
    }

    /// Whether there are such parts.
    pub fn has_stored(&self) -> bool {
        !self.parts.is_empty()
    }

    /// Takes the next bytes.
    ///
    /// # Errors
    /// [`Error::TooLarge`], [`Error::Unfit`], [`Error::LowSpace`], [`Error::Storage`].
    pub async fn push(&mut self, chunk: &[u8]) -> Result<(), Error> {
        if self.came.byte_count + chunk.len() as u64 > self.intake.max_bytes {
            return Err(Error::TooLarge(self.intake.max_bytes));
        }
        let mut rest = chunk;
        while !rest.is_empty() {
            let later = self.buffer.fill(rest);
            self.came.extend(rest.get(..rest.len() - later.len()).unwrap_or_default());
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

    /// Stores what is left of the last part.
    ///
    /// # Errors
    /// [`Error::LowSpace`], [`Error::Storage`].
    pub async fn store_rest(&mut self) -> Result<(), Error> {
        match self.came.byte_count > self.stored.byte_count {
            true => self.store().await,
            false => Ok(()),
        }
    }

    /// Stores the last part of a whole file.
    ///
    /// # Errors
    /// As [`Spool::push`]; [`Error::Truncated`], [`Error::Empty`].
    pub async fn end(mut self, name: String) -> Result<Stored, Error> {
        let byte_count = self.came.byte_count;
        if self.announced.is_some_and(|announced| announced != byte_count) {
            return Err(Error::Truncated(format!("{byte_count} bytes came")));
        }
        if byte_count == 0 {
            return Err(Error::Empty);
        }
        self.announced = Some(byte_count);
        self.judge()?;
        self.store_rest().await?;
        let sha256 = self.came.sha256();
        let Spool { id, parts, is_packed, .. } = self;
        Ok(Stored { id: id.to_owned(), name, sha256, is_packed, byte_count, parts })
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

    async fn store(&mut self) -> Result<(), Error> {
        let byte_count = self.buffer.len() as u64;
        if !self.intake.space.has_room_for(byte_count) {
            return Err(Error::LowSpace);
        }
        let blob = format!("{}/{:06}{}", ray_set_folder(self.id), self.number, self.mark);
        let bytes = self.buffer.lend();
        let put = self.intake.storage.blobs.put(&blob, bytes.clone()).await;
        self.buffer.take_back(bytes);
        put?;
        crash::point("upload.part_stored");
        self.number += 1;
        self.parts.push(Part { blob, byte_count });
        self.stored = self.came.clone();
        Ok(())
    }
}

impl Intake {
    /// Whether a file that begins so is a packed one. What is in a packed one is judged when it is unpacked.
    ///
    /// # Errors
    /// [`Error::Unfit`]: it is no ray file, or one that is refused.
    pub(super) fn judge(&self, prefix: &[u8], byte_count: Option<u64>) -> Result<bool, Error> {
        if pipeline::packing(prefix).is_some() {
            return Ok(true);
        }
        pipeline::peek(prefix, byte_count, &self.limits)?;
        Ok(false)
    }
}
