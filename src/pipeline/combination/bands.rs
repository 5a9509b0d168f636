//! One spectral side for all components: what one of them does not know is unknown of the whole.

use super::component::{Changed, nothing};
use crate::error::Error;
use crate::flux::Amounts;
use crate::source::{Columns, Spectral};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::spectrum::Bands;

/// Edges of bands that differ by less are one, nm.
const SAME_NM: f64 = 1e-9;
/// What to do where a quantity or a spectrum is lost.
const REMEDY: &str =
    "Build each model with a spectrum declared (lampwright build RAYS,spectrum=FILE), so that all know the same.";

/// Leaves each component with the quantities that all know, and with the bands of all: bands of different edges are cut at the edges of
/// all, which changes no spectrum, because light is even within a band.
///
/// # Errors
/// [`Error::Refused`] where there is no quantity that all know, or above [`Limits::max_tally_values`].
pub fn unite(components: &mut [Changed], limits: &Limits, notices: &mut Notices) -> Result<Spectral, Error> {
    let [radiant, luminous] = [0, 1].map(|quantity| components.iter().all(|component| component.knows[quantity]));
    if !radiant && !luminous {
        let found = "Some models know only their W and others only their lm, so that nothing is known of all together.";
        return Err(Error::refused("combination.quantity", found, REMEDY));
    }
    for (known, quantity, name) in [(radiant, 0, "W"), (luminous, 1, "lm")] {
        let without: Vec<&str> = components
            .iter()
            .filter(|component| !component.knows[quantity])
            .map(|component| component.ancestor.name.as_str())
            .collect();
        if !known && without.len() < components.len() {
            let found = format!(
                "The {name} of the whole are unknown, because these models do not know theirs: {}. {REMEDY}",
                without.join(", ")
            );
            notices.add("combination.unknown_quantity", found);
        }
    }
    for component in components.iter_mut() {
        forget(component, radiant, luminous);
    }
    let spectral = match &*components {
        [first, ..] => of_all(first, components, radiant, luminous, notices),
        [] => return Err(nothing()),
    };
    let numbers: usize = components.iter_mut().map(|component| numbers_with(component, &spectral)).sum();
    if numbers > limits.max_tally_values {
        let found = format!(
            "The models together have {} bands, and {numbers} spectral numbers with them, too many.",
            spectral.bands.len()
        );
        return Err(Error::refused("combination.too_large", found, "Build the models with the same bands."));
    }
    for component in components.iter_mut() {
        let own = component.spectral.clone();
        if own != spectral {
            take(component, &own, &spectral);
        }
    }
    Ok(spectral)
}

/// Spectral numbers of a component with the bands of all: of its places, and of its directions where these differ in spectrum.
fn numbers_with(component: &mut Changed, all: &Spectral) -> usize {
    let own = component.spectral.bands.len().max(1);
    let directions: usize =
        component.goniograms_mut().map(|goniogram| goniogram.spectral_w_per_sr_nm.len() / own).sum();
    let of_places = component.sites().saturating_mul(all.column_count());
    of_places.saturating_add(if all.has_bands() { directions.saturating_mul(all.bands.len()) } else { 0 })
}

fn forget(component: &mut Changed, radiant: bool, luminous: bool) {
    let nodes = component.volume.as_mut().map(|volume| &mut volume.nodes);
    for amounts in [&mut component.vertices, &mut component.triangles].into_iter().chain(nodes) {
        amounts.radiant_w = amounts.radiant_w.take().filter(|_| radiant);
        amounts.luminous_lm = amounts.luminous_lm.take().filter(|_| luminous);
    }
    component.goniograms_mut().for_each(|goniogram| {
        goniogram.radiant_w_per_sr = goniogram.radiant_w_per_sr.take().filter(|_| radiant);
        goniogram.luminous_cd = goniogram.luminous_cd.take().filter(|_| luminous);
        goniogram.flux.radiant_w = goniogram.flux.radiant_w.filter(|_| radiant);
        goniogram.flux.luminous_lm = goniogram.flux.luminous_lm.filter(|_| luminous);
    });
}

