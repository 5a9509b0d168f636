//! Radiance along a line: that of each triangle that the line crosses, M q / |cos θ|, summed, because the surface carries the light and does not
//! block it; of a volume q ∫ j ds. Both are closed forms.

use super::emission::Emission;
use crate::flux::bvh::Bvh;
use crate::vocabulary::space::Bounds;
use glam::{DVec2, DVec3};

/// What lines meet.
pub struct Lines<'e, 'a> {
    emission: &'e Emission<'a>,
    /// Of a surface.
    index: Option<Bvh>,
    /// Of a volume: the emission coefficient of each channel at the nodes.
    densities: Vec<Vec<f64>>,
    center_mm: DVec3,
}

/// A line that light goes along.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// A point of it, mm.
    pub point_mm: DVec3,
    /// Where the light goes, unit.
    pub direction: DVec3,
    /// The point is an eye: light that starts beyond it does not count.
    pub ends: bool,
}

/// What one thread needs.
#[derive(Default)]
pub struct Scratch {
    met: Vec<usize>,
    here: Vec<f64>,
    /// Points of the model evaluated.
    pub evaluations: u64,
}

impl<'e, 'a> Lines<'e, 'a> {
    /// Of a model.
    pub fn new(emission: &'e Emission<'a>) -> Lines<'e, 'a> {
        let light = emission.light();
        let bounds_mm = Bounds::of(light.mesh.vertices_mm.iter().copied());
        let boxes = || -> Vec<Bounds> {
            (0..light.mesh.triangles.len()).map(|triangle| Bounds::of(light.mesh.corners_mm(triangle))).collect()
        };
        let (index, densities) = match light.volume {
            Some(_) => (None, (0..emission.channels()).map(|channel| emission.densities(channel)).collect()),
            None => (Some(Bvh::new(&boxes())), Vec::new()),
        };
        Lines { emission, index, densities, center_mm: bounds_mm.center() }
    }

    /// Adds the radiance of the light that goes along a line, flux/(mm² sr), one number a channel.
    pub fn add(&self, line: Line, scratch: &mut Scratch, sums: &mut [f64]) {
        let toward = self.emission.toward(line.direction);
        if let Some(volume) = self.emission.light().volume {
            let end_mm = if line.ends { 0.0 } else { f64::INFINITY };
            scratch.evaluations += 1;
            scratch.here.clear();
            let path =
                |density: &Vec<f64>| volume.lattice.integral_up_to(line.point_mm, line.direction, end_mm, density);
            scratch.here.extend(self.densities.iter().map(path));
            return self.emission.add(0, &toward, &scratch.here, 1.0, sums);
        }
        let Some(index) = &self.index else { return };
        let Scratch { met, here, evaluations } = scratch;
        met.clear();
        index.along_line(line.point_mm, line.direction, |triangle| met.push(triangle));
        // The order of the sum does not depend on the tree.
        met.sort_unstable();
        // Coordinates from the point of the line that is nearest to the source: far eyes would lose digits.
        let before_mm = (self.center_mm - line.point_mm).dot(line.direction);
        let origin_mm = line.point_mm + before_mm * line.direction;
        let (across, up) = line.direction.any_orthonormal_pair();
        let (mesh, channels) = (self.emission.light().mesh, self.emission.channels());
        for triangle in met.iter() {
            let corners = mesh.corners_mm(*triangle).map(|corner| corner - origin_mm);
            let seen = corners.map(|corner| DVec2::new(corner.dot(across), corner.dot(up)));
            let Some(shares) = inside(seen) else { continue };
            let along_mm: f64 =
                corners.iter().zip(shares).map(|(corner, share)| share * corner.dot(line.direction)).sum();
            let cosine = mesh.normal(*triangle).dot(line.direction).abs();
            if cosine <= 0.0 || (line.ends && along_mm + before_mm > 0.0) {
                continue;
            }
            *evaluations += 1;
            here.clear();
            here.resize(channels, 0.0);
            let vertices = mesh.triangles[*triangle].map(|vertex| vertex as usize);
            for (vertex, share) in vertices.into_iter().zip(shares) {
                let density = self.emission.density(vertex);
                here.iter_mut().zip(density).for_each(|(sum, density)| *sum += share * density);
            }
            for (vertex, share) in vertices.into_iter().zip(shares) {
                for (zone, weight) in self.emission.parts(vertex) {
                    self.emission.add(zone, &toward, here, share * weight / cosine, sums);
                }
            }
        }
    }
}

/// Barycentric coordinates of the origin in a triangle; `None` outside. An origin on an edge or a corner, which neighbours share, belongs to
/// one of them: all see it moved by the same infinitely small step, and all compute an edge from its lesser end on.
fn inside(corners: [DVec2; 3]) -> Option<[f64; 3]> {
    let area = (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]);
    if area == 0.0 {
        return None;
    }
    let mut shares = [0.0; 3];
    for (k, share) in shares.iter_mut().enumerate() {
        let (a, b) = (corners[(k + 1) % 3], corners[(k + 2) % 3]);
        let is_turned = (a.x, a.y) > (b.x, b.y);
        let (low, high) = if is_turned { (b, a) } else { (a, b) };
        let edge = high - low;
        let own = edge.perp_dot(-low);
        // Moved by (ε, ε²), the origin on an edge lies to its left where this is positive.
        let moved = if edge.y == 0.0 { edge.x } else { -edge.y };
        let sign = if is_turned == (area > 0.0) { -1.0 } else { 1.0 };
        if sign * own < 0.0 || (own == 0.0 && sign * moved < 0.0) {
            return None;
        }
        *share = (sign * own).max(0.0);
    }
    let sum: f64 = shares.iter().sum();
    (sum > 0.0).then(|| shares.map(|share| share / sum))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fan of eight triangles round a point, moved so that the origin comes to lie on its corners, on its edges, inside and outside: it lies
    /// in one triangle or in none.
    #[test]
    fn a_point_belongs_to_one_triangle() {
        let rim: Vec<DVec2> = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
            .map(|(x, y)| DVec2::new(f64::from(x), f64::from(y)))
            .to_vec();
        let count = |from: DVec2, turned: bool| {
            let triangle = |k: usize| {
                let [a, b] = [rim[k], rim[(k + 1) % 8]].map(|corner| corner - from);
                if turned == k.is_multiple_of(2) { [a, b, -from] } else { [b, a, -from] }
            };
            (0..8).filter(|k| inside(triangle(*k)).is_some()).count()
        };
        for turned in [false, true] {
            for x in -4_i32..=4 {
                for y in -4_i32..=4 {
                    let at = DVec2::new(f64::from(x), f64::from(y)) / 4.0;
                    let found = count(at, turned);
                    let is_within = x.abs() < 4 && y.abs() < 4;
                    assert!(found == 1 || (!is_within && found == 0), "{at}: {found}");
                }
            }
            assert_eq!(count(DVec2::new(1.1, 0.0), turned), 0);
        }
    }

    #[test]
    fn shares_are_barycentric() {
        let at = DVec2::new(0.2, 0.3);
        let corners = [DVec2::ZERO, DVec2::X, DVec2::Y].map(|corner| corner - at);
        for (found, exact) in inside(corners).unwrap().into_iter().zip([0.5, 0.2, 0.3]) {
            assert!((found - exact).abs() < 1e-15);
        }
    }
}
