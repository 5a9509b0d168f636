//! Zip (PKWARE APPNOTE 6.3, sections of which are in brackets). Read here and not with a library, because what a directory may
//! ask for must be bounded: entries are counted before they are kept, and no byte of the file belongs to two of them.

use super::gauge::{AGAIN, Gauge, LAYER_BYTES, Tape, shown};
use crate::error::Error;
use crate::formats::bytes::{Cursor, u16_in, u32_in, u64_in};
use crate::formats::record::Bytes;
use flate2::Crc;
use flate2::bufread::DeflateDecoder;
use std::io;
use std::io::{BufRead, BufReader, Read};

/// End of central directory [4.3.16]: its length without the comment, and its longest.
const END_BYTES: u64 = 22;
const LONGEST_END_BYTES: u64 = END_BYTES + 65_535;
/// Zip64 end of central directory locator [4.3.15] and record [4.3.14].
const LOCATOR_BYTES: u64 = 20;
const END64_BYTES: u64 = 56;
/// A file in the central directory [4.3.12] and before its data [4.3.7], without name and extra fields.
const ENTRY_BYTES: u64 = 46;
const LOCAL_BYTES: u64 = 30;

/// One file as the central directory has it.
pub struct Entry {
    /// Its path, for people.
    pub name: String,
    /// A folder, or what operating systems put beside a file.
    pub clutter: bool,
    encrypted: bool,
    method: u16,
    crc32: u32,
    packed_bytes: u64,
    byte_count: u64,
    /// Where its local header is.
    offset: u64,
}

fn is_clutter(name: &str) -> bool {
    let last = name.rsplit(['/', '\\']).next().unwrap_or_default();
    last.is_empty() || last == ".DS_Store" || name.starts_with("__MACOSX/")
}

/// Where the central directory is and how many entries it announces.
struct Directory {
    entries: u64,
    byte_count: u64,
    offset: u64,
}

/// Every entry, in the order of the directory.
///
/// # Errors
/// `container.truncated`, `container.malformed`, `container.members`, `container.overlap`; [`Error::Unreadable`].
pub fn directory(gauge: &Gauge<'_>, max_members: usize) -> Result<Vec<Entry>, Error> {
    let directory = find_directory(gauge.bytes)?;
    let end = directory.offset.saturating_add(directory.byte_count);
    let mut cursor = Cursor::new(gauge.bytes, directory.offset);
    let mut entries = Vec::new();
    while cursor.at() < end {
        if entries.len() >= max_members {
            let found = format!("The zip holds more than {max_members} files.");
            return Err(Error::refused("container.members", found, "Send the ray files alone."));
        }
        entries.push(next_entry(&mut cursor)?);
    }
    // The count has 16 bits in an ordinary zip, whatever it counts.
    if entries.len() as u64 & 0xffff != directory.entries & 0xffff {
        let found = format!("The directory announces {} files and lists {}.", directory.entries, entries.len());
        return Err(malformed(found, directory.offset));
    }
    apart(&entries, directory.offset)?;
    Ok(entries)
}

fn malformed(found: impl Into<String>, offset: u64) -> Error {
    Error::malformed("container.malformed", found, AGAIN).at_byte(offset)
}

