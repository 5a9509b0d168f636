//! What the channels of a source must satisfy together, judged before any ray is read: units and quantities are known, one
//! quantity is common to all, fluxes and shares can be meant.

use crate::error::{Error, Place};
use crate::formats::record::{EQUAL_SHARES, EQUAL_SHARES_MESSAGE, SPECTRUM_UNREADABLE, TOTAL_UNREADABLE};
use crate::formats::record::{Facts, Format, SpectralData, TotalRule};
use crate::formats::text::column_rules;
use crate::rays::bands::Reach;
use crate::rays::conversion::Conversion;
use crate::rays::declared::apply_declaration;
use crate::vocabulary::declaration::{Column, Declared, Total};
use crate::vocabulary::notice::Notices;
use crate::vocabulary::space::Bounds;
use crate::vocabulary::spectrum::Table;
use crate::vocabulary::units::{Flux, LengthUnit};
use glam::DVec3;
use serde::Deserialize;

/// Largest difference of the sum of the shares from 1: rounding of the numbers only. Shares that a data sheet has rounded must be
/// corrected.
const SHARE_TOLERANCE: f64 = 1e-6;
/// A visible wavelength, nm: stands for a spectrum that the file is known to have and that is not loaded.
const VISIBLE_NM: f64 = 555.0;

/// One ray set that is to be a channel.
pub struct Candidate<'a> {
    /// What the user calls the channel.
    pub name: &'a str,
    /// SHA-256 of its file.
    pub sha256: &'a str,
    /// What the file says of itself, amended by what was declared.
    pub facts: &'a Facts,
    /// What was declared of it.
    pub declared: &'a Declared,
}

/// Which quantities every ray set of a source has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Known {
    /// W are known: the quantity that weights rays.
    pub radiant: bool,
    /// lm are known.
    pub luminous: bool,
}

impl Known {
    fn of(facts: &Facts) -> Known {
        let conversion = Conversion::of(facts);
        Known { radiant: conversion.knows_radiant(), luminous: conversion.knows_luminous() }
    }

    /// The channels' totals together; absent where one channel's is.
    pub fn sum(&self, channels: impl Iterator<Item = Flux> + Clone) -> Flux {
        let total = |known: bool, of: fn(&Flux) -> Option<f64>| {
            known.then(|| channels.clone().map(|flux| of(&flux).unwrap_or(0.0)).sum())
        };
        Flux {
            radiant_w: total(self.radiant, |flux| flux.radiant_w),
            luminous_lm: total(self.luminous, |flux| flux.luminous_lm),
        }
    }
}

