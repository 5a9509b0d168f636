//! What can be said of a ray file before anybody makes a model of it: at its first bytes, at its header, after its rays.

use super::super::Error;
use super::super::vocabulary::limits::Limits;
use super::super::vocabulary::notice::{Notice, Notices};
use super::super::vocabulary::space::Axis;
use super::super::vocabulary::spectrum::Bands;
use super::super::vocabulary::units::{Flux, LengthUnit};
use super::super::vocabulary::watch::StageWatch;
use super::conversion::Conversion;
use super::survey::{Reading, survey, wider};
use super::{Bytes, Facts, Format, Input, TotalRule, bands, detect, open, totals};
use serde::Serialize;
use std::io;
use std::sync::Arc;

/// A name and what the file says under it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Text {
    /// Name of the field.
    pub name: String,
    /// Its content.
    pub value: String,
}

/// What a file says of itself; no ray was read for it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Header {
    /// The format it is.
    pub format: Format,
    /// Length of the file.
    pub byte_count: u64,
    /// Rays in the file, proven by its length.
    pub ray_count: u64,
    /// Totals of the header; `null` where it has none.
    pub flux: Flux,
    /// Which total holds in this format.
    pub total_rule: TotalRule,
    /// Rays carry W.
    pub has_radiant: bool,
    /// Rays carry lm.
    pub has_luminous: bool,
    /// What the rays carry of the spectrum: "none", "table", "wavelength per ray", "table per ray", "tristimulus".
    pub spectrum: &'static str,
    /// Length unit: "mm", …; `null` where it does not say.
    pub length_unit: Option<&'static str>,
    /// It does not say whether its flux is W or lm.
    pub quantity_unknown: bool,
    /// Wavelengths of its tables, nm; `null` without tables.
    pub table_range_nm: Option<(f64, f64)>,
    /// Everything else, in the file's order.
    pub texts: Vec<Text>,
    /// What was odd about the header and yet read.
    pub notices: Vec<Notice>,
}

/// A box, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Extent {
    /// Smallest coordinates, mm.
    pub min: [f64; 3],
    /// Largest coordinates, mm.
    pub max: [f64; 3],
}

/// Share of the flux that goes to one side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Hemisphere {
    /// Its middle.
    pub axis: Axis,
    /// Share of the flux, 0..=1.
    pub share: f64,
}

/// A file's header and what its rays say.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Inspection {
    /// What the file says of itself.
    pub header: Header,
    /// Rays that can be used.
    pub rays_used: u64,
    /// Rays that cannot be meant.
    pub rays_refused: u64,
    /// Rays without flux.
    pub rays_dropped: u64,
    /// Sum of the stored radiant values: W, or relative; `null` where rays carry none.
    pub radiant_sum: Option<f64>,
    /// Sum of the stored luminous values: lm, or relative; `null` where rays carry none.
    pub luminous_sum: Option<f64>,
    /// Ray sum over header total.
    pub sum_over_header: Option<f64>,
    /// Totals of a model of this file.
    pub flux: Flux,
    /// Luminous efficacy of the radiation, lm/W.
    pub lm_per_w: Option<f64>,
    /// Box of the origins.
    pub origins_mm: Extent,
    /// Flux-weighted mean of the origins, mm.
    pub centroid_mm: [f64; 3],
    /// Smallest and largest wavelength, nm.
    pub wavelength_nm: Option<(f64, f64)>,
    /// Share of the flux in the hemisphere round each axis.
    pub hemispheres: [Hemisphere; 6],
    /// What was odd about header and rays.
    pub notices: Vec<Notice>,
}

/// Judges a file by its first bytes, `length` being its full length where that is known. `Some` means: so far a file of this
/// format; `None`: too few bytes to tell.
///
/// # Errors
/// As [`open`], as soon as the bytes at hand prove it.
pub fn peek(prefix: &[u8], length: Option<u64>, limits: &Limits) -> Result<Option<Format>, Error> {
    let start = prefix.get(..prefix.len().min(detect::LOOK)).unwrap_or_default();
    let Some(format) = detect::detect_start(start, length)? else { return Ok(None) };
    let bytes = Prefix { bytes: prefix, length: length.unwrap_or(u64::MAX) };
    match super::peek(format, &bytes, length, limits) {
        Err(Error::Unreadable(_)) | Ok(()) => Ok(Some(format)),
        Err(error) => Err(error),
    }
}

