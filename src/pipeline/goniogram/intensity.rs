//! Directions to intensities.

use super::ancestry::Ancestry;
use super::beam::{Beam, NarrowLight};
use super::mixture::Shares;
use super::smoothing::{Directions, Estimates, add, add_up};
use super::sphere::SphereGrid;
use crate::flux::Amounts;
use crate::options::GoniogramOptions;
use crate::rays::direction_cube::DirectionCube;
use crate::smoothing::{Caution, Counted, Refined};
use crate::source::Spectral;
use crate::vocabulary::space::Frame;
use crate::vocabulary::units::Flux;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Steps of γ to choose from, degrees.
const GAMMA_STEPS_DEG: [f64; 3] = [2.5, 1.0, 0.5];
/// Steps of γ in the beam's full width at half maximum: linear interpolation is then right within 0.2 % of the peak.
const STEPS_IN_BEAM: f64 = 12.0;
/// A finer step of γ is no use to cells with fewer rays than this.
const RAYS_PER_CELL: f64 = 1.0;
/// Step of C unless asked otherwise, degrees.
const C_STEP_DEG: f64 = 5.0;
/// Steps of γ and C of the zones of a wide beam to choose from, degrees: the finest is taken whose numbers are not too many.
const WIDE_STEPS_DEG: [(f64, f64); 5] = [(2.5, 5.0), (3.0, 6.0), (3.75, 7.5), (4.5, 9.0), (5.0, 10.0)];
/// Most bytes of the intensities of all zones as text; of a cell that holds light, and of a dark one.
const MOST_BYTES: f64 = 7e6;
const LIT_BYTES: f64 = 20.0;
const DARK_BYTES: f64 = 4.0;
/// Steps of γ and C of the spectral grid to choose from, degrees: the finest is taken whose numbers are not too many.
const SPECTRAL_STEPS_DEG: [(f64, f64); 4] = [(2.5, 5.0), (5.0, 10.0), (7.5, 15.0), (15.0, 30.0)];
/// Most spectral intensities in all zones together: some megabytes of JSON.
const MOST_SPECTRAL_NUMBERS: f64 = 600_000.0;

/// Part of the flux of a column that may go elsewhere than that of the zone while the zone counts as of one spectrum; and by chance, of a
/// column of one ray, less of more: over the zones and columns of three sources of 1e5 and 1e6 rays whose light is alike in all bands (a chip, four
/// chips, a dome), what smoothing left of noise came to 0.91. A column of a ray alone tells nothing.
const ONE_SPECTRUM: f64 = 0.03;
const ONE_SPECTRUM_BY_CHANCE: f64 = 1.25;

/// The angular distribution of a zone or of the whole source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Goniogram {
    /// Rays in it; a ray shared between zones counts by its shares.
    pub rays: f64,
    /// Its flux: equal to the sum of intensity × solid angle, before and after smoothing.
    pub flux: Flux,
    /// Luminous intensity, cd, `[c][gamma]` over the fine grid.
    pub luminous_cd: Option<Vec<f64>>,
    /// Radiant intensity, W/sr, `[c][gamma]` over the fine grid.
    pub radiant_w_per_sr: Option<Vec<f64>>,
    /// Spectral radiant intensity, W/(sr nm), `[c][gamma][band]` over the spectral grid; empty without bands, and where the light has
    /// one spectrum in all directions as far as the rays tell.
    pub spectral_w_per_sr_nm: Vec<f64>,
    /// Spectral flux, W/nm, one per band; empty without bands.
    pub spectral_flux_w_per_nm: Vec<f64>,
    /// How good it is.
    pub quality: Quality,
}

/// What the statistics of a goniogram allow to say.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quality {
    /// Median of rays per lit cell, before smoothing.
    pub rays_per_cell_median: f64,
    /// Share of cells without a ray.
    pub empty_cell_fraction: f64,
    /// Relative standard error of the largest intensity, after smoothing.
    pub relative_noise_at_peak: f64,
    /// Radius of the cap of directions whose rays share the largest intensity, degrees; 0 when off.
    pub smoothing_deg: f64,
}

/// The two grids of a run.
pub struct Grids {
    /// Luminous and radiant intensities.
    pub fine: SphereGrid,
    /// Spectral intensities: 40 bands want more rays per cell than one number does.
    pub spectral: SphereGrid,
}

