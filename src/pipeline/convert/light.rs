//! What the rays of all channels carry together, as one file holds it; texts and totals that a converted file takes from its sources.

use crate::error::Error;
use crate::formats::record::{Facts, RawRay, SpectralData};
use crate::rays::Input;
use crate::rays::check::Checked;
use crate::source::{Channel, Source};
use crate::vocabulary::notice::Notices;
use crate::vocabulary::spectrum::{Table, wider};
use crate::vocabulary::units::Flux;
use crate::writing::number;

/// What to do where another format cannot hold a spectrum per ray.
pub const TO_TM25: &str = "Convert to TM-25, which holds it.";

/// The light of one file to be written.
pub struct Light<'a> {
    /// The files it comes from.
    pub inputs: &'a [Input],
    /// The same as they were read, at least one.
    pub channels: &'a [Channel],
    /// What the rays carry of the spectrum.
    pub spectral: SpectralData,
    /// Rays carry W.
    pub has_radiant: bool,
    /// Rays carry lm.
    pub has_luminous: bool,
    /// Totals.
    pub flux: Flux,
    /// From the shortest to the longest wavelength, nm.
    pub range_nm: Option<(f64, f64)>,
    /// Rays that will be written.
    pub ray_count: u64,
    /// For each channel, what its rays take from it.
    marks: Vec<Mark>,
}

/// What the rays of one channel take from it.
#[derive(Clone, Copy)]
struct Mark {
    /// Its first table among those of the file.
    first_table: u32,
    /// The one wavelength of its rays, nm, where the file says it for all of them.
    line_nm: Option<f64>,
}

impl<'a> Light<'a> {
    /// Of all channels of `source`, which was read from `inputs`.
    ///
    /// # Errors
    /// `convert.spectra_differ`.
    pub fn of(inputs: &'a [Input], source: &'a Source) -> Result<Light<'a>, Error> {
        let channels = source.channels.as_slice();
        let (spectral, marks) = joined(channels)?;
        let per_ray = matches!(spectral, SpectralData::Wavelength | SpectralData::Tables(_));
        if per_ray && source.flux.radiant_w.is_none() {
            return Err(differ(channels, 0));
        }
        let all = |test: fn(&Facts) -> bool| channels.iter().all(|channel| test(channel.facts()));
        let (radiant, luminous) = (all(|facts| facts.has_radiant), all(|facts| facts.has_luminous));
        let has_radiant = radiant || !luminous && source.flux.radiant_w.is_some();
        let flux = match channels {
            [channel] => Flux {
                radiant_w: total(channel, |flux| flux.radiant_w),
                luminous_lm: total(channel, |flux| flux.luminous_lm),
            },
            _ => source.flux,
        };
        Ok(Light {
            inputs,
            channels,
            spectral,
            has_radiant,
            has_luminous: luminous || !has_radiant,
            flux,
            range_nm: channels.iter().fold(None, |range, channel| wider(range, channel.range_nm())),
            ray_count: source.survey.rays_used,
            marks,
        })
    }

    /// The ray in W and lm, as one of all. A direction that is a unit vector but for rounding stays as it was stored.
    pub fn ray(&self, channel: usize, raw: &RawRay, checked: &Checked) -> RawRay {
        let mark = self.marks.get(channel).copied().unwrap_or(Mark { first_table: 0, line_nm: None });
        RawRay {
            direction: if checked.normalized { checked.direction.to_array() } else { raw.direction },
            radiant: checked.flux[0],
            luminous: checked.flux[1],
            wavelength_nm: mark.line_nm.unwrap_or(raw.wavelength_nm),
            table: mark.first_table.saturating_add(raw.table),
            xz: checked.xz_lm,
            ..*raw
        }
    }

    /// What each ray says of its colour that a file without tables, or without tristimulus values either, cannot hold.
    pub fn too_colorful(&self, tristimulus: bool) -> Option<&'static str> {
        match &self.spectral {
            SpectralData::Tables(_) => Some("spectral table"),
            SpectralData::Tristimulus if !tristimulus => Some("tristimulus colour"),
            _ => None,
        }
    }

    /// The one wavelength of all rays. A spectrum has no place in a file of `format`: users keep it in a file beside.
    pub fn one_wavelength(&self, format: &str, notices: &mut Notices) -> Option<f64> {
        let SpectralData::Table(table) = &self.spectral else { return None };
        let line = line_nm(table);
        if line.is_none() {
            let told = format!("A {format} file has no place for the spectrum of its rays; keep it beside the file.");
            notices.add("convert.spectrum_left_out", told);
        }
        line
    }

    /// Tells of W beside lm, where a file of `format` holds one flux.
    pub fn tell_luminous(&self, format: &str, notices: &mut Notices) {
        let by_wavelength = match &self.spectral {
            SpectralData::Table(table) => line_nm(table).is_some(),
            spectral => matches!(spectral, SpectralData::Wavelength),
        };
        // Lumens that follow from the wavelengths are not lost; those that follow from a spectrum are, as the spectrum is.
        let lumens = self.flux.luminous_lm.filter(|_| self.has_luminous || !by_wavelength);
        if let (true, Some(lumens)) = (self.has_radiant, lumens) {
            let why = if by_wavelength { "lm follow from W and the wavelength" } else { "W were written" };
            let lumens = number::text(lumens, 5);
            let told =
                format!("Rays of a {format} file have one flux: {why}, and the lm, {lumens} in all, were left out.");
            notices.add("convert.luminous_left_out", told);
        }
    }

    /// What the light is called: each channel by its user, by its file, or as its file is.
    pub fn name(&self) -> String {
        let names = self.inputs.iter().zip(self.channels).map(|(input, channel)| called(input, channel.facts()));
        names.collect::<Vec<_>>().join(" + ")
    }
}