fn find_directory(bytes: &dyn Bytes) -> Result<Directory, Error> {
    let tail_offset = bytes.len().saturating_sub(LONGEST_END_BYTES);
    let tail = Cursor::new(bytes, tail_offset).block("the zip", bytes.len() - tail_offset)?;
    let is_end = |at: &usize| {
        let rest = tail.get(*at..).unwrap_or_default();
        let whole = END_BYTES as usize + usize::from(u16_in(rest, 20)) <= rest.len();
        rest.starts_with(b"PK\x05\x06") && whole
    };
    let at = (0..tail.len()).rev().find(is_end).ok_or_else(|| {
        let found = "The zip has no end: the list of its files, which comes last, is missing.";
        Error::malformed("container.truncated", found, AGAIN).at_byte(bytes.len())
    })?;
    let (end, offset) = (tail.get(at..).unwrap_or_default(), tail_offset + at as u64);
    let narrow = Directory {
        entries: u16_in(end, 10).into(),
        byte_count: u32_in(end, 12).into(),
        offset: u32_in(end, 16).into(),
    };
    let wide = narrow.entries == 0xffff || narrow.byte_count == 0xffff_ffff || narrow.offset == 0xffff_ffff;
    let locator = if wide { find_locator(bytes, offset)? } else { None };
    let directory = locator.unwrap_or(narrow);
    if directory.offset.checked_add(directory.byte_count).is_none_or(|end| end > offset) {
        return Err(malformed("The directory of the zip does not lie before its end.", offset));
    }
    Ok(directory)
}

/// The 64-bit directory that a zip with an end record at `end` has, if it has one.
fn find_locator(bytes: &dyn Bytes, end: u64) -> Result<Option<Directory>, Error> {
    let Some(at) = end.checked_sub(LOCATOR_BYTES) else { return Ok(None) };
    let locator = Cursor::new(bytes, at).block("the zip64 locator", LOCATOR_BYTES)?;
    if !locator.starts_with(b"PK\x06\x07") {
        return Ok(None);
    }
    let offset = u64_in(&locator, 8);
    let record = Cursor::new(bytes, offset).block("the zip64 end record", END64_BYTES)?;
    if !record.starts_with(b"PK\x06\x06") {
        return Err(malformed("The zip64 end record is not where its locator says.", offset));
    }
    Ok(Some(Directory { entries: u64_in(&record, 32), byte_count: u64_in(&record, 40), offset: u64_in(&record, 48) }))
}

fn next_entry(cursor: &mut Cursor<'_>) -> Result<Entry, Error> {
    let at = cursor.at();
    let fixed = cursor.block("the directory of the zip", ENTRY_BYTES)?;
    if !fixed.starts_with(b"PK\x01\x02") {
        return Err(malformed("The directory of the zip is broken: an entry was expected.", at));
    }
    let name = cursor.block("a name in the zip", u16_in(&fixed, 28).into())?;
    let extra = cursor.block("the directory of the zip", u16_in(&fixed, 30).into())?;
    cursor.block("the directory of the zip", u16_in(&fixed, 32).into())?;
    // [4.5.3]: what does not fit its 32 bits stands in the extra field 1, in this order.
    let mut wide = wide_values(&extra).into_iter();
    let mut whole = |narrow: u32| if narrow == u32::MAX { wide.next().unwrap_or(narrow.into()) } else { narrow.into() };
    let byte_count = whole(u32_in(&fixed, 24));
    let packed_bytes = whole(u32_in(&fixed, 20));
    let offset = whole(u32_in(&fixed, 42));
    let name = String::from_utf8_lossy(&name);
    Ok(Entry {
        name: shown(&name),
        clutter: is_clutter(&name),
        encrypted: u16_in(&fixed, 8) & 1 != 0,
        method: u16_in(&fixed, 10),
        crc32: u32_in(&fixed, 16),
        packed_bytes,
        byte_count,
        offset,
    })
}

/// The numbers of the extra field 1.
fn wide_values(extra: &[u8]) -> Vec<u64> {
    let mut rest = extra;
    while rest.len() >= 4 {
        let (id, length) = (u16_in(rest, 0), usize::from(u16_in(rest, 2)));
        let field = rest.get(4..).unwrap_or_default();
        if id == 1 {
            let numbers = field.get(..length).unwrap_or(field);
            return numbers.chunks_exact(8).map(|number| u64_in(number, 0)).collect();
        }
        rest = field.get(length..).unwrap_or_default();
    }
    Vec::new()
}

