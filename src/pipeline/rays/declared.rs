//! What a user says of a ray file, before the file's own word: vendors leave units out, write wrong totals, and keep the
//! spectrum in another file.

use super::conversion::Conversion;
use crate::error::Error;
use crate::formats;
use crate::formats::record::{Bytes, Facts, RawRay, RaySet, Records, SpectralData};
use crate::formats::record::{CHUNK_RAYS, DEFAULT_UNIT, EQUAL_SHARES, SPECTRUM_UNREADABLE, TOTAL_UNREADABLE};
use crate::vocabulary::declaration::Declared;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::spectrum::Table;
use crate::vocabulary::units::{Flux, LengthUnit, Quantity};
use std::sync::Arc;

/// Opens one ray file and applies what was declared of it.
///
/// # Errors
/// As [`formats::open`] and [`apply_declaration`]; [`Error::Unusable`] for a declaration that cannot be right.
pub fn open(bytes: Arc<dyn Bytes>, declared: &Declared, limits: &Limits) -> Result<RaySet, Error> {
    apply(formats::open(bytes, declared.columns.as_deref(), limits)?, declared)
}

/// The ray set as its user says it is.
///
/// # Errors
/// As [`apply_declaration`].
fn apply(set: RaySet, declared: &Declared) -> Result<RaySet, Error> {
    let RaySet { mut facts, records } = set;
    let Correction { scale, moved } = apply_declaration(&mut facts, declared)?;
    let equal = match declared.flux {
        Some(flux) if all_without_flux(records.as_ref(), facts.ray_count)? => {
            Some(share_equally(&mut facts, flux.quantity()))
        }
        _ => None,
    };
    if scale == 1.0 && !moved && equal.is_none() {
        return Ok(RaySet { facts, records });
    }
    Ok(RaySet { facts, records: Box::new(Corrected { records, scale, moved, equal }) })
}

/// Whether no ray carries any flux. Mostly the first one does.
fn all_without_flux(records: &dyn Records, ray_count: u64) -> Result<bool, Error> {
    let mut rays = Vec::new();
    let (mut first, mut count) = (0, 1);
    while first < ray_count {
        count = (ray_count - first).min(count);
        rays.clear();
        records.read(first, count as usize, &mut rays)?;
        if rays.iter().any(|ray| ray.radiant != 0.0 || ray.luminous != 0.0) {
            return Ok(false);
        }
        (first, count) = (first + count, CHUNK_RAYS as u64);
    }
    Ok(ray_count > 0)
}

/// Rays without flux have equal shares of what is declared, in its quantity unless they carry another one alone; the quantity that
/// they carry then. Totals in the header are those of no ray.
fn share_equally(facts: &mut Facts, declared: Quantity) -> Quantity {
    let quantity = stored(facts).unwrap_or(declared);
    (facts.has_radiant, facts.has_luminous) = (quantity == Quantity::Radiant, quantity == Quantity::Luminous);
    facts.header_flux = Flux::default();
    if facts.spectral == SpectralData::Tristimulus {
        facts.spectral = SpectralData::None;
    }
    facts.notices.add(EQUAL_SHARES, "No ray of the file has flux: every ray has an equal share of the declared flux.");
    quantity
}

/// What records need so that they are what the facts say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction {
    /// Factor of the positions.
    scale: f64,
    /// Radiant and luminous values change places.
    moved: bool,
}

