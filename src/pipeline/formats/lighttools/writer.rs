//! Writing LightTools binary ray files of version 2 as a stream (`pipeline/formats/README.md` 3): positions in mm, rays that sum to the total.

use super::binary::TRAILER;
use crate::formats::record::RawRay;
use crate::formats::writer;
use crate::formats::writer::{Encode, put};
use std::io;
use std::io::Write;

/// Version of the format.
const VERSION: u32 = 2;
/// Length unit of millimetres.
const MILLIMETRE: u32 = 1;

/// A file being written.
pub type Writer<'a> = writer::Writer<'a, Rows>;

/// What stands before the rays.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Header {
    /// Rays announced to the writer; the file does not hold it.
    pub ray_count: u64,
    /// Flux of all rays, W, or lm when the rays are luminous.
    pub flux: f64,
    /// What the rays carry.
    pub rows: Rows,
}

/// What each ray carries besides position and direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rows {
    /// Flux is in lm.
    pub luminous: bool,
    /// What follows, or takes the place of, the flux.
    pub color: Color,
}

/// What a ray says of its colour, by the numbers of the header.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Color {
    /// 0: nothing.
    #[default]
    None,
    /// 1: tristimulus X, Y, Z in place of the flux, lm.
    Tristimulus,
    /// 2: a wavelength, nm, after the flux.
    Wavelength,
}

impl<'a> writer::Writer<'a, Rows> {
    /// Writes all that comes before the rays.
    ///
    /// # Errors
    /// What `out` answers.
    pub fn start(out: &'a mut dyn Write, header: &Header) -> io::Result<Writer<'a>> {
        let rows = header.rows;
        let color = match rows.color {
            Color::None => 0,
            Color::Tristimulus => 1,
            Color::Wavelength => 2,
        };
        out.write_all(b"LTRF")?;
        // Version, data type, far field, colour, unit, and three times 0 for the data origin.
        for word in [VERSION, 0, rows.luminous.into(), 0, color, MILLIMETRE, 0, 0, 0] {
            out.write_all(&word.to_le_bytes())?;
        }
        out.write_all(&(header.flux as f32).to_le_bytes())?;
        Ok(writer::Writer::announced(out, rows, header.ray_count))
    }
}

impl Encode for Rows {
    fn row_bytes(&self) -> usize {
        match self.color {
            Color::None => 28,
            Color::Wavelength => 32,
            Color::Tristimulus => 36,
        }
    }

    #[inline]
    fn encode_ray(&self, ray: &RawRay, rows: &mut Vec<u8>) {
        let ([x, y, z], [l, m, n]) = (ray.origin_mm, ray.direction);
        put([x, y, z, l, m, n], rows);
        let flux = if self.luminous { ray.luminous } else { ray.radiant };
        let [tristimulus_x, tristimulus_z] = ray.xz;
        match self.color {
            Color::None => put([flux], rows),
            Color::Wavelength => put([flux, ray.wavelength_nm], rows),
            Color::Tristimulus => put([tristimulus_x, ray.luminous, tristimulus_z], rows),
        }
    }

    fn end(&self) -> &'static [u8] {
        TRAILER
    }
}
