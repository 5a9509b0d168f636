//! What a client declares of a ray file, as sent and as stored.

use pipeline::{Declared, Error, Place, Quantity};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What the client declared about a ray file when it was uploaded. Declarations override what the file says; a channel of a job
/// overrides them in turn.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FileDeclaration {
    /// Length unit of the ray positions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_unit: Option<LengthUnit>,
    /// Whether the flux values are radiant (W) or luminous (lm).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quantity: Option<QuantityName>,
    /// The meaning of each column, for text files only; names as in a channel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(max_items = 64, example = json!(["x", "y", "z", "l", "m", "n", "flux"]))]
    pub columns: Option<Vec<String>>,
}

/// A unit of length.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "the names say it")]
pub enum LengthUnit {
    Nm,
    Um,
    Mm,
    Cm,
    M,
    In,
    Ft,
}

/// Whether a flux is radiant (W) or luminous (lm).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = Quantity)]
#[serde(rename_all = "lowercase")]
pub enum QuantityName {
    /// W.
    Radiant,
    /// lm.
    Luminous,
}

impl FileDeclaration {
    /// The pipeline's own words for it.
    ///
    /// # Errors
    /// `rays.column_unknown`.
    pub fn resolve(&self) -> Result<Declared, Error> {
        Ok(Declared {
            length_unit: self.length_unit.map(LengthUnit::unit),
            quantity: self.quantity.map(QuantityName::quantity),
            columns: self.columns.as_deref().map(|names| columns(0, names)).transpose()?,
            ..Declared::default()
        })
    }
}

impl LengthUnit {
    /// The pipeline's own word for it.
    pub fn unit(self) -> pipeline::LengthUnit {
        match self {
            LengthUnit::Nm => pipeline::LengthUnit::Nanometre,
            LengthUnit::Um => pipeline::LengthUnit::Micrometre,
            LengthUnit::Mm => pipeline::LengthUnit::Millimetre,
            LengthUnit::Cm => pipeline::LengthUnit::Centimetre,
            LengthUnit::M => pipeline::LengthUnit::Metre,
            LengthUnit::In => pipeline::LengthUnit::Inch,
            LengthUnit::Ft => pipeline::LengthUnit::Foot,
        }
    }
}

impl QuantityName {
    /// The pipeline's own word for it.
    pub fn quantity(self) -> Quantity {
        match self {
            QuantityName::Radiant => Quantity::Radiant,
            QuantityName::Luminous => Quantity::Luminous,
        }
    }
}

/// The columns of these names. `index`: the place of the channel in its source.
///
/// # Errors
/// `rays.column_unknown`.
pub fn columns(index: usize, names: &[String]) -> Result<Vec<pipeline::Column>, Error> {
    let column = |name: &String| {
        pipeline::Column::from_name(name).ok_or_else(|| {
            let known = pipeline::Column::ALL.map(pipeline::Column::name).join(", ");
            let place = Place::Channel(index, "columns");
            let found = format!("The column {name:?} is not known.");
            Error::invalid_declaration("rays.column_unknown", place, found, format!("Name each column one of {known}."))
        })
    };
    names.iter().map(column).collect()
}
