//! 4. Flux to angles [Расчет углового распределения яркости].

/// Which way the source looks.
pub mod orientation;
/// The grid of directions: the one owner of the binning rule.
pub mod sphere;
/// Which vertices are alike: faces and spectra.
mod kinds;
/// Where zones come from.
mod ancestry;
/// Zones: which point belongs where.
pub mod zone;
/// Zones and weights of a vertex.
pub mod mixture;
/// Directions to intensities.
pub mod intensity;
/// Mirror images in what is counted.
mod images;
/// What is counted in zones while rays land.
mod counts;
/// How wide the beam is, which decides how fine its grid must be.
mod beam;
/// Smoothing of the intensities over the grid of directions.
mod smoothing;

use crate::options::{GoniogramOptions, ZoneLayout};
pub use intensity::Goniogram;
pub use mixture::Mixture;
pub use sphere::SphereGrid;
pub use zone::{Lattice, Zone};

use crate::error::Error;
use crate::flux::tally::{Deposit, Quanta};
use crate::flux::{Laid, Surface};
use crate::hull::focal::FocalGrid;
use crate::hull::images::Images;
use crate::hull::{Carrier, Cloud, Hull};
use crate::inspection::beam::brightest;
use crate::inspection::sample::hash;
use crate::source::Ray;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::space::Frame;
use crate::vocabulary::watch::StageWatch;
use ancestry::Ancestry;
use beam::NarrowLight;
use counts::Counts;
use glam::DVec3;
use images::Groups;
use intensity::{Grids, Measured};
use mixture::Shares;
use zone::Zoning;

/// Most zones that follow the surface: their goniograms are less than 10 MB of text.
const MOST_ZONES: usize = 256;
/// Most zones of the surface of a volume, which is not the model.
const MOST_ZONES_OF_VOLUME: usize = 48;
/// Most spectral columns of all cells of all zones together, and cells of a zone's coarsest spectral grid.
const MOST_COLUMNS: f64 = 2e6;
const COARSEST_CELLS: f64 = 134.0;
/// So many rays tell how wide a beam is, within half a per cent.
const MOST_RAYS_OF_BEAM: usize = 1 << 14;
/// Most zones that follow the surface and have files of their own.
const MOST_FILES: usize = 16;

/// Zones and their goniograms.
#[derive(Clone, Debug)]
pub struct Goniograms {
    /// The photometric frame.
    pub frame: Frame,
    /// The zone lattice; `None` where zones follow the surface.
    pub lattice: Option<Lattice>,
    /// Grid of the luminous and radiant intensities.
    pub grid: SphereGrid,
    /// Coarser grid of the spectral intensities.
    pub spectral_grid: SphereGrid,
    /// Zones that hold light; a zone's id is its index.
    pub zones: Vec<Zone>,
    /// The zone that each vertex of the hull lies in.
    pub zone_of_vertex: Vec<u32>,
    /// Zones and weights of each vertex: what its light is mixed of.
    pub mixtures: Vec<Mixture>,
    /// The whole source: the sum of its zones; of a volume, what is found of all its rays together.
    pub total: Goniogram,
    /// What happened on the way.
    pub notices: Notices,
}

impl Goniograms {
    /// The zones that get files of their own, ids in ascending order: all, or of many those of the largest flux.
    pub fn zones_with_files(&self) -> Vec<u32> {
        let mut zones: Vec<&Zone> = self.zones.iter().collect();
        if self.lattice.is_none() && zones.len() > MOST_FILES {
            let flux = |zone: &Zone| zone.goniogram.flux.primary();
            zones.sort_by(|a, b| flux(b).total_cmp(&flux(a)).then(a.id.cmp(&b.id)));
            zones.truncate(MOST_FILES);
        }
        let mut ids: Vec<u32> = zones.into_iter().map(|zone| zone.id).collect();
        ids.sort_unstable();
        ids
    }
}

/// Zones, and what is counted in them while the rays are laid on the hull.
pub struct Plan {
    zoning: Zoning,
    narrow: Option<NarrowLight>,
    zones: Counts,
    /// The zones of each kind together, on finer grids: there are fewer. `None` where kinds are not all that may be left of the zones.
    kinds: Option<Counts>,
}

