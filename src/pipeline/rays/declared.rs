//! What a user says of a ray file, before the file's own word: vendors leave units out, write wrong totals, and keep the
//! spectrum in another file (`USERS.md` 1, 2, 8 to 10).

use super::super::vocabulary::spectrum::Table;
use super::super::vocabulary::units::{Flux, LengthUnit, Quantity};
use super::super::{Error, error::Place};
use super::conversion::Conversion;
use super::{Facts, Format, RawRay, RaySet, Records, SpectralData};
use serde::Serialize;

/// What a user says of one ray file. `Default` says nothing.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Declared {
    /// What the channel is called in the report; default: the file's name.
    pub name: Option<String>,
    /// Length unit of its positions, in place of the file's.
    pub length_unit: Option<LengthUnit>,
    /// What its flux values are, in place of the file's word.
    pub quantity: Option<Quantity>,
    /// What stands in each column; for text in columns only.
    pub columns: Option<Vec<Column>>,
    /// The spectrum of its light, in place of the file's.
    pub spectrum: Option<Table>,
    /// Its total flux, in place of the file's.
    pub flux: Option<FluxOverride>,
}

/// A channel's flux as the user has it from a data sheet. It fixes the total of its own quantity. Where the channel knows the
/// other quantity too, that scales along: lm/W stays. Where it does not (rays in lm, no spectrum, flux in W), the rays' values
/// become relative weights of the quantity that was given, and the other one is unknown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FluxOverride {
    /// Radiant flux, W.
    RadiantW(f64),
    /// Luminous flux, lm.
    LuminousLm(f64),
    /// Share of the source's radiant flux, 0..=1.
    RadiantShare(f64),
    /// Share of the source's luminous flux, 0..=1.
    LuminousShare(f64),
}

impl FluxOverride {
    /// What it fixes.
    pub fn quantity(self) -> Quantity {
        match self {
            FluxOverride::RadiantW(_) | FluxOverride::RadiantShare(_) => Quantity::Radiant,
            FluxOverride::LuminousLm(_) | FluxOverride::LuminousShare(_) => Quantity::Luminous,
        }
    }

    /// The share, if it is one.
    pub fn share(self) -> Option<f64> {
        match self {
            FluxOverride::RadiantShare(share) | FluxOverride::LuminousShare(share) => Some(share),
            FluxOverride::RadiantW(_) | FluxOverride::LuminousLm(_) => None,
        }
    }
}

/// A total flux: that of a source whose channels carry shares, or what a channel's override comes to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Total {
    /// Radiant flux, W.
    RadiantW(f64),
    /// Luminous flux, lm.
    LuminousLm(f64),
}

impl Total {
    /// What an override comes to; `source`: the source's total, for shares.
    pub fn from_override(flux: FluxOverride, source: f64) -> Total {
        match flux {
            FluxOverride::RadiantW(value) => Total::RadiantW(value),
            FluxOverride::LuminousLm(value) => Total::LuminousLm(value),
            FluxOverride::RadiantShare(share) => Total::RadiantW(share * source),
            FluxOverride::LuminousShare(share) => Total::LuminousLm(share * source),
        }
    }

    /// What it is a total of.
    pub fn quantity(self) -> Quantity {
        match self {
            Total::RadiantW(_) => Quantity::Radiant,
            Total::LuminousLm(_) => Quantity::Luminous,
        }
    }

    /// W or lm.
    pub fn value(self) -> f64 {
        match self {
            Total::RadiantW(value) | Total::LuminousLm(value) => value,
        }
    }

    /// Whether it can be a flux.
    ///
    /// # Errors
    /// `rays.flux_impossible` at `place`.
    pub fn validate(self, place: Place) -> Result<(), Error> {
        let value = self.value();
        if value > 0.0 && value.is_finite() {
            return Ok(());
        }
        let found = format!("The declared flux is {value} {}.", self.quantity().unit());
        Err(Error::undeclarable("rays.flux_impossible", place, found, "Declare a positive number."))
    }
}

/// What a column of a text file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Column {
    /// Start.
    X,
    /// Start.
    Y,
    /// Start.
    Z,
    /// Direction cosine along x.
    L,
    /// Direction cosine along y.
    M,
    /// Direction cosine along z.
    N,
    /// Flux, W or lm as the file or the user says.
    Flux,
    /// Radiant flux, W.
    RadiantFlux,
    /// Luminous flux, lm.
    LuminousFlux,
    /// Wavelength, nm.
    WavelengthNm,
    /// Wavelength, µm.
    WavelengthUm,
    /// Tristimulus X.
    TristimulusX,
    /// Tristimulus Z.
    TristimulusZ,
    /// Something else.
    Ignored,
}

impl Column {
    /// All, in the order of a ray.
    pub const ALL: [Column; 14] = [
        Column::X,
        Column::Y,
        Column::Z,
        Column::L,
        Column::M,
        Column::N,
        Column::Flux,
        Column::RadiantFlux,
        Column::LuminousFlux,
        Column::WavelengthNm,
        Column::WavelengthUm,
        Column::TristimulusX,
        Column::TristimulusZ,
        Column::Ignored,
    ];

