//! Models changed, and several models as one, without their rays: each is read back from its two files, made brighter or darker, turned and
//! moved; then its surface, its zones and its goniograms stand beside those of the others (`openapi/README.md`, combination).
//!
//! Light adds up, so nothing is computed anew: vertices keep their flux times a factor, zones their goniograms. Only the frame, the grid of
//! directions and the bands must become one.

/// What is changed of a model.
pub mod change;
/// How directions are told.
mod sight;
/// A model that goes in.
mod component;
/// One spectrum for all light of a model.
mod spectrum;
/// One spectral side for all.
mod bands;
/// One frame and one grid for all.
mod grids;

pub use change::{Change, Strength, Turn};
pub use component::Component;

use crate::error::{Error, Place};
use crate::flux::balance::{Balance, Share};
use crate::flux::{Amounts, Surface};
use crate::goniogram::intensity::Quality;
use crate::goniogram::{Goniogram, Goniograms, Mixture, Zone};
use crate::hull::Hull;
use crate::model::Model;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::StageWatch;
use component::{Changed, nothing};
use grids::Common;

/// Most models in one.
pub const MOST_MODELS: usize = 64;

/// The model that all components are together.
///
/// # Errors
/// As [`crate::artifacts::read::read`] of each; [`Error::Unusable`] for a change that cannot be made or a wrong number of models;
/// [`Error::Refused`] for models that cannot be one; [`Error::Cancelled`].
pub fn combine(components: &[Component], limits: &Limits, watch: StageWatch<'_>) -> Result<Model, Error> {
    if components.len() > MOST_MODELS {
        let (place, found) = (Place::Asked("models"), format!("{} models are to be one.", components.len()));
        let remedy = format!("Combine at most {MOST_MODELS} at a time; combinations can be combined again.");
        return Err(Error::invalid_declaration("combination.models", place, found, remedy));
    }
    let mut changed = Vec::with_capacity(components.len());
    let mut numbers = 0_usize;
    for (at, component) in components.iter().enumerate() {
        let own = made(component, limits, &mut numbers);
        changed.push(own.map_err(|error| error.of_model(at)).map_err(|error| {
            let name = component.name.as_ref().map_or(String::new(), |name| format!(" ({name})"));
            if components.len() == 1 { error } else { error.of_one(&format!("Model {}{name}", at + 1)) }
        })?);
        watch.step(0.6 * (at + 1) as f64 / components.len() as f64)?;
    }
    check_volumes(&changed)?;
    if changed.len() > 1 {
        changed.iter_mut().for_each(Changed::light_dark_zones);
    }
    let mut notices = Notices::default();
    let spectral = bands::unite(&mut changed, limits, &mut notices)?;
    watch.step(0.7)?;
    let bands = if spectral.has_bands() { spectral.bands.len() } else { 0 };
    let common = grids::unite(&mut changed, bands, &mut notices)?;
    watch.step(0.9)?;
    let model = together(changed, common, spectral, notices)?;
    watch.step(1.0)?;
    Ok(model)
}

/// A component, changed. `numbers`: those on the surfaces so far; they are bounded before there are more.
fn made(component: &Component, limits: &Limits, numbers: &mut usize) -> Result<Changed, Error> {
    let mut own = Changed::new(component, limits)?;
    let with_bands = |table| spectrum::bands(table).map(|bands| (table, bands));
    let given = component.change.spectrum.as_ref().map(with_bands).transpose()?;
    let columns = given.as_ref().map_or(own.vertices.column_count, |(_, bands)| bands.len() + 1);
    *numbers = numbers.saturating_add(own.sites().saturating_mul(columns.max(1)));
    if *numbers > limits.max_tally_values {
        let found = format!("The models together have {numbers} numbers on their surfaces, more than are written.");
        let remedy = "Combine fewer models, or models with wider bands or a spectrum over fewer wavelengths.";
        return Err(Error::refused("combination.too_large", found, remedy));
    }
    if let Some((table, bands)) = given {
        spectrum::give(&mut own, table, bands)?;
    }
    own.scale(component.change.factor(&own.total.flux)?);
    Ok(own)
}

/// A volume has one goniogram and one lattice, and is the model: it cannot stand beside something else.
fn check_volumes(components: &[Changed]) -> Result<(), Error> {
    match components.iter().find(|component| component.volume.is_some()) {
        Some(volume) if components.len() > 1 => {
            let found =
                format!("{} is a volume, and a model has one volume and nothing beside it.", volume.ancestor.name);
            let remedy = "Build that model on its surface, with --emission origins, and combine that.";
            Err(Error::refused("combination.volume", found, remedy))
        }
        _ => Ok(()),
    }
}

