//! Wavelengths of rays that stand in another unit than their format has: the values tell, because nm and µm of light do not
//! overlap. The first rays decide; those that differ are refused one by one (`rays/check.rs`).

use super::record::{RawRay, RaySet, Records, SpectralData};
use crate::error::Error;
use crate::vocabulary::wavelength::{LIGHT_NM, NM_PER_UM};

/// Rays looked at.
const PROOF_RAYS: u64 = 64;

/// The same rays, their wavelengths in nm, with a notice where they had to be converted.
pub fn in_nm(set: RaySet) -> RaySet {
    if set.facts.spectral != SpectralData::Wavelength {
        return set;
    }
    let mut first = Vec::new();
    if set.records.read(0, set.facts.ray_count.min(PROOF_RAYS) as usize, &mut first).is_err() {
        // What is wrong with them is told where they are read.
        return set;
    }
    let values: Vec<f64> = first.iter().map(|ray| ray.wavelength_nm).filter(|nm| nm.is_finite()).collect();
    let all_light = |factor: f64| !values.is_empty() && values.iter().all(|value| LIGHT_NM.contains(&(value * factor)));
    let (factor, found) = match () {
        () if all_light(1.0) => return set,
        () if all_light(NM_PER_UM) => (NM_PER_UM, "\u{b5}m where nm belong"),
        () if all_light(1.0 / NM_PER_UM) => (1.0 / NM_PER_UM, "nm where \u{b5}m belong"),
        () => return set,
    };
    let RaySet { mut facts, records } = set;
    let told =
        format!("The wavelengths of the rays stand in {found}: by their size they are light; they were read as such.");
    facts.notices.add("rays.wavelength_unit", told);
    RaySet { facts, records: Box::new(Rescaled { records, factor }) }
}

/// Records whose wavelengths are multiplied.
struct Rescaled {
    records: Box<dyn Records>,
    factor: f64,
}

impl Records for Rescaled {
    fn read(&self, first: u64, count: usize, rays: &mut Vec<RawRay>) -> Result<(), Error> {
        let start = rays.len();
        self.records.read(first, count, rays)?;
        rays.iter_mut().skip(start).for_each(|ray| ray.wavelength_nm *= self.factor);
        Ok(())
    }
}
