//! The surface as small sources: the light of each zone, cut into parts that are near to each other.

use crate::adapters::surface::Surface;
use glam::DVec3;
use std::collections::BTreeMap;

/// Radius of a source's sphere, as a part of how far its light reaches from its middle: Radiance lets no light through one `illum` to
/// another, so what lies between must be next to nothing. A thousand spheres of this size hide 0.02 % of the dome from itself.
const RADIUS: f64 = 0.01;
/// Least radius, mm: Radiance cannot tell distances below 10⁻⁶ apart.
const SMALLEST_MM: f64 = 1e-5;

/// A small source.
pub struct Source {
    /// Whose distribution it has.
    pub zone: usize,
    /// Middle of its flux, mm.
    pub middle_mm: DVec3,
    /// Radius of the sphere that stands for it, mm.
    pub radius_mm: f64,
    /// Root mean square distance of its flux from the middle, mm.
    pub reach_mm: f64,
    /// Flux in red, green and blue, in the units of the exitance times mm².
    pub flux: [f64; 3],
}

/// Light of a zone on one triangle.
struct Piece {
    at_mm: DVec3,
    edge_mm: f64,
    flux: [f64; 3],
    brightness: f64,
}

/// Flux of each zone on a triangle, in the units of `rgb` times mm²: ∫ M w dA, M and w linear between the corners.
pub fn shares_of(surface: &Surface<'_>, rgb: &[[f64; 3]], triangle: usize) -> Vec<(usize, [f64; 3])> {
    let mesh = surface.light.mesh;
    let corners = mesh.triangles[triangle].map(|vertex| vertex as usize);
    let mut zones: BTreeMap<usize, [f64; 3]> = BTreeMap::new();
    for corner in corners {
        // ∫ p_a p_b dA is A/12, of a corner with itself twice that.
        let sum = |part: usize| rgb[corner][part] + corners.iter().map(|other| rgb[*other][part]).sum::<f64>();
        let own: [f64; 3] = std::array::from_fn(|part| mesh.area_mm2(triangle) / 12.0 * sum(part));
        for (zone, weight) in surface.light.mixtures[corner].parts() {
            let entry = zones.entry(zone).or_default();
            entry.iter_mut().zip(own).for_each(|(flux, own)| *flux += weight * own);
        }
    }
    zones.into_iter().filter(|(_, flux)| flux.iter().any(|part| *part > 0.0)).collect()
}

/// `most` sources, or as many as there are zones, by zone. The part whose flux lies farthest from its middle (flux times squares of distances) is cut in
/// two until there are so many.
pub fn sources(surface: &Surface<'_>, rgb: &[[f64; 3]], most: usize) -> Vec<Source> {
    let mesh = surface.light.mesh;
    let mut zones: Vec<Vec<Piece>> = surface.distributions.iter().map(|_| Vec::new()).collect();
    for triangle in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners_mm(triangle);
        let (at_mm, edge_mm) = ((a + b + c) / 3.0, mesh.area_mm2(triangle).sqrt());
        for (zone, flux) in shares_of(surface, rgb, triangle) {
            zones[zone].push(Piece { at_mm, edge_mm, flux, brightness: flux.iter().sum() });
        }
    }
    let parts = zones.into_iter().enumerate();
    let mut parts: Vec<(Source, Vec<Piece>)> =
        parts.filter_map(|(zone, pieces)| Some((source(zone, &pieces)?, pieces))).collect();
    let spread = |(source, pieces): &(Source, Vec<Piece>)| {
        if pieces.len() < 2 { 0.0 } else { source.flux.iter().sum::<f64>() * source.reach_mm * source.reach_mm }
    };
    while parts.len() < most {
        let widest = (0..parts.len()).max_by(|a, b| spread(&parts[*a]).total_cmp(&spread(&parts[*b])));
        let Some(widest) = widest.filter(|widest| spread(&parts[*widest]) > 0.0) else { break };
        let (Source { zone, .. }, pieces) = parts.swap_remove(widest);
        let (first, second) = halves(pieces);
        parts.extend([first, second].into_iter().filter_map(|pieces| Some((source(zone, &pieces)?, pieces))));
    }
    parts.sort_by_key(|(source, _)| source.zone);
    parts.into_iter().map(|(source, _)| source).collect()
}

/// Cuts across the longest side of the box, so that each side has half of the flux.
fn halves(mut pieces: Vec<Piece>) -> (Vec<Piece>, Vec<Piece>) {
    let least = pieces.iter().map(|piece| piece.at_mm).fold(DVec3::INFINITY, DVec3::min);
    let most = pieces.iter().map(|piece| piece.at_mm).fold(DVec3::NEG_INFINITY, DVec3::max);
    let axis = (0..3).max_by(|a, b| (most - least)[*a].total_cmp(&(most - least)[*b])).unwrap_or(0);
    pieces.sort_by(|a, b| a.at_mm[axis].total_cmp(&b.at_mm[axis]));
    let half = 0.5 * pieces.iter().map(|piece| piece.brightness).sum::<f64>();
    let mut sum = 0.0;
    let before = |piece: &Piece| {
        sum += piece.brightness;
        sum <= half
    };
    let place = pieces.iter().map(before).take_while(|is_before| *is_before).count().clamp(1, pieces.len() - 1);
    let second = pieces.split_off(place);
    (pieces, second)
}

fn source(zone: usize, pieces: &[Piece]) -> Option<Source> {
    let brightness: f64 = pieces.iter().map(|piece| piece.brightness).sum();
    let mean = |of: &dyn Fn(&Piece) -> f64| pieces.iter().map(|p| p.brightness * of(p)).sum::<f64>() / brightness;
    if brightness <= 0.0 {
        return None;
    }
    let middle_mm = pieces.iter().map(|piece| piece.brightness * piece.at_mm).sum::<DVec3>() / brightness;
    // A triangle of its own reaches about a third of its edge.
    let reach_mm = mean(&|p| p.at_mm.distance_squared(middle_mm) + p.edge_mm * p.edge_mm / 9.0).sqrt();
    let mut flux = [0.0; 3];
    pieces.iter().for_each(|p| flux.iter_mut().zip(p.flux).for_each(|(sum, own)| *sum += own));
    Some(Source { zone, middle_mm, radius_mm: (RADIUS * reach_mm).max(SMALLEST_MM), reach_mm, flux })
}
