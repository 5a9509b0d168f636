//! The ray records: rows of binary32 in a fixed column order, those columns present whose flags are set.

use super::additional::COLUMN_NAME_BYTES;
use super::header::{ALIGNMENT, Flags, Header};
use crate::error::Error;
use crate::formats::binary::{float, triple};
use crate::formats::proof;
use crate::formats::record::{Bytes, RawRay, Records};
use crate::vocabulary::notice::Notices;
use std::sync::Arc;

/// Stokes columns: S1 S2 S3 and the ellipse's axis, as all readers do it, or without the axis, as the 2013 text reads.
const STOKES: [u64; 2] = [6, 3];

/// Where the records are and which column is what; columns count numbers from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    additional_start: u64,
    start: u64,
    columns: usize,
    radiant: Option<usize>,
    wavelength: Option<usize>,
    luminous: Option<usize>,
    stokes: Option<usize>,
    tristimulus: Option<usize>,
    index: Option<usize>,
}

impl Layout {
    /// The layout that the length of the file and, where it is not the standard's, its directions prove, when its tables
    /// end at `tables_end`.
    ///
    /// # Errors
    /// `tm25.size`, with both numbers; [`Error::Unreadable`].
    pub fn prove(header: &Header, tables_end: u64, bytes: &dyn Bytes, notices: &mut Notices) -> Result<Layout, Error> {
        let length = bytes.len();
        let padded = tables_end.next_multiple_of(ALIGNMENT);
        for additional_start in [padded, tables_end] {
            for stokes in STOKES {
                let layout = Layout::new(header, additional_start, stokes);
                let standard = additional_start == padded && stokes == STOKES[0];
                if layout.length(header.ray_count) != u128::from(length)
                    || !(standard
                        || proof::directions_hold(bytes, layout.start, layout.record_bytes(), header.ray_count)?)
                {
                    continue;
                }
                if additional_start != padded {
                    let told = "The spectral tables are not padded to 32 bytes; the file was read without the padding.";
                    notices.add("tm25.unpadded_tables", told);
                }
                return Ok(layout);
            }
        }
        if let Some(layout) = Layout::over_padded(header, tables_end, bytes)? {
            let told = format!(
                "More zeros stand before the rays than the 32 bytes they are padded to; counted back from the end of the file, \
                 the rays begin at byte {}.",
                layout.start
            );
            notices.add("tm25.over_padded", told);
            return Ok(layout);
        }
        let expected = Layout::new(header, padded, STOKES[0]);
        let found = format!(
            "The header (version {}) announces {} rays of {} bytes from byte {}, which makes {} bytes; the file has {length}.",
            header.version,
            header.ray_count,
            expected.record_bytes(),
            expected.start,
            expected.length(header.ray_count)
        );
        let remedy = "Fetch the file again if it is shorter than announced; export it again if it is longer.";
        Err(Error::malformed("tm25.size", found, remedy).at_byte(length.min(expected.start)))
    }

    /// The layout of a file that is padded beyond the standard's.
    fn over_padded(header: &Header, tables_end: u64, bytes: &dyn Bytes) -> Result<Option<Layout>, Error> {
        let padded = tables_end.next_multiple_of(ALIGNMENT);
        for stokes in STOKES {
            let standard = Layout::new(header, padded, stokes);
            let back =
                |from: u64| proof::counted_back(bytes, from, standard.start, standard.record_bytes(), header.ray_count);
            if let Some(start) = back(standard.start)? {
                return Ok(Some(Layout { start, ..standard }));
            }
        }
        Ok(None)
    }

