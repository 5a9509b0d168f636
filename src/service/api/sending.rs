//! The queries that files are sent with, a name and how to read a ray file that does not say, and those they are found by.

use super::super::jobs::channels::{FileDeclaration, LengthUnit, QuantityName};
use super::super::metadata::Metadata;
use super::super::upload::in_query;
use super::extract::Page;
use super::problem::Problem;
use serde::Deserialize;

/// How an upload is called.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Naming {
    /// What to call it; goes before `Content-Disposition`, decides nothing.
    #[param(max_length = 255)]
    pub name: Option<String>,
}

/// How a ray file is called, and what is declared of it or of every file in it.
#[derive(Debug, Default, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Sending {
    /// What to call it; goes before `Content-Disposition`, decides nothing.
    #[param(max_length = 255)]
    pub name: Option<String>,
    /// Unit of its positions; goes before the file's own word.
    length_unit: Option<LengthUnit>,
    /// What its flux values are, W or lm; goes before the file's own word.
    quantity: Option<QuantityName>,
    /// What stands in each column, for text in columns only, with commas between: x, y, z, l, m, n, flux, radiant_flux,
    /// luminous_flux, wavelength_nm, wavelength_um, tristimulus_x, tristimulus_z, ignored.
    #[param(example = "x,y,z,l,m,n,flux")]
    columns: Option<String>,
    /// The client's own keys and values, as a JSON object of texts: at most 16 and 4096 bytes in all; keys of 1 to 64 of A-Z, a-z,
    /// 0-9, _, . and -; values of at most 512 characters. Every ray set that comes of it has them.
    #[param(value_type = Option<String>, example = "{\"order\":\"4711\"}")]
    #[serde(default, deserialize_with = "Metadata::from_text")]
    pub metadata: Metadata,
}

impl Sending {
    /// What it declares.
    ///
    /// # Errors
    /// `rays.column_unknown`.
    pub fn declaration(&self) -> Result<FileDeclaration, Problem> {
        let columns = self.columns.as_ref().map(|list| list.split(',').map(|name| name.trim().to_owned()).collect());
        let declared = FileDeclaration { length_unit: self.length_unit, quantity: self.quantity, columns };
        declared.resolve().map_err(in_query)?;
        Ok(declared)
    }
}

/// A page of the list of ray sets.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct RaySetPage {
    /// Only those called so.
    pub name: Option<String>,
    /// Only those of these bytes: is the file here already?
    #[param(pattern = "^[0-9A-Fa-f]{64}$")]
    pub sha256: Option<String>,
    /// Only those whose metadata has all of these keys and values: a JSON object of texts.
    #[param(value_type = Option<String>, example = "{\"order\":\"4711\"}")]
    #[serde(default, deserialize_with = "Metadata::from_text")]
    pub metadata: Metadata,
    /// Most entries to answer.
    #[param(minimum = 1, maximum = 100, default = 20)]
    #[serde(default = "Page::default_limit")]
    pub limit: u32,
    /// The `next` of the page before.
    pub after: Option<String>,
}
