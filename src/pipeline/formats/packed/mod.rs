//! Ray files as vendors ship them: packed with gzip or zstd, or several in a zip. Everything streams, nothing that a packed
//! file says of sizes is believed, and [`Limits`] bound what comes out of it.

/// Where the packed bytes come from, what has come out so far, and why it stopped.
mod gauge;
/// Gzip (RFC 1952).
mod gzip;
/// Zstandard (RFC 8878).
mod zstd;
/// Zip (APPNOTE 6.3).
mod zip;
#[cfg(test)]
mod tests;

use super::foreign::{GLDF, gldf};
use super::own::{MODEL, model};
use super::record::Bytes;
use crate::error::Error;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::{Notice, Notices};
use gauge::{Gauge, Tape};
use gauge::{LAYER_BYTES, shown};
use std::io;
use std::io::{BufRead, BufReader, Read};

/// Packings inside packings that are undone: the file's own, and one more, as in a zip of .gz files.
const MAX_DEPTH: u32 = 2;
/// Most files that are named in a notice.
const MOST_NAMED: usize = 8;

/// Ways to pack that are undone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// One file, in one or more gzip members.
    Gzip,
    /// One file, in one or more zstd frames.
    Zstd,
    /// Any number of files.
    Zip,
}

/// How a file that starts with `start` is packed, if it is. Four bytes tell.
pub fn packing(start: &[u8]) -> Option<Packing> {
    let word = start.first_chunk().map_or(0, |word| u32::from_le_bytes(*word));
    match word {
        // A zip starts with a file, or is empty.
        0x0403_4b50 | 0x0605_4b50 => Some(Packing::Zip),
        // A frame, or one to be skipped: pzstd begins with those.
        0xfd2f_b528 | 0x184d_2a50..=0x184d_2a5f => Some(Packing::Zstd),
        _ if word & 0x00ff_ffff == 0x0008_8b1f => Some(Packing::Gzip),
        _ => None,
    }
}

/// What a packed file has under one name.
pub enum Content<'a> {
    /// A file that can be read.
    Open(Member<'a>),
    /// One that a rule of ours leaves closed: encrypted, packed in a way we do not undo or too often.
    Closed(Error),
}

/// One file in a packed one, unpacked as it is read.
pub struct Member<'a> {
    gauge: &'a Gauge<'a>,
    name: String,
    content: Box<dyn BufRead + 'a>,
}

impl<'a> Member<'a> {
    /// Its name as far as it is known, folders included; for people, never for a disk.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The next bytes; 0 only at its end, and there its checksum was right.
    ///
    /// # Errors
    /// `container.*` at the byte of the packed file: truncated or damaged, or more than the limits allow;
    /// [`Error::Unreadable`] from the medium.
    pub fn read(&mut self, into: &mut [u8]) -> Result<usize, Error> {
        self.content.read(into).map_err(|error| self.gauge.error(&self.name, &error))
    }
}

/// The notice that the packed file `name` holds something besides ray files, a name and the code that refuses it for each;
/// nothing where it does not.
pub fn left_out<'a>(name: &str, files: impl ExactSizeIterator<Item = (&'a str, &'a str)>) -> Vec<Notice> {
    let count = files.len();
    let mut notices = Notices::default();
    if count > 0 {
        let named: Vec<String> = files.take(MOST_NAMED).map(|(file, code)| format!("{file:?} ({code})")).collect();
        let more = if count > named.len() { format!(" and {} more", count - named.len()) } else { String::new() };
        let told = format!(
            "What else is in {name:?} was left out, because it is no ray file that can be read: {}{more}. If light of this \
             source is in it, the model lacks that light.",
            named.join(", ")
        );
        notices.count("container.left_out", count as u64, None, told);
    }
    notices.to_vec()
}