impl Grids {
    /// Steps of γ and C, degrees, of `zones` zones. As asked, else: γ steps of at most a twelfth of the beam's full width at half maximum as
    /// long as the beam's rays can fill such cells, C steps of 5°; of many zones of a wide beam, as fine as there is room.
    pub fn steps_deg(
        directions: &DirectionCube,
        frame: &Frame,
        options: &GoniogramOptions,
        zones: usize,
    ) -> (f64, f64) {
        let beam = Beam::of(directions);
        let wanted_deg = (beam.full_width_deg() / STEPS_IN_BEAM).max(beam.cell_deg(RAYS_PER_CELL));
        let [coarsest, .., finest] = GAMMA_STEPS_DEG;
        let fitting = GAMMA_STEPS_DEG.into_iter().find(|step| *step <= wanted_deg).unwrap_or(finest);
        let chosen_deg = if beam.rays > 0.0 { fitting } else { coarsest };
        let (gamma_deg, c_deg) = if chosen_deg == coarsest {
            let fits = |(gamma_deg, c_deg): &(f64, f64)| zones <= most_zones(directions, frame, *gamma_deg, *c_deg);
            let [.., widest] = WIDE_STEPS_DEG;
            WIDE_STEPS_DEG.into_iter().find(fits).unwrap_or(widest)
        } else {
            (chosen_deg, C_STEP_DEG)
        };
        (options.gamma_step_deg.unwrap_or(gamma_deg), options.c_step_deg.unwrap_or(c_deg))
    }

    /// For `zones` zones with `bands` bands; the spectral grid as fine as there is room.
    pub fn new(
        directions: &DirectionCube,
        frame: &Frame,
        options: &GoniogramOptions,
        zones: usize,
        bands: usize,
        narrow: Option<&NarrowLight>,
    ) -> Grids {
        let grid = |gamma_deg: f64, c_deg: f64| {
            SphereGrid::new((180.0 / gamma_deg).round() as usize, (360.0 / c_deg).round() as usize)
        };
        let (gamma_deg, c_deg) = Grids::steps_deg(directions, frame, options, zones);
        if let Some(light) = narrow {
            return Grids::narrow(light, zones, bands);
        }
        let numbers = |grid: &SphereGrid| (grid.gamma_nodes() * grid.c_planes() * bands * (zones + 1)) as f64;
        let spectral = SPECTRAL_STEPS_DEG.map(|(gamma_deg, c_deg)| grid(gamma_deg, c_deg));
        let [.., coarsest] = spectral.clone();
        Grids {
            fine: grid(gamma_deg, c_deg),
            spectral: spectral.into_iter().find(|grid| numbers(grid) <= MOST_SPECTRAL_NUMBERS).unwrap_or(coarsest),
        }
    }

    /// Grids whose nodes of γ follow narrow light; the spectral one as fine as there is room.
    fn narrow(light: &NarrowLight, zones: usize, bands: usize) -> Grids {
        let (gamma_deg, planes) = light.nodes();
        let numbers = |grid: &SphereGrid| (grid.gamma_nodes() * grid.c_planes() * bands) as f64 * (zones as f64 + 1.0);
        let every = |step: usize| {
            let (first, last) = (gamma_deg.iter().step_by(step), gamma_deg.len() - 1);
            let last = gamma_deg.get(last).filter(|_| !last.is_multiple_of(step));
            first.chain(last).copied().collect::<Vec<f64>>()
        };
        let spectral = [(1, 3), (2, 6), (4, 6)].map(|(step, parts)| SphereGrid::uneven(every(step), planes / parts));
        let [.., coarsest] = spectral.clone();
        Grids {
            spectral: spectral.into_iter().find(|grid| numbers(grid) <= MOST_SPECTRAL_NUMBERS).unwrap_or(coarsest),
            fine: SphereGrid::uneven(gamma_deg, planes),
        }
    }

    /// How many zones with the grids of narrow light there is room for.
    pub fn most_narrow_zones(light: &NarrowLight, bands: usize) -> usize {
        let Grids { fine, spectral } = Grids::narrow(light, 1_000_000, bands);
        let cells = |grid: &SphereGrid| (grid.gamma_nodes() * grid.c_planes()) as f64;
        let bytes = LIT_BYTES * light.lit() + DARK_BYTES * (1.0 - light.lit());
        let (by_bytes, by_numbers) =
            (MOST_BYTES / (bytes * cells(&fine)), MOST_SPECTRAL_NUMBERS / (cells(&spectral) * bands.max(1) as f64));
        by_bytes.min(by_numbers) as usize
    }

