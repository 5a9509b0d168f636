//! Directions to intensities.

use super::beam::Beam;
use super::smoothing::smoother;
use super::sphere::SphereGrid;
use crate::error::Error;
use crate::flux::Amounts;
use crate::flux::shepard::Smoother;
use crate::options::GoniogramOptions;
use crate::rays::direction_cube::DirectionCube;
use crate::source::Spectral;
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::StageWatch;
/// Steps of γ to choose from, degrees.
const GAMMA_STEPS_DEG: [f64; 4] = [5.0, 2.5, 1.0, 0.5];
/// A finer step of γ is no use to cells with fewer rays than this.
const RAYS_PER_CELL: f64 = 5.0;
/// Step of C unless asked otherwise, degrees.
const C_STEP_DEG: f64 = 10.0;
/// γ intervals and C planes of the spectral grid: 15° × 30°.
const SPECTRAL_GRID: (usize, usize) = (12, 12);

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
    /// Spectral radiant intensity, W/(sr nm), `[c][gamma][band]` over the spectral grid; empty without bands.
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
    /// Widest smoothing radius, degrees; 0 when off.
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
    /// As asked, else: γ steps of at most an eighth of the beam's full width at half maximum as long as the
    /// beam's rays can fill such cells, C steps of 10°.
    pub fn new(directions: &DirectionCube, options: &GoniogramOptions) -> Grids {
        let beam = Beam::of(directions);
        let wanted_deg = (beam.full_width_deg() / 8.0).max(beam.cell_deg(RAYS_PER_CELL));
        let [coarsest, .., finest] = GAMMA_STEPS_DEG;
        let fitting = GAMMA_STEPS_DEG.into_iter().find(|step| *step <= wanted_deg).unwrap_or(finest);
        let chosen_deg = if beam.rays > 0.0 { fitting } else { coarsest };
        let gamma_count = (180.0 / options.gamma_step_deg.unwrap_or(chosen_deg)).round() as usize;
        let c_count = (360.0 / options.c_step_deg.unwrap_or(C_STEP_DEG)).round() as usize;
        Grids {
            fine: SphereGrid::new(gamma_count, c_count),
            spectral: SphereGrid::new(SPECTRAL_GRID.0, SPECTRAL_GRID.1),
        }
    }

    /// What each zone was counted to send, from the tallies of all zones (sites `zone × cells + cell`), smoothed where asked:
    /// all zones alike, so that smoothing the zones smooths their sum and no more.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn measured(
        &self,
        fine: &Amounts,
        spectral: &Amounts,
        smoothing: bool,
        watch: StageWatch<'_>,
    ) -> Result<Vec<Measured>, Error> {
        let fine_cells = self.fine.cell_count();
        let spectral_cells = if spectral.is_empty() { 0 } else { self.spectral.cell_count() };
        let zones = fine.len() / fine_cells;
        let smoothers = smoothing.then(|| [smoother(&self.fine, &fine.rays), smoother(&self.spectral, &spectral.rays)]);
        let mut measured = Vec::with_capacity(zones);
        for id in 0..zones {
            watch.step(id as f64 / zones as f64)?;
            let mut zone = Measured::new(
                fine.slice(id * fine_cells..(id + 1) * fine_cells),
                spectral.slice(id * spectral_cells..(id + 1) * spectral_cells),
            );
            if let Some([fine, spectral]) = &smoothers {
                zone.smooth(fine, spectral);
            }
            measured.push(zone);
        }
        Ok(measured)
    }

    /// The intensities of what was measured.
    pub fn goniogram(&self, measured: &Measured, spectrum: &Spectral) -> Goniogram {
        let Measured { fine, spectral, .. } = measured;
        let solid_angles_sr = self.fine.cell_solid_angles_sr();
        let per_sr = |flux: &Vec<f64>| -> Vec<f64> {
            let cells: Vec<f64> =
                flux.iter().zip(&solid_angles_sr).map(|(flux, solid_angle)| flux / solid_angle).collect();
            self.fine.nodes_from_cells(&cells)
        };
        Goniogram {
            rays: measured.counted.iter().sum(),
            flux: fine.total(),
            luminous_cd: fine.luminous_lm.as_ref().map(per_sr),
            radiant_w_per_sr: fine.radiant_w.as_ref().map(per_sr),
            spectral_w_per_sr_nm: self.spectral_intensities(spectral, spectrum),
            spectral_flux_w_per_nm: spectrum.bands_w_per_nm(&spectral.column_totals()),
            quality: measured.quality(&solid_angles_sr),
        }
    }

    /// `[c][gamma][band]`, W/(sr nm).
    fn spectral_intensities(&self, amounts: &Amounts, spectrum: &Spectral) -> Vec<f64> {
        if amounts.is_empty() || !spectrum.has_bands() {
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

/// What a zone, or several, send into the cells of both grids.
pub struct Measured {
    /// Rays counted per fine cell, before smoothing.
    counted: Vec<f64>,
    /// Flux per fine cell.
    fine: Amounts,
    /// Spectral columns per spectral cell.
    spectral: Amounts,
    /// Variance of the primary flux per fine cell.
    variance: Vec<f64>,
    /// Widest smoothing radius.
    smoothing_rad: f64,
}

impl Measured {
    /// As counted.
    fn new(fine: Amounts, spectral: Amounts) -> Measured {
        let (counted, sharing) = (fine.rays.clone(), fine.rays.clone());
        let mut measured = Measured { counted, fine, spectral, variance: Vec::new(), smoothing_rad: 0.0 };
        measured.vary(&sharing);
        measured
    }

    fn smooth(&mut self, fine: &Smoother, spectral: &Smoother) {
        let sharing: Vec<f64> = (0..self.counted.len()).map(|cell| fine.effective_rays(&self.counted, cell)).collect();
        self.fine.map(|amounts| fine.apply(amounts));
        if !self.spectral.is_empty() {
            self.spectral.map(|amounts| spectral.apply(amounts));
        }
        self.smoothing_rad = fine.widest;
        self.vary(&sharing);
    }

    /// Variances of fluxes that `rays` rays share in.
    fn vary(&mut self, rays: &[f64]) {
        let variance = |(flux, rays): (&f64, &f64)| if *rays > 0.0 { flux * flux / rays } else { 0.0 };
        self.variance = self.fine.primary().iter().zip(rays).map(variance).collect();
    }

    /// Adds another zone: the whole source is the sum of its zones, so that its file is the sum of theirs.
    pub fn add(&mut self, other: &Measured) {
        let add = |to: &mut [f64], from: &[f64]| to.iter_mut().zip(from).for_each(|(a, b)| *a += b);
        add(&mut self.counted, &other.counted);
        add(&mut self.variance, &other.variance);
        self.fine.accumulate(&other.fine);
        self.spectral.accumulate(&other.spectral);
        self.smoothing_rad = self.smoothing_rad.max(other.smoothing_rad);
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
            smoothing_deg: self.smoothing_rad.to_degrees(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothing_keeps_an_even_field_even() {
        for (gamma, c) in [(36, 36), (72, 36), (18, 8)] {
            let grid = SphereGrid::new(gamma, c);
            let solid_angles_sr = grid.cell_solid_angles_sr();
            for total in [2e3, 2e4, 2e5, 1e6] {
                let rays: Vec<f64> = solid_angles_sr.iter().map(|solid_angle| total * solid_angle).collect();
                let even = smoother(&grid, &rays).apply(&solid_angles_sr);
                for (cell, (flux, solid_angle)) in even.iter().zip(&solid_angles_sr).enumerate() {
                    let density = flux / solid_angle;
                    assert!((density - 1.0).abs() < 1e-3, "{gamma} {c}, {total} rays/sr, cell {cell}: {density}");
                }
            }
        }
    }
}