    fn new(header: &Header, additional_start: u64, stokes: u64) -> Layout {
        let Flags { radiant, wavelength, luminous, stokes: has_stokes, tristimulus, index } = header.flags;
        let mut columns = 6;
        let mut place = |present: bool, width: u64| {
            let at = columns;
            columns += if present { width as usize } else { 0 };
            present.then_some(at)
        };
        let names = u64::from(header.additional_columns) * COLUMN_NAME_BYTES;
        Layout {
            additional_start,
            start: additional_start + names + u64::from(header.text_bytes),
            radiant: place(radiant, 1),
            wavelength: place(wavelength, 1),
            luminous: place(luminous, 1),
            stokes: place(has_stokes, stokes),
            tristimulus: place(tristimulus, 2),
            index: place(index, 1),
            columns: columns + header.additional_columns as usize,
        }
    }

    /// Offset of the additional column names.
    pub fn additional_start(&self) -> u64 {
        self.additional_start
    }

    /// Offset of the first record.
    pub fn start(&self) -> u64 {
        self.start
    }

    /// Bytes per record.
    pub fn record_bytes(&self) -> u64 {
        4 * self.columns as u64
    }

    /// The rays are polarised.
    pub fn has_stokes(&self) -> bool {
        self.stokes.is_some()
    }

    /// Length of the whole file.
    fn length(&self, ray_count: u64) -> u128 {
        u128::from(self.start) + u128::from(ray_count) * u128::from(self.record_bytes())
    }
}

/// The records of a file.
pub struct Tm25Records {
    bytes: Arc<dyn Bytes>,
    layout: Layout,
    table_count: u32,
}

impl Tm25Records {
    /// Records laid out by `layout`, with indices into `table_count` tables.
    pub fn new(bytes: Arc<dyn Bytes>, layout: Layout, table_count: u32) -> Tm25Records {
        Tm25Records { bytes, layout, table_count }
    }
}

impl Records for Tm25Records {
    fn read(&self, first: u64, count: usize, rays: &mut Vec<RawRay>) -> Result<(), Error> {
        let layout = &self.layout;
        let mut block = vec![0; count * layout.record_bytes() as usize];
        self.bytes.read_at(layout.start + first * layout.record_bytes(), &mut block)?;
        let (words, _) = block.as_chunks::<4>();
        rays.extend(words.chunks_exact(layout.columns).map(|record| {
            let at = |k: usize| float(record, k);
            let or_zero = |column: Option<usize>| column.map_or(0.0, at);
            RawRay {
                origin_mm: triple(record, 0, 1.0),
                direction: triple(record, 3, 1.0),
                radiant: or_zero(layout.radiant),
                luminous: or_zero(layout.luminous),
                wavelength_nm: or_zero(layout.wavelength),
                table: layout.index.and_then(|k| record.get(k)).map_or(0, |word| table_index(*word, self.table_count)),
                xz: layout.tristimulus.map_or([0.0; 2], |k| [at(k), at(k + 1)]),
            }
        }));
        Ok(())
    }
}

/// Index from 0 of a stored index from 1: an i32 by the standard, an f32 in some writers. The patterns cannot be mistaken for
/// each other: integers this small are denormal floats. `u32::MAX` out of range.
fn table_index(word: [u8; 4], table_count: u32) -> u32 {
    let integer = u32::from_le_bytes(word);
    let float = f32::from_le_bytes(word);
    let from_one = if (1..=table_count).contains(&integer) {
        integer
    } else if float >= 1.0 && float <= table_count as f32 && float.fract() == 0.0 {
        float as u32
    } else {
        return u32::MAX;
    };
    from_one - 1
}

#[cfg(test)]
mod tests {
    use super::table_index;

    #[test]
    fn an_index_is_an_integer_or_a_float() {
        assert_eq!(table_index(2_i32.to_le_bytes(), 3), 1);
        assert_eq!(table_index(3.0_f32.to_le_bytes(), 3), 2);
        for word in [0_i32.to_le_bytes(), 4_i32.to_le_bytes(), (-1_i32).to_le_bytes(), 1.5_f32.to_le_bytes()] {
            assert_eq!(table_index(word, 3), u32::MAX);
        }
    }
}
