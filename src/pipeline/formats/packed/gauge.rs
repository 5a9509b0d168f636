//! What all layers of one unpacking share: the packed bytes, how many came out, and the first thing that went wrong. Layers
//! are made of foreign decoders that hand on nothing but `io::Error`; why reading stopped is therefore kept here.

use crate::error::Error;
use crate::formats::record::Bytes;
use crate::vocabulary::limits::Limits;
use std::cell::{Cell, RefCell};
use std::io;
use std::io::{BufRead, Read};

/// Packed bytes read at once.
pub const BLOCK_BYTES: usize = 256 << 10;
/// Longest name shown, characters.
pub const MAX_NAME_CHARS: usize = 255;
/// Buffer between two packings, bytes.
pub const LAYER_BYTES: usize = 64 << 10;
/// Bytes that may come out of any file, however small it is: what repeats itself by nature is no attack.
const RATIO_FLOOR_BYTES: u64 = 16 << 20;
/// What to do about a broken file.
pub const AGAIN: &str = "Fetch the packed file again; the copy is not whole.";
/// What to do about a file that grows too much.
const APART: &str = "Unpack it and send the ray files one by one.";

/// One packed file as it is being unpacked.
pub struct Gauge<'a> {
    /// The packed bytes.
    pub bytes: &'a dyn Bytes,
    max_expanded_bytes: u64,
    max_expansion_ratio: u64,
    /// Offset of the next packed byte.
    at: Cell<u64>,
    expanded: Cell<u64>,
    fault: RefCell<Option<Error>>,
}

impl<'a> Gauge<'a> {
    /// Nothing read yet.
    pub fn new(bytes: &'a dyn Bytes, limits: &Limits) -> Gauge<'a> {
        Gauge {
            bytes,
            max_expanded_bytes: limits.max_expanded_bytes,
            max_expansion_ratio: limits.max_expansion_ratio,
            at: Cell::new(0),
            expanded: Cell::new(0),
            fault: RefCell::new(None),
        }
    }

    /// Remembers why reading stops; what decoders are to hand on.
    pub fn stop(&self, error: Error) -> io::Error {
        let stopped = io::Error::other(error.to_string());
        self.fault.replace(Some(error));
        stopped
    }

    /// Why reading `name` stopped: what was remembered, or what the decoder says.
    pub fn error(&self, name: &str, said: &io::Error) -> Error {
        if let Some(error) = self.fault.take() {
            return error;
        }
        let error = if said.kind() == io::ErrorKind::UnexpectedEof {
            Error::malformed("container.truncated", format!("{name:?} ends in the middle of its packed data."), AGAIN)
        } else {
            Error::malformed("container.damaged", format!("The packed data of {name:?} is damaged: {said}."), AGAIN)
        };
        error.at_byte(self.at.get())
    }

    /// `count` more bytes came out of a decoder.
    pub fn expand(&self, count: usize) -> io::Result<()> {
        let expanded = self.expanded.get().saturating_add(count as u64);
        self.expanded.set(expanded);
        let error = if expanded > self.max_expanded_bytes {
            let found = format!("It unpacks to more than {} bytes.", self.max_expanded_bytes);
            Error::refused("container.too_large", found, APART)
        } else if expanded > self.bytes.len().saturating_mul(self.max_expansion_ratio).max(RATIO_FLOOR_BYTES) {
            let found = format!("It unpacks to more than {} times its size.", self.max_expansion_ratio);
            Error::refused("container.ratio", found, APART)
        } else {
            return Ok(());
        };
        Err(self.stop(error.at_byte(self.at.get())))
    }
}

/// The packed bytes from one offset to another, in order.
pub struct Tape<'a> {
    gauge: &'a Gauge<'a>,
    /// Offset of the next block.
    next: u64,
    end: u64,
    block: Vec<u8>,
    used: usize,
}

impl<'a> Tape<'a> {
    /// Bytes `from..to`, which lie within the file.
    pub fn new(gauge: &'a Gauge<'a>, from: u64, to: u64) -> Tape<'a> {
        gauge.at.set(from);
        Tape { gauge, next: from, end: to, block: Vec::new(), used: 0 }
    }
}

impl BufRead for Tape<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.used == self.block.len() && self.next < self.end {
            let count = usize::try_from(self.end - self.next).unwrap_or(usize::MAX).min(BLOCK_BYTES);
            self.block.resize(count, 0);
            let read = self.gauge.bytes.read_at(self.next, &mut self.block);
            read.map_err(|error| self.gauge.stop(Error::Unreadable(error)))?;
            self.next += count as u64;
            self.used = 0;
        }
        Ok(self.block.get(self.used..).unwrap_or_default())
    }

    fn consume(&mut self, count: usize) {
        self.used = self.used.saturating_add(count).min(self.block.len());
        self.gauge.at.set(self.next - (self.block.len() - self.used) as u64);
    }
}

impl Read for Tape<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(into)?;
        self.consume(count);
        Ok(count)
    }
}

/// A name as people may see it: no control characters, no way out of a folder, not endless.
pub fn shown(name: &str) -> String {
    let plain: String = name.replace('\\', "/").chars().filter(|c| !c.is_control()).collect();
    let steps: Vec<&str> = plain.split('/').filter(|step| !matches!(*step, "" | "." | "..")).collect();
    let shown: String = steps.join("/").chars().take(MAX_NAME_CHARS).collect();
    if shown.is_empty() { "rays".to_owned() } else { shown }
}