/// What the rays of `channels` carry of the spectrum together, and what each of them adds.
fn joined(channels: &[Channel]) -> Result<(SpectralData, Vec<Mark>), Error> {
    let spectra = || channels.iter().map(|channel| &channel.facts().spectral);
    let line = |data: &SpectralData| match data {
        SpectralData::Table(table) => line_nm(table),
        _ => None,
    };
    let mut marks: Vec<Mark> = spectra().map(|data| Mark { first_table: 0, line_nm: line(data) }).collect();
    let first = spectra().next().cloned().unwrap_or(SpectralData::None);
    let Some(other) = spectra().position(|data| *data != first) else { return Ok((first, marks)) };
    if spectra().all(|data| line(data).is_some() || *data == SpectralData::Wavelength) {
        return Ok((SpectralData::Wavelength, marks));
    }
    if spectra().any(|data| data.tables().is_empty()) {
        return Err(differ(channels, other));
    }
    let mut tables = Vec::new();
    for (mark, data) in marks.iter_mut().zip(spectra()) {
        mark.first_table = tables.len() as u32;
        tables.extend_from_slice(data.tables());
    }
    Ok((SpectralData::Tables(tables), marks))
}

/// The wavelength of a table of one point.
pub fn line_nm(table: &Table) -> Option<f64> {
    let (first, last) = table.range_nm();
    (first == last).then_some(first)
}

fn differ(channels: &[Channel], index: usize) -> Error {
    let has = |channel: &Channel| format!("{:?} has {}", channel.name, channel.facts().spectral.name());
    let found = format!(
        "The rays of one file carry one kind of spectrum, and those of the channels do not: {}.",
        channels.iter().map(has).collect::<Vec<_>>().join(", ")
    );
    let remedy = "Declare the spectrum of every channel, or convert each file by itself.";
    Error::refused("convert.spectra_differ", found, remedy).at_channel(index, "spectrum")
}

/// What the file says under `name`.
pub fn text<'f>(facts: &'f Facts, name: &str) -> &'f str {
    facts.texts.iter().find(|(own, _)| own == name).map_or("", |(_, value)| value)
}

fn called<'i>(input: &'i Input, facts: &'i Facts) -> &'i str {
    let names = ["source_name", "description", "dataname", "title"].map(|name| text(facts, name));
    let declared = input.declared.name.as_deref();
    declared.into_iter().chain(names).find(|name| !name.is_empty()).unwrap_or(&input.name)
}

/// The total to be written: the header's own number where the rays agree with it, so that a file converted to its own format
/// keeps it to the last digit. A declared flux leaves nothing of the header.
fn total(channel: &Channel, of: impl Fn(&Flux) -> Option<f64>) -> Option<f64> {
    const SAME: f64 = 1e-6;
    let header = of(&channel.facts().header_flux).filter(|_| channel.fixed.is_none());
    match (header, of(&channel.flux)) {
        (Some(header), Some(rays)) if (header / rays - 1.0).abs() > SAME => Some(rays),
        (header, rays) => header.or(rays),
    }
}