/// Makes the facts what their user says they are: unit, quantity, spectrum, and the quantity of the flux.
///
/// # Errors
/// `rays.columns_not_text` where columns are declared of a format that has its own, `rays.quantity_both` where a quantity is
/// declared of a file that carries both, `rays.quantity_known` where the file's own spectrum tells it, `rays.flux_impossible`.
pub fn apply_declaration(facts: &mut Facts, declared: &Declared) -> Result<Correction, Error> {
    declared.validate()?;
    if declared.columns.is_some() && !facts.format.is_text() {
        let found = format!(
            "Columns are declared of a file in {}, which says itself where its numbers stand.",
            facts.format.name()
        );
        let refused = Error::refused("rays.columns_not_text", found, "Leave the columns out.");
        return Err(refused.at_channel(0, "columns"));
    }
    if declared.length_unit.is_some() {
        facts.notices.take_out(DEFAULT_UNIT);
    }
    let scale = apply_unit(facts, declared.length_unit);
    let mut moved = apply_quantity(facts, declared)?;
    if let Some(table) = &declared.spectrum {
        apply_spectrum(facts, table);
    }
    if let Some(flux) = declared.flux {
        if let Some(unread) = facts.notices.take_out(TOTAL_UNREADABLE) {
            facts.notices.add("rays.total_replaced", format!("{} As declared, another was used.", unread.message));
        }
        moved ^= apply_for_flux(facts, flux.quantity(), declared.quantity.is_none());
    }
    Ok(Correction { scale, moved })
}

fn apply_unit(facts: &mut Facts, declared: Option<LengthUnit>) -> f64 {
    let Some(unit) = declared else { return 1.0 };
    if let Some(stored) = facts.length_unit.filter(|stored| *stored != unit) {
        let told =
            format!("The file says {}; as declared, its lengths were read in {}.", stored.symbol(), unit.symbol());
        facts.notices.add("rays.unit_replaced", told);
    }
    let stored_mm = facts.length_unit.map_or(1.0, LengthUnit::mm);
    facts.length_unit = Some(unit);
    unit.mm() / stored_mm
}

/// True when the values move to the other quantity.
fn apply_quantity(facts: &mut Facts, declared: &Declared) -> Result<bool, Error> {
    let Some(quantity) = declared.quantity else { return Ok(false) };
    let unknown = std::mem::take(&mut facts.quantity_unknown);
    let Some(stored) = stored(facts) else {
        let found = "The file carries W and lm for every ray; there is nothing to declare.";
        return Err(Error::refused("rays.quantity_both", found, "Leave the quantity out.").at_channel(0, "quantity"));
    };
    if stored == quantity {
        return Ok(false);
    }
    if !unknown {
        let read = read_as(facts, declared, [stored, quantity])?;
        let told = format!("The file says {}; as declared, its values were read as {read}.", stored.unit());
        facts.notices.add("rays.quantity_replaced", told);
    }
    shift(facts);
    Ok(true)
}

/// As what the values are read where the file says the first quantity and its user the second one. 2.4 W are never 2.4 lm by a word alone: the
/// file's own total in the declared quantity holds, and where its spectrum tells that quantity of each ray, only who also says the flux, or a
/// share of it, can mean other numbers.
fn read_as(facts: &Facts, declared: &Declared, [stored, quantity]: [Quantity; 2]) -> Result<String, Error> {
    let [own, other] = [stored.unit(), quantity.unit()];
    if declared.flux.is_some() {
        return Ok(other.to_owned());
    }
    let per_ray = matches!(facts.spectral, SpectralData::Wavelength | SpectralData::Tables(_));
    let total = facts.header_flux.of(quantity).filter(|_| !per_ray || declared.spectrum.is_some());
    if let Some(total) = total {
        return Ok(format!("shares of its own total of {total} {other}"));
    }
    let conversion = Conversion::of(facts);
    let by_file = match quantity {
        Quantity::Radiant => conversion.knows_radiant(),
        Quantity::Luminous => conversion.knows_luminous(),
    };
    let by_table = |table: &Table| quantity == Quantity::Luminous || table.lm_per_w() > 0.0;
    if declared.spectrum.as_ref().map_or(by_file, by_table) {
        let found = format!(
            "The file's values are in {own}, and its spectrum gives {other} too: the model has both, whatever is declared. Read as \
             {other}, the same numbers would be another light."
        );
        let remedy = format!(
            "Leave the quantity out. If the file is wrong and its values are {other}, declare the quantity and the flux of its channel together (in {other})."
        );
        return Err(Error::refused("rays.quantity_known", found, remedy).at_channel(0, "quantity"));
    }
    Ok(format!("{other}, and {own} are unknown"))
}

