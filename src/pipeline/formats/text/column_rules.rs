//! What columns can be: declared by a user, or named by a file.

use super::rows::LINE_OF_LIGHT;
use crate::error::{Error, Fault, Place};
use crate::formats::record::{EQUAL_SHARES, EQUAL_SHARES_MESSAGE};
use crate::vocabulary::declaration::Column;
use crate::vocabulary::notice::Notices;

/// Where a user says what columns hold.
pub const DECLARED: Place = Place::Channel(0, "columns");
/// What to do where the file and we do not agree on its columns.
pub const DECLARE: &str = "Declare what each column holds: x, y, z, l, m, n, a flux, and \"ignored\" for the rest.";
/// What to do where no column holds flux.
pub const DECLARE_WITHOUT_FLUX: &str = "Declare what each column holds: x, y, z, l, m, n, a flux, and \"ignored\" for the rest. If there is \
     no flux among them, declare them without one, and the flux of the whole: every ray then has an equal share of it.";
/// The same error; what it misses may stand under a name that is not known.
pub fn with_names(error: Error, unknown: &str) -> Error {
    match error {
        Error::Unusable(fault) if fault.code == "columns.missing" && !unknown.is_empty() => {
            let found = format!("{} Names that are not known: {unknown}.", fault.found);
            Error::Unusable(Fault { found, ..fault })
        }
        other => other,
    }
}

/// One of them is a flux.
pub fn has_flux(columns: &[Column]) -> bool {
    columns.iter().any(|column| matches!(column, Column::Flux | Column::RadiantFlux | Column::LuminousFlux))
}

/// Columns that are declared of a format whose header has a word on the flux, and that word where they have none: lm or not.
///
/// # Errors
/// As [`judge`].
pub fn under_header(columns: &[Column], luminous: Option<bool>) -> Result<(Vec<Column>, Option<bool>), Error> {
    judge(columns, true)?;
    let has = |column: Column| columns.contains(&column);
    let luminous = match (has(Column::RadiantFlux), has(Column::LuminousFlux)) {
        (_, true) => Some(true),
        (true, false) => Some(false),
        _ if has(Column::Flux) => luminous,
        _ => None,
    };
    let flux = if luminous == Some(true) { Column::LuminousFlux } else { Column::RadiantFlux };
    let columns = columns.iter().map(|column| if *column == Column::Flux { flux } else { *column });
    Ok((columns.collect(), luminous))
}

/// Tells that rays have no flux, where these columns have none.
pub fn tell_equal_shares(columns: &[Column], notices: &mut Notices) {
    if !has_flux(columns) {
        notices.add(EQUAL_SHARES, EQUAL_SHARES_MESSAGE);
    }
}

/// All that a ray needs is there, and nothing twice. Only who declares the columns can leave the flux out.
///
/// # Errors
/// `columns.missing`, `columns.twice`.
pub fn judge(columns: &[Column], declared: bool) -> Result<(), Error> {
    let count = |column: Column| columns.iter().filter(|other| **other == column).count();
    let fluxes = [Column::Flux, Column::RadiantFlux, Column::LuminousFlux].map(count);
    let missing: Vec<&str> = LINE_OF_LIGHT
        .into_iter()
        .filter(|column| count(*column) == 0)
        .map(Column::name)
        .chain((!declared && fluxes == [0; 3]).then_some("flux"))
        .collect();
    if !missing.is_empty() {
        let found = format!("No column holds {}.", missing.join(", "));
        return Err(Error::invalid_declaration("columns.missing", DECLARED, found, DECLARE_WITHOUT_FLUX));
    }
    let waves = count(Column::WavelengthNm) + count(Column::WavelengthUm);
    let unit_known = fluxes[1] + fluxes[2];
    let twice = Column::ALL.into_iter().find(|column| *column != Column::Ignored && count(*column) > 1);
    if twice.is_some() || waves > 1 || (fluxes[0] > 0 && unit_known > 0) {
        let what = twice.map_or(if waves > 1 { "a wavelength" } else { "a flux" }, Column::name);
        let found = format!("More than one column holds {what}.");
        return Err(Error::invalid_declaration("columns.twice", DECLARED, found, DECLARE));
    }
    Ok(())
}
