//! Smoothing of the intensities over the grid of directions.

use super::sphere::SphereGrid;
use crate::flux::shepard::{Site, Smoother, typical_radius};
use glam::DVec3;

/// Rays that an intensity is averaged over: 3 % noise is left in a zone. It blurs the horizon of a flat source by its radius, a
/// few degrees for a million rays in 16 zones; fewer rays leave more noise than that is worth.
const SMOOTHING_RAYS: f64 = 800.0;
/// Smoothing reaches at most this far, radians (20°): it costs a Lambertian 1.5 % at the peak, less than the noise it takes from
/// any zone that needs it.
const SMOOTHING_REACH: f64 = 0.35;
/// Most pairs of cells that exchange; 16 bytes each, twice.
const MOST_LINKS: f64 = 8e6;

/// The smoothing operator on the sphere for zones whose cells counted `rays`.
pub fn smoother(grid: &SphereGrid, rays: &[f64]) -> Smoother {
    let solid_angles_sr = grid.cell_solid_angles_sr();
    let site = |(cell, (c, gamma)): (usize, (f64, f64))| Site {
        at: DVec3::new(gamma.sin() * c.cos(), gamma.sin() * c.sin(), -gamma.cos()),
        measure: solid_angles_sr[cell],
        rays: 0.0,
        part: 0,
        normal: DVec3::Z,
    };
    let sites: Vec<Site> = grid.cell_nodes().into_iter().enumerate().map(site).collect();
    let cells = rays.iter().copied().zip(solid_angles_sr.iter().copied().cycle());
    let wanted = typical_radius(cells, SMOOTHING_RAYS);
    // A cap of radius r holds r²/4 of the sphere: this many cells link to as many others.
    let affordable = 2.0 * MOST_LINKS.sqrt() / sites.len() as f64;
    Smoother::uniform(&sites, wanted.min(SMOOTHING_REACH).min(affordable))
}