/// What all of them know, if they can be one source.
///
/// # Errors
/// `rays.unit_unknown`, `rays.quantity_unknown`, `rays.twice`, `rays.no_common_quantity`, each at the channel and the field
/// to declare.
pub fn judge(candidates: &[Candidate<'_>]) -> Result<Known, Error> {
    for (index, Candidate { name, sha256, facts, declared }) in candidates.iter().enumerate() {
        if facts.length_unit.is_none() {
            let found = format!("The file of channel {name:?} does not say in which unit its lengths are.");
            let remedy = "Declare its length unit: mm, um, nm, cm, m, in or ft.";
            return Err(Error::refused("rays.unit_unknown", found, remedy).at_channel(index, "length_unit"));
        }
        judge_unread(index, name, facts, declared)?;
        if facts.quantity_unknown {
            let found = format!("The file of channel {name:?} does not say whether its flux is in W or in lm.");
            let remedy = "Declare its quantity, radiant (W) or luminous (lm), or its flux.";
            return Err(Error::refused("rays.quantity_unknown", found, remedy).at_channel(index, "quantity"));
        }
        let same = candidates.iter().filter(|other| other.sha256 == *sha256).count();
        if same > 1 && declared.flux.is_none() {
            let found = format!(
                "The file of channel {name:?} is in the source more than once, so that its light counts twice."
            );
            let remedy =
                "Name it once; or declare a flux for each of its channels, where one set of rays stands for several.";
            return Err(Error::refused("rays.twice", found, remedy).at_channel(index, "flux"));
        }
    }
    common(candidates)
}

/// What the file says of its spectrum or its total and cannot mean is declared in its place.
fn judge_unread(index: usize, name: &str, facts: &Facts, declared: &Declared) -> Result<(), Error> {
    let said =
        |code: &str| facts.notices.iter().find(|notice| notice.code == code).map(|notice| notice.message.as_str());
    if let Some(said) = said(SPECTRUM_UNREADABLE) {
        let found = format!("The spectrum in the file of channel {name:?} cannot be meant. {said}");
        let remedy = "Declare the spectrum of its light, or export the file again.";
        return Err(Error::refused(SPECTRUM_UNREADABLE, found, remedy).at_channel(index, "spectrum"));
    }
    if let Some(said) = said(TOTAL_UNREADABLE) {
        let found = format!("The total in the file of channel {name:?} cannot be read. {said}");
        let remedy = "Declare its flux, or correct the number in its header.";
        return Err(Error::refused(TOTAL_UNREADABLE, found, remedy).at_channel(index, "flux"));
    }
    if said(EQUAL_SHARES).is_some() && declared.flux.is_none() {
        let found = format!("The columns of channel {name:?} were declared without a flux.");
        let remedy = "Declare its flux: every ray then has an equal share of it. Or declare the column of the flux.";
        return Err(Error::refused("rays.flux_missing", found, remedy).at_channel(index, "flux"));
    }
    Ok(())
}

/// What all of `candidates` know.
fn common(candidates: &[Candidate<'_>]) -> Result<Known, Error> {
    let known: Vec<Known> = candidates.iter().map(|candidate| Known::of(candidate.facts)).collect();
    let all = Known { radiant: known.iter().all(|k| k.radiant), luminous: known.iter().all(|k| k.luminous) };
    let without_w = known.iter().position(|k| !k.radiant);
    let without_lm = known.iter().position(|k| !k.luminous);
    let (Some(lumens), Some(watts)) = (without_w, without_lm) else { return Ok(all) };
    let name = |index: usize| candidates.get(index).map_or("", |candidate| candidate.name);
    let found = format!(
        "Channel {:?} is in lm and channel {:?} in W, and neither has a spectrum that converts one into the other.",
        name(lumens),
        name(watts)
    );
    let remedy = "Declare the spectrum of every channel in lm (or of every one in W).";
    Err(Error::refused("rays.no_common_quantity", found, remedy).at_channel(lumens, "spectrum"))
}

/// Factors between units of length that people mix up, and what they are.
const UNIT_FACTORS: [(f64, &str); 5] = [
    (10.0, "mm and cm"),
    (25.4, "mm and in"),
    (100.0, "cm and m"),
    (304.8, "mm and ft"),
    (1000.0, "mm and m, or um and mm"),
];
/// How near the ratio of two sizes comes to such a factor.
const FACTOR_TOLERANCE: f64 = 0.02;

/// Tells of channels that can hardly belong together: sizes that differ by a unit's factor, places far from each other. Each is a
/// channel's name and the box of its origins.
pub fn tell_unlike(boxes: &[(&str, Bounds)], notices: &mut Notices) {
    let pairs = boxes.iter().enumerate().flat_map(|(k, a)| boxes.iter().skip(k + 1).map(move |b| (a, b)));
    for ((name, a), (other, b)) in pairs {
        let [one, two] = [a, b].map(|bounds| bounds.size().max_element());
        let (small, large) = (one.min(two), one.max(two));
        let near = |(factor, _): &&(f64, &str)| (large / small / factor - 1.0).abs() < FACTOR_TOLERANCE;
        if small > 0.0
            && let Some((factor, units)) = UNIT_FACTORS.iter().find(near)
        {
            let told = format!(
                "The origins of channels {name:?} and {other:?} span {small:.4} and {large:.4} mm, {factor} times as much: the \
                 length unit of one may be wrong ({units})."
            );
            notices.add("rays.channel_sizes", told);
        }
        let gap = (a.min.max(b.min) - a.max.min(b.max)).max_element();
        if large > 0.0 && gap > large && gap.is_finite() {
            let told = format!(
                "The origins of channels {name:?} and {other:?} are {gap:.4} mm apart, and span {large:.4} mm at most: they may not \
                 be in one frame, or not of one source."
            );
            notices.add("rays.channel_places", told);
        }
    }
}

/// The flux each channel is declared to have, shares resolved.
///
/// # Errors
/// `rays.flux_impossible`; `rays.share_without_total`, `rays.share_quantity`, `rays.share_missing`, `rays.share_sum`;
/// `rays.total_unused` for a total of which nobody has a share.
pub fn fluxes(declared: &[&Declared], total: Option<Total>) -> Result<Vec<Option<Total>>, Error> {
    total.map_or(Ok(()), |total| total.validate(Place::Total))?;
    let mut sum = 0.0;
    let (mut resolved, mut missing) = (Vec::new(), None);
    for (index, channel) in declared.iter().enumerate() {
        channel.validate().map_err(|error| error.of_channel(index))?;
        let place = Place::Channel(index, "flux");
        let share = channel.flux.and_then(|flux| Some((flux.share()?, flux.quantity())));
        let Some((share, quantity)) = share else {
            missing = missing.or(Some(index));
            resolved.push(channel.flux.map(|flux| Total::from_override(flux, 0.0)));
            continue;
        };
        let Some(total) = total else {
            let found = "The channel has a share of a total that was not given.";
            let remedy = "Give the source's total in W or lm, or the channel's own flux.";
            return Err(Error::invalid_declaration("rays.share_without_total", place, found, remedy));
        };
        if total.quantity() != quantity {
            let found =
                format!("The share is one of {}, the total is in {}.", quantity.unit(), total.quantity().unit());
            let remedy = "Give shares and total in the same quantity; data sheets have both kinds of shares.";
            return Err(Error::invalid_declaration("rays.share_quantity", place, found, remedy));
        }
        sum += share;
        resolved.push(channel.flux.map(|flux| Total::from_override(flux, total.value())));
    }
    together(total, sum, missing)?;
    Ok(resolved)
}

/// Shares are those of all channels, and of nothing else. `missing`: the first channel without one.
fn together(total: Option<Total>, sum: f64, missing: Option<usize>) -> Result<(), Error> {
    if total.is_some() && sum == 0.0 {
        let found = "A total is given, and no channel has a share of it.";
        let remedy = "Declare the share of every channel, or leave the total out and declare fluxes.";
        return Err(Error::invalid_declaration("rays.total_unused", Place::Total, found, remedy));
    }
    if sum > 0.0
        && let Some(index) = missing
    {
        let found = "Other channels have shares of the total, this one has none.";
        let place = Place::Channel(index, "flux");
        return Err(Error::invalid_declaration(
            "rays.share_missing",
            place,
            found,
            "Declare the share of every channel.",
        ));
    }
    if sum > 0.0 && (sum - 1.0).abs() > SHARE_TOLERANCE {
        let found = format!("The shares of the channels add to {sum}, not to 1.");
        let remedy = "Correct them; where a channel was left out, divide each by their sum.";
        return Err(Error::invalid_declaration("rays.share_sum", Place::Total, found, remedy));
    }
    Ok(())
}

/// What a stored [`crate::inspection::findings::Header`] says of its file, as far as it decides whether that can be a channel.
#[derive(Clone, Debug, Deserialize)]
pub struct Claims {
    /// Rays in the file.
    #[serde(default)]
    pub ray_count: u64,
    format: Format,
    flux: Flux,
    total_rule: TotalRule,
    has_radiant: bool,
    has_luminous: bool,
    /// What its rays carry of the spectrum: the word of [`SpectralData::name`].
    pub spectrum: String,
    /// Headers stored before there were formats without a unit do not have it.
    #[serde(default = "some_unit")]
    length_unit: Option<String>,
    #[serde(default)]
    quantity_unknown: bool,
    /// Wavelengths of its tables, nm.
    #[serde(default)]
    pub table_range_nm: Option<(f64, f64)>,
    /// What was odd about it.
    #[serde(default)]
    notices: Vec<Said>,
    /// Wavelengths that were found in its rays, nm; no header has them.
    #[serde(skip)]
    pub wavelength_nm: Option<(f64, f64)>,
    /// Smallest and largest coordinates of its origins, mm if its header's unit is right; no header has them.
    #[serde(skip)]
    pub origins_mm: Option<([f64; 3], [f64; 3])>,
}

/// A notice of a header.
#[derive(Clone, Debug, Deserialize)]
struct Said {
    code: String,
    message: String,
}

fn some_unit() -> Option<String> {
    Some(LengthUnit::Millimetre.symbol().to_owned())
}

impl Claims {
    /// Whether its rays have wavelengths of their own, as the file or the user says.
    pub fn by_ray(&self, declared: &Declared) -> bool {
        let has =
            |columns: &Vec<Column>| columns.contains(&Column::WavelengthNm) || columns.contains(&Column::WavelengthUm);
        let columns = declared.columns.as_ref().filter(|_| self.format.is_text());
        let in_rays = columns.map_or(self.spectrum == SpectralData::Wavelength.name(), has);
        in_rays && declared.spectrum.is_none()
    }

    /// Which wavelengths its light has.
    pub fn reach(&self, declared: &Declared) -> Reach {
        let by_ray = self.by_ray(declared);
        let range = match &declared.spectrum {
            Some(table) => Some(table.range_nm()),
            None if by_ray => self.wavelength_nm,
            None => self.table_range_nm,
        };
        match range {
            Some((low, high)) => Reach::Range(low, high),
            None if by_ray => Reach::Unknown,
            None => Reach::Nothing,
        }
    }

    /// Box of its origins in the unit that is declared.
    fn bounds_mm(&self, declared: &Declared) -> Option<Bounds> {
        let header = self.length_unit.as_deref().and_then(LengthUnit::from_symbol).unwrap_or(LengthUnit::Millimetre);
        let scale = declared.length_unit.unwrap_or(header).mm() / header.mm();
        let (min, max) = self.origins_mm?;
        Some(Bounds { min: scale * DVec3::from_array(min), max: scale * DVec3::from_array(max) })
    }

    /// Facts that lead to the same judgement as the file's own. Tables are not at hand; they are taken to be visible light, and
    /// [`crate::source::Source::read`] has the last word.
    fn facts(&self, declared: &Declared) -> Result<Facts, Error> {
        let visible = || Table::new(&[(VISIBLE_NM, 1.0)]);
        let spectral = |kind: &SpectralData| kind.name() == self.spectrum;
        let kinds = [SpectralData::Wavelength, SpectralData::Tristimulus];
        let kinds = kinds.into_iter().chain(visible().map(SpectralData::Table));
        let kinds = kinds.chain(visible().map(|table| SpectralData::Tables(vec![table])));
        let mut facts = Facts {
            format: self.format,
            ray_count: 0,
            header_flux: self.flux,
            total_rule: self.total_rule,
            has_radiant: self.has_radiant,
            has_luminous: self.has_luminous,
            spectral: kinds.into_iter().find(spectral).unwrap_or(SpectralData::None),
            length_unit: self.length_unit.as_deref().and_then(LengthUnit::from_symbol),
            quantity_unknown: self.quantity_unknown,
            texts: Vec::new(),
            notices: Notices::default(),
        };
        for code in [SPECTRUM_UNREADABLE, TOTAL_UNREADABLE] {
            if let Some(said) = self.notices.iter().find(|said| said.code == code) {
                facts.notices.add(code, said.message.clone());
            }
        }
        if let Some(columns) = declared.columns.as_ref().filter(|_| self.format.is_text()) {
            in_columns(&mut facts, columns)?;
        }
        apply_declaration(&mut facts, declared)?;
        Ok(facts)
    }
}

/// What declared columns say of the flux and the spectrum; names in the file, and the unit in them, hold no more.
fn in_columns(facts: &mut Facts, columns: &[Column]) -> Result<(), Error> {
    column_rules::judge(columns, true)?;
    let has = |column: Column| columns.contains(&column);
    let in_header = facts.format != Format::Columns && has(Column::Flux);
    if facts.format == Format::Columns {
        facts.length_unit = None;
    }
    if !in_header {
        facts.has_luminous = has(Column::LuminousFlux);
        facts.has_radiant = has(Column::RadiantFlux) || !facts.has_luminous;
        facts.quantity_unknown = !has(Column::RadiantFlux) && !facts.has_luminous;
    }
    if !(has(Column::Flux) || has(Column::RadiantFlux) || has(Column::LuminousFlux)) {
        facts.notices.add(EQUAL_SHARES, EQUAL_SHARES_MESSAGE);
    }
    facts.spectral = match has(Column::WavelengthNm) || has(Column::WavelengthUm) {
        true => SpectralData::Wavelength,
        false => SpectralData::None,
    };
    Ok(())
}

/// Whether these files, as stored headers tell of them, can be one source: everything that [`crate::source::Source::read`] would refuse before
/// reading a ray. Each comes with its name and its SHA-256. What can be told of them before: [`tell_unlike`].
///
/// # Errors
/// As [`judge`], [`fluxes`] and [`apply_declaration`].
pub fn judge_claims(files: &[(&str, &str, &Claims, &Declared)], total: Option<Total>) -> Result<Notices, Error> {
    let declared: Vec<&Declared> = files.iter().map(|(_, _, _, declared)| *declared).collect();
    fluxes(&declared, total)?;
    let facts = files
        .iter()
        .enumerate()
        .map(|(index, (_, _, claims, declared))| claims.facts(declared).map_err(|error| error.of_channel(index)));
    let facts = facts.collect::<Result<Vec<Facts>, Error>>()?;
    let candidates: Vec<Candidate<'_>> = files
        .iter()
        .zip(&facts)
        .map(|((name, sha256, _, declared), facts)| Candidate { name, sha256, facts, declared })
        .collect();
    judge(&candidates)?;
    let mut notices = Notices::default();
    let boxes: Vec<(&str, Bounds)> =
        files.iter().filter_map(|(name, _, claims, declared)| Some((*name, claims.bounds_mm(declared)?))).collect();
    tell_unlike(&boxes, &mut notices);
    Ok(notices)
}
