//! Shepard smoothing that conserves: noise is averaged away where rays are few, nothing is blurred where they are many.
//!
//! D. Shepard, "A two-dimensional interpolation function for irregularly-spaced data", ACM 1968 [7]: values are averaged with
//! weights that fall with distance and end at a radius R: (1 − d²/R²)₊², Franke and Little's compact form without the pole of
//! 1/d at d = 0, which would interpolate the noise. What is averaged is the density (flux per measure: exitance on the surface, intensity on
//! the sphere), not the flux. Two things are added to the paper:
//! - each site's radius follows from the distance within which enough rays were counted, up to the radius that a ray's typical
//!   surroundings need; a pair uses the smaller of its two radii, so a well-known site neither gives to nor takes from a
//!   noisy one, and dark surroundings do not drink from a bright edge;
//! - the weights are balanced (Sinkhorn) so that a constant density stays constant, then normalised per giver, so that what
//!   a site gives away adds up to what it had: flux is conserved to rounding.

use super::bvh::Bvh;
use crate::vocabulary::space::Bounds;
use glam::DVec3;
use rayon::prelude::*;

/// A place that holds an amount.
#[derive(Clone, Copy, Debug)]
pub struct Site {
    /// Where it is: a vertex (mm), or a unit direction.
    pub at: DVec3,
    /// What turns its amount into a density: an area (mm²), or a solid angle (sr).
    pub measure: f64,
    /// Rays counted there.
    pub rays: f64,
    /// Sites of different parts do not exchange.
    pub part: u32,
    /// Sites whose normals differ by more than 60° do not exchange.
    pub normal: DVec3,
}

/// How far to smooth.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// Rays that a site's neighbourhood must hold; the relative noise left is about 0.8 / √rays.
    pub rays: f64,
    /// Largest radius, in the unit of [`Site::at`].
    pub radius: f64,
}

/// Neighbours within which a radius must end, enough rays or not: sites finer than the rays can fill share less, not without
/// bound. √3 times the distance holds three times as many.
const MOST_NEIGHBOURS: usize = 160;
/// Rounds of balancing; the error falls geometrically, and what is left costs constancy, never flux.
const SINKHORN_ROUNDS: usize = 24;

/// A smoothing operator over sites.
pub struct Smoother {
    /// Start of each site's row in `links`; one more than sites.
    rows: Vec<usize>,
    /// `(other site, share of the other's amount that comes here)`.
    links: Vec<(u32, f64)>,
    /// Largest radius used, in the unit of [`Site::at`]; 0 where nothing is smoothed.
    pub widest: f64,
}

impl Smoother {
    /// The operator for `sites`, found through the spatial index. Work: sites × neighbours within the reach.
    pub fn new(sites: &[Site], reach: Reach) -> Smoother {
        let index = point_index(sites);
        let typical = typical_radius(sites.iter().map(|site| (site.rays, site.measure)), reach.rays);
        let reach = Reach { radius: reach.radius.min(typical), ..reach };
        let radii: Vec<f64> = (0..sites.len()).into_par_iter().map(|k| radius(sites, &index, k, reach)).collect();
        Smoother::with_radii(sites, &index, &radii)
    }

    /// The operator with one radius for all sites: applied to several sets of amounts it commutes with adding them up.
    pub fn uniform(sites: &[Site], radius: f64) -> Smoother {
        Smoother::with_radii(sites, &point_index(sites), &vec![radius; sites.len()])
    }

    fn with_radii(sites: &[Site], index: &Bvh, radii: &[f64]) -> Smoother {
        let weights: Vec<Vec<(u32, f64)>> =
            (0..sites.len()).into_par_iter().map(|k| row(sites, index, k, radii)).collect();
        let balance = balance(sites, &weights);
        // Normalise per giver: the measure-weighted sum of what each site gives is 1.
        let given: Vec<f64> = (0..sites.len())
            .into_par_iter()
            .map(|k| weights[k].iter().map(|(to, w)| w * balance[*to as usize] * sites[*to as usize].measure).sum())
            .collect();
        let mut smoother = Smoother {
            rows: vec![0],
            links: Vec::with_capacity(weights.iter().map(Vec::len).sum()),
            widest: radii.iter().copied().fold(0.0, f64::max),
        };
        for (k, row) in weights.iter().enumerate() {
            let take = |(from, w): &(u32, f64)| (*from, w * balance[k] * sites[k].measure / given[*from as usize]);
            smoother.links.extend(row.iter().map(take));
            smoother.rows.push(smoother.links.len());
        }
        smoother
    }

