//! What a user declares of a ray file, before the file's own word.

use super::spectrum::Table;
use super::units::{Flux, LengthUnit, Quantity};
use crate::error::{Error, Place};
use schemars::JsonSchema;
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
    /// What stands in each column; for text only, in place of what its header says of its rows.
    pub columns: Option<Vec<Column>>,
    /// The spectrum of its light, in place of the file's.
    pub spectrum: Option<Table>,
    /// Its total flux, in place of the file's.
    pub flux: Option<FluxOverride>,
}

/// A channel's flux as the user has it from a data sheet. It fixes the total of its own quantity. Where the channel knows the
/// other quantity too, that scales along: lm/W stays. Where it does not (rays in lm, no spectrum, flux in W), the rays' values
/// become relative weights of the quantity that was given, and the other one is unknown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FluxOverride {
    /// Radiant flux, W.
    RadiantW(#[schemars(extend("exclusiveMinimum" = 0))] f64),
    /// Luminous flux, lm.
    LuminousLm(#[schemars(extend("exclusiveMinimum" = 0))] f64),
    /// Share of the source's radiant flux, 0..=1.
    RadiantShare(#[schemars(extend("exclusiveMinimum" = 0))] f64),
    /// Share of the source's luminous flux, 0..=1.
    LuminousShare(#[schemars(extend("exclusiveMinimum" = 0))] f64),
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
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Total {
    /// Radiant flux, W.
    RadiantW(#[schemars(extend("exclusiveMinimum" = 0))] f64),
    /// Luminous flux, lm.
    LuminousLm(#[schemars(extend("exclusiveMinimum" = 0))] f64),
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
        if Flux::MODELLED.contains(&value) {
            return Ok(());
        }
        let told =
            if (1e-3..1e6).contains(&value.abs()) || value == 0.0 { value.to_string() } else { format!("{value:e}") };
        let found = format!("The declared flux is {told} {}.", self.quantity().unit());
        let remedy = "Declare a positive number, from 1e-20 to 1e24.";
        Err(Error::invalid_declaration("rays.flux_impossible", place, found, remedy))
    }
}

/// What a column of a text file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
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
                Err(Error::invalid_declaration("rays.flux_impossible", FLUX, found, remedy))
            }
            _ => Ok(()),
        }
    }
}

/// The flux of a channel whose place in the source is not known yet.
const FLUX: Place = Place::Channel(0, "flux");