    /// The primary flux of the zones, smoothed: of outward `normals` of each zone's surface in the photometric frame, with weights that
    /// sum to 1, and of a `family`. `ray`: what a typical ray carries to a cell, `images`: how many of its images do so all round.
    pub fn estimates(
        &self,
        zones: &[Measured],
        normals: &[Vec<(DVec3, f64)>],
        family: &[Ancestry],
        ray: &Flux,
        images: usize,
    ) -> Estimates {
        let directions = Directions::new(&self.fine);
        let projected_sr = directions.projected_sr(normals);
        let counted: Vec<&[f64]> = zones.iter().map(|zone| zone.fine.primary()).collect();
        let ray = ray.primary();
        directions.zones(&counted, &projected_sr, family, [ray, ray * images as f64])
    }

    /// Every quantity smoothed, from the primary flux that is `refined` at each zone's own vertices, and handed to the zones of their
    /// mixtures by `shares`.
    pub fn smooth(
        &self,
        zones: &mut [Measured],
        mut refined: Vec<Refined>,
        shares: &Shares,
        ray: &Flux,
        spectrum: &Spectral,
    ) {
        let mut whole = vec![0.0; self.fine.cell_count()];
        refined.iter().for_each(|zone| add(&mut whole, &zone.amounts, 1.0));
        let own: Vec<Vec<f64>> = refined.iter_mut().map(|zone| std::mem::take(&mut zone.amounts)).collect();
        for (zone, amounts) in refined.iter_mut().zip(shares.sharpen(&own)) {
            zone.amounts = amounts;
        }
        add_up(&mut refined, &whole);
        hand_over(zones, shares);
        let (fine, coarse) = (Directions::new(&self.fine), Directions::new(&self.spectral));
        let column_ray = if spectrum.has_bands() { ray.primary() } else { ray.luminous_lm.unwrap_or(0.0) };
        let luminous = luminous(zones, &refined, &fine, ray);
        zones.par_iter_mut().zip(refined).zip(luminous).for_each(|((zone, refined), luminous)| {
            zone.take(&self.fine, refined, luminous);
            self.smooth_columns(zone, &coarse, column_ray);
        });
    }

    /// What a volume sends, its light in all directions alike as far as the rays do not say otherwise; `None` without zones.
    pub fn of_volume(&self, zones: &[Measured], smooths: bool, ray: &Flux, spectrum: &Spectral) -> Option<Measured> {
        let mut whole = sum(zones)?;
        if smooths {
            let (fine, coarse) = (Directions::new(&self.fine), Directions::new(&self.spectral));
            let refined = fine.even(whole.fine.primary(), ray.primary());
            let luminous = luminous(std::slice::from_ref(&whole), std::slice::from_ref(&refined), &fine, ray).pop();
            whole.take(&self.fine, refined, luminous.flatten());
            let column_ray = if spectrum.has_bands() { ray.primary() } else { ray.luminous_lm.unwrap_or(0.0) };
            self.smooth_columns(&mut whole, &coarse, column_ray);
        }
        Some(whole)
    }

    /// The columns of a zone in each spectral cell: of the intensity there the shares that the rays of the cell's surroundings have.
    fn smooth_columns(&self, zone: &mut Measured, coarse: &Directions<'_>, ray: f64) {
        if zone.spectral.is_empty() {
            return;
        }
        let nodes = self.fine.nodes_from_cells(&per_sr(zone.fine.primary(), &self.fine));
        let solid_angles_sr = self.spectral.cell_solid_angles_sr();
        let at = |((c, gamma), sr): ((f64, f64), f64)| self.fine.interpolate(&nodes, c, gamma) * sr;
        let form: Vec<f64> = self.spectral.cell_nodes().into_iter().zip(solid_angles_sr).map(at).collect();
        let expected = coarse.fluxes(|direction| {
            let gamma = (-direction.z).clamp(-1.0, 1.0).acos();
            self.fine.interpolate(&nodes, direction.y.atan2(direction.x), gamma)
        });
        let (totals, lit) = (zone.spectral.column_totals(), zone.spectral.lit_columns());
        let mut columns: Vec<Vec<f64>> = lit.iter().map(|column| zone.spectral.column(*column)).collect();
        if columns.len() > 1 {
            let counted = |amounts| Counted::new(amounts, &expected, ray, Caution::Smooth);
            columns = coarse.like(&columns.iter().map(|column| counted(column)).collect::<Vec<_>>());
        }
        for cell in 0..form.len() {
            let sum: f64 = columns.iter().map(|column| column[cell]).sum();
            let one = 1.0 / lit.len() as f64;
            columns.iter_mut().for_each(|column| {
                column[cell] = form[cell] * if sum > 0.0 { column[cell] / sum } else { one };
            });
        }
        for (column, values) in lit.iter().zip(&columns) {
            let sum: f64 = values.iter().sum();
            let scale = if sum > 0.0 { totals[*column] / sum } else { 0.0 };
            let values: Vec<f64> = values.iter().map(|value| value * scale).collect();
            zone.spectral.set_column(*column, &values);
        }
    }

