//! What a user says of a ray file, before the file's own word: vendors leave units out, write wrong totals, and keep the
//! spectrum in another file (`USERS.md` 1, 2, 8 to 10).

use super::super::Error;
use super::super::vocabulary::spectrum::Table;
use super::super::vocabulary::units::{LengthUnit, Quantity};
use super::{RawRay, RaySet, Records, SpectralData};
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

/// A channel's flux as the user has it from a data sheet.
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

/// The ray set as its user says it is.
///
/// # Errors
/// `rays.columns_not_text` where columns are declared of a format that has its own.
pub fn obey(mut set: RaySet, declared: &Declared) -> Result<RaySet, Error> {
    let stored_mm = set.facts.length_unit.map_or(1.0, LengthUnit::mm);
    let scale = declared.length_unit.map_or(1.0, |unit| unit.mm() / stored_mm);
    set.facts.length_unit = declared.length_unit.or(set.facts.length_unit);
    let stored_radiant = set.facts.has_radiant;
    let moved = declared.quantity.is_some_and(|quantity| {
        (set.facts.has_radiant != set.facts.has_luminous) && (quantity == Quantity::Radiant) != stored_radiant
    });
    if declared.quantity.is_some() {
        set.facts.quantity_unknown = false;
    }
    if moved {
        (set.facts.has_radiant, set.facts.has_luminous) = (set.facts.has_luminous, set.facts.has_radiant);
    }
    if let Some(table) = &declared.spectrum {
        set.facts.spectral = SpectralData::Table(table.clone());
    }
    if scale != 1.0 || moved {
        set.records = Box::new(Corrected { records: set.records, scale, moved });
    }
    Ok(set)
}

/// Records with what was declared of them.
struct Corrected {
    records: Box<dyn Records>,
    /// Factor of the positions.
    scale: f64,
    /// Radiant and luminous values change places.
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
