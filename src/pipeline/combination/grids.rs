//! One frame and one grid of directions for all components.
//!
//! A goniogram is bilinear between its nodes, so a grid that has all nodes of another holds the same distribution exactly: where all γ run
//! along one axis, the grid has the nodes of all, and their C planes too where these are not too many. Other goniograms are taken to its
//! nodes, and how much goes elsewhere is measured.

use super::component::{Changed, nothing};
use super::sight::{Resampling, Sight, ratio};
use crate::error::Error;
use crate::goniogram::{Goniogram, SphereGrid};
use crate::vocabulary::notice::Notices;
use crate::vocabulary::space::Frame;

/// Most C planes.
const MOST_PLANES: usize = 720;
/// C planes where those of all models have no common multiple that fits.
const PLANES: [usize; 7] = [360, 240, 180, 144, 120, 90, 72];
/// Most numbers of all goniograms together, of one quantity; and of all their bands.
const MOST_NUMBERS: usize = 1 << 21;
const MOST_SPECTRAL_NUMBERS: usize = 1 << 22;
/// Steps for goniograms that are not told along the common γ, degrees; all make 180.
const STEPS_DEG: [f64; 9] = [1.0, 1.5, 2.0, 2.5, 3.0, 5.0, 7.5, 10.0, 15.0];
/// Of the finest step of such a goniogram, the part that its new step is at most.
const FINER: f64 = 0.5;
/// Nodes nearer to each other are one, degrees.
const SAME_DEG: f64 = 1e-9;
/// Share of the flux that goes elsewhere above which a user is told, and above which it is refused.
const ASTRAY_WORTH_A_NOTICE: f64 = 0.002;
const ASTRAY_REFUSED: f64 = 0.05;
/// What makes grids alike.
const ALIKE: &str =
    "Turn by quarters about the axes, or build the models with the same steps (--gamma-step and --c-step).";

/// What all goniograms have in common.
pub struct Common {
    /// The photometric frame.
    pub frame: Frame,
    /// Grid of the luminous and radiant intensities.
    pub grid: SphereGrid,
    /// Grid of the spectral intensities.
    pub spectral_grid: SphereGrid,
}

/// Takes all goniograms to a common frame and grids: those of the first component, as near as axes are.
///
/// # Errors
/// [`Error::Refused`] where grids cannot be one, and where a beam is too narrow to be told on the common grid.
pub fn unite(components: &mut [Changed], bands: usize, notices: &mut Notices) -> Result<Common, Error> {
    let frame = components.first().ok_or_else(nothing)?.sight.nearest_frame();
    let goniograms = |is: fn(&Goniogram) -> bool| {
        let of = |own: &Changed| own.zones.iter().map(|zone| &zone.goniogram).filter(|own| is(own)).count() + 1;
        components.iter().map(of).sum::<usize>()
    };
    let fine: Vec<(Sight, &SphereGrid)> = components.iter().map(|own| (own.sight, &own.grid)).collect();
    let grid = common(&fine, &frame, MOST_NUMBERS / goniograms(|_| true))?;
    let spectral: Vec<(Sight, &SphereGrid)> =
        components.iter().filter(|own| own.has_spectral()).map(|own| (own.sight, &own.spectral_grid)).collect();
    let spectral_grid = match spectral.as_slice() {
        [] => coarse(&grid),
        spectral => {
            let count = bands.max(1) * goniograms(|own| !own.spectral_w_per_sr_nm.is_empty());
            common(spectral, &frame, MOST_SPECTRAL_NUMBERS / count)?
        }
    };
    let common = Common { frame, grid, spectral_grid };
    for (index, component) in components.iter_mut().enumerate() {
        let astray = common.take(component, bands);
        let (name, percent) = (&component.ancestor.name, 100.0 * astray);
        if astray > ASTRAY_REFUSED {
            let found = format!(
                "Of {name}, {percent:.1} % of the light would go into other directions than before: its beam is too narrow for the common grid."
            );
            return Err(Error::refused("combination.blurred", found, ALIKE));
        }
        if astray > ASTRAY_WORTH_A_NOTICE {
            let found = format!(
                "Its directions are told on another grid than before, by which {percent:.2} % of its light goes into others."
            );
            let mut own = Notices::default();
            own.add("combination.resampled", found);
            notices.merge_of_channel(index, name, own.iter());
        }
    }
    Ok(common)
}