/// The refusal of a packed file without a ray file: of each file in it its name, the code that refuses it, and the refusal's sentence.
pub fn no_ray_file<'a>(files: impl ExactSizeIterator<Item = (&'a str, &'a str, &'a str)>) -> Error {
    let files: Vec<_> = files.collect();
    if files.iter().any(|(_, code, found)| *code == MODEL && found.contains("emitter.glb")) {
        return model();
    }
    if files.iter().any(|(_, code, _)| *code == GLDF) {
        return gldf();
    }
    let told = match files.as_slice() {
        [] => "The archive contains no ray file: it is empty.".to_owned(),
        [(name, code, found)] => format!("The archive contains no ray file, only {name:?} ({code}): {found}"),
        _ => {
            let named: Vec<String> =
                files.iter().take(MOST_NAMED).map(|(name, code, _)| format!("{name:?} ({code})")).collect();
            let more = files.len() - named.len();
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            format!("The archive contains no ray file. In it are {}{more}.", named.join(", "))
        }
    };
    Error::refused(
        "container.no_ray_file",
        told,
        "Take the ray file itself, or a gzip, zstd or zip file that contains it.",
    )
}

/// Shows every file in a packed one to `visit`, in order, but for folders and what operating systems add. `name` is what the
/// packed file is called; one that is not packed is shown as it is. What `visit` does not read is not unpacked.
///
/// # Errors
/// `container.*` for a packed file that is broken, or above the limits; what `visit` answers.
pub fn unpack<E: From<Error>>(
    bytes: &dyn Bytes,
    name: &str,
    limits: &Limits,
    mut visit: impl FnMut(&str, Content<'_>) -> Result<(), E>,
) -> Result<(), E> {
    let gauge = Gauge::new(bytes, limits);
    let mut start = [0; 4];
    if bytes.len() >= 4 {
        bytes.read_at(0, &mut start).map_err(Error::from)?;
    }
    if packing(&start) != Some(Packing::Zip) {
        let whole = Box::new(Tape::new(&gauge, 0, bytes.len()));
        let content = open(&gauge, shown(name), whole, 0)?;
        return show(shown(name), content, &mut visit);
    }
    for entry in zip::directory(&gauge, limits.max_members)? {
        if entry.clutter {
            continue;
        }
        let content = match zip::open(&gauge, &entry)? {
            Ok(content) => open(&gauge, entry.name.clone(), content, 1)?,
            Err(closed) => Content::Closed(closed),
        };
        show(entry.name, content, &mut visit)?;
    }
    Ok(())
}

fn show<E>(
    name: String,
    content: Content<'_>,
    visit: &mut impl FnMut(&str, Content<'_>) -> Result<(), E>,
) -> Result<(), E> {
    let name = if let Content::Open(member) = &content { member.name.clone() } else { name };
    visit(&name, content)
}

/// Undoes what `content` is packed with, `depth` packings having been undone before.
fn open<'a>(
    gauge: &'a Gauge<'a>,
    name: String,
    mut content: Box<dyn BufRead + 'a>,
    depth: u32,
) -> Result<Content<'a>, Error> {
    let broken = |error: io::Error| gauge.error(&name, &error);
    let mut start = Vec::new();
    content.by_ref().take(4).read_to_end(&mut start).map_err(broken)?;
    let packing = packing(&start);
    let content = Box::new(io::Cursor::new(start).chain(content));
    match packing {
        None => Ok(Content::Open(Member { gauge, name, content })),
        Some(Packing::Zip) => Ok(Content::Closed(nested(&name))),
        Some(_) if depth >= MAX_DEPTH => Ok(Content::Closed(nested(&name))),
        Some(Packing::Gzip) => {
            let gzip = gzip::Gzip::new(gauge, content);
            let name = gzip.name().unwrap_or_else(|| without_suffix(&name, &[".gz", ".gzip"]));
            open(gauge, name, Box::new(BufReader::with_capacity(LAYER_BYTES, gzip)), depth + 1)
        }
        Some(Packing::Zstd) => {
            let zstd = zstd::Zstd::new(gauge, content);
            let name = without_suffix(&name, &[".zst", ".zstd"]);
            open(gauge, name, Box::new(BufReader::with_capacity(LAYER_BYTES, zstd)), depth + 1)
        }
    }
}

fn nested(name: &str) -> Error {
    let found = format!("{name:?} is packed in a packed file, deeper than is unpacked here.");
    Error::refused("container.nested", found, "Unpack the outer file and send what is inside.")
}

fn without_suffix(name: &str, suffixes: &[&str]) -> String {
    let stem = |suffix: &&str| {
        let (stem, end) = name.split_at_checked(name.len().checked_sub(suffix.len())?)?;
        (end.eq_ignore_ascii_case(suffix) && !stem.is_empty()).then(|| stem.to_owned())
    };
    suffixes.iter().find_map(stem).unwrap_or_else(|| name.to_owned())
}