/// Lays out zones by the light on `sketch`, and grids.
///
/// # Errors
/// [`Error::Unusable`] when γ = 0 and C0 lie along one line; [`Error::Refused`] above [`Limits::max_tally_values`].
pub fn plan(
    cloud: &Cloud<'_>,
    hull: &Hull,
    sketch: &Surface,
    sample: &[Ray],
    options: &GoniogramOptions,
    limits: &Limits,
) -> Result<Plan, Error> {
    let frame = orientation::frame(&cloud.source.survey.directions, options)?;
    let narrow = narrow_light(cloud, &frame, sample, options);
    let asked = options.zones.map(|zones| (zones.columns, zones.rows));
    let zoning = match (asked, options.zoning()) {
        (None, ZoneLayout::Auto) if options.smooths() => {
            Zoning::along(hull, sketch, frame, most_zones(cloud, &frame, options, narrow.as_ref()))
        }
        _ => Zoning::on_lattice(hull, sketch, frame, asked),
    };
    let spectrum = cloud.spectral();
    let bands = if spectrum.has_bands() { spectrum.bands.len() } else { 0 };
    let quanta = Quanta::of(cloud);
    let images = Images::of(hull)?;
    let counts = |zones: usize, zone_of_vertex: &[u32]| {
        let grids = Grids::new(&cloud.source.survey.directions, &frame, options, zones, bands, narrow.as_ref());
        let groups = Groups::new(zone_of_vertex, images.as_ref());
        let maps = hull.focal.as_ref().map_or(&[][..], FocalGrid::maps);
        Counts::new(&quanta, grids, zones, groups, (&frame, maps), spectrum, limits)
    };
    let (zone_count, kind_count) = (zoning.zones.len(), Ancestry::kinds(&zoning.family) as usize);
    let may_merge = options.smooths() && zoning.lattice.is_none() && kind_count < zone_count;
    let kind_of_zone = |zone: &u32| zoning.family[*zone as usize].kind;
    let kind_of_vertex = || zoning.zone_of_vertex.iter().map(kind_of_zone).collect::<Vec<u32>>();
    let kinds = may_merge.then(|| counts(kind_count, &kind_of_vertex())).transpose()?;
    Ok(Plan { zones: counts(zone_count, &zoning.zone_of_vertex)?, kinds, zoning, narrow })
}

/// What one thread adds to a [`Plan`].
pub struct Adding<'a> {
    plan: &'a Plan,
    hull: &'a Hull,
    zones: counts::Adding<'a>,
    kinds: Option<counts::Adding<'a>>,
}

impl Adding<'_> {
    /// Adds a ray that landed to the zones its triangle's corners belong to, by the weights at its landing point: a zone's flux is the
    /// flux of its vertices before smoothing.
    pub fn add(&mut self, ray: &Ray, laid: &Laid<'_>, deposit: &Deposit) {
        let Plan { zoning, narrow, .. } = self.plan;
        let direction = narrow.as_ref().map_or(ray.direction, |light| light.shown(ray.direction, hash(!ray.hash())));
        let angles = zoning.frame.angles(direction);
        let corners = self.hull.triangles[laid.landing.triangle];
        for counts in [Some(&mut self.zones), self.kinds.as_mut()].into_iter().flatten() {
            counts.add(corners, laid, direction, angles, deposit);
        }
    }
}

impl Plan {
    /// Begins to add on this thread what lands on `hull`.
    pub fn adding<'a>(&'a self, hull: &'a Hull) -> Adding<'a> {
        Adding { plan: self, hull, zones: self.zones.adding(), kinds: self.kinds.as_ref().map(Counts::adding) }
    }