/// Refuses a zip that gives the same bytes out twice: small bombs are made that way.
fn apart(entries: &[Entry], directory: u64) -> Result<(), Error> {
    let mut ranges: Vec<(u64, u64)> = entries
        .iter()
        .map(|entry| (entry.offset, entry.offset.saturating_add(LOCAL_BYTES).saturating_add(entry.packed_bytes)))
        .collect();
    ranges.push((directory, u64::MAX));
    ranges.sort_unstable();
    match ranges.windows(2).find(|pair| pair[0].1 > pair[1].0) {
        Some(pair) => {
            let found = "Two files in the zip share the same bytes, or share them with its directory.";
            Err(Error::malformed("container.overlap", found, AGAIN).at_byte(pair[1].0))
        }
        None => Ok(()),
    }
}

/// The content of an entry, unpacked as it is read; or why a rule of ours leaves it closed.
///
/// # Errors
/// `container.malformed` where its data cannot be where the directory says; [`Error::Unreadable`].
pub fn open<'a>(gauge: &'a Gauge<'a>, entry: &Entry) -> Result<Result<Box<dyn BufRead + 'a>, Error>, Error> {
    if entry.encrypted {
        let found = format!("{:?} is encrypted.", entry.name);
        let remedy = "Unpack it with its password and send the ray file inside.";
        return Ok(Err(Error::refused("container.encrypted", found, remedy).at_byte(entry.offset)));
    }
    let local = Cursor::new(gauge.bytes, entry.offset).block("a file in the zip", LOCAL_BYTES)?;
    if !local.starts_with(b"PK\x03\x04") {
        return Err(malformed(format!("{:?} is not where the directory of the zip says.", entry.name), entry.offset));
    }
    let from = entry.offset + LOCAL_BYTES + u64::from(u16_in(&local, 26)) + u64::from(u16_in(&local, 28));
    Cursor::new(gauge.bytes, from).fits("a file in the zip", entry.packed_bytes)?;
    let tape = Tape::new(gauge, from, from + entry.packed_bytes);
    let content: Box<dyn Read + 'a> = match entry.method {
        0 => Box::new(tape),
        8 => Box::new(DeflateDecoder::new(tape)),
        other => {
            let found = format!("{:?} is packed with {}, which is not undone here.", entry.name, method_name(other));
            let remedy = "Pack it with the ordinary method (deflate), or send it unpacked.";
            return Ok(Err(Error::refused("container.method", found, remedy).at_byte(entry.offset)));
        }
    };
    let checked = Checked { gauge, content, crc: Crc::new(), left: entry.byte_count, crc32: entry.crc32 };
    Ok(Ok(Box::new(BufReader::with_capacity(LAYER_BYTES, checked))))
}

/// Methods by name [4.4.5].
fn method_name(method: u16) -> String {
    let name = match method {
        9 => "Deflate64",
        12 => "bzip2",
        14 => "LZMA",
        93 => "Zstandard",
        95 => "xz",
        98 => "PPMd",
        99 => "AES encryption",
        other => return format!("method {other}"),
    };
    name.to_owned()
}

/// An entry's content, held to the length and the checksum in the directory.
struct Checked<'a> {
    gauge: &'a Gauge<'a>,
    content: Box<dyn Read + 'a>,
    crc: Crc,
    left: u64,
    crc32: u32,
}

impl Read for Checked<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.content.read(into)?;
        let wrong = |what: &str| Err(io::Error::new(io::ErrorKind::InvalidData, what));
        let Some(left) = self.left.checked_sub(count as u64) else {
            return wrong("it is longer than the zip announces");
        };
        self.left = left;
        self.crc.update(into.get(..count).unwrap_or_default());
        self.gauge.expand(count)?;
        if count == 0 && !into.is_empty() {
            if left > 0 {
                return wrong("it is shorter than the zip announces");
            }
            if self.crc.sum() != self.crc32 {
                return wrong("its checksum does not match");
            }
        }
        Ok(count)
    }
}