/// A grid of at most so many nodes that holds what all see.
fn common(seen: &[(Sight, &SphereGrid)], frame: &Frame, most_nodes: usize) -> Result<SphereGrid, Error> {
    if let [(first, grid), rest @ ..] = seen
        && first.is(frame)
        && rest.iter().all(|(sight, other)| sight.is(frame) && other == grid)
    {
        return Ok((*grid).clone());
    }
    let least_planes = seen.iter().map(|(_, grid)| grid.c_planes()).max().unwrap_or(1);
    let fitting = |least_deg: f64| {
        let (gamma_deg, planes) = nodes_of_all(seen, frame, least_deg);
        let enough = PLANES.into_iter().filter(|planes| *planes >= least_planes);
        let planes = planes.into_iter().chain(enough).find(|planes| planes * gamma_deg.len() <= most_nodes)?;
        Some(SphereGrid::uneven(gamma_deg, planes))
    };
    STEPS_DEG.into_iter().find_map(fitting).ok_or_else(|| {
        let found = "The grids of directions of the models do not fit into one of a reasonable size.";
        Error::refused("combination.too_large", found, ALIKE)
    })
}

/// The nodes of γ, degrees, of all that look along `frame`, and even ones at least `least_deg` apart for the others; and the C planes that hold
/// those of all, where they are not too many.
fn nodes_of_all(seen: &[(Sight, &SphereGrid)], frame: &Frame, least_deg: f64) -> (Vec<f64>, Option<usize>) {
    let (mut gamma_deg, mut planes) = (vec![0.0, 90.0, 180.0], Some(1));
    for (sight, grid) in seen {
        let own_deg = grid.gamma_deg();
        let own_planes = if sight.is_along(frame) {
            let is_upside_down = sight.frame.nadir != frame.nadir;
            gamma_deg.extend(own_deg.iter().map(|degrees| if is_upside_down { 180.0 - degrees } else { *degrees }));
            // Another C0 lies a quarter or two away.
            if sight.is(frame) { Some(grid.c_planes()) } else { common_multiple(grid.c_planes(), 4) }
        } else {
            let finest_deg = own_deg.windows(2).map(|pair| pair[1] - pair[0]).fold(180.0, f64::min);
            let finer = STEPS_DEG.into_iter().rev().find(|step| *step <= FINER * finest_deg);
            let steps = (180.0 / finer.unwrap_or(STEPS_DEG[0]).max(least_deg)).round() as usize;
            gamma_deg.extend((0..=steps).map(|node| node as f64 * 180.0 / steps as f64));
            Some(2 * steps)
        };
        planes = planes.zip(own_planes).and_then(|(all, own)| common_multiple(all, own));
    }
    gamma_deg.sort_by(f64::total_cmp);
    gamma_deg.dedup_by(|next, kept| *next - *kept < SAME_DEG);
    // 0 and 180 themselves, whatever lies that near.
    if let Some(last) = gamma_deg.last_mut() {
        *last = 180.0;
    }
    (gamma_deg, planes)
}

fn common_multiple(a: usize, b: usize) -> Option<usize> {
    let (mut divisor, mut rest) = (a, b);
    while rest > 0 {
        (divisor, rest) = (rest, divisor % rest);
    }
    Some(a / divisor * b).filter(|planes| *planes <= MOST_PLANES)
}

/// A grid for spectra where none has one: at most 25 of the nodes of γ, and 24 planes.
fn coarse(grid: &SphereGrid) -> SphereGrid {
    const STEPS: usize = 24;
    let nodes = grid.gamma_deg();
    let last = nodes.len() - 1;
    let steps = last.min(STEPS);
    SphereGrid::uneven((0..=steps).map(|at| nodes[(at * last + steps / 2) / steps]).collect(), STEPS)
}