    /// The goniograms of what was counted, one for each zone and one for the whole source.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn measure(
        self,
        cloud: &Cloud<'_>,
        hull: &Hull,
        surface: &Surface,
        options: &GoniogramOptions,
        watch: StageWatch<'_>,
    ) -> Result<Goniograms, Error> {
        let Plan { mut zoning, zones, kinds, .. } = self;
        zoning.describe(hull, surface);
        let spectrum = cloud.spectral();
        let (mut grids, mut measured) = zones.measured();
        watch.step(0.1)?;
        let mut refined = Vec::new();
        let mut noise = None;
        if options.smooths() {
            let images = images::all_round(hull, &zoning.frame);
            let estimates = |grids: &Grids, measured: &[Measured], zoning: &Zoning| {
                grids.estimates(measured, &zoning.normals(hull, surface), &zoning.family, &surface.ray, images)
            };
            let mut found = estimates(&grids, &measured, &zoning);
            watch.step(0.5)?;
            if zoning.lattice.is_none() {
                let zone_of_zone = zoning.merge(&found.even_kinds, hull, surface);
                match kinds.filter(|_| found.even_kinds.iter().all(|even| *even)) {
                    // Zones are in the order of their kinds, so each kind is a zone now.
                    Some(kinds) => {
                        (grids, measured) = kinds.measured();
                        found = estimates(&grids, &measured, &zoning);
                    }
                    None => {
                        measured = intensity::merged(measured, &zone_of_zone);
                        found.merge(&zone_of_zone, &zoning.family);
                    }
                }
            }
            refined = found.zones;
            noise = Some(found.whole);
        }
        let of_volume = (cloud.carrier == Carrier::Volume)
            .then(|| grids.of_volume(&measured, options.smooths(), &surface.ray, spectrum))
            .flatten();
        if options.smooths() {
            let shares =
                Shares::of(&zoning.mixtures, &zoning.zone_of_vertex, surface.vertices.primary(), zoning.zones.len());
            grids.smooth(&mut measured, refined, &shares, &surface.ray, spectrum);
        }
        watch.step(1.0)?;
        let zones = zoning.zones.into_iter().zip(&measured);
        let zones = zones.map(|(zone, own)| Zone { goniogram: grids.goniogram(own, spectrum), ..zone }).collect();
        let of_zones = || {
            let sum = intensity::sum(&measured)?;
            Some(match &noise {
                Some(refined) => sum.with_noise_of(refined),
                None => sum,
            })
        };
        let whole = of_volume.or_else(of_zones);
        let mixtures = match zoning.lattice {
            Some(_) => zoning.mixtures,
            None => mixture::interpolated(hull, surface.vertices.primary(), &zoning.mixtures),
        };
        Ok(Goniograms {
            frame: zoning.frame,
            lattice: zoning.lattice,
            zones,
            zone_of_vertex: zoning.zone_of_vertex,
            mixtures,
            total: whole.map(|whole| grids.goniogram(&whole, spectrum)).unwrap_or_default(),
            grid: grids.fine,
            spectral_grid: grids.spectral,
            notices: Notices::default(),
        })
    }
}

/// The light of the rays of a sample, where it is narrow and no steps were asked for.
fn narrow_light(cloud: &Cloud<'_>, frame: &Frame, sample: &[Ray], options: &GoniogramOptions) -> Option<NarrowLight> {
    let asked = options.gamma_step_deg.is_some() || options.c_step_deg.is_some() || options.zones.is_some();
    if asked || options.zoning() == ZoneLayout::Paper {
        return None;
    }
    // The rays of a sample are in random order.
    let rays: Vec<(DVec3, f64)> =
        sample.iter().take(MOST_RAYS_OF_BEAM).map(|ray| (ray.direction, ray.weight())).collect();
    NarrowLight::of(&rays, brightest(&cloud.source.survey.directions), frame.nadir.vector())
}

/// Most zones that follow the surface, so that all of their cells stay few: narrow beams, fine grids and many bands leave room for
/// fewer zones.
fn most_zones(cloud: &Cloud<'_>, frame: &Frame, options: &GoniogramOptions, narrow: Option<&NarrowLight>) -> usize {
    let most = if cloud.carrier == Carrier::Volume { MOST_ZONES_OF_VOLUME } else { MOST_ZONES };
    if let Some(light) = narrow {
        let bands = if cloud.spectral().has_bands() { cloud.spectral().bands.len() } else { 0 };
        return Grids::most_narrow_zones(light, bands).clamp(1, most);
    }
    let directions = &cloud.source.survey.directions;
    let (gamma_deg, c_deg) = Grids::steps_deg(directions, frame, options, MOST_ZONES);
    let columns = COARSEST_CELLS * cloud.spectral().column_count().max(1) as f64;
    let by_columns = (MOST_COLUMNS / columns) as usize;
    intensity::most_zones(directions, frame, gamma_deg, c_deg).min(by_columns).clamp(1, most)
}
