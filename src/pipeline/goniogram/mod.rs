//! 4. Flux to angles [Расчет углового распределения яркости].

/// Which way the source looks.
pub mod orientation;
/// The grid of directions: the one owner of the binning rule.
pub mod sphere;
/// The zone lattice and which point belongs where.
pub mod zone;
/// Directions to intensities.
pub mod intensity;
/// How wide the beam is, which decides how fine its grid must be.
mod beam;
/// Smoothing of the intensities over the grid of directions.
mod smoothing;

use crate::options::GoniogramOptions;
pub use intensity::Goniogram;
pub use sphere::SphereGrid;
pub use zone::{Lattice, Zone};

use crate::error::Error;
use crate::flux::Surface;
use crate::flux::project::Projector;
use crate::flux::tally::{Quanta, Tally};
use crate::hull::{Cloud, Hull};
use crate::source::Ray;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::space::Frame;
use crate::vocabulary::watch::StageWatch;
use intensity::Grids;
use zone::Zoning;

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
    options: &GoniogramOptions,
    limits: &Limits,
    watch: StageWatch<'_>,
) -> Result<Goniograms, Error> {
    let frame = orientation::frame(&cloud.source.survey.directions, options)?;
    let zoning = Zoning::new(hull, surface, frame, options.zones.map(|zones| (zones.columns, zones.rows)));
    let grids = Grids::new(&cloud.source.survey.directions, options);
    let (fine, spectral) = collect(cloud, hull, &zoning, &grids, limits, watch.part(0.0, 0.8))?;
    let measured = grids.measured(&fine, &spectral, options.smooths(), watch.part(0.8, 1.0))?;
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
) -> Result<(crate::flux::Amounts, crate::flux::Amounts), Error> {
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