    /// Smoothed amounts; their sum is the sum of `amounts` to rounding.
    pub fn apply(&self, amounts: &[f64]) -> Vec<f64> {
        let gather = |k: usize| {
            self.links[self.rows[k]..self.rows[k + 1]].iter().map(|(from, share)| share * amounts[*from as usize]).sum()
        };
        (0..amounts.len()).into_par_iter().map(gather).collect()
    }

    /// Rays that effectively share a site's estimate: 1 / Σ share² weighted by the givers' rays.
    pub fn effective_rays(&self, rays: &[f64], site: usize) -> f64 {
        let row = &self.links[self.rows[site]..self.rows[site + 1]];
        let mean: f64 = row.iter().map(|(from, share)| share * rays[*from as usize]).sum();
        let variance: f64 = row.iter().map(|(from, share)| share * share * rays[*from as usize]).sum();
        if variance > 0.0 { mean * mean / variance } else { 0.0 }
    }
}

fn point_index(sites: &[Site]) -> Bvh {
    let points: Vec<Bounds> = sites.iter().map(|site| Bounds { min: site.at, max: site.at }).collect();
    Bvh::new(&points)
}

/// The radius of a neighbourhood that holds `wanted` rays at the density that the average ray finds round itself; from the
/// `(rays, measure)` of all sites. Radii that grew on down a slope of density would tilt: a site would average with dimmer
/// neighbours farther away than with brighter ones, and a distribution would lose its shoulders.
pub fn typical_radius(sites: impl Iterator<Item = (f64, f64)>, wanted: f64) -> f64 {
    let (mut total, mut density) = (0.0, 0.0);
    for (rays, measure) in sites.filter(|(_, measure)| *measure > 0.0) {
        total += rays;
        // n (n − 1): a ray is no neighbour of its own.
        density += rays * (rays - 1.0).max(0.0) / measure;
    }
    if density > 0.0 { (3.0 * wanted * total / (std::f64::consts::PI * density)).sqrt() } else { f64::INFINITY }
}

/// Distances to the sites that may exchange with site `k` within `within`, itself included, nearest first.
fn neighbours(sites: &[Site], index: &Bvh, k: usize, within: f64) -> Vec<(f64, u32)> {
    let here = &sites[k];
    let mut found = Vec::new();
    index.near(here.at, within, |other| {
        let there = &sites[other];
        let distance = here.at.distance(there.at);
        if other == k || (distance < within && there.part == here.part && there.normal.dot(here.normal) > 0.5) {
            found.push((distance, other as u32));
        }
    });
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found
}

/// The radius of site `k`: √3 times the distance within which it sees enough rays, because (1 − d²/R²)² over a disc of radius R
/// weighs as much as a disc of radius R/√3; 0 where it has enough itself.
fn radius(sites: &[Site], index: &Bvh, k: usize, reach: Reach) -> f64 {
    if sites[k].rays >= reach.rays || sites[k].measure <= 0.0 {
        return 0.0;
    }
    let mut seen = 0.0;
    for (passed, (distance, other)) in neighbours(sites, index, k, reach.radius).into_iter().enumerate() {
        seen += sites[other as usize].rays;
        if seen >= reach.rays || passed == MOST_NEIGHBOURS {
            return (3f64.sqrt() * distance).min(reach.radius);
        }
    }
    reach.radius
}