    /// The intensities of what was measured.
    pub fn goniogram(&self, measured: &Measured, spectrum: &Spectral) -> Goniogram {
        let Measured { fine, spectral, .. } = measured;
        let solid_angles_sr = self.fine.cell_solid_angles_sr();
        let per_sr = |flux: &Vec<f64>| self.fine.nodes_from_cells(&per_sr(flux, &self.fine));
        Goniogram {
            rays: measured.counted.iter().sum(),
            flux: fine.total(),
            luminous_cd: fine.luminous_lm.as_ref().map(per_sr),
            radiant_w_per_sr: fine.radiant_w.as_ref().map(per_sr),
            spectral_w_per_sr_nm: self.spectral_intensities(spectral, measured.counted.iter().sum(), spectrum),
            spectral_flux_w_per_nm: spectrum.bands_w_per_nm(&spectral.column_totals()),
            quality: measured.quality(&solid_angles_sr),
        }
    }

    /// `[c][gamma][band]`, W/(sr nm).
    fn spectral_intensities(&self, amounts: &Amounts, rays: f64, spectrum: &Spectral) -> Vec<f64> {
        if amounts.is_empty() || !spectrum.has_bands() || has_one_spectrum(amounts, rays) {
            return Vec::new();
        }
        let solid_angles_sr = self.spectral.cell_solid_angles_sr();
        let mut values =
            Vec::with_capacity(self.spectral.c_planes() * self.spectral.gamma_nodes() * spectrum.bands.len());
        for c in 0..self.spectral.c_planes() {
            for gamma in 0..self.spectral.gamma_nodes() {
                let cell = self.spectral.cell_of_node(c, gamma);
                let bands = spectrum.bands_w_per_nm(amounts.columns_of(cell));
                values.extend(bands.into_iter().map(|w_per_nm| w_per_nm / solid_angles_sr[cell]));
            }
        }
        values
    }
}

/// How many zones with these steps there is room for, by how much of the sphere is lit.
pub fn most_zones(directions: &DirectionCube, frame: &Frame, gamma_deg: f64, c_deg: f64) -> usize {
    let lit = |cell: usize| {
        let (_, gamma) = frame.angles(DirectionCube::center(cell));
        if directions.rays[cell] > 0 { DirectionCube::solid_angle_sr(cell) / gamma.sin().max(0.01) } else { 0.0 }
    };
    let share = ((0..DirectionCube::CELLS).map(lit).sum::<f64>() / (TAU * PI)).min(1.0);
    let cells = 180.0 / gamma_deg * 360.0 / c_deg;
    (MOST_BYTES / (cells * (LIT_BYTES * share + DARK_BYTES * (1.0 - share)))) as usize
}

/// The luminous flux of zones per cell, smoothed like the radiant flux that is `refined`; `None` of a zone that does not know both.
fn luminous(zones: &[Measured], refined: &[Refined], fine: &Directions<'_>, ray: &Flux) -> Vec<Option<Vec<f64>>> {
    let knows_both = |zone: &Measured| zone.fine.radiant_w.is_some() && zone.fine.luminous_lm.is_some();
    let counted = zones.iter().zip(refined).filter_map(|(zone, refined)| {
        let amounts = zone.fine.luminous_lm.as_deref().filter(|_| knows_both(zone))?;
        Some(Counted::new(amounts, &refined.amounts, zone.luminous_ray(ray), Caution::Smooth))
    });
    let mut smoothed = fine.like(&counted.collect::<Vec<_>>()).into_iter();
    zones.iter().map(|zone| if knows_both(zone) { smoothed.next() } else { None }).collect()
}

/// What zones send together; `None` without zones.
pub fn sum(zones: &[Measured]) -> Option<Measured> {
    let (first, others) = zones.split_first()?;
    let mut whole = first.clone();
    others.iter().for_each(|zone| whole.add(zone));
    Some(whole)
}