/// The first bytes of a longer file.
struct Prefix<'a> {
    bytes: &'a [u8],
    length: u64,
}

impl Bytes for Prefix<'_> {
    fn len(&self) -> u64 {
        self.length
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        let from = usize::try_from(offset).ok().and_then(|start| self.bytes.get(start..));
        let found = from.and_then(|rest| rest.get(..into.len())).ok_or(io::ErrorKind::UnexpectedEof)?;
        into.copy_from_slice(found);
        Ok(())
    }
}

/// What a file says of itself, with its length as witness.
///
/// # Errors
/// As [`open`].
pub fn header(input: &Input, limits: &Limits) -> Result<Header, Error> {
    Ok(Header::of(&open(Arc::clone(&input.bytes), &input.declared, limits)?.facts, input.bytes.len()))
}

/// Reads a whole file once and tells what is in it.
///
/// # Errors
/// As [`super::read`].
pub fn inspect(input: &Input, limits: &Limits, watch: StageWatch<'_>) -> Result<Inspection, Error> {
    let set = open(Arc::clone(&input.bytes), &input.declared, limits)?;
    let bands: Bands = bands::asked(&super::Options::default())?.into_bands();
    let radiant = Conversion::of(&set.facts).knows_radiant();
    let reading = survey(&set, radiant, &bands, limits, watch)?;
    Inspection::of(&set.facts, input.bytes.len(), &reading)
}

impl Header {
    fn of(facts: &Facts, byte_count: u64) -> Header {
        let texts = facts.texts.iter().filter(|(_, value)| !value.is_empty());
        Header {
            format: facts.format,
            byte_count,
            ray_count: facts.ray_count,
            flux: facts.header_flux,
            total_rule: facts.total_rule,
            has_radiant: facts.has_radiant,
            has_luminous: facts.has_luminous,
            spectrum: facts.spectral.name(),
            length_unit: facts.length_unit.map(LengthUnit::symbol),
            quantity_unknown: facts.quantity_unknown,
            table_range_nm: facts.spectral.tables().iter().fold(None, |all, table| wider(all, Some(table.range_nm()))),
            texts: texts.map(|(name, value)| Text { name: name.clone(), value: value.clone() }).collect(),
            notices: facts.notices.to_vec(),
        }
    }
}

impl Inspection {
    fn of(facts: &Facts, byte_count: u64, reading: &Reading) -> Result<Inspection, Error> {
        let mut notices = Notices::default();
        notices.merge(&facts.notices);
        notices.merge(&reading.notices);
        let flux = Conversion::of(facts).scaled(facts, &reading.sums).totals(&reading.sums);
        totals::judge(facts, &reading.sums, &flux, &mut notices)?;
        totals::notice_size(&reading.survey, &mut notices);
        let survey = &reading.survey;
        let shares = survey.directions.hemispheres();
        Ok(Inspection {
            header: Header::of(facts, byte_count),
            rays_used: survey.rays_used,
            rays_refused: reading.refused,
            rays_dropped: reading.dropped,
            radiant_sum: facts.has_radiant.then_some(survey.radiant_sum),
            luminous_sum: facts.has_luminous.then_some(survey.luminous_sum),
            sum_over_header: totals::ratio(facts, &reading.sums),
            flux,
            lm_per_w: flux.luminous_lm.zip(flux.radiant_w).filter(|(_, w)| *w > 0.0).map(|(lm, w)| lm / w),
            origins_mm: Extent { min: survey.bounds_mm.min.to_array(), max: survey.bounds_mm.max.to_array() },
            centroid_mm: survey.centroid_mm.to_array(),
            wavelength_nm: survey.wavelength_nm,
            hemispheres: std::array::from_fn(|k| Hemisphere { axis: Axis::ALL[k], share: shares[k] }),
            notices: notices.to_vec(),
        })
    }
}
