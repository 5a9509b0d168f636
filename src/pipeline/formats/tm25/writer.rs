//! Writing TM-25-13 files as a stream: the count comes first, the rays after it, memory does not grow with them.

use super::Preamble;
use super::additional::{COLUMN_NAME_BYTES, to_utf32};
use super::header::{ALIGNMENT, Flags, Header, SpectralId, TEXT_POINTS};
use crate::formats::record::RawRay;
use crate::formats::writer;
use crate::formats::writer::{Encode, put};
use std::io;
use std::io::Write;

/// What unknown numbers are written as: a quiet NaN.
const UNKNOWN: f32 = f32::NAN;
/// Stokes columns written: S1 S2 S3 and the ellipse's axis.
const STOKES_COLUMNS: u64 = 6;

/// A file being written.
pub type Writer<'a> = writer::Writer<'a, Rows>;

/// Turns rays into rows; what [`Writer::rows`] gives can be used on any thread.
#[derive(Clone, Copy, Debug)]
pub struct Rows {
    flags: Flags,
    additional_columns: usize,
}

impl<'a> writer::Writer<'a, Rows> {
    /// Writes all that comes before the rays. `preamble` is [`Preamble::new`]'s.
    ///
    /// # Errors
    /// What `out` answers.
    pub fn start(out: &'a mut dyn Write, preamble: &Preamble) -> io::Result<Writer<'a>> {
        let Preamble { header, spectra, additional } = preamble;
        write_header(out, header)?;
        let mut bytes = 0;
        for table in &spectra.points {
            out.write_all(&(table.len() as i32).to_le_bytes())?;
            for (nm, weight) in table {
                out.write_all(&nm.to_le_bytes())?;
                out.write_all(&weight.to_le_bytes())?;
            }
            bytes += 4 + 8 * table.len() as u64;
        }
        out.write_all(&vec![0; (bytes.next_multiple_of(ALIGNMENT) - bytes) as usize])?;
        for name in &additional.columns {
            out.write_all(&to_utf32(name, COLUMN_NAME_BYTES as usize))?;
        }
        out.write_all(&to_utf32(&additional.text, header.text_bytes as usize))?;
        let rows = Rows { flags: header.flags, additional_columns: additional.columns.len() };
        Ok(writer::Writer::announced(out, rows, header.ray_count))
    }
}

impl Encode for Rows {
    fn row_bytes(&self) -> usize {
        4 * (self.flags.columns(STOKES_COLUMNS) as usize + self.additional_columns)
    }

    #[inline]
    fn encode_ray(&self, ray: &RawRay, rows: &mut Vec<u8>) {
        self.encode(ray, &[], rows);
    }
}

impl Rows {
    /// Appends one ray. [`RawRay::table`] counts from 0. Missing additional values become 0, polarisation none.
    #[inline]
    pub fn encode(&self, ray: &RawRay, additional: &[f32], rows: &mut Vec<u8>) {
        let flags = self.flags;
        let ([x, y, z], [l, m, n]) = (ray.origin_mm, ray.direction);
        put([x, y, z, l, m, n], rows);
        for (present, value) in
            [(flags.radiant, ray.radiant), (flags.wavelength, ray.wavelength_nm), (flags.luminous, ray.luminous)]
        {
            if present {
                put([value], rows);
            }
        }
        if flags.stokes {
            put([0.0; STOKES_COLUMNS as usize], rows);
        }
        if flags.tristimulus {
            put(ray.xz, rows);
        }
        if flags.index {
            rows.extend(ray.table.saturating_add(1).to_le_bytes());
        }
        for k in 0..self.additional_columns {
            rows.extend(additional.get(k).copied().unwrap_or(0.0).to_le_bytes());
        }
    }
}

fn write_header(out: &mut dyn Write, header: &Header) -> io::Result<()> {
    let float = |value: Option<f64>| value.map_or(UNKNOWN, |value| value as f32).to_le_bytes();
    let flag = |set: bool| i32::from(set).to_le_bytes();
    let id = SpectralId::ALL.iter().position(|id| *id == header.spectral_id).unwrap_or(0) as i32;
    let mut date: Vec<u8> = header.date.bytes().take(28).collect();
    date.resize(28, 0);
    let mut block: Vec<u8> = Vec::new();
    block.extend(b"TM25");
    block.extend(header.version.to_le_bytes());
    block.extend(header.creation_method.to_le_bytes());
    block.extend(float(header.luminous_lm));
    block.extend(float(header.radiant_w));
    block.extend(header.ray_count.to_le_bytes());
    block.extend(date);
    block.extend(header.start_position.to_le_bytes());
    block.extend(id.to_le_bytes());
    block.extend(float(header.wavelength_nm));
    block.extend(header.range_nm.map(float).concat());
    block.extend(header.table_count.to_le_bytes());
    block.extend(header.additional_columns.to_le_bytes());
    block.extend(header.text_bytes.to_le_bytes());
    block.resize(256, 0);
    let Flags { radiant, wavelength, luminous, stokes, tristimulus, index } = header.flags;
    for set in [true, true, radiant, wavelength, luminous, stokes, tristimulus, index] {
        block.extend(flag(set));
    }
    for text in &header.texts {
        block.extend(to_utf32(text, 4 * TEXT_POINTS));
    }
    out.write_all(&block)
}