impl Common {
    /// Takes the goniograms of a component there; the share of its light that goes elsewhere by that.
    fn take(&self, component: &mut Changed, bands: usize) -> f64 {
        let (sight, grid, spectral_grid) = (component.sight, component.grid.clone(), component.spectral_grid.clone());
        let is_same = |own: &SphereGrid, common: &SphereGrid| sight.is(&self.frame) && own == common;
        let mut astray = [0.0; 2];
        if !is_same(&grid, &self.grid) {
            let resampling = Resampling::new(&grid, sight, &self.grid, self.frame);
            component.goniograms_mut().for_each(|goniogram| {
                let primary = goniogram.radiant_w_per_sr.clone().or_else(|| goniogram.luminous_cd.clone());
                take_fine(goniogram, &resampling, &self.grid);
                let taken = goniogram.radiant_w_per_sr.as_ref().or(goniogram.luminous_cd.as_ref());
                if let (Some(own), Some(taken)) = (primary, taken) {
                    let [missed, all] = resampling.astray(&own, taken);
                    astray = [astray[0] + missed, astray[1] + all];
                }
            });
        }
        if component.has_spectral() && !is_same(&spectral_grid, &self.spectral_grid) {
            let resampling = Resampling::new(&spectral_grid, sight, &self.spectral_grid, self.frame);
            component.goniograms_mut().filter(|goniogram| !goniogram.spectral_w_per_sr_nm.is_empty()).for_each(
                |goniogram| {
                    let values = resampling.bands(&goniogram.spectral_w_per_sr_nm, bands);
                    goniogram.spectral_w_per_sr_nm = values;
                    keep_spectral_flux(goniogram, &self.spectral_grid, bands);
                },
            );
        }
        component.grid = self.grid.clone();
        component.spectral_grid = self.spectral_grid.clone();
        if !component.sight.is(&self.frame) {
            component.lattice = None;
            component.zones.iter_mut().for_each(|zone| zone.place = None);
        }
        component.sight = Sight::turned(self.frame, glam::DMat3::IDENTITY);
        ratio(astray[0], astray[1])
    }

    /// The spectral intensities of a goniogram whose light has one spectrum in all directions.
    pub fn spectral_of(&self, goniogram: &Goniogram) -> Vec<f64> {
        let (Some(radiant), spectrum) = (&goniogram.radiant_w_per_sr, &goniogram.spectral_flux_w_per_nm) else {
            return Vec::new();
        };
        let sight = Sight::turned(self.frame, glam::DMat3::IDENTITY);
        let form = Resampling::new(&self.grid, sight, &self.spectral_grid, self.frame).values(radiant);
        let flux = flux_of_cells(&form, &self.spectral_grid);
        form.iter().flat_map(|value| spectrum.iter().map(move |density| ratio(value * density, flux))).collect()
    }
}

fn take_fine(goniogram: &mut Goniogram, resampling: &Resampling<'_>, grid: &SphereGrid) {
    let flux = goniogram.flux;
    let quantities =
        [(&mut goniogram.radiant_w_per_sr, flux.radiant_w), (&mut goniogram.luminous_cd, flux.luminous_lm)];
    for (nodes, flux) in quantities {
        let Some(nodes) = nodes else { continue };
        *nodes = resampling.values(nodes);
        // By the rule of the cells the flux of a goniogram is the sum of its cells.
        let found = flux_of_cells(nodes, grid);
        let factor = flux.map_or(1.0, |flux| ratio(flux, found));
        nodes.iter_mut().filter(|_| factor > 0.0).for_each(|value| *value *= factor);
    }
}

fn keep_spectral_flux(goniogram: &mut Goniogram, grid: &SphereGrid, bands: usize) {
    for band in 0..bands {
        let own: Vec<f64> = goniogram.spectral_w_per_sr_nm.iter().skip(band).step_by(bands).copied().collect();
        let factor = ratio(goniogram.spectral_flux_w_per_nm[band], flux_of_cells(&own, grid));
        goniogram.spectral_w_per_sr_nm.iter_mut().skip(band).step_by(bands).for_each(|value| *value *= factor);
    }
}

/// Sum of the cells of `[c][gamma]` values, each times its solid angle.
fn flux_of_cells(nodes: &[f64], grid: &SphereGrid) -> f64 {
    let weights = grid.plane_solid_angles_sr();
    nodes.chunks_exact(weights.len()).flat_map(|plane| plane.iter().zip(&weights)).map(|(value, sr)| value * sr).sum()
}
