//! Zones: which point belongs where, on a lattice or along the surface.

use super::ancestry::Ancestry;
use super::intensity::Goniogram;
use super::kinds::kinds;
use super::mixture::{Middle, Mixture, blend};
use crate::flux::Surface;
use crate::hull::Hull;
use crate::vocabulary::space::{Bounds, Frame};
use glam::DVec3;
use std::collections::BTreeMap;

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

/// Row and column of a zone in the lattice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Counted from 0 along photometric y.
    pub row: usize,
    /// Counted from 0 along photometric x.
    pub column: usize,
}

/// A zone that holds light.
#[derive(Clone, Debug, PartialEq)]
pub struct Zone {
    /// Its index among the zones that hold light.
    pub id: u32,
    /// Where it lies in the lattice; `None` where zones follow the surface.
    pub place: Option<Place>,
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

impl Zone {
    /// What its files are called: row and column, or its number.
    pub fn name(&self) -> String {
        match self.place {
            Some(Place { row, column }) => format!("zone_{row:02}_{column:02}"),
            None => format!("zone_{:03}", self.id),
        }
    }

    /// Its place in words: ", row 1 column 2"; nothing where zones follow the surface.
    pub fn position(&self) -> String {
        self.place.map_or_else(String::new, |Place { row, column }| format!(", row {row} column {column}"))
    }

    fn empty(id: u32, place: Option<Place>) -> Zone {
        Zone {
            id,
            place,
            bounds_mm: Bounds::EMPTY,
            centroid_mm: DVec3::ZERO,
            area_mm2: 0.0,
            vertex_count: 0,
            goniogram: Goniogram::default(),
        }
    }
}

/// Most zones unless more are asked for; the paper has the same limit [общее количество зон ограничено 16].
const MOST_BY_DEFAULT: f64 = 16.0;
/// Rays that a zone of the paper's lattice needs: about 30 per lit cell, where half of 1300 cells are lit.
const RAYS_PER_LATTICE_ZONE: f64 = 20_000.0;
/// Rays that a zone that follows the surface needs: with fewer it would hardly differ from the whole.
const RAYS_PER_ZONE: f64 = 200.0;
/// Vertices that such a zone has at least.
const VERTICES_PER_ZONE: usize = 4;

/// Normals are told apart in steps of one in so many, 4 degrees.
const NORMAL_STEPS: f64 = 16.0;

/// What belongs where, before any goniogram.
pub struct Zoning {
    /// The photometric frame.
    pub frame: Frame,
    /// The lattice; `None` where zones follow the surface.
    pub lattice: Option<Lattice>,
    /// Zones that hold vertices, goniograms still empty.
    pub zones: Vec<Zone>,
    /// Zone id of each vertex.
    pub zone_of_vertex: Vec<u32>,
    /// Where each zone comes from.
    pub family: Vec<Ancestry>,
    /// Zones and weights of each vertex.
    pub mixtures: Vec<Mixture>,
}

impl Zoning {
    /// Zones that follow the surface: its faces, and where their light differs in spectrum the areas that do, each halved where most
    /// rays are as long as there is room for zones and there are rays for them.
    pub fn along(hull: &Hull, surface: &Surface, frame: Frame, most: usize) -> Zoning {
        let (kind_of_vertex, kinds) = kinds(hull, &surface.vertices);
        let mut leaves: Vec<Leaf> =
            (0..kinds as u32).map(|kind| Leaf::new(Ancestry::whole(kind), Vec::new(), surface)).collect();
        for (vertex, kind) in kind_of_vertex.iter().enumerate() {
            leaves[*kind as usize].vertices.push(vertex);
        }
        let mut leaves: Vec<Leaf> =
            leaves.into_iter().map(|leaf| Leaf::new(leaf.ancestry, leaf.vertices, surface)).collect();
        while leaves.len() < most {
            let splits = |leaf: &Leaf| {
                let has_room = leaf.vertices.len() >= 2 * VERTICES_PER_ZONE && leaf.ancestry.may_halve();
                leaf.rays >= 2.0 * RAYS_PER_ZONE && has_room
            };
            let fullest = (0..leaves.len())
                .filter(|k| splits(&leaves[*k]))
                .max_by(|a, b| leaves[*a].rays.total_cmp(&leaves[*b].rays).then(b.cmp(a)));
            let Some(fullest) = fullest else { break };
            let half = leaves[fullest].halve(hull, surface);
            leaves.push(half);
        }
        leaves.sort_by_key(|leaf| (leaf.ancestry.kind, leaf.vertices[0]));
        let mut zone_of_vertex = vec![0; hull.vertices_mm.len()];
        for (id, leaf) in leaves.iter().enumerate() {
            leaf.vertices.iter().for_each(|vertex| zone_of_vertex[*vertex] = id as u32);
        }
        let mut zones: Vec<Zone> = (0..leaves.len()).map(|id| Zone::empty(id as u32, None)).collect();
        describe(&mut zones, &zone_of_vertex, hull, surface);
        let family: Vec<Ancestry> = leaves.iter().map(|leaf| leaf.ancestry).collect();
        let mixtures = zone_of_vertex.iter().map(|zone| Mixture::hard(*zone)).collect();
        Zoning { frame, lattice: None, zones, zone_of_vertex, family, mixtures }
    }