    /// Its name in options and answers.
    pub fn name(self) -> &'static str {
        match self {
            Column::X => "x",
            Column::Y => "y",
            Column::Z => "z",
            Column::L => "l",
            Column::M => "m",
            Column::N => "n",
            Column::Flux => "flux",
            Column::RadiantFlux => "radiant_flux",
            Column::LuminousFlux => "luminous_flux",
            Column::WavelengthNm => "wavelength_nm",
            Column::WavelengthUm => "wavelength_um",
            Column::TristimulusX => "tristimulus_x",
            Column::TristimulusZ => "tristimulus_z",
            Column::Ignored => "ignored",
        }
    }

    /// The column of this name.
    pub fn from_name(name: &str) -> Option<Column> {
        Column::ALL.into_iter().find(|column| column.name() == name)
    }
}

impl Declared {
    /// Whether its flux can be meant; shares only alone, not what they come to together.
    ///
    /// # Errors
    /// `rays.flux_impossible`.
    pub fn validate(&self) -> Result<(), Error> {
        match self.flux {
            Some(FluxOverride::RadiantW(value)) => Total::RadiantW(value).validate(FLUX),
            Some(FluxOverride::LuminousLm(value)) => Total::LuminousLm(value).validate(FLUX),
            Some(FluxOverride::RadiantShare(share) | FluxOverride::LuminousShare(share))
                if !(share > 0.0 && share <= 1.0) =>
            {
                let found = format!("The declared share is {share}.");
                let remedy = "Declare a share above 0 and at most 1; leave a channel without light out.";
                Err(Error::undeclarable("rays.flux_impossible", FLUX, found, remedy))
            }
            _ => Ok(()),
        }
    }
}

/// The flux of a channel whose place in the source is not known yet.
const FLUX: Place = Place::Channel(0, "flux");

/// The ray set as its user says it is.
///
/// # Errors
/// As [`amend`].
pub fn obey(set: RaySet, declared: &Declared) -> Result<RaySet, Error> {
    let RaySet { mut facts, records } = set;
    let Correction { scale, moved } = amend(&mut facts, declared)?;
    if scale == 1.0 && !moved {
        return Ok(RaySet { facts, records });
    }
    Ok(RaySet { facts, records: Box::new(Corrected { records, scale, moved }) })
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
/// declared of a file that carries both, `rays.flux_impossible`.
pub fn amend(facts: &mut Facts, declared: &Declared) -> Result<Correction, Error> {
    declared.validate()?;
    if declared.columns.is_some() && facts.format != Format::Columns {
        let found = format!(
            "Columns are declared of a file in {}, which says itself where its numbers stand.",
            facts.format.name()
        );
        let refused = Error::refused("rays.columns_not_text", found, "Leave the columns out.");
        return Err(refused.at_channel(0, "columns"));
    }
    let scale = amend_unit(facts, declared.length_unit);
    let mut moved = amend_quantity(facts, declared.quantity)?;
    if let Some(table) = &declared.spectrum {
        amend_spectrum(facts, table);
    }
    if let Some(flux) = declared.flux {
        moved ^= amend_for_flux(facts, flux.quantity(), declared.quantity.is_none());
    }
    Ok(Correction { scale, moved })
}

fn amend_unit(facts: &mut Facts, declared: Option<LengthUnit>) -> f64 {
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
fn amend_quantity(facts: &mut Facts, declared: Option<Quantity>) -> Result<bool, Error> {
    let Some(quantity) = declared else { return Ok(false) };
    let unknown = std::mem::take(&mut facts.quantity_unknown);
    match stored(facts) {
        None => {
            let found = "The file carries W and lm for every ray; there is nothing to declare.";
            Err(Error::refused("rays.quantity_both", found, "Leave the quantity out.").at_channel(0, "quantity"))
        }
        Some(stored) if stored == quantity => Ok(false),
        Some(stored) => {
            if !unknown {
                let told = format!(
                    "The file says {}; as declared, its values were read as {}.",
                    stored.unit(),
                    quantity.unit()
                );
                facts.notices.add("rays.quantity_replaced", told);
            }
            shift(facts);
            Ok(true)
        }
    }
}

/// The declared table holds, and its lm/W: the header's, and the lm of rays that have W too, came from a spectrum that no longer
/// does.
fn amend_spectrum(facts: &mut Facts, table: &Table) {
    if facts.spectral != SpectralData::None {
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
fn amend_for_flux(facts: &mut Facts, quantity: Quantity, may_answer: bool) -> bool {
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

/// The values of a file that carries one quantity are of the other, and so is the header's total of them.
fn shift(facts: &mut Facts) {
    let Some(from) = stored(facts) else { return };
    let to = from.other();
    let header = facts.header_flux;
    facts.header_flux = Flux::only(to, header.of(from).or(header.of(to)));
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
        }
        Ok(())
    }
}