/// What was counted in zones that became one; `zone_of_zone`: the new zone of each.
pub fn merged(zones: Vec<Measured>, zone_of_zone: &[u32]) -> Vec<Measured> {
    let mut merged: Vec<Measured> = Vec::new();
    for (zone, new) in zones.into_iter().zip(zone_of_zone) {
        match merged.get_mut(*new as usize) {
            Some(sum) => sum.add(&zone),
            None => merged.push(zone),
        }
    }
    merged
}

/// Hands what was counted at each zone's own vertices to the zones of their mixtures.
fn hand_over(zones: &mut [Measured], shares: &Shares) {
    let handed = |of: &dyn Fn(&Measured) -> &[f64]| shares.hand_over(&zones.iter().map(of).collect::<Vec<&[f64]>>());
    let counted = handed(&|zone| &zone.counted);
    let rays = handed(&|zone| &zone.fine.rays);
    let radiant = handed(&|zone| zone.fine.radiant_w.as_deref().unwrap_or(&[]));
    let luminous = handed(&|zone| zone.fine.luminous_lm.as_deref().unwrap_or(&[]));
    let columns = handed(&|zone| &zone.spectral.columns);
    let lists = counted.into_iter().zip(rays).zip(radiant).zip(luminous).zip(columns);
    for (zone, ((((counted, rays), radiant), luminous), columns)) in zones.iter_mut().zip(lists) {
        (zone.counted, zone.fine.rays, zone.spectral.columns) = (counted, rays, columns);
        zone.fine.radiant_w = zone.fine.radiant_w.as_ref().map(|_| radiant);
        zone.fine.luminous_lm = zone.fine.luminous_lm.as_ref().map(|_| luminous);
    }
}

/// Whether all columns of a zone go into the same directions: none sends more of its flux elsewhere than counts, or than as few of the zone's
/// `rays` as it has show by chance. A column may be small and yet matter: at the border of a blue chip lies a little of the yellow light
/// round it, which does not go where the blue goes.
fn has_one_spectrum(amounts: &Amounts, rays: f64) -> bool {
    let totals = amounts.column_totals();
    let total: f64 = totals.iter().sum();
    let mut elsewhere = vec![0.0; totals.len()];
    for cell in 0..amounts.len() {
        let columns = amounts.columns_of(cell);
        let share = columns.iter().sum::<f64>() / total;
        let differences = columns.iter().zip(&totals).map(|(column, whole)| (column - share * whole).abs());
        // What goes elsewhere is there too much and here too little.
        elsewhere.iter_mut().zip(differences).for_each(|(sum, difference)| *sum += 0.5 * difference);
    }
    let most = |whole: f64| (ONE_SPECTRUM + ONE_SPECTRUM_BY_CHANCE / (rays * whole / total).sqrt()) * whole;
    let mut lit = elsewhere.iter().zip(&totals).filter(|(_, whole)| **whole > 0.0);
    lit.all(|(elsewhere, whole)| *elsewhere <= most(*whole))
}

/// Flux per cell as intensity per cell.
fn per_sr(flux: &[f64], grid: &SphereGrid) -> Vec<f64> {
    flux.iter().zip(grid.cell_solid_angles_sr()).map(|(flux, solid_angle_sr)| flux / solid_angle_sr).collect()
}

/// What a zone, or several, send into the cells of both grids.
#[derive(Clone)]
pub struct Measured {
    /// Rays counted per fine cell, before smoothing.
    counted: Vec<f64>,
    /// Flux per fine cell.
    fine: Amounts,
    /// Spectral columns per spectral cell.
    spectral: Amounts,
    /// Variance of the primary flux per fine cell.
    variance: Vec<f64>,
}

impl Measured {
    /// As counted.
    pub fn new(fine: Amounts, spectral: Amounts) -> Measured {
        let variance = |(flux, rays): (&f64, &f64)| if *rays > 0.0 { flux * flux / rays } else { 0.0 };
        let variance = fine.primary().iter().zip(&fine.rays).map(variance).collect();
        Measured { counted: fine.rays.clone(), fine, spectral, variance }
    }

