//! ASAP distribution files (.dis) of rays (`pipeline/formats/README.md` 5).
//!
//! Five header records, then the rays, all of the same size, which the first word tells. The file names no length unit and does
//! not say whether its flux is W or lm: both stay unknown until declared.

use super::binary::{Floats, Words, float, triple};
use super::bytes::{Cursor, ascii, i32_in};
use super::proof;
use super::record::{Bytes, Facts, Format, RawRay, RaySet, SpectralData, TotalRule};
use crate::error::Error;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::Flux;
use std::ops::RangeInclusive;
use std::sync::Arc;

/// Words of a record: position, direction, flux; the larger ones are said to add path length and shape.
const WORDS: RangeInclusive<usize> = 7..=16;
/// Records of the header.
const HEADER_RECORDS: u64 = 5;
/// Of the header's fourth record: the byte where the number of rows is, negative for rays.
const ROWS_AT: usize = 24;

/// Whether a file begins as one of these.
pub fn begins(start: &[u8]) -> bool {
    start.len() >= 4 && words(i32_in(start, 0)).is_some()
}

/// Words per record of a file whose first word is `code` = 247 + 256 × (bytes of a record); `None` for any other file.
pub fn words(code: i32) -> Option<usize> {
    WORDS.into_iter().find(|words| 247 + 1024 * *words as i32 == code)
}

/// Opens a file of this format.
///
/// # Errors
/// As [`super::open`].
pub fn open(bytes: Arc<dyn Bytes>, limits: &Limits) -> Result<RaySet, Error> {
    let code = Cursor::new(bytes.as_ref(), 0).i32("the first word")?;
    let words = words(code).ok_or_else(|| layout(4 * *WORDS.start() as u64))?;
    let size = 4 * words as u64;
    let header = Header { block: Cursor::new(bytes.as_ref(), 0).block("the header", HEADER_RECORDS * size)?, words };
    let ray_count = header.ray_count(bytes.len())?;
    proof::count(ray_count, limits)?;
    let start = HEADER_RECORDS * size;
    let wider = words > *WORDS.start();
    if wider && !proof::directions_hold(bytes.as_ref(), start, size, ray_count)? {
        return Err(layout(size));
    }
    let facts = header.facts(ray_count, wider);
    Ok(RaySet { facts, records: Box::new(Floats { bytes, start, words, ray }) })
}

/// Judges the header from the first bytes of a file that is `length` bytes long, if that is known.
///
/// # Errors
/// As [`open`]; [`Error::Unreadable`] (end of file) when `bytes` holds too little to tell.
pub fn peek(bytes: &dyn Bytes, length: Option<u64>) -> Result<(), Error> {
    let mut first = [0; 4];
    bytes.read_at(0, &mut first)?;
    let Some(words) = words(i32_in(&first, 0)) else { return Ok(()) };
    let mut block = vec![0; HEADER_RECORDS as usize * 4 * words];
    bytes.read_at(0, &mut block)?;
    match length {
        Some(length) => Header { block, words }.ray_count(length).map(|_| ()),
        None => Ok(()),
    }
}

fn layout(size: u64) -> Error {
    let found = format!("The records are {size} bytes long, and no rays were found in them.");
    let remedy = "Export the rays from ASAP with 7 words each, or use the source's IES TM-25 or Zemax binary file.";
    Error::refused("asap.layout", found, remedy).at_byte(HEADER_RECORDS * size)
}

/// The header, not yet believed.
struct Header {
    block: Vec<u8>,
    words: usize,
}

impl Header {
    /// Record `index` of the header.
    fn record(&self, index: usize) -> &[u8] {
        self.block.chunks_exact(4 * self.words).nth(index).unwrap_or_default()
    }

    /// The negative number of rows is the number of rays; the length of the file must agree.
    fn ray_count(&self, length: u64) -> Result<u64, Error> {
        let size = 4 * self.words as u64;
        let (rows, at) = (i32_in(self.record(3), ROWS_AT), 3 * size + ROWS_AT as u64);
        if rows > 0 {
            let found = format!("This is a distribution over {rows} rows of a grid, not rays.");
            let remedy = "Save the rays themselves from ASAP, or use the source's IES TM-25 or Zemax binary file.";
            return Err(Error::refused("asap.distribution", found, remedy).at_byte(at));
        }
        let count = u64::from(rows.unsigned_abs());
        let announced = (HEADER_RECORDS + count) * size;
        if announced == length {
            return Ok(count);
        }
        let found = format!(
            "The header announces {count} rays of {size} bytes, which makes {announced} bytes; the file has {length}."
        );
        let remedy = "Fetch the file again if it is shorter than announced; export it again if it is longer.";
        Err(Error::malformed("asap.size", found, remedy).at_byte(at))
    }

