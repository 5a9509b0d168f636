//! 3. Rays onto the surface [Расчет поверхностного распределения светового потока].

/// The spatial index: the only file that names the BVH library.
pub mod bvh;
/// Which triangles lie near a point.
mod cells;
/// One ray: hit, snapped or rejected, counted exactly once.
pub mod project;
/// Sums per site that do not depend on the number of threads.
pub mod tally;
/// The exitance, smoothed.
pub mod exitance;
/// Flux in equals flux on the surface plus rejected.
pub mod balance;

use crate::options::FluxOptions;
pub use balance::Balance;
pub use tally::Amounts;

use crate::error::Error;
use crate::hull::images::Images;
use crate::hull::{Cloud, Hull};
use crate::source::Ray;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::StageWatch;
use balance::Share;
use project::{Fate, Landing, Projector};
use tally::{Deposit, Kept, Quanta, Tally};

/// Flux on the surface.
#[derive(Clone, Debug)]
pub struct Surface {
    /// F_t: flux per triangle as counted [(1)]; sites are triangles, no columns.
    pub triangles: Amounts,
    /// ρ_l: flux per vertex, with its spectral columns [(2)], smoothed where asked; sites are vertices.
    pub vertices: Amounts,
    /// Σ w² / Σ w of the rays, in each known quantity: what a typical ray carries.
    pub ray: Flux,
    /// Where every ray and every watt went.
    pub balance: Balance,
    /// What happened on the way.
    pub notices: Notices,
}

/// Share of rejected flux above which a user is told.
const REJECTED_WORTH_A_NOTICE: f64 = 0.005;
/// Sites of the tally of fates.
const FATES: usize = 3;
const HIT: usize = 0;
const SNAPPED: usize = 1;
const REJECTED: usize = 2;

impl Surface {
    /// A sketch made of a sample, its rays counted as the `factor` times as many that they stand for.
    #[must_use]
    pub fn of_more_rays(mut self, factor: f64) -> Surface {
        self.vertices.rays.iter_mut().for_each(|rays| *rays *= factor);
        self
    }
}

/// A ray, or an image of one, on the surface.
pub struct Laid<'a> {
    /// Where it landed.
    pub landing: &'a Landing,
    /// Its deposit, shared among the corners of the triangle.
    pub parts: &'a [Deposit; 3],
}

/// Lays every ray on the hull, of a symmetric source all of its images. For each chunk of rays, on any thread, `begin` makes what is told
/// of each ray or image how it was laid, if it was, and of its part of the flux.
///
/// # Errors
/// [`Error::Refused`] above [`Limits::max_tally_values`]; [`Error::Cancelled`], [`Error::Unreadable`].
pub fn project<L: FnMut(&Ray, Option<Laid<'_>>, &Deposit)>(
    cloud: &Cloud<'_>,
    hull: &Hull,
    options: &FluxOptions,
    limits: &Limits,
    watch: StageWatch<'_>,
    begin: impl Fn() -> L + Sync + Send,
) -> Result<Surface, Error> {
    let projector = Projector::new(hull);
    let quanta = Quanta::of(cloud);
    let triangles = Tally::new(&quanta, hull.triangles.len(), Kept::Fluxes, limits)?;
    let vertices = Tally::new(&quanta, hull.vertices_mm.len(), Kept::All, limits)?;
    let fates = Tally::new(&quanta, FATES, Kept::Fluxes, limits)?;
    // The part of a ray's flux that each of its images has.
    let part = 1.0 / cloud.images() as f64;
    let images = Images::of(hull)?;
    let image_count = images.as_ref().map_or(1, Images::count);
    let lay = |rays: &[Ray]| {
        let (mut triangles, mut vertices, mut laid) = (triangles.adding(), vertices.adding(), begin());
        let mut met = [Deposit::default(); FATES];
        let mut squares = [0.0; 2];
        for ray in rays {
            let deposit = quanta.deposit(ray);
            squares[0] += part * ray.radiant_w * ray.radiant_w;
            squares[1] += part * ray.luminous_lm * ray.luminous_lm;
            projector.land_images(ray, |image, landing| {
                let Some(landing) = landing else {
                    laid(image, None, &deposit);
                    return met[REJECTED].gather(&deposit, 1);
                };
                let parts = deposit.split(landing.shares);
                laid(image, Some(Laid { landing: &landing, parts: &parts }), &deposit);
                let times = landing.image.map_or(1, |_| image_count as u64);
                met[if landing.fate == Fate::Hit { HIT } else { SNAPPED }].gather(&deposit, times);
                triangles.add(landing.triangle, &deposit);
                for (vertex, part) in hull.triangles[landing.triangle].iter().zip(&parts) {
                    vertices.add(*vertex as usize, part);
                }
            });
        }
        let mut fates = fates.adding();
        met.iter().enumerate().for_each(|(fate, sum)| fates.add(fate, sum));
        Ok(squares)
    };
    let add = |sums: &mut [f64; 2], more: [f64; 2]| sums.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
    let squares = cloud.fold(watch.part(0.0, 0.9), [0.0; 2], lay, add)?;
    let ray = typical_ray(&cloud.flux(), squares);
    let (triangles, mut vertices) = match &images {
        Some(images) => (
            triangles.spread(hull.triangles.len(), |site, add| images.of_triangle(site).for_each(add)).amounts(),
            vertices.spread(hull.vertices_mm.len(), |site, add| images.of_vertex(site).for_each(add)).amounts(),
        ),
        None => (triangles.amounts(), vertices.amounts()),
    };
    let mut balance = account(cloud, &fates.amounts(), &triangles, &vertices);
    if options.smooths() {
        watch.step(0.9)?;
        exitance::smooth(hull, &mut vertices, &ray, cloud.spectral(), watch.part(0.9, 1.0))?;
    }
    balance.after_smoothing = vertices.total();
    Ok(Surface { notices: notices(&balance), triangles, vertices, ray, balance })
}