/// The declared table holds, and its lm/W: the header's, and the lm of rays that have W too, came from a spectrum that no longer
/// does.
fn apply_spectrum(facts: &mut Facts, table: &Table) {
    if let Some(unread) = facts.notices.take_out(SPECTRUM_UNREADABLE) {
        facts.notices.add("rays.spectrum_replaced", format!("{} As declared, another was used.", unread.message));
    } else if facts.spectral != SpectralData::None {
        let told = "The file has a spectrum of its own; as declared, another was used in its place.";
        facts.notices.add("rays.spectrum_replaced", told);
    }
    facts.spectral = SpectralData::Table(table.clone());
    if facts.has_radiant && facts.has_luminous {
        facts.has_luminous = false;
        facts.header_flux.luminous_lm = None;
    }
    if let Some(quantity) = stored(facts)
        && let own @ Some(_) = facts.header_flux.of(quantity)
    {
        facts.header_flux = Flux::only(quantity, own);
    }
}

/// A flux in a quantity that neither the rays nor a spectrum gives makes their values relative weights of it; it also answers
/// what the values are, where nobody else does.
fn apply_for_flux(facts: &mut Facts, quantity: Quantity, may_answer: bool) -> bool {
    let unknown = may_answer && std::mem::take(&mut facts.quantity_unknown);
    let Some(stored) = stored(facts).filter(|stored| *stored != quantity) else { return false };
    if !unknown {
        let conversion = Conversion::of(facts);
        let known = match quantity {
            Quantity::Radiant => conversion.knows_radiant(),
            Quantity::Luminous => conversion.knows_luminous(),
        };
        if known {
            return false;
        }
        let told = format!(
            "The rays are in {0}, the declared flux is in {1}, and no spectrum connects them: the rays' values were taken as \
             relative weights of {1}, and {0} are unknown.",
            stored.unit(),
            quantity.unit()
        );
        facts.notices.add("rays.relative_weights", told);
    }
    shift(facts);
    true
}

/// The one quantity that rays carry; `None` where they carry both.
fn stored(facts: &Facts) -> Option<Quantity> {
    match (facts.has_radiant, facts.has_luminous) {
        (true, true) => None,
        (true, false) => Some(Quantity::Radiant),
        (false, _) => Some(Quantity::Luminous),
    }
}

/// The values of a file that carries one quantity are of the other, and so is the header's total of them where it has none of the other.
fn shift(facts: &mut Facts) {
    let Some(from) = stored(facts) else { return };
    let to = from.other();
    if facts.header_flux.of(to).is_none() {
        facts.header_flux = Flux::only(to, facts.header_flux.of(from));
    }
    (facts.has_radiant, facts.has_luminous) = (to == Quantity::Radiant, to == Quantity::Luminous);
    if facts.spectral == SpectralData::Tristimulus {
        facts.spectral = SpectralData::None;
    }
}

/// Records with what was declared of them.
struct Corrected {
    records: Box<dyn Records>,
    scale: f64,
    moved: bool,
    /// Every ray has 1 of this.
    equal: Option<Quantity>,
}

impl Records for Corrected {
    fn read(&self, first: u64, count: usize, rays: &mut Vec<RawRay>) -> Result<(), Error> {
        let start = rays.len();
        self.records.read(first, count, rays)?;
        for ray in rays.iter_mut().skip(start) {
            ray.origin_mm = ray.origin_mm.map(|value| value * self.scale);
            if self.moved {
                std::mem::swap(&mut ray.radiant, &mut ray.luminous);
            }
            match self.equal {
                Some(Quantity::Radiant) => ray.radiant = 1.0,
                Some(Quantity::Luminous) => ray.luminous = 1.0,
                None => {}
            }
        }
        Ok(())
    }
}