    fn facts(&self, ray_count: u64, wider: bool) -> Facts {
        let mut notices = Notices::default();
        if wider {
            let told = format!(
                "The records have {} numbers; count, size and directions prove the first seven, the rest was left out.",
                self.words
            );
            notices.add("asap.wide_records", told);
        }
        let text = |record: usize, from: usize, to: usize| ascii(self.record(record).get(from..to).unwrap_or_default());
        let texts = [("title", text(1, 0, 24)), ("quantity", text(2, 12, 28))];
        Facts {
            format: Format::Asap,
            ray_count,
            header_flux: Flux::default(),
            total_rule: TotalRule::RaySum,
            has_radiant: true,
            has_luminous: false,
            spectral: SpectralData::None,
            length_unit: None,
            quantity_unknown: true,
            texts: texts.map(|(name, value)| (name.to_owned(), value)).to_vec(),
            notices,
        }
    }
}

fn ray(record: &Words) -> RawRay {
    RawRay {
        origin_mm: triple(record, 0, 1.0),
        direction: triple(record, 3, 1.0),
        radiant: float(record, 6),
        ..RawRay::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file by `pipeline/formats/README.md` 5: five header records of `words` words, then rays, zeros after their seven numbers.
    fn file(words: usize, rows: i32, rays: &[&[f32]]) -> Vec<u8> {
        let size = 4 * words;
        let mut bytes = vec![0; 5 * size];
        bytes[..4].copy_from_slice(&(247 + 256 * size as i32).to_le_bytes());
        bytes[size..size + 9].copy_from_slice(b"LED chip ");
        bytes[2 * size + 12..2 * size + 16].copy_from_slice(b"FLUX");
        bytes[3 * size + 24..3 * size + 28].copy_from_slice(&rows.to_le_bytes());
        for ray in rays {
            bytes.extend(ray.iter().flat_map(|value| value.to_le_bytes()));
            bytes.resize(bytes.len().next_multiple_of(size).max(bytes.len()), 0);
        }
        bytes
    }

    const RAY: &[f32] = &[1.0, 2.0, 0.5, 0.6, 0.0, -0.8, 0.25];

    fn opened(bytes: Vec<u8>) -> Result<(Facts, Vec<RawRay>), Error> {
        crate::formats::open(Arc::new(bytes), None, &Limits::default())?.read_all()
    }

    #[test]
    fn seven_words_are_read_and_more_with_a_notice() {
        assert_eq!(file(7, -1, &[RAY]).len(), 140 + 28);
        for words in [7, 8, 9, 16] {
            let (facts, rays) = opened(file(words, -3, &[RAY; 3])).unwrap();
            let expected = RawRay {
                origin_mm: [1.0, 2.0, 0.5],
                direction: [0.6_f32, 0.0, -0.8].map(f64::from),
                radiant: 0.25,
                ..RawRay::default()
            };
            assert_eq!(rays, [expected; 3]);
            assert_eq!((facts.format, facts.length_unit, facts.quantity_unknown), (Format::Asap, None, true));
            assert_eq!((facts.header_flux, facts.total_rule), (Flux::default(), TotalRule::RaySum));
            assert_eq!((facts.texts[0].1.as_str(), facts.texts[1].1.as_str()), ("LED chip", "FLUX"));
            assert_eq!(facts.notices.count_of("asap.wide_records"), u64::from(words > 7));
        }
    }

    #[test]
    fn what_is_no_set_of_rays_has_a_name() {
        let still: &[f32] = &[1.0, 2.0, 0.5, 0.0, 0.0, 0.0, 0.25];
        let cases = [
            (file(7, 3, &[RAY; 3]), "asap.distribution"),
            (file(7, i32::MAX, &[]), "asap.distribution"),
            (file(7, -2, &[RAY; 3]), "asap.size"),
            (file(7, i32::MIN, &[RAY; 3]), "asap.size"),
            (file(9, -3, &[still; 3]), "asap.layout"),
        ];
        for (bytes, expected) in cases {
            assert_eq!(opened(bytes).unwrap_err().code(), expected);
        }
        assert_eq!(words(7415), Some(7));
        assert_eq!([7414, 247 + 1024 * 6, 247 + 1024 * 17, i32::MIN, i32::MAX].map(words), [None; 5]);
        let limits = Limits { max_rays: 1, ..Limits::default() };
        assert_eq!(open(Arc::new(file(7, -2, &[RAY; 2])), &limits).err().unwrap().code(), "rays.too_many");
    }

    #[test]
    fn every_prefix_is_refused_and_the_first_bytes_tell_it() {
        let whole = file(7, -3, &[RAY; 3]);
        for length in 0..whole.len() {
            assert!(opened(whole[..length].to_vec()).is_err(), "{length}");
            let seen = crate::formats::peek(&whole[..length], Some(whole.len() as u64), &Limits::default());
            assert!(seen.is_ok(), "{length}");
        }
        assert_eq!(peek(&whole, Some(10_000)).unwrap_err().code(), "asap.size");
    }
}