fn is_tristimulus(spectral: &Spectral) -> bool {
    spectral.columns == Columns::Tristimulus
}

/// The spectral side that all components can have.
fn of_all(first: &Changed, components: &[Changed], radiant: bool, luminous: bool, notices: &mut Notices) -> Spectral {
    let all = |is: fn(&Spectral) -> bool| components.iter().all(|component| is(&component.spectral));
    let any = |is: fn(&Spectral) -> bool| components.iter().any(|component| is(&component.spectral));
    let columns = match (all(Spectral::has_bands) && radiant, all(is_tristimulus) && luminous) {
        (true, _) => Columns::Bands,
        (_, true) => Columns::Tristimulus,
        _ => Columns::None,
    };
    if columns == Columns::None && (any(Spectral::has_bands) || any(is_tristimulus)) {
        let found =
            format!("The spectrum of the whole is unknown, because not all models have one of the same kind. {REMEDY}");
        notices.add("combination.no_spectrum", found);
    }
    let own = components.iter().filter(|component| columns != Columns::Bands || component.spectral.has_bands());
    let mut edges_nm: Vec<f64> = own.flat_map(|component| component.spectral.bands.edges_nm()).copied().collect();
    edges_nm.sort_by(f64::total_cmp);
    edges_nm.dedup_by(|next, kept| *next - *kept < SAME_NM);
    // Where there are no bands, those of the first model stand and are not read.
    let bands = Bands::new(edges_nm).filter(|_| columns == Columns::Bands);
    Spectral { bands: bands.unwrap_or_else(|| first.spectral.bands.clone()), columns }
}

/// Which band of `own` each band of `all` lies in.
fn bands_within(own: &Bands, all: &Bands) -> Vec<Option<usize>> {
    all.centers_nm().into_iter().map(|nm| own.band(nm)).collect()
}

fn take(component: &mut Changed, own: &Spectral, all: &Spectral) {
    let within = (all.columns == Columns::Bands).then(|| bands_within(&own.bands, &all.bands));
    let nodes = component.volume.as_mut().map(|volume| &mut volume.nodes);
    for amounts in [&mut component.vertices].into_iter().chain(nodes) {
        match &within {
            Some(within) => cut(amounts, own, all, within),
            None if all.columns == Columns::None => (amounts.columns, amounts.column_count) = (Vec::new(), 0),
            None => {}
        }
    }
    let bands = own.bands.len();
    component.goniograms_mut().for_each(|goniogram| {
        let of = |values: &[f64]| -> Vec<f64> {
            let Some(within) = &within else { return Vec::new() };
            let row = |row: &[f64]| within.iter().map(|band| band.map_or(0.0, |band| row[band])).collect::<Vec<f64>>();
            values.chunks_exact(bands).flat_map(row).collect()
        };
        goniogram.spectral_flux_w_per_nm = of(&goniogram.spectral_flux_w_per_nm);
        goniogram.spectral_w_per_sr_nm = of(&goniogram.spectral_w_per_sr_nm);
    });
    component.spectral = all.clone();
}

/// W of the bands of `own` as W of those of `all`; what lies outside stays outside.
fn cut(amounts: &mut Amounts, own: &Spectral, all: &Spectral, within: &[Option<usize>]) {
    let (widths, new) = (own.bands.widths_nm(), all.bands.widths_nm());
    let mut columns = Vec::with_capacity(amounts.len() * (new.len() + 1));
    for site in 0..amounts.len() {
        let old = amounts.columns_of(site);
        let share = |(band, width): (&Option<usize>, &f64)| band.map_or(0.0, |band| old[band] * width / widths[band]);
        columns.extend(within.iter().zip(&new).map(share));
        columns.extend(old.last());
    }
    (amounts.columns, amounts.column_count) = (columns, new.len() + 1);
}
