//! What stands before the rays of a TM-25 file: it can hold all that any format we read says of rays.

use super::light::{Light, line_nm, text};
use crate::error::Error;
use crate::formats::record::{Facts, Format, SpectralData};
use crate::formats::tm25::Preamble;
use crate::formats::tm25::additional::Additional;
use crate::formats::tm25::header::{Flags, Header, SpectralId, TEXT_NAMES};
use crate::formats::tm25::spectra::Spectra;
use crate::rays::Input;
use crate::source::Channel;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::spectrum::Table;

/// Creation method where the file does not say: neither a simulation (0) nor a measurement (1); ams OSRAM writes the same.
const METHOD_UNKNOWN: i32 = -1;

/// Header, tables and texts for the rays of `light`.
///
/// # Errors
/// `convert.table_too_fine`.
pub fn preamble(light: &Light<'_>, notices: &mut Notices) -> Result<Preamble, Error> {
    let points = tables(light.spectral.tables())?;
    let line = match &light.spectral {
        SpectralData::Table(table) => line_nm(table),
        _ => None,
    };
    let spectral_id = match &light.spectral {
        SpectralData::None | SpectralData::Tristimulus => SpectralId::None,
        SpectralData::Table(_) if line.is_some() => SpectralId::One,
        SpectralData::Table(_) => SpectralId::OneTable,
        SpectralData::Wavelength => SpectralId::PerRay,
        SpectralData::Tables(_) => SpectralId::IndexPerRay,
    };
    let ranged = matches!(spectral_id, SpectralId::PerRay | SpectralId::OneTable | SpectralId::IndexPerRay);
    let range = light.range_nm.filter(|_| ranged);
    let header = Header {
        creation_method: agreed(light, "creation_method").parse().unwrap_or(METHOD_UNKNOWN),
        luminous_lm: light.flux.luminous_lm,
        radiant_w: light.flux.radiant_w,
        ray_count: light.ray_count,
        date: agreed(light, "creation_date").to_owned(),
        start_position: agreed(light, "start_position").parse().unwrap_or(0),
        spectral_id,
        wavelength_nm: line,
        range_nm: [range.map(|range| range.0), range.map(|range| range.1)],
        flags: flags(light, notices),
        texts: texts(light),
        ..Header::default()
    };
    let spectra = Spectra::new(if line.is_some() { Vec::new() } else { points });
    let mut texts_of_all = light.channels.iter().flat_map(|channel| &channel.facts().texts);
    if texts_of_all.any(|(name, _)| name == "additional_column") {
        let told = "The file has additional columns; what they mean is not known, and they were left out.";
        notices.add("convert.additional_columns", told);
    }
    Ok(Preamble::new(header, spectra, Additional { columns: Vec::new(), text: additional(light) }))
}

/// What all files say under `name`; nothing where they differ.
fn agreed<'l>(light: &'l Light<'_>, name: &str) -> &'l str {
    let said = || light.channels.iter().map(|channel| text(channel.facts(), name));
    let first = said().next().unwrap_or("");
    if said().all(|other| other == first) { first } else { "" }
}

/// The standard has radiant flux alone beside a wavelength or a table per ray: lm follow from them.
fn flags(light: &Light<'_>, notices: &mut Notices) -> Flags {
    let per_ray = matches!(light.spectral, SpectralData::Wavelength | SpectralData::Tables(_));
    if per_ray && light.has_luminous {
        let told =
            "Rays with a spectrum of their own are written in W; their lm follow from the spectrum and were left out.";
        notices.add("convert.luminous_left_out", told);
    }
    Flags {
        radiant: light.has_radiant || per_ray,
        wavelength: matches!(light.spectral, SpectralData::Wavelength),
        luminous: light.has_luminous && !per_ray,
        stokes: false,
        tristimulus: matches!(light.spectral, SpectralData::Tristimulus),
        index: matches!(light.spectral, SpectralData::Tables(_)),
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
fn texts(light: &Light<'_>) -> [String; 9] {
    if let Some(facts) = own(light) {
        return TEXT_NAMES.map(|name| text(facts, name).to_owned());
    }
    let mut texts: [String; 9] = Default::default();
    texts[0] = light.name();
    texts[4] = format!("lampwright {}", env!("CARGO_PKG_VERSION"));
    let from = light.inputs.iter().zip(light.channels).map(|(input, channel)| {
        format!("Converted from {} file {}, SHA-256 {}.", channel.facts().format.name(), input.name, input.sha256)
    });
    texts[7] = from.collect::<Vec<_>>().join(" ");
    texts
}

/// A TM-25 file's own additional text; else all that the files say of themselves, a line each.
fn additional(light: &Light<'_>) -> String {
    if let Some(facts) = own(light) {
        return text(facts, "additional_text").to_owned();
    }
    let of = |(input, channel): (&Input, &Channel)| {
        let named = channel.facts().texts.iter().filter(|(_, value)| !value.is_empty());
        let lines = named.map(|(name, value)| format!("{name}: {value}"));
        std::iter::once(format!("file: {}", input.name)).chain(lines).collect::<Vec<_>>()
    };
    light.inputs.iter().zip(light.channels).flat_map(of).collect::<Vec<_>>().join("\n").replace('\0', " ")
}

/// What the file says of itself, where it is one TM-25 file.
fn own<'l>(light: &'l Light<'_>) -> Option<&'l Facts> {
    match light.channels {
        [channel] => Some(channel.facts()).filter(|facts| facts.format == Format::Tm25),
        _ => None,
    }
}
