//! Spectral tables (4.7.4): back to back, numbered from 1 by their place, zero padded once after the last.

use crate::error::Error;
use crate::formats::bytes::{Cursor, f32_in};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::spectrum::Table;

/// All tables as stored: `(nm, weight per nm)` points and the byte offset of each table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spectra {
    /// Points of each table.
    pub points: Vec<Vec<(f32, f32)>>,
    offsets: Vec<u64>,
}

impl Spectra {
    /// Tables to be written.
    pub fn new(points: Vec<Vec<(f32, f32)>>) -> Spectra {
        let mut end = super::header::PREAMBLE;
        let offsets = points
            .iter()
            .map(|table| {
                let start = end;
                end += 4 + 8 * table.len() as u64;
                start
            })
            .collect();
        Spectra { points, offsets }
    }

    /// Reads `count` tables; the cursor ends behind the last, before the padding.
    ///
    /// # Errors
    /// `rays.truncated`, `tm25.table`, `tm25.too_many_table_points`.
    pub fn read(cursor: &mut Cursor<'_>, count: u32, limits: &Limits, notices: &mut Notices) -> Result<Spectra, Error> {
        let mut spectra = Spectra::default();
        let mut points_left = limits.max_table_points;
        for _ in 0..count {
            let at = cursor.at();
            let stored = cursor.i32("a spectral table")?;
            let size = usize::try_from(stored).ok().filter(|size| *size > 0).ok_or_else(|| {
                let found = format!("A spectral table announces {stored} points.");
                Error::malformed("tm25.table", found, "Export the file again.").at_byte(at)
            })?;
            cursor.fits("a spectral table", 8 * size as u64)?;
            points_left = points_left.checked_sub(size).ok_or_else(|| {
                let found = format!("The spectral tables have more than {} points.", limits.max_table_points);
                Error::refused("tm25.too_many_table_points", found, "Raise the limit.").at_byte(at)
            })?;
            let block = cursor.block("a spectral table", 8 * size as u64)?;
            spectra.points.push(block.chunks_exact(8).map(|point| (f32_in(point, 0), f32_in(point, 4))).collect());
            spectra.offsets.push(at);
        }
        if spectra.points.iter().any(|table| table.windows(2).any(|pair| pair[0].0 > pair[1].0)) {
            notices.add("tm25.table_order", "The wavelengths of a spectral table do not increase; it was sorted.");
        }
        Ok(spectra)
    }

    /// The tables as spectra, sorted by wavelength.
    ///
    /// # Errors
    /// `tm25.table` at the byte of a table that is no spectrum.
    pub fn tables(&self, notices: &mut Notices) -> Result<Vec<Table>, Error> {
        let mut tables = Vec::new();
        for (points, at) in self.points.iter().zip(&self.offsets) {
            let mut points: Vec<(f64, f64)> =
                points.iter().map(|(nm, weight)| (f64::from(*nm), f64::from(*weight))).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let stored = points.len();
            points.dedup();
            if points.len() < stored {
                let told = "A spectral table repeats points; the repetitions were left out.";
                notices.count("tm25.table_repeats", (stored - points.len()) as u64, None, told);
            }
            tables.push(Table::new(&points).ok_or_else(|| {
                let found = "A spectral table is no spectrum: wavelengths must be positive and differ, weights not negative \
                             and not all zero.";
                Error::malformed("tm25.table", found, "Export the file again.").at_byte(*at)
            })?);
        }
        Ok(tables)
    }
}
