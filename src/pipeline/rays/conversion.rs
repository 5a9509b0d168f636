//! From the numbers a file stores to W and lm. Nothing is guessed: what neither the rays nor a spectrum gives stays unknown.

use crate::error::{Error, Place};
use crate::formats::record::{Facts, RawRay, SpectralData, TotalRule};
use crate::vocabulary::declaration::Total;
use crate::vocabulary::spectrum::lm_per_w;
use crate::vocabulary::units::Flux;

/// Rays and header agree to the rounding of their 32-bit numbers.
const SAME_TOTAL: f64 = 2.5e-7;

/// Luminous efficacy of radiation, as far as a file tells.
#[derive(Clone, Debug, PartialEq)]
enum Efficacy {
    /// No spectrum, or one that cannot turn lm into W.
    Unknown,
    /// The same for all rays, lm/W.
    Same(f64),
    /// By table, lm/W.
    PerTable(Vec<f64>),
    /// 683 V(λ) at each ray's wavelength.
    PerWavelength,
}

impl Efficacy {
    /// The header's own lm/W where it has both totals and one spectrum holds for all rays: it was made from the measured
    /// spectrum, of which the table is a coarse copy (`pipeline/formats/README.md` 1).
    fn of(facts: &Facts) -> Efficacy {
        match &facts.spectral {
            SpectralData::None | SpectralData::Tristimulus => Efficacy::Unknown,
            SpectralData::Table(table) => {
                let own = header_lm_per_w(facts).unwrap_or_else(|| table.lm_per_w());
                if own > 0.0 || facts.has_radiant { Efficacy::Same(own) } else { Efficacy::Unknown }
            }
            SpectralData::Tables(tables) => Efficacy::PerTable(tables.iter().map(|table| table.lm_per_w()).collect()),
            SpectralData::Wavelength => Efficacy::PerWavelength,
        }
    }
}

/// The header's totals as an efficacy, lm/W.
pub fn header_lm_per_w(facts: &Facts) -> Option<f64> {
    Some(facts.header_flux.luminous_lm? / facts.header_flux.radiant_w?)
}

/// Sums of one file's rays as stored.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    /// Stored radiant values.
    pub radiant: f64,
    /// Stored luminous values.
    pub luminous: f64,
    /// The quantity that is not stored but follows from the spectrum, in the unit of the stored one times lm/W or W/lm.
    pub derived: f64,
}

/// How one file's stored values become W and lm.
#[derive(Clone, Debug)]
pub struct Conversion {
    has_radiant: bool,
    has_luminous: bool,
    efficacy: Efficacy,
    radiant_scale: f64,
    luminous_scale: f64,
}

impl Conversion {
    /// As stored: scales of 1.
    pub fn of(facts: &Facts) -> Conversion {
        Conversion {
            has_radiant: facts.has_radiant,
            has_luminous: facts.has_luminous,
            efficacy: Efficacy::of(facts),
            radiant_scale: 1.0,
            luminous_scale: 1.0,
        }
    }

    /// Scaled to the total that is right: the header's under [`TotalRule::Header`], as far as it has one.
    pub fn scaled(mut self, facts: &Facts, sums: &Sums) -> Conversion {
        if facts.total_rule == TotalRule::RaySum {
            return self;
        }
        let of = |header: Option<f64>, sum: f64| header.filter(|_| sum > 0.0).map(|total| total / sum);
        let header = facts.header_flux;
        let radiant = of(header.radiant_w, sums.radiant).filter(|_| self.has_radiant);
        let luminous = of(header.luminous_lm, sums.luminous).filter(|_| self.has_luminous);
        // Rays are relative by one factor: where the header knows only the other total, that total scales them.
        let derived = of(if self.has_radiant { header.luminous_lm } else { header.radiant_w }, sums.derived);
        self.radiant_scale = radiant.or(luminous).or(derived).unwrap_or(1.0);
        self.luminous_scale = luminous.or(radiant).or(derived).unwrap_or(1.0);
        self
    }