    /// Takes what was found: the primary flux, and lm where both are known.
    fn take(&mut self, grid: &SphereGrid, refined: Refined, luminous: Option<Vec<f64>>) {
        let form = refined.amounts;
        if let Some(known) = &mut self.fine.luminous_lm {
            *known = luminous.unwrap_or_else(|| form.clone());
        }
        if let Some(radiant) = &mut self.fine.radiant_w {
            *radiant = form;
        }
        for flux in [&mut self.fine.luminous_lm, &mut self.fine.radiant_w].into_iter().flatten() {
            *flux = grid.sharpened(flux);
        }
        let square = |(amount, variance): (&f64, &f64)| amount * amount * variance;
        self.variance = self.fine.primary().iter().zip(&refined.variance).map(square).collect();
    }

    /// Amount of a typical ray of the zone, lm: a green zone's has more than the source's. Where rays have unlike wavelengths, that is more than
    /// the zone's mean; twice the mean holds for any mixture of light and dark halves.
    fn luminous_ray(&self, ray: &Flux) -> f64 {
        let Flux { radiant_w, luminous_lm } = self.fine.total();
        let lm_per_w = luminous_lm.zip(radiant_w).filter(|(_, watt)| *watt > 0.0).map_or(0.0, |(lm, watt)| lm / watt);
        (2.0 * lm_per_w * ray.radiant_w.unwrap_or(0.0)).max(ray.luminous_lm.unwrap_or(0.0))
    }

    /// The same flux with the noise of `refined`: that of zones which have one prior does not average out.
    #[must_use]
    pub fn with_noise_of(mut self, refined: &Refined) -> Measured {
        let square = |(amount, variance): (&f64, &f64)| amount * amount * variance;
        self.variance = self.fine.primary().iter().zip(&refined.variance).map(square).collect();
        self
    }

    /// Adds another zone: on a surface the whole source is the sum of its zones, so that its file is the sum of theirs.
    pub fn add(&mut self, other: &Measured) {
        let add = |to: &mut [f64], from: &[f64]| to.iter_mut().zip(from).for_each(|(a, b)| *a += b);
        add(&mut self.counted, &other.counted);
        add(&mut self.variance, &other.variance);
        self.fine.accumulate(&other.fine);
        self.spectral.accumulate(&other.spectral);
    }

    /// Radius of the cap round a cell that holds as many rays as its noise says took part in it; 0 where nothing was smoothed.
    fn smoothed_deg(&self, cell: usize, intensity: f64) -> f64 {
        let flux = self.fine.primary();
        let counted: f64 = self.counted.iter().sum();
        let per_ray = flux.iter().sum::<f64>() / counted;
        let taking_part = flux[cell] * flux[cell] / self.variance[cell];
        let solid_angle_sr = taking_part * per_ray / intensity;
        let alone = taking_part <= self.counted[cell] * (1.0 + 1e-9);
        if alone || !solid_angle_sr.is_finite() {
            return 0.0;
        }
        (1.0 - solid_angle_sr / TAU).clamp(-1.0, 1.0).acos().to_degrees()
    }

    fn quality(&self, solid_angles_sr: &[f64]) -> Quality {
        let mut lit: Vec<f64> = self.counted.iter().copied().filter(|rays| *rays > 0.0).collect();
        lit.sort_by(f64::total_cmp);
        let flux = self.fine.primary();
        let intensity = |cell: &usize| flux[*cell] / solid_angles_sr[*cell];
        let peak =
            (0..flux.len()).max_by(|a, b| intensity(a).total_cmp(&intensity(b))).filter(|cell| flux[*cell] > 0.0);
        Quality {
            rays_per_cell_median: lit.get(lit.len() / 2).copied().unwrap_or(0.0),
            empty_cell_fraction: 1.0 - lit.len() as f64 / self.counted.len() as f64,
            relative_noise_at_peak: peak.map_or(0.0, |cell| self.variance[cell].sqrt() / flux[cell]),
            smoothing_deg: peak.map_or(0.0, |cell| self.smoothed_deg(cell, intensity(&cell))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten cells with the same flux of one column, and in the first a hundredth of it of another, nine tenths of whose flux thus go elsewhere:
    /// seen by ten rays, of one alone it may be chance.
    #[test]
    fn a_small_column_that_goes_elsewhere_is_no_part_of_one_spectrum() {
        let amounts = |small: f64| {
            let columns = (0..10).flat_map(|cell| [100.0, if cell == 0 { small } else { 0.0 }, 0.0]).collect();
            Amounts { columns, column_count: 3, ..Amounts::none() }
        };
        assert!(!has_one_spectrum(&amounts(10.0), 1000.0));
        assert!(has_one_spectrum(&amounts(10.0), 100.0));
        assert!(has_one_spectrum(&amounts(0.0), 1000.0), "columns without light go nowhere");
    }
}
