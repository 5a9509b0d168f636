//! A model whose light is given one spectrum: a bin's, a fitted one, or the first that is known of it.

use super::component::Changed;
use crate::error::{Error, Place};
use crate::flux::Amounts;
use crate::source::{Columns, Spectral};
use crate::vocabulary::spectrum::{Bands, Table, wider};
use crate::vocabulary::units::Flux;

/// Bands that every spectrum has at least, nm: first and last edge, and step.
const VISIBLE_NM: (f64, f64) = (380.0, 780.0);
const STEP_NM: f64 = 10.0;

/// What is known of a flux in both quantities, where its spectrum is known.
#[derive(Clone, Copy)]
struct Efficacy {
    lm_per_w: f64,
    /// W are known, and stay; otherwise lm stay.
    has_radiant: bool,
}

impl Efficacy {
    /// W and lm of a known W or lm.
    fn of(&self, known: f64) -> [f64; 2] {
        if self.has_radiant { [known, known * self.lm_per_w] } else { [known / self.lm_per_w, known] }
    }

    /// Makes both lists known.
    fn fill(&self, radiant: &mut Option<Vec<f64>>, luminous: &mut Option<Vec<f64>>) {
        let known = if self.has_radiant { radiant.take() } else { luminous.take() };
        let both = known.map(|known| known.into_iter().map(|own| self.of(own)).collect::<Vec<[f64; 2]>>());
        *radiant = both.as_ref().map(|both| both.iter().map(|[watt, _]| *watt).collect());
        *luminous = both.map(|both| both.iter().map(|[_, lumen]| *lumen).collect());
    }
}

/// Gives all light of a model the spectrum of `table`: its W stay, where they are known, and its lm follow; of a model that knows only lm, these
/// stay.
///
/// `bands`: those of [`bands`].
///
/// # Errors
/// [`Error::Unusable`] where a spectrum without visible light is to make W of lm.
pub fn give(component: &mut Changed, table: &Table, bands: Bands) -> Result<(), Error> {
    let efficacy = Efficacy { lm_per_w: table.lm_per_w(), has_radiant: component.knows[0] };
    if !efficacy.has_radiant && efficacy.lm_per_w <= 0.0 {
        let found = "The spectrum has no visible light, and the model knows only its lm.";
        let (place, remedy) = (Place::Asked("spectrum"), "Give the spectrum of the light that the lm are of.");
        return Err(Error::invalid_declaration("combination.change", place, found, remedy));
    }
    let shares = table.shares(&bands);
    let nodes = component.volume.as_mut().map(|volume| &mut volume.nodes);
    for sites in [&mut component.vertices].into_iter().chain(nodes) {
        efficacy.fill(&mut sites.radiant_w, &mut sites.luminous_lm);
        color(sites, &shares);
    }
    efficacy.fill(&mut component.triangles.radiant_w, &mut component.triangles.luminous_lm);
    let widths_nm = bands.widths_nm();
    component.goniograms_mut().for_each(|goniogram| {
        efficacy.fill(&mut goniogram.radiant_w_per_sr, &mut goniogram.luminous_cd);
        let known = if efficacy.has_radiant { goniogram.flux.radiant_w } else { goniogram.flux.luminous_lm };
        let [watt, lumen] = efficacy.of(known.unwrap_or(0.0));
        goniogram.flux = Flux { radiant_w: Some(watt), luminous_lm: Some(lumen) };
        let density = |(share, width_nm): (&f64, &f64)| watt * share / width_nm;
        goniogram.spectral_flux_w_per_nm = shares.iter().zip(&widths_nm).map(density).collect();
        goniogram.spectral_w_per_sr_nm.clear();
    });
    component.spectral_grid = component.grid.clone();
    component.spectral = Spectral { bands, columns: Columns::Bands };
    component.knows = [true, true];
    component.origin.spectrum = "table";
    Ok(())
}

/// The bands of a model whose light has the spectrum of `table`.
///
/// # Errors
/// [`Error::Unusable`] where they would be too many.
pub fn bands(table: &Table) -> Result<Bands, Error> {
    let range_nm = wider(Some(VISIBLE_NM), Some(table.range_nm()));
    range_nm.and_then(|(from, to)| Bands::regular(from, to, STEP_NM)).ok_or_else(|| {
        let found = "The spectrum reaches over more wavelengths than bands of 10 nm can hold.";
        let (place, remedy) = (Place::Asked("spectrum"), "Cut the spectrum to where its light is.");
        Error::invalid_declaration("combination.change", place, found, remedy)
    })
}

/// W in each band, and what lies outside of all.
fn color(sites: &mut Amounts, shares: &[f64]) {
    let outside = (1.0 - shares.iter().sum::<f64>()).max(0.0);
    let watts = sites.radiant_w.iter().flatten();
    let columns = watts.flat_map(|watt| shares.iter().chain([&outside]).map(move |share| watt * share)).collect();
    (sites.columns, sites.column_count) = (columns, shares.len() + 1);
}
