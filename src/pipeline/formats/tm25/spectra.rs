//! Spectral tables (4.7.4): back to back, numbered from 1 by their place, zero padded once after the last.

use crate::error::Error;
use crate::formats::bytes::{Cursor, f32_in};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::spectrum::Table;
use crate::vocabulary::wavelength::{WavelengthUnit, lowest_dark};

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

    /// The first `count` tables as spectra, sorted by wavelength; what is wrong with the first that is none.
    ///
    /// # Errors
    /// A sentence.
    pub fn tables(&self, count: usize, notices: &mut Notices) -> Result<Vec<Table>, String> {
        let stored = self.points.iter().zip(&self.offsets).take(count);
        stored.map(|(points, at)| table(points, *at, notices)).collect()
    }
}

/// A table of points as stored from byte `at` on, mended as spectrum files are.
fn table(stored: &[(f32, f32)], at: u64, notices: &mut Notices) -> Result<Table, String> {
    let mut points: Vec<(f64, f64)> = stored.iter().map(|(nm, weight)| (f64::from(*nm), f64::from(*weight))).collect();
    let unit = WavelengthUnit::of(points.iter().map(|(nm, _)| *nm)).map_err(|stray| {
        format!("The wavelengths of the spectral table at byte {at} are neither all nm (100 to 20000) nor all \u{b5}m; see {stray}.")
    })?;
    if unit == WavelengthUnit::Micrometre {
        points.iter_mut().for_each(|point| point.0 *= unit.nm());
        notices.add(
            "tm25.table_micrometres",
            "The wavelengths of a spectral table are in \u{b5}m by their size; they were read as such.",
        );
    }
    let most = points.iter().fold(0.0, |most: f64, point| most.max(point.1));
    let dark = points.iter().filter(|(_, weight)| *weight < 0.0 && *weight >= lowest_dark(most)).count();
    if dark > 0 {
        points.iter_mut().filter(|point| point.1 < 0.0 && point.1 >= lowest_dark(most)).for_each(|point| point.1 = 0.0);
        let told = "Small negative values of a spectral table, a spectrometer's dark noise, were set to 0.";
        notices.count("tm25.table_negative", dark as u64, None, told);
    }
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let count = points.len();
    points.dedup();
    if points.len() < count {
        let told = "A spectral table repeats points; the repetitions were left out.";
        notices.count("tm25.table_repeats", (count - points.len()) as u64, None, told);
    }
    Table::new(&points).ok_or_else(|| {
        format!(
            "The spectral table at byte {at} is no spectrum: wavelengths must be positive and differ, weights not negative by \
             more than 1 % of the highest and not all zero."
        )
    })
}
