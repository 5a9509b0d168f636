//! The zone lattice and which point belongs where.

use super::intensity::Goniogram;
use crate::flux::Surface;
use crate::hull::Hull;
use crate::vocabulary::space::{Bounds, Frame};
use glam::DVec3;

/// A regular lattice of zones over the emission, in the plane normal to γ = 0. Columns run along C0 (photometric x), rows along
/// C90 (photometric y).
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    /// The frame whose x and y span the plane.
    pub frame: Frame,
    /// Zones along C0.
    pub columns: usize,
    /// Zones along C90.
    pub rows: usize,
    /// Lower corner in the plane, photometric x and y, mm.
    pub min_mm: [f64; 2],
    /// Upper corner in the plane, photometric x and y, mm.
    pub max_mm: [f64; 2],
}

impl Lattice {
    /// Row and column of a point; points outside belong to the nearest zone.
    pub fn place(&self, point_mm: DVec3) -> (usize, usize) {
        let along = |axis: usize, count: usize, at: f64| {
            let span = self.max_mm[axis] - self.min_mm[axis];
            if span <= 0.0 {
                return 0;
            }
            (((at - self.min_mm[axis]) / span * count as f64).floor().max(0.0) as usize).min(count - 1)
        };
        let column = along(0, self.columns, point_mm.dot(self.frame.x()));
        let row = along(1, self.rows, point_mm.dot(self.frame.y()));
        (row, column)
    }
}

/// A zone that holds light.
#[derive(Clone, Debug, PartialEq)]
pub struct Zone {
    /// Its index among the zones that hold light.
    pub id: u32,
    /// Row in the lattice.
    pub row: usize,
    /// Column in the lattice.
    pub column: usize,
    /// Box of its vertices, source frame, mm.
    pub bounds_mm: Bounds,
    /// Flux-weighted mean of its vertices, source frame, mm.
    pub centroid_mm: DVec3,
    /// Area of the surface that its vertices stand for, mm².
    pub area_mm2: f64,
    /// How many vertices.
    pub vertex_count: usize,
    /// What it sends where.
    pub goniogram: Goniogram,
}

/// Most zones unless more are asked for; the paper has the same limit [общее количество зон ограничено 16].
const MOST_BY_DEFAULT: f64 = 16.0;
/// Rays that a zone needs: about 30 per lit cell, where half of 1300 cells are lit.
const RAYS_PER_ZONE: f64 = 20_000.0;

/// The lattice, and what belongs where, before any goniogram.
pub struct Zoning {
    /// The lattice.
    pub lattice: Lattice,
    /// Zones that hold vertices, goniograms still empty.
    pub zones: Vec<Zone>,
    /// Zone id of each vertex.
    pub zone_of_vertex: Vec<u32>,
}

impl Zoning {
    /// Lays the lattice over the hull and places every vertex.
    pub fn new(hull: &Hull, surface: &Surface, frame: Frame, asked: Option<(u32, u32)>) -> Zoning {
        let lattice = lattice(hull, surface, frame, asked);
        let cell = |point_mm: DVec3| {
            let (row, column) = lattice.place(point_mm);
            row * lattice.columns + column
        };
        let cells: Vec<usize> = hull.vertices_mm.iter().map(|vertex| cell(*vertex)).collect();
        let mut id_of_cell = vec![None; lattice.columns * lattice.rows];
        cells.iter().for_each(|cell| id_of_cell[*cell] = Some(0));
        let mut zones = Vec::new();
        for (cell, id) in id_of_cell.iter_mut().enumerate().filter(|(_, id)| id.is_some()) {
            *id = Some(zones.len() as u32);
            zones.push(Zone {
                id: zones.len() as u32,
                row: cell / lattice.columns,
                column: cell % lattice.columns,
                bounds_mm: Bounds::EMPTY,
                centroid_mm: DVec3::ZERO,
                area_mm2: 0.0,
                vertex_count: 0,
                goniogram: Goniogram::default(),
            });
        }
        let zone_of_vertex: Vec<u32> = cells.iter().map(|cell| id_of_cell[*cell].unwrap_or(0)).collect();
        describe(&mut zones, &zone_of_vertex, hull, surface);
        Zoning { lattice, zones, zone_of_vertex }
    }
}