/// Weights of the sites that exchange with site `k`, by site number: symmetric.
fn row(sites: &[Site], index: &Bvh, k: usize, radii: &[f64]) -> Vec<(u32, f64)> {
    if radii[k] <= 0.0 {
        return vec![(k as u32, 1.0)];
    }
    let mut row: Vec<(u32, f64)> = neighbours(sites, index, k, radii[k])
        .into_iter()
        .filter_map(|(distance, other)| {
            let radius = radii[k].min(radii[other as usize]);
            let far = distance / radius;
            (other as usize == k).then_some((other, 1.0)).or_else(|| {
                (distance < radius && sites[other as usize].measure > 0.0).then(|| (other, (1.0 - far * far).powi(2)))
            })
        })
        .collect();
    row.sort_by_key(|(other, _)| *other);
    row
}

/// Positive factors s with s_k Σ_j w_kj s_j measure_j → 1 (symmetric Sinkhorn).
fn balance(sites: &[Site], weights: &[Vec<(u32, f64)>]) -> Vec<f64> {
    let mut factors = vec![1.0; sites.len()];
    for _ in 0..SINKHORN_ROUNDS {
        let next = |k: usize| {
            let sum: f64 = weights[k].iter().map(|(j, w)| w * factors[*j as usize] * sites[*j as usize].measure).sum();
            if sum > 0.0 { (factors[k] / sum).sqrt() } else { 1.0 }
        };
        factors = (0..sites.len()).into_par_iter().map(next).collect();
    }
    factors
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A 20 × 20 lattice of sites on a square, with half and quarter cells at the rim.
    fn square(rays: impl Fn(usize, usize) -> f64) -> Vec<Site> {
        let mut sites = Vec::new();
        for i in 0..20 {
            for j in 0..20 {
                let half = |k: usize| if k == 0 || k == 19 { 0.5 } else { 1.0 };
                sites.push(Site {
                    at: DVec3::new(i as f64, j as f64, 0.0),
                    measure: half(i) * half(j),
                    rays: rays(i, j),
                    part: 0,
                    normal: DVec3::Z,
                });
            }
        }
        sites
    }

    #[test]
    fn conserves_flux_and_keeps_a_constant_density() {
        let sites = square(|_, _| 3.0);
        let smoother = Smoother::new(&sites, Reach { rays: 100.0, radius: 5.0 });
        let constant: Vec<f64> = sites.iter().map(|site| 2.0 * site.measure).collect();
        for (value, site) in smoother.apply(&constant).iter().zip(&sites) {
            assert!((value / site.measure - 2.0).abs() < 1e-5, "density {}", value / site.measure);
        }
        let mut spike = vec![0.0; sites.len()];
        spike[0] = 1.0;
        spike[210] = 5.0;
        let smooth = smoother.apply(&spike);
        assert!((smooth.iter().sum::<f64>() - 6.0).abs() < 1e-12);
        assert!(smooth[210] < 1.0, "a spike is spread: {}", smooth[210]);
    }

    #[test]
    fn sites_with_enough_rays_are_left_alone() {
        // Left half well known, right half dark: nothing bleeds over the edge.
        let sites = square(|i, _| if i < 10 { 1000.0 } else { 0.0 });
        let smoother = Smoother::new(&sites, Reach { rays: 100.0, radius: 5.0 });
        let lit: Vec<f64> = sites.iter().map(|site| if site.at.x < 10.0 { site.measure } else { 0.0 }).collect();
        assert_eq!(smoother.apply(&lit), lit);
    }

    #[test]
    fn parts_do_not_exchange() {
        let mut sites = square(|_, _| 1.0);
        for site in &mut sites {
            site.part = u32::from(site.at.x >= 10.0);
        }
        let smoother = Smoother::new(&sites, Reach { rays: 50.0, radius: 6.0 });
        let left: Vec<f64> = sites.iter().map(|site| if site.part == 0 { 1.0 } else { 0.0 }).collect();
        let smooth = smoother.apply(&left);
        assert!(sites.iter().zip(&smooth).all(|(site, value)| (site.part == 1) == (*value == 0.0)));
    }
}
