//! 4. Flux to angles [Расчет углового распределения яркости].

/// Which way the source looks.
pub mod aim;
/// The grid of directions: the one owner of the binning rule.
pub mod sphere;
/// The zone lattice and which point belongs where.
pub mod zone;
/// Directions to intensities.
pub mod intensity;

pub use intensity::Goniogram;
pub use sphere::SphereGrid;
pub use zone::{Lattice, Zone};

use super::Error;
use super::flux::Surface;
use super::flux::project::Projector;
use super::flux::tally::{Quanta, Tally};
use super::hull::{Cloud, Hull};
use super::rays::Ray;
use super::vocabulary::limits::Limits;
use super::vocabulary::notice::Notices;
use super::vocabulary::space::{Axis, Frame};
use super::vocabulary::watch::StageWatch;
use intensity::Grids;
use serde::Serialize;
use zone::Zoning;

/// How zones and their goniograms are made.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Options {
    /// Zones along C0 and across it, 1..=32 each. Default: at most 16 zones, from the rays' density.
    pub zones: Option<(u32, u32)>,
    /// The source axis at γ = 0. Default: the axis nearest the direction of maximum intensity.
    pub nadir: Option<Axis>,
    /// The source axis at C0. Default: the next axis in cyclic order.
    pub c0: Option<Axis>,
    /// Step of γ, degrees; 180 is a whole multiple of it; 0.5..=30. Default: from the beam's width.
    pub gamma_step_deg: Option<f64>,
    /// Step of C, degrees; 360 is a whole multiple of it; 1..=90. Default 10.
    pub c_step_deg: Option<f64>,
    /// Smoothing on the grid.
    pub smoothing: bool,
}

impl Default for Options {
    fn default() -> Options {
        Options { zones: None, nadir: None, c0: None, gamma_step_deg: None, c_step_deg: None, smoothing: true }
    }
}

/// Most cells of an angular grid: more than any reader of IES files wants.
const MOST_CELLS: usize = 40_000;

impl Options {
    /// What can be said of the options without a source.
    ///
    /// # Errors
    /// [`Error::Unusable`] naming the option.
    pub fn validate(&self) -> Result<(), Error> {
        if let Some((columns, rows)) = self.zones {
            for (option, count) in [("goniogram.zones.columns", columns), ("goniogram.zones.rows", rows)] {
                if !(1..=zone::MOST_ALONG).contains(&count) {
                    let found = format!("{columns} x {rows} zones were asked for.");
                    return Err(Error::unusable("options.zones", option, found, "Ask for 1 to 32 each way."));
                }
            }
        }
        if let (Some(nadir), Some(c0)) = (self.nadir, self.c0)
            && nadir.component() == c0.component()
        {
            return Err(aim::parallel(nadir, c0));
        }
        let gamma = sphere::whole_steps(self.gamma_step_deg, 180.0, 0.5..=30.0, "goniogram.gamma_step_deg")?;
        let c = sphere::whole_steps(self.c_step_deg, 360.0, 1.0..=90.0, "goniogram.c_step_deg")?;
        if let (Some(gamma), Some(c)) = (gamma, c)
            && gamma * c > MOST_CELLS
        {
            let found = format!("{gamma} steps of gamma times {c} of C are {} cells.", gamma * c);
            let remedy = format!("Choose wider steps: at most {MOST_CELLS} cells, e.g. 0.5 by 5 degrees.");
            return Err(Error::unusable("options.angle_step", "goniogram.c_step_deg", found, remedy));
        }
        Ok(())
    }
}

/// Zones and their goniograms.
#[derive(Clone, Debug)]
pub struct Goniograms {
    /// The photometric frame.
    pub frame: Frame,
    /// The zone lattice.
    pub lattice: Lattice,
    /// Grid of the luminous and radiant intensities.
    pub grid: SphereGrid,
    /// Coarser grid of the spectral intensities.
    pub spectral_grid: SphereGrid,
    /// Zones that hold light, ids 0.. in row-major lattice order; a zone's id is its index.
    pub zones: Vec<Zone>,
    /// Zone id of each vertex of the hull (hard zones: one zone, weight 1).
    pub zone_of_vertex: Vec<u32>,
    /// The whole source.
    pub total: Goniogram,
    /// What happened on the way.
    pub notices: Notices,
}

