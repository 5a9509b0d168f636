//! Speos / OPTIS ray files (`pipeline/formats/README.md` 4).
//!
//! No magic, no ray count, no unit: 28 bytes of header, then 32 bytes per ray, mm and nm. The energy of a ray is relative; the
//! total in the header is shared out by it.

use super::binary::{Floats, Words, float, triple};
use super::bytes::{Cursor, f32_in};
use super::proof;
use super::record::{Bytes, Facts, Format, RawRay, RaySet, SpectralData, TotalRule};
use crate::error::Error;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::{Flux, LengthUnit};
use crate::vocabulary::wavelength::LIGHT_NM;
use std::sync::Arc;

/// Bytes of the header.
const HEADER: u64 = 28;
/// Bytes of a ray.
const RAY: u64 = 32;
/// Sizes of a record, bytes, that hold a ray and more: polarised rays have five more numbers.
const LARGER_RAYS: std::ops::RangeInclusive<u64> = 36..=64;

/// Opens a file of this format.
///
/// # Errors
/// As [`super::open`].
pub fn open(bytes: Arc<dyn Bytes>, limits: &Limits) -> Result<RaySet, Error> {
    let header = Cursor::new(bytes.as_ref(), 0).block("the header", HEADER)?;
    let ray_count = ray_count(bytes.as_ref())?;
    proof::count(ray_count, limits)?;
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
        proof::is_unit_at(ray, 12)
            && LIGHT_NM.contains(&f64::from(f32_in(ray, 24)))
            && energy.is_finite()
            && energy >= 0.0
    };
    whole && totals.iter().all(|total| total.is_finite() && *total >= 0.0) && rays.peek().is_some() && rays.all(fits)
}

/// How many rays the length and, where it leaves a doubt, the directions prove.
fn ray_count(bytes: &dyn Bytes) -> Result<u64, Error> {
    let length = bytes.len();
    let body = length.saturating_sub(HEADER);
    let holds = |size: u64| -> Result<bool, Error> {
        Ok(body.is_multiple_of(size) && proof::directions_hold(bytes, HEADER, size, body / size)?)
    };
    if body == 0 || holds(RAY)? {
        return Ok(body / RAY);
    }
    for size in LARGER_RAYS.step_by(4) {
        // The second ray is the first to tell the size.
        if body >= 2 * size && holds(size)? {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A file by `pipeline/formats/README.md` 4: W, five constants, lm, then rays.
    fn file(constant: f32, rays: &[&[f32]]) -> Vec<u8> {
        let header = [4.0, constant, constant, constant, constant, constant, 450.0];
        header.iter().chain(rays.iter().copied().flatten()).flat_map(|value| value.to_le_bytes()).collect()
    }

    const RAY: &[f32] = &[1.0, 2.0, 0.5, 0.6, 0.0, -0.8, 555.0, 0.25];
    /// Ellipse axis o p q and two numbers more.
    const POLARISED: &[f32] = &[1.0, 2.0, 0.5, 0.6, 0.0, -0.8, 555.0, 0.25, 1.0, 0.0, 0.0, 1.0, 0.0];

    fn opened(bytes: Vec<u8>) -> Result<(Facts, Vec<RawRay>), Error> {
        crate::formats::open(Arc::new(bytes), None, &Limits::default())?.read_all()
    }

    #[test]
    fn totals_are_the_headers_and_energies_are_relative() {
        let (facts, rays) = opened(file(2.0, &[RAY; 3])).unwrap();
        assert_eq!(facts.header_flux, Flux { radiant_w: Some(4.0), luminous_lm: Some(450.0) });
        assert_eq!((facts.format, facts.total_rule), (Format::Speos, TotalRule::Header));
        assert_eq!((facts.length_unit, facts.notices), (Some(LengthUnit::Millimetre), Notices::default()));
        let expected = RawRay {
            origin_mm: [1.0, 2.0, 0.5],
            direction: [0.6_f32, 0.0, -0.8].map(f64::from),
            radiant: 0.25,
            wavelength_nm: 555.0,
            ..RawRay::default()
        };
        assert_eq!(rays, [expected; 3]);
    }

    /// Old files have 0 lm; a file without any total is told.
    #[test]
    fn totals_may_be_missing() {
        for (watt, lumen, told) in [(4.0, 0.0, 0), (0.0, 450.0, 0), (0.0, 0.0, 1), (f32::NAN, -1.0, 1)] {
            let mut bytes = file(2.0, &[RAY]);
            bytes[..4].copy_from_slice(&f32::to_le_bytes(watt));
            bytes[24..28].copy_from_slice(&f32::to_le_bytes(lumen));
            let (facts, _) = opened(bytes).unwrap();
            assert_eq!(facts.header_flux.radiant_w.is_some(), watt > 0.0);
            assert_eq!(facts.header_flux.luminous_lm.is_some(), lumen > 0.0);
            assert_eq!(facts.notices.count_of("speos.no_total"), told);
        }
    }

    #[test]
    fn other_constants_need_rays_that_prove_the_layout() {
        let (facts, rays) = opened(file(3.0, &[RAY; 3])).unwrap();
        assert_eq!((facts.notices.count_of("speos.header_constants"), rays.len()), (1, 3));
        let off: [(usize, f32); 4] = [(5, 0.8001), (5, 0.9), (6, 50.0), (7, -1.0)];
        for ((k, value), read) in off.into_iter().zip([true, false, false, false]) {
            let mut ray = RAY.to_vec();
            ray[k] = value;
            assert_eq!(opened(file(3.0, &[RAY, &ray])).is_ok(), read, "{k} {value}");
        }
        assert_eq!(opened(file(3.0, &[])).unwrap_err().code(), "detect.unknown");
    }

    /// There is no count: a file cut between two rays is a shorter file. Any other cut is seen.
    #[test]
    fn every_prefix_is_refused_or_ends_between_rays() {
        let whole = file(2.0, &[RAY; 4]);
        for length in 0..whole.len() {
            match opened(whole[..length].to_vec()) {
                Ok((facts, _)) => assert_eq!(28 + 32 * facts.ray_count, length as u64),
                Err(error) if length > 28 => assert_eq!(error.code(), "speos.size", "{length}"),
                Err(error) => assert!(error.code().starts_with("detect."), "{length}: {error}"),
            }
            let _ = crate::formats::peek(&whole[..length], Some(whole.len() as u64), &Limits::default()).unwrap();
        }
    }

    #[test]
    fn polarised_rays_are_refused_by_name() {
        for count in [2, 8, 100] {
            let bytes = file(2.0, &vec![POLARISED; count]);
            assert_eq!(opened(bytes.clone()).unwrap_err().code(), "speos.polarised", "{count}");
            assert!(peek(&bytes, Some(bytes.len() as u64)).is_err());
        }
    }
}