    /// Makes one zone of all zones of each kind that is `even`. Answers the new zone of each; zones of a kind stay side by side.
    pub fn merge(&mut self, even: &[bool], hull: &Hull, surface: &Surface) -> Vec<u32> {
        let (mut zone_of_zone, mut family): (Vec<u32>, Vec<Ancestry>) = (Vec::new(), Vec::new());
        for zone in &self.family {
            let is_even = even[zone.kind as usize];
            let merged = if is_even { Ancestry::whole(zone.kind) } else { *zone };
            if !(is_even && family.last() == Some(&merged)) {
                family.push(merged);
            }
            zone_of_zone.push(family.len() as u32 - 1);
        }
        self.family = family;
        self.zone_of_vertex.iter_mut().for_each(|zone| *zone = zone_of_zone[*zone as usize]);
        self.zones = (0..self.family.len()).map(|id| Zone::empty(id as u32, None)).collect();
        describe(&mut self.zones, &self.zone_of_vertex, hull, surface);
        let flux = surface.vertices.primary();
        let mut of_zone = vec![0.0; self.zones.len()];
        self.zone_of_vertex.iter().zip(flux).for_each(|(zone, flux)| of_zone[*zone as usize] += flux);
        let middle = |(zone, flux): (&Zone, f64)| {
            let exitance = if zone.area_mm2 > 0.0 { flux / zone.area_mm2 } else { 0.0 };
            Middle { zone: zone.id, at_mm: zone.centroid_mm, exitance }
        };
        let middles = self.zones.iter().zip(of_zone).map(middle).collect();
        self.mixtures = blend(hull, flux, middles, &self.zone_of_vertex, &self.family);
        zone_of_zone
    }

    /// The paper's zones: a lattice over the hull, as asked or as the rays can feed.
    pub fn on_lattice(hull: &Hull, surface: &Surface, frame: Frame, asked: Option<(u32, u32)>) -> Zoning {
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
            let place = Place { row: cell / lattice.columns, column: cell % lattice.columns };
            zones.push(Zone::empty(zones.len() as u32, Some(place)));
        }
        let zone_of_vertex: Vec<u32> = cells.iter().map(|cell| id_of_cell[*cell].unwrap_or(0)).collect();
        describe(&mut zones, &zone_of_vertex, hull, surface);
        let family = vec![Ancestry::whole(0); zones.len()];
        let mixtures = zone_of_vertex.iter().map(|zone| Mixture::hard(*zone)).collect();
        Zoning { frame, lattice: Some(lattice), zones, zone_of_vertex, family, mixtures }
    }

    /// Boxes, areas and centroids of the zones, by the light on `surface`.
    pub fn describe(&mut self, hull: &Hull, surface: &Surface) {
        self.zones = self.zones.iter().map(|zone| Zone::empty(zone.id, zone.place)).collect();
        describe(&mut self.zones, &self.zone_of_vertex, hull, surface);
    }

    /// Outward normals of each zone's surface in the photometric frame, weighted by the flux of its vertices, weights that sum to 1.
    /// Nearly equal normals are one.
    pub fn normals(&self, hull: &Hull, surface: &Surface) -> Vec<Vec<(DVec3, f64)>> {
        let frame = &self.frame;
        let mut sums: Vec<BTreeMap<[i32; 3], f64>> = vec![BTreeMap::new(); self.zones.len()];
        for ((zone, normal), flux) in
            self.zone_of_vertex.iter().zip(hull.vertex_normals()).zip(surface.vertices.primary())
        {
            let key = [frame.x(), frame.y(), frame.z()].map(|axis| (normal.dot(axis) * NORMAL_STEPS).round() as i32);
            *sums[*zone as usize].entry(key).or_insert(0.0) += flux;
        }
        let weighted = |sums: BTreeMap<[i32; 3], f64>| {
            let total: f64 = sums.values().sum();
            let normal = |key: [i32; 3]| DVec3::from(key.map(f64::from)).normalize_or_zero();
            sums.into_iter().filter(|_| total > 0.0).map(|(key, flux)| (normal(key), flux / total)).collect()
        };
        sums.into_iter().map(weighted).collect()
    }
}

/// Vertices that become a zone.
struct Leaf {
    ancestry: Ancestry,
    /// In ascending order.
    vertices: Vec<usize>,
    rays: f64,
}

impl Leaf {
    fn new(ancestry: Ancestry, vertices: Vec<usize>, surface: &Surface) -> Leaf {
        let rays = vertices.iter().map(|vertex| surface.vertices.rays[*vertex]).sum();
        Leaf { ancestry, vertices, rays }
    }

    /// Parts with the half of the rays that lies farther along the longest side of its box.
    fn halve(&mut self, hull: &Hull, surface: &Surface) -> Leaf {
        let at = |vertex: &usize| hull.vertices_mm[*vertex];
        let size = Bounds::of(self.vertices.iter().map(at)).size();
        let axis = size.max_position();
        let mut sorted = std::mem::take(&mut self.vertices);
        sorted.sort_by(|a, b| at(a)[axis].total_cmp(&at(b)[axis]).then(a.cmp(b)));
        let mut seen = 0.0;
        let middle = sorted.iter().position(|vertex| {
            seen += surface.vertices.rays[*vertex];
            2.0 * seen >= self.rays
        });
        let middle = (middle.unwrap_or(0) + 1).clamp(VERTICES_PER_ZONE, sorted.len() - VERTICES_PER_ZONE);
        let mut far = sorted.split_off(middle);
        sorted.sort_unstable();
        far.sort_unstable();
        let [near, other] = self.ancestry.halves();
        *self = Leaf::new(near, sorted, surface);
        Leaf::new(other, far, surface)
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
        None => shape((weight / RAYS_PER_LATTICE_ZONE).clamp(1.0, MOST_BY_DEFAULT), spread),
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