/// Boxes, areas and centroids of the zones from their vertices.
fn describe(zones: &mut [Zone], zone_of_vertex: &[u32], hull: &Hull, surface: &Surface) {
    let flux = surface.vertices.primary();
    let areas_mm2 = hull.vertex_areas_mm2();
    let mut weights = vec![0.0; zones.len()];
    for (vertex, id) in zone_of_vertex.iter().enumerate() {
        let zone = &mut zones[*id as usize];
        zone.bounds_mm.grow(hull.vertices_mm[vertex]);
        zone.area_mm2 += areas_mm2[vertex];
        zone.vertex_count += 1;
        zone.centroid_mm += flux[vertex] * hull.vertices_mm[vertex];
        weights[*id as usize] += flux[vertex];
    }
    for (zone, weight) in zones.iter_mut().zip(weights) {
        zone.centroid_mm = if weight > 0.0 { zone.centroid_mm / weight } else { zone.bounds_mm.center() };
    }
}

/// The lattice over the hull's extent in the plane: as asked, or as many zones as the rays can feed, shaped like the emission.
fn lattice(hull: &Hull, surface: &Surface, frame: Frame, asked: Option<(u32, u32)>) -> Lattice {
    let planar = |point: &DVec3| [point.dot(frame.x()), point.dot(frame.y())];
    let (mut min_mm, mut max_mm) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let (mut sum, mut square, mut weight) = ([0.0; 2], [0.0; 2], 0.0);
    for (vertex, rays) in hull.vertices_mm.iter().zip(&surface.vertices.rays) {
        weight += rays;
        for (axis, at) in planar(vertex).into_iter().enumerate() {
            min_mm[axis] = min_mm[axis].min(at);
            max_mm[axis] = max_mm[axis].max(at);
            sum[axis] += rays * at;
            square[axis] += rays * at * at;
        }
    }
    let spread = [0, 1].map(|axis| (square[axis] / weight - (sum[axis] / weight).powi(2)).max(0.0).sqrt());
    let (columns, rows) = match asked {
        Some((columns, rows)) => (columns as usize, rows as usize),
        None => shape((weight / RAYS_PER_ZONE).clamp(1.0, MOST_BY_DEFAULT), spread),
    };
    Lattice { frame, columns, rows, min_mm, max_mm }
}

/// Columns and rows, at most `count` zones together, nearest to square zones in terms of the rays' spread (mm); the fullest such
/// lattice, the squarest of those.
fn shape(count: f64, spread: [f64; 2]) -> (usize, usize) {
    let floor = spread[0].max(spread[1]).max(f64::MIN_POSITIVE) / MOST_BY_DEFAULT;
    let (across, along) = (spread[0].max(floor), spread[1].max(floor));
    let most = count as usize;
    let badness = |(columns, rows): &(usize, usize)| {
        let elongation = ((across / *columns as f64) / (along / *rows as f64)).ln().abs();
        // An empty place costs as much as zones stretched by its share.
        elongation + (count / (columns * rows) as f64).ln()
    };
    (1..=most)
        .flat_map(|columns| (1..=most / columns).map(move |rows| (columns, rows)))
        .min_by(|a, b| badness(a).total_cmp(&badness(b)))
        .unwrap_or((1, 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vocabulary::space::Axis;

    #[test]
    fn lattices_follow_the_emission() {
        assert_eq!(shape(16.0, [1.0, 1.0]), (4, 4));
        assert_eq!(shape(16.0, [16.0, 0.0]), (16, 1));
        assert_eq!(shape(16.0, [1.0, 4.0]), (2, 8));
        assert_eq!(shape(1.0, [3.0, 1.0]), (1, 1));
        assert_eq!(shape(5.0, [1.0, 1.0]), (2, 2));
        assert_eq!(shape(16.0, [0.0, 0.0]), (4, 4));
    }

    #[test]
    fn every_point_belongs_to_a_zone() {
        let frame = Frame::looking(Axis::PosZ);
        let lattice = Lattice { frame, columns: 4, rows: 2, min_mm: [0.0, -1.0], max_mm: [4.0, 1.0] };
        // Rows run along C90 = −Y of a +Z emitter.
        assert_eq!(lattice.place(DVec3::new(0.5, 0.5, 9.0)), (0, 0));
        assert_eq!(lattice.place(DVec3::new(3.5, -0.5, 9.0)), (1, 3));
        assert_eq!(lattice.place(DVec3::new(4.0, -1.0, 0.0)), (1, 3));
        assert_eq!(lattice.place(DVec3::new(-100.0, 100.0, 0.0)), (0, 0));
        let flat = Lattice { max_mm: [0.0, -1.0], ..lattice };
        assert_eq!(flat.place(DVec3::new(1.0, 1.0, 1.0)), (0, 0));
    }
}