/// Makes the zones and measures a goniogram for each, and one for the whole source.
///
/// # Errors
/// [`Error::Unusable`] when γ = 0 and C0 lie along one line; [`Error::Refused`] above [`Limits::max_tally_values`];
/// [`Error::Cancelled`]; [`Error::Unreadable`].
pub fn measure(
    cloud: &Cloud<'_>,
    hull: &Hull,
    surface: &Surface,
    options: &Options,
    limits: &Limits,
    watch: StageWatch<'_>,
) -> Result<Goniograms, Error> {
    let frame = aim::frame(&cloud.source.survey.directions, options)?;
    let zoning = Zoning::new(hull, surface, frame, options.zones);
    let grids = Grids::new(&cloud.source.survey.directions, options);
    let (fine, spectral) = collect(cloud, hull, &zoning, &grids, limits, watch.part(0.0, 0.8))?;
    let measured = grids.measured(&fine, &spectral, options.smoothing, watch.part(0.8, 1.0))?;
    let spectrum = &cloud.source.spectral;
    let zones = zoning.zones.into_iter().zip(&measured);
    let zones = zones.map(|(zone, own)| Zone { goniogram: grids.goniogram(own, spectrum), ..zone }).collect();
    let whole = measured.into_iter().reduce(|mut whole, zone| {
        whole.add(&zone);
        whole
    });
    Ok(Goniograms {
        frame,
        lattice: zoning.lattice,
        zones,
        zone_of_vertex: zoning.zone_of_vertex,
        total: whole.map(|whole| grids.goniogram(&whole, spectrum)).unwrap_or_default(),
        grid: grids.fine,
        spectral_grid: grids.spectral,
        notices: Notices::default(),
    })
}

/// Lays every ray on the hull again and adds it to the cells of the zones its triangle's corners belong to, by the weights at
/// its landing point: a zone's flux is the flux of its vertices before
/// smoothing. Sites are `zone × cells + cell`, over the fine and the
/// spectral grid.
fn collect(
    cloud: &Cloud<'_>,
    hull: &Hull,
    zoning: &Zoning,
    grids: &Grids,
    limits: &Limits,
    watch: StageWatch<'_>,
) -> Result<(super::flux::Amounts, super::flux::Amounts), Error> {
    let projector = Projector::new(hull);
    let quanta = Quanta::of(cloud.source);
    let has_bands = cloud.source.spectral.column_count() > 0;
    let (fine_cells, spectral_cells) = (grids.fine.cell_count(), grids.spectral.cell_count());
    let fine = Tally::new(&quanta, zoning.zones.len() * fine_cells, false, limits)?;
    let spectral = Tally::new(&quanta, if has_bands { zoning.zones.len() * spectral_cells } else { 0 }, true, limits)?;
    let add = |rays: &[Ray]| {
        for ray in rays {
            let Some(landing) = projector.land(ray) else { continue };
            let (c, gamma) = zoning.lattice.frame.angles(ray.direction);
            let (fine_cell, spectral_cell) = (grids.fine.cell(c, gamma), grids.spectral.cell(c, gamma));
            let deposit = quanta.deposit(ray);
            let zones = hull.triangles[landing.triangle].map(|vertex| zoning.zone_of_vertex[vertex as usize] as usize);
            let put = |zone: usize, part: &_| {
                fine.add(zone * fine_cells + fine_cell, part);
                if has_bands {
                    spectral.add(zone * spectral_cells + spectral_cell, part);
                }
            };
            if zones[0] == zones[1] && zones[1] == zones[2] {
                put(zones[0], &deposit);
            } else {
                zones.iter().zip(deposit.split(landing.shares)).for_each(|(zone, part)| put(*zone, &part));
            }
        }
        Ok(())
    };
    cloud.fold(watch, (), add, |(), ()| ())?;
    Ok((fine.amounts(), spectral.amounts()))
}
