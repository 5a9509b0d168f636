//! What stands before the rays of a TM-25 file: it can hold all that any format we read says of rays.

use super::labels::{called, text, total};
use crate::error::Error;
use crate::formats::record::{Facts, Format, SpectralData};
use crate::formats::tm25::Preamble;
use crate::formats::tm25::additional::Additional;
use crate::formats::tm25::header::{Flags, Header, SpectralId, TEXT_NAMES};
use crate::formats::tm25::spectra::Spectra;
use crate::rays::Input;
use crate::source::Channel;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::spectrum::{Table, wider};

/// Creation method where the file does not say: neither a simulation (0) nor a measurement (1); ams OSRAM writes the same.
const METHOD_UNKNOWN: i32 = -1;

/// Header, tables and texts for the rays of `channel`.
///
/// # Errors
/// `convert.table_too_fine`.
pub fn preamble(input: &Input, channel: &Channel, notices: &mut Notices) -> Result<Preamble, Error> {
    let facts = channel.facts();
    let points = tables(facts.spectral.tables())?;
    let tables_nm = facts.spectral.tables().iter().fold(None, |range, table| wider(range, Some(table.range_nm())));
    let range = channel.survey.wavelength_nm.or(tables_nm);
    let one_line = matches!(&facts.spectral, SpectralData::Table(table) if is_line(table));
    let spectral_id = match &facts.spectral {
        SpectralData::None | SpectralData::Tristimulus => SpectralId::None,
        SpectralData::Table(_) if one_line => SpectralId::One,
        SpectralData::Table(_) => SpectralId::OneTable,
        SpectralData::Wavelength => SpectralId::PerRay,
        SpectralData::Tables(_) => SpectralId::IndexPerRay,
    };
    let ranged = matches!(spectral_id, SpectralId::PerRay | SpectralId::OneTable | SpectralId::IndexPerRay);
    let header = Header {
        creation_method: text(facts, "creation_method").parse().unwrap_or(METHOD_UNKNOWN),
        luminous_lm: total(channel, |flux| flux.luminous_lm),
        radiant_w: total(channel, |flux| flux.radiant_w),
        ray_count: channel.survey.rays_used,
        date: text(facts, "creation_date").to_owned(),
        start_position: text(facts, "start_position").parse().unwrap_or(0),
        spectral_id,
        wavelength_nm: range.filter(|_| one_line).map(|(nm, _)| nm),
        range_nm: [range.filter(|_| ranged).map(|range| range.0), range.filter(|_| ranged).map(|range| range.1)],
        flags: flags(facts, notices),
        texts: texts(input, facts),
        ..Header::default()
    };
    let spectra = Spectra::new(if one_line { Vec::new() } else { points });
    if facts.texts.iter().any(|(name, _)| name == "additional_column") {
        let told = "The file has additional columns; what they mean is not known, and they were left out.";
        notices.add("convert.additional_columns", told);
    }
    Ok(Preamble::new(header, spectra, Additional { columns: Vec::new(), text: additional(input, facts) }))
}

fn is_line(table: &Table) -> bool {
    let (first, last) = table.range_nm();
    first == last
}

/// The standard has radiant flux alone beside a wavelength or a table per ray: lm follow from them.
fn flags(facts: &Facts, notices: &mut Notices) -> Flags {
    let per_ray = matches!(facts.spectral, SpectralData::Wavelength | SpectralData::Tables(_));
    if per_ray && facts.has_luminous {
        let told =
            "Rays with a spectrum of their own are written in W; their lm follow from the spectrum and were left out.";
        notices.add("convert.luminous_left_out", told);
    }
    Flags {
        radiant: facts.has_radiant || per_ray,
        wavelength: matches!(facts.spectral, SpectralData::Wavelength),
        luminous: facts.has_luminous && !per_ray,
        stokes: false,
        tristimulus: matches!(facts.spectral, SpectralData::Tristimulus),
        index: matches!(facts.spectral, SpectralData::Tables(_)),
    }
}

/// The tables as the file stores them, still spectra after rounding.
fn tables(tables: &[Table]) -> Result<Vec<Vec<(f32, f32)>>, Error> {
    let single = |table: &Table| {
        let points: Vec<(f32, f32)> = table.points().map(|(nm, weight)| (nm as f32, weight as f32)).collect();
        let rounded: Vec<(f64, f64)> = points.iter().map(|(nm, w)| (f64::from(*nm), f64::from(*w))).collect();
        Table::new(&rounded).map(|_| points).ok_or_else(|| {
            let found = "Points of the spectrum fall together, vanish or overflow as 32-bit numbers.";
            Error::refused("convert.table_too_fine", found, "Give a spectrum with fewer points and weights near 1.")
        })
    };
    tables.iter().map(single).collect()
}

/// A TM-25 file's own nine texts; else what the light is called and what wrote this.
fn texts(input: &Input, facts: &Facts) -> [String; 9] {
    if facts.format == Format::Tm25 {
        return TEXT_NAMES.map(|name| text(facts, name).to_owned());
    }
    let mut texts: [String; 9] = Default::default();
    texts[0] = called(input, facts).to_owned();
    texts[4] = format!("lampwright {}", env!("CARGO_PKG_VERSION"));
    texts[7] = format!("Converted from {} file {}, SHA-256 {}.", facts.format.name(), input.name, input.sha256);
    texts
}

/// A TM-25 file's own additional text; else all that the file says of itself, a line each.
fn additional(input: &Input, facts: &Facts) -> String {
    if facts.format == Format::Tm25 {
        return text(facts, "additional_text").to_owned();
    }
    let named = facts.texts.iter().filter(|(_, value)| !value.is_empty());
    let lines = named.map(|(name, value)| format!("{name}: {value}"));
    std::iter::once(format!("file: {}", input.name)).chain(lines).collect::<Vec<_>>().join("\n").replace('\0', " ")
}
