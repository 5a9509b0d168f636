//! Writing Zemax / OpticStudio binary source files as a stream (`pipeline/formats/README.md` 2): positions in mm, the current identifier.
//!
//! Of the header OpticStudio uses the count, the unit, the format and the flux type. The rest is written where it is known
//! and 0 where it is not: angles, place and rotation are informational.

use super::binary::{HEADER, IDENTIFIERS};
use crate::formats::record::RawRay;
use crate::formats::writer;
use crate::formats::writer::{Encode, put};
use crate::vocabulary::wavelength::NM_PER_UM;
use std::io;
use std::io::Write;

/// Bytes of the description.
const DESCRIPTION_BYTES: usize = 100;
/// `DimensionUnits` of millimetres.
const MILLIMETRE: i32 = 4;

/// A file being written.
pub type Writer<'a> = writer::Writer<'a, Rows>;

/// What stands before the rays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Header {
    /// Rays announced.
    pub ray_count: u32,
    /// What it is: ASCII, cut after 100 bytes.
    pub description: String,
    /// Flux of all rays, W, or lm when `luminous`.
    pub flux: f64,
    /// One wavelength for all rays, nm, where there is one.
    pub wavelength_nm: Option<f64>,
    /// What the rays carry.
    pub rows: Rows,
}

/// What each ray carries besides position and direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rows {
    /// Radiant flux, W.
    #[default]
    Radiant,
    /// Luminous flux, lm.
    Luminous,
    /// Radiant flux, W, and a wavelength.
    Spectral,
}

impl<'a> writer::Writer<'a, Rows> {
    /// Writes all that comes before the rays.
    ///
    /// # Errors
    /// What `out` answers.
    pub fn start(out: &'a mut dyn Write, header: &Header) -> io::Result<Writer<'a>> {
        let mut block = vec![0; HEADER as usize];
        let mut put = |at: usize, word: [u8; 4]| {
            block.iter_mut().skip(at).zip(word).for_each(|(byte, value)| *byte = value);
        };
        let flux = (header.flux as f32).to_le_bytes();
        let wavelength_um = header.wavelength_nm.map_or(0.0, |nm| (nm / NM_PER_UM) as f32);
        let [format, flux_type] = match header.rows {
            Rows::Radiant => [0, 0],
            Rows::Luminous => [0, 1],
            Rows::Spectral => [2, 0],
        };
        put(0, IDENTIFIERS[0].to_le_bytes());
        put(4, header.ray_count.to_le_bytes());
        put(108, flux);
        put(112, flux);
        put(116, wavelength_um.to_le_bytes());
        put(136, MILLIMETRE.to_le_bytes());
        put(192, i32::to_le_bytes(format));
        put(196, i32::to_le_bytes(flux_type));
        let shown =
            header.description.chars().map(|c| if c.is_ascii() && !c.is_ascii_control() { c as u8 } else { b'?' });
        block.iter_mut().skip(8).zip(shown.take(DESCRIPTION_BYTES)).for_each(|(byte, value)| *byte = value);
        out.write_all(&block)?;
        Ok(writer::Writer::announced(out, header.rows, header.ray_count.into()))
    }
}

impl Encode for Rows {
    fn row_bytes(&self) -> usize {
        if *self == Rows::Spectral { 32 } else { 28 }
    }

    #[inline]
    fn encode_ray(&self, ray: &RawRay, rows: &mut Vec<u8>) {
        let ([x, y, z], [l, m, n]) = (ray.origin_mm, ray.direction);
        put([x, y, z, l, m, n, if *self == Rows::Luminous { ray.luminous } else { ray.radiant }], rows);
        if *self == Rows::Spectral {
            put([ray.wavelength_nm / NM_PER_UM], rows);
        }
    }
}