    /// The same for who writes the rays again: rays that agree with the total but for rounding are in W or lm as they stand, and
    /// stay so to the last digit.
    pub fn unless_rounding(&self) -> Conversion {
        let kept = |scale: f64| if (scale - 1.0).abs() <= SAME_TOTAL { 1.0 } else { scale };
        Conversion {
            radiant_scale: kept(self.radiant_scale),
            luminous_scale: kept(self.luminous_scale),
            ..self.clone()
        }
    }

    /// Scaled once more, so that the total of these sums is `flux`; lm/W stays.
    ///
    /// # Errors
    /// `rays.flux_dark` where there is nothing of that quantity to scale.
    pub fn fixed(mut self, sums: &Sums, flux: Total) -> Result<Conversion, Error> {
        let Some(own) = self.totals(sums).of(flux.quantity()).filter(|own| *own > 0.0 && own.is_finite()) else {
            let unit = flux.quantity().unit();
            let found = format!("The declared flux is {} {unit}, and the channel's light has no {unit}.", flux.value());
            let remedy = "Declare its flux in the other quantity, or another spectrum.";
            return Err(Error::invalid_declaration("rays.flux_dark", Place::Channel(0, "flux"), found, remedy));
        };
        let factor = flux.value() / own;
        self.radiant_scale *= factor;
        self.luminous_scale *= factor;
        Ok(self)
    }

    /// Radiant flux is stored or follows from the spectrum.
    pub fn knows_radiant(&self) -> bool {
        self.has_radiant || self.efficacy != Efficacy::Unknown
    }

    /// Luminous flux is stored or follows from the spectrum.
    pub fn knows_luminous(&self) -> bool {
        self.has_luminous || self.efficacy != Efficacy::Unknown
    }

    /// `[W, lm]` of a ray; 0 where unknown.
    pub fn flux(&self, raw: &RawRay) -> [f64; 2] {
        match (self.has_radiant, self.has_luminous) {
            (true, true) => [raw.radiant * self.radiant_scale, raw.luminous * self.luminous_scale],
            (true, false) => {
                let watt = raw.radiant * self.radiant_scale;
                [watt, watt * self.lm_per_w(raw)]
            }
            (false, _) => {
                let (lumen, efficacy) = (raw.luminous * self.luminous_scale, self.lm_per_w(raw));
                [if efficacy > 0.0 { lumen / efficacy } else { 0.0 }, lumen]
            }
        }
    }

    /// Tristimulus X and Z, lm.
    pub fn xz_lm(&self, raw: &RawRay) -> [f64; 2] {
        raw.xz.map(|value| value * self.luminous_scale)
    }

    /// Totals of a file with these sums.
    pub fn totals(&self, sums: &Sums) -> Flux {
        let radiant =
            if self.has_radiant { sums.radiant * self.radiant_scale } else { sums.derived * self.luminous_scale };
        let luminous =
            if self.has_luminous { sums.luminous * self.luminous_scale } else { sums.derived * self.radiant_scale };
        Flux {
            radiant_w: self.knows_radiant().then_some(radiant),
            luminous_lm: self.knows_luminous().then_some(luminous),
        }
    }

    /// Factor from the radiant (`true`) or luminous flux at scale 1 to the scaled one.
    pub fn scale(&self, radiant: bool) -> f64 {
        let stored_radiant = if radiant { self.has_radiant } else { !self.has_luminous };
        if stored_radiant { self.radiant_scale } else { self.luminous_scale }
    }

    /// Efficacy of the ray's radiation, lm/W; 0 where unknown.
    fn lm_per_w(&self, raw: &RawRay) -> f64 {
        match &self.efficacy {
            Efficacy::Unknown => 0.0,
            Efficacy::Same(efficacy) => *efficacy,
            Efficacy::PerTable(by_table) => by_table.get(raw.table as usize).copied().unwrap_or(0.0),
            Efficacy::PerWavelength => lm_per_w(raw.wavelength_nm),
        }
    }
}