/// What a typical ray carries, from the sums of squares of W and lm. Rounded, so that the order of the rays does not show.
fn typical_ray(flux: &Flux, [radiant, luminous]: [f64; 2]) -> Flux {
    let of = |total: Option<f64>, squares: f64| {
        let ray = squares / total?;
        Some(if ray.is_finite() { f64::from(ray as f32) } else { 0.0 })
    };
    Flux { radiant_w: of(flux.radiant_w, radiant), luminous_lm: of(flux.luminous_lm, luminous) }
}

/// Where everything went.
fn account(cloud: &Cloud<'_>, fates: &Amounts, triangles: &Amounts, vertices: &Amounts) -> Balance {
    // Images of one ray may meet different fates: the parts of it that hit make up for those that do not.
    let all: f64 = fates.rays.iter().sum();
    let whole = |fate: usize| fates.rays[fate].round() as u64;
    let rays = |fate: usize| {
        if fate == HIT { (all.round() as u64).saturating_sub(whole(SNAPPED) + whole(REJECTED)) } else { whole(fate) }
    };
    let share = |fate: usize| Share { rays: rays(fate), flux: fates.flux_of(fate) };
    Balance {
        incoming: Share { rays: cloud.source.survey.rays_used, flux: cloud.flux() },
        hit: share(HIT),
        snapped: share(SNAPPED),
        rejected: share(REJECTED),
        on_triangles: triangles.total(),
        on_vertices: vertices.total(),
        after_smoothing: vertices.total(),
    }
}

fn notices(balance: &Balance) -> Notices {
    let mut notices = Notices::default();
    let rejected = balance.rejected.flux.primary() / balance.incoming.flux.primary();
    if rejected > REJECTED_WORTH_A_NOTICE {
        let message =
            format!("{:.2} % of the flux starts too far from the surface and is not in the model", 100.0 * rejected);
        notices.count("flux.rejected", balance.rejected.rays, None, message);
    }
    notices
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::focal::{FocalPatch, FocalSurface};
    use crate::hull::sheet;
    use crate::hull::symmetry::Symmetry;
    use glam::{DVec2, DVec3};

    /// What rays leave at triangles and vertices where each of their images is landed, and where one stands for all.
    #[test]
    fn one_in_the_sector_stands_for_all_images() {
        for (symmetry, cells, curvature) in
            [(Symmetry::TwoMirrors, [8, 6], 0.0), (Symmetry::FourMirrors, [10, 10], -0.7)]
        {
            let axis = DVec3::new(0.3, -0.4, 0.8).normalize();
            let surface = FocalSurface::new(DVec3::new(1.0, 2.0, -0.5), axis, curvature);
            let (min_mm, max_mm) = (DVec2::new(-0.6, -0.4), DVec2::new(0.6, 0.4));
            let patch = FocalPatch { surface, min_mm, max_mm, lit_mm2: 1.0, symmetry: Symmetry::None }.with(symmetry);
            let hull = sheet::of_grid(patch, cells, &vec![true; cells[0] * cells[1]]);
            let (images, projector) = (Images::of(&hull).unwrap().unwrap(), Projector::new(&hull));
            assert_eq!(images.count(), symmetry.images());
            let (mut once, mut each) =
                ([vec![0.0; hull.triangles.len()], vec![0.0; hull.vertices_mm.len()]], [vec![], vec![]]);
            each.clone_from(&once);
            for k in 1..2000 {
                let [x, y, z, w] = [2f64, 3.0, 5.0, 7.0].map(|prime| (f64::from(k) * prime.sqrt()).fract() - 0.5);
                let at_mm = 0.8 * x * surface.axes.x_axis + 0.6 * y * surface.axes.y_axis;
                let direction = (axis + DVec3::new(z, w, 0.0)).normalize();
                let origin_mm = surface.apex_mm + at_mm - direction;
                let ray = Ray { origin_mm, direction, radiant_w: 1.0, luminous_lm: 0.0, column: 0, xz_lm: [0.0; 2] };
                let mut told = 0;
                projector.land_images(&ray, |_, landing| {
                    let landing = landing.unwrap();
                    told += 1;
                    assert!(landing.image.is_some());
                    images.of_triangle(landing.triangle).for_each(|image| once[0][image] += 1.0);
                    for (vertex, share) in hull.triangles[landing.triangle].iter().zip(landing.shares) {
                        assert!(images.is_in_sector(*vertex as usize) && images.is_on_grid(*vertex as usize));
                        images.of_vertex(*vertex as usize).for_each(|image| once[1][image] += share);
                    }
                });
                assert_eq!(told, 1);
                for image in patch.images(&[ray]) {
                    let landing = projector.land(&image).unwrap();
                    each[0][landing.triangle] += 1.0;
                    for (vertex, share) in hull.triangles[landing.triangle].iter().zip(landing.shares) {
                        each[1][*vertex as usize] += share;
                    }
                }
            }
            assert_eq!(once[0], each[0], "{symmetry:?}");
            assert!(once[1].iter().zip(&each[1]).all(|(a, b)| (a - b).abs() < 1e-9), "{symmetry:?}");
        }
    }
}