fn together(
    components: Vec<Changed>,
    common: Common,
    spectral: crate::source::Spectral,
    notices: Notices,
) -> Result<Model, Error> {
    let is_alone = components.len() == 1;
    let total = whole(&components, &common);
    let mut all = components.into_iter();
    let mut sum = all.next().ok_or_else(nothing)?;
    let (mut origins, mut ancestors) = (vec![sum.origin], vec![sum.ancestor]);
    for next in all {
        let first = sum.zones.len() as u32;
        sum.zones.extend(next.zones.into_iter().map(|zone| Zone { id: first + zone.id, ..zone }));
        let offset = |mixture: Mixture| Mixture { zones: mixture.zones.map(|zone| first + zone), ..mixture };
        sum.mixtures.extend(next.mixtures.into_iter().map(offset));
        sum.hull = sum.hull.beside(&next.hull);
        append(&mut sum.vertices, next.vertices);
        append(&mut sum.triangles, next.triangles);
        origins.push(next.origin);
        ancestors.push(next.ancestor);
    }
    if !is_alone {
        sum.zones.iter_mut().for_each(|zone| zone.place = None);
    }
    let rays = origins.iter().fold(0_u64, |sum, origin| sum.saturating_add(origin.rays_used));
    let flux = total.flux;
    let surface = surface(sum.triangles, sum.vertices, rays, flux);
    // Of the zones of a vertex, the one with the largest weight.
    let heaviest = |mixture: &Mixture| mixture.parts().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
    let zone_of_vertex = sum.mixtures.iter().map(|own| heaviest(own).map_or(0, |(zone, _)| zone as u32)).collect();
    let goniograms = Goniograms {
        frame: common.frame,
        lattice: sum.lattice.filter(|_| is_alone),
        grid: common.grid,
        spectral_grid: common.spectral_grid,
        zones: sum.zones,
        zone_of_vertex,
        mixtures: sum.mixtures,
        total,
        notices: Notices::default(),
    };
    Ok(Model {
        origins,
        ancestors,
        flux,
        spectral,
        hull: Hull { notices: Notices::default(), ..sum.hull },
        surface,
        goniograms,
        volume: sum.volume,
        study: None,
        notices: notices.to_vec(),
    })
}

fn append(all: &mut Amounts, more: Amounts) {
    all.rays.extend(more.rays);
    all.columns.extend(more.columns);
    for (all, more) in [(&mut all.radiant_w, more.radiant_w), (&mut all.luminous_lm, more.luminous_lm)] {
        if let (Some(all), Some(more)) = (all, more) {
            all.extend(more);
        }
    }
}

/// The flux of a combination: no ray was laid on anything, so all of it lies where it lay.
fn surface(triangles: Amounts, vertices: Amounts, rays: u64, flux: Flux) -> Surface {
    let none = |known: Option<f64>| known.map(|_| 0.0);
    let nothing = Flux { radiant_w: none(flux.radiant_w), luminous_lm: none(flux.luminous_lm) };
    let (all, none) = (Share { rays, flux }, Share { rays: 0, flux: nothing });
    let on_vertices = vertices.total();
    let balance = Balance {
        incoming: all,
        hit: all,
        snapped: none,
        rejected: none,
        on_triangles: triangles.total(),
        on_vertices,
        after_smoothing: on_vertices,
    };
    Surface { triangles, vertices, ray: nothing, balance, notices: Notices::default() }
}

/// The goniogram of all components together: their sum.
fn whole(components: &[Changed], common: &Common) -> Goniogram {
    let [first, rest @ ..] = components else { return Goniogram::default() };
    if rest.is_empty() {
        return first.total.clone();
    }
    let add = |sum: &mut [f64], more: &[f64]| sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
    let full = |own: &Changed| -> Goniogram {
        let mut total = own.total.clone();
        if total.spectral_w_per_sr_nm.is_empty() && !total.spectral_flux_w_per_nm.is_empty() {
            total.spectral_w_per_sr_nm = common.spectral_of(&total);
        }
        total
    };
    let mut sum = full(first);
    let weights: Vec<f64> = components.iter().map(|own| own.total.flux.primary()).collect();
    for own in rest {
        let next = full(own);
        sum.rays += next.rays;
        sum.flux = Flux {
            radiant_w: sum.flux.radiant_w.zip(next.flux.radiant_w).map(|(a, b)| a + b),
            luminous_lm: sum.flux.luminous_lm.zip(next.flux.luminous_lm).map(|(a, b)| a + b),
        };
        let pairs = [(&mut sum.radiant_w_per_sr, next.radiant_w_per_sr), (&mut sum.luminous_cd, next.luminous_cd)];
        for (sum, more) in pairs {
            if let (Some(sum), Some(more)) = (sum, more) {
                add(sum, &more);
            }
        }
        add(&mut sum.spectral_flux_w_per_nm, &next.spectral_flux_w_per_nm);
        add(&mut sum.spectral_w_per_sr_nm, &next.spectral_w_per_sr_nm);
    }
    let mean = |of: fn(&Quality) -> f64| {
        let pairs = components.iter().zip(&weights);
        sight::ratio(pairs.map(|(own, weight)| weight * of(&own.total.quality)).sum(), weights.iter().sum())
    };
    sum.quality = Quality {
        rays_per_cell_median: mean(|quality| quality.rays_per_cell_median),
        empty_cell_fraction: mean(|quality| quality.empty_cell_fraction),
        relative_noise_at_peak: mean(|quality| quality.relative_noise_at_peak),
        smoothing_deg: mean(|quality| quality.smoothing_deg),
    };
    sum
}
