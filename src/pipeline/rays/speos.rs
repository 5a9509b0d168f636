//! Speos / OPTIS ray files (`FORMATS.md` 4).
//!
//! No magic, no ray count, no unit: 28 bytes of header, then 32 bytes per ray, mm and nm. The energy of a ray is relative; the
//! total in the header is shared out by it.

use super::super::Error;
use super::super::vocabulary::limits::Limits;
use super::super::vocabulary::notice::Notices;
use super::super::vocabulary::units::{Flux, LengthUnit};
use super::bytes::{Cursor, f32_in};
use super::floats::{Floats, Words, float, triple};
use super::{Bytes, Facts, Format, RawRay, RaySet, SpectralData, TotalRule, check};
use std::sync::Arc;

/// Bytes of the header.
const HEADER: u64 = 28;
/// Bytes of a ray.
const RAY: u64 = 32;
/// Sizes of a record, bytes, that hold a ray and more: polarised rays have five more numbers.
const LARGER_RAYS: std::ops::RangeInclusive<u64> = 36..=64;
/// Wavelengths, nm, that a light source may have.
const LIGHT_NM: std::ops::RangeInclusive<f32> = 100.0..=20_000.0;

/// Opens a file of this format.
///
/// # Errors
/// As [`super::open`].
pub fn open(bytes: Arc<dyn Bytes>, limits: &Limits) -> Result<RaySet, Error> {
    let header = Cursor::new(bytes.as_ref(), 0).block("the header", HEADER)?;
    let ray_count = ray_count(bytes.as_ref())?;
    check::count(ray_count, limits)?;
    let facts = facts(&header, ray_count);
    Ok(RaySet { facts, records: Box::new(Floats { bytes, start: HEADER, words: RAY as usize / 4, ray }) })
}

/// Judges the header from the first bytes of a file that is `length` bytes long, if that is known.
///
/// # Errors
/// As [`open`]; [`Error::Unreadable`] (end of file) when `bytes` holds too little to tell.
pub fn peek(bytes: &dyn Bytes, length: Option<u64>) -> Result<(), Error> {
    match length {
        Some(_) => ray_count(bytes).map(|_| ()),
        None => Ok(()),
    }
}

/// A file that starts with `start` looks like this format: five constants of 2, or else rays, with `length` as witness.
pub fn is_speos(start: &[u8], length: Option<u64>) -> bool {
    start.len() as u64 >= HEADER && (has_constants(start) || has_rays(start, length))
}

/// The five constants of all files seen.
fn has_constants(header: &[u8]) -> bool {
    (1..6).all(|k| f32_in(header, 4 * k) == 2.0)
}

/// Another version may have other constants; then all first rays must have unit directions, wavelengths of light and an energy.
fn has_rays(start: &[u8], length: Option<u64>) -> bool {
    let totals = [0, 24].map(|at| f32_in(start, at));
    let whole = length.is_none_or(|length| length >= HEADER && (length - HEADER).is_multiple_of(RAY));
    let mut rays = start.get(HEADER as usize..).unwrap_or_default().chunks_exact(RAY as usize).peekable();
    let fits = |ray: &[u8]| {
        let energy = f32_in(ray, 28);
        check::is_unit(ray, 12) && LIGHT_NM.contains(&f32_in(ray, 24)) && energy.is_finite() && energy >= 0.0
    };
    whole && totals.iter().all(|total| total.is_finite() && *total >= 0.0) && rays.peek().is_some() && rays.all(fits)
}

/// How many rays the length and, where it leaves a doubt, the directions prove.
fn ray_count(bytes: &dyn Bytes) -> Result<u64, Error> {
    let length = bytes.len();
    let body = length.saturating_sub(HEADER);
    let holds = |size: u64| -> Result<bool, Error> {
        Ok(body.is_multiple_of(size) && check::directions_hold(bytes, HEADER, size, body / size)?)
    };
    if body == 0 || holds(RAY)? {
        return Ok(body / RAY);
    }
    for size in LARGER_RAYS.step_by(4) {
        if holds(size)? {
            let found =
                format!("These are rays of {size} bytes, as Speos writes them with polarisation; that is not read.");
            let remedy = "Export the file without polarisation.";
            return Err(Error::refused("speos.polarised", found, remedy).at_byte(HEADER));
        }
    }
    if !body.is_multiple_of(RAY) {
        let found = format!(
            "After the header are {body} bytes, which is no whole number of rays of {RAY} bytes: {} and {} bytes.",
            body / RAY,
            body % RAY
        );
        let remedy = "Fetch the file again; the copy is not complete.";
        return Err(Error::malformed("speos.size", found, remedy).at_byte(length - body % RAY));
    }
    // Rays of the right size whose directions are wrong are the checks' to count and to name.
    Ok(body / RAY)
}

fn facts(header: &[u8], ray_count: u64) -> Facts {
    let mut notices = Notices::default();
    if !has_constants(header) {
        let told =
            "The constants of the header are not those known; the rays prove the layout, and it was read as such.";
        notices.add("speos.header_constants", told);
    }
    let total = |at| Some(f64::from(f32_in(header, at))).filter(|total| total.is_finite() && *total > 0.0);
    let flux = Flux { radiant_w: total(0), luminous_lm: total(24) };
    if flux == Flux::default() {
        let told = "The header has no total; the sum of the rays was taken, which Speos means to be relative.";
        notices.add("speos.no_total", told);
    }
    let texts = [("radiant_w", 0), ("luminous_lm", 24)];
    Facts {
        format: Format::Speos,
        ray_count,
        header_flux: flux,
        total_rule: TotalRule::Header,
        has_radiant: true,
        has_luminous: false,
        spectral: SpectralData::Wavelength,
        length_unit: Some(LengthUnit::Millimetre),
        quantity_unknown: false,
        texts: texts.map(|(name, at)| (name.to_owned(), f32_in(header, at).to_string())).to_vec(),
        notices,
    }
}

fn ray(record: &Words) -> RawRay {
    RawRay {
        origin_mm: triple(record, 0, 1.0),
        direction: triple(record, 3, 1.0),
        wavelength_nm: float(record, 6),
        radiant: float(record, 7),
        ..RawRay::default()
    }
}
