//! The triangles of a surface, or the lit cells of a volume, in ever smaller groups: from afar a group is one point.

use super::emission::Emission;
use super::lump::{Lump, Piece};
use crate::vocabulary::space::Bounds;
use glam::DVec3;
use std::collections::BTreeMap;
use std::ops::Range;

/// A group.
pub struct Cluster {
    /// Middle of its flux, mm.
    pub center_mm: DVec3,
    /// No point of it is farther from the middle, mm.
    pub radius_mm: f64,
    /// The box that it lies in, mm.
    pub bounds_mm: Bounds,
    /// Its zones among all.
    entries: Range<usize>,
    /// The groups it is made of, or its triangles or cells.
    parts: Parts,
}

enum Parts {
    Clusters(Vec<u32>),
    Items(Vec<u32>),
}

/// All groups, the whole last.
pub struct Clusters {
    clusters: Vec<Cluster>,
    zones: Vec<u32>,
    flux: Vec<f64>,
    channels: usize,
    in_volume: bool,
}

/// What a node of the hierarchy is.
#[derive(Clone, Copy, Debug)]
pub enum Node {
    /// A group.
    Cluster(u32),
    /// A triangle, a cell, or a part of one.
    Piece(Piece),
}

/// What is summed over a group.
struct Sums {
    zones: BTreeMap<u32, Vec<f64>>,
    weight: f64,
    moment: DVec3,
    points_mm: Vec<DVec3>,
}

impl Clusters {
    /// Of all triangles or lit cells.
    pub fn new(emission: &Emission<'_>) -> Clusters {
        let light = emission.light();
        let mut items: Vec<(u32, DVec3)> = match light.volume {
            Some(volume) => {
                let middle = |cell: usize| (cell as u32, volume.lattice.point_mm(cell, [0.5; 3]));
                volume.lattice.lit_cells().map(middle).collect()
            }
            None => {
                let middle = |triangle: usize| {
                    let [a, b, c] = light.mesh.corners_mm(triangle);
                    (triangle as u32, (a + b + c) / 3.0)
                };
                (0..light.mesh.triangles.len()).map(middle).collect()
            }
        };
        let mut clusters = Clusters {
            clusters: Vec::new(),
            zones: Vec::new(),
            flux: Vec::new(),
            channels: emission.channels(),
            in_volume: light.volume.is_some(),
        };
        clusters.build(emission, &mut items, &mut Lump::default());
        clusters
    }

    /// Halvings between a group and its parts: a surface has two dimensions, a volume three.
    fn halvings(&self) -> u32 {
        if self.in_volume { 3 } else { 2 }
    }

    fn build(&mut self, emission: &Emission<'_>, items: &mut [(u32, DVec3)], lump: &mut Lump) -> (u32, Sums) {
        let mut sums = Sums { zones: BTreeMap::new(), weight: 0.0, moment: DVec3::ZERO, points_mm: Vec::new() };
        let parts = if items.len() <= 1 << self.halvings() {
            for (item, _) in items.iter() {
                self.piece(*item).fill(emission, lump);
                sums.add(emission, lump);
                self.corners_mm(emission, *item, &mut sums.points_mm);
            }
            Parts::Items(items.iter().map(|(item, _)| *item).collect())
        } else {
            let mut parts = Vec::new();
            halved(items, self.halvings(), &mut |items| {
                let (part, own) = self.build(emission, items, lump);
                sums.merge(own);
                parts.push(part);
            });
            Parts::Clusters(parts)
        };
        let even = || sums.points_mm.iter().sum::<DVec3>() / sums.points_mm.len().max(1) as f64;
        let center_mm = if sums.weight > 0.0 { sums.moment / sums.weight } else { even() };
        let radius_mm = sums.points_mm.iter().map(|point| point.distance(center_mm)).fold(0.0, f64::max);
        let bounds_mm = Bounds::of(sums.points_mm.iter().copied());
        let from = self.zones.len();
        for (zone, flux) in &sums.zones {
            self.zones.push(*zone);
            self.flux.extend(flux);
        }
        let entries = from..self.zones.len();
        self.clusters.push(Cluster { center_mm, radius_mm, bounds_mm, entries, parts });
        (self.clusters.len() as u32 - 1, sums)
    }

    fn piece(&self, item: u32) -> Piece {
        if self.in_volume { Piece::cell(item) } else { Piece::triangle(item) }
    }

    fn corners_mm(&self, emission: &Emission<'_>, item: u32, into: &mut Vec<DVec3>) {
        match emission.light().volume {
            Some(volume) => into.extend((0..8_usize).map(|corner| {
                let at = std::array::from_fn(|k| (corner >> k & 1) as f64);
                volume.lattice.point_mm(item as usize, at)
            })),
            None => into.extend(emission.light().mesh.corners_mm(item as usize)),
        }
    }

    /// The whole.
    pub fn root(&self) -> Node {
        Node::Cluster(self.clusters.len() as u32 - 1)
    }

    /// A group by its number.
    pub fn cluster(&self, cluster: u32) -> &Cluster {
        &self.clusters[cluster as usize]
    }

    /// Whether a node is a group of whole triangles or cells: these are not much smaller than it, so that they do not tell its error.
    pub fn is_of_pieces(&self, node: Node) -> bool {
        matches!(node, Node::Cluster(cluster) if matches!(self.clusters[cluster as usize].parts, Parts::Items(_)))
    }

    /// Zones of a group and the flux of each, `[zone][channel]`.
    pub fn light_of(&self, cluster: u32) -> (&[u32], &[f64]) {
        let Range { start, end } = self.clusters[cluster as usize].entries.clone();
        (&self.zones[start..end], &self.flux[start * self.channels..end * self.channels])
    }

    /// Calls `visit` with the parts of a node.
    pub fn split(&self, node: Node, mut visit: impl FnMut(Node)) {
        match node {
            Node::Piece(piece) => piece.split(|part| visit(Node::Piece(part))),
            Node::Cluster(cluster) => match &self.clusters[cluster as usize].parts {
                Parts::Clusters(parts) => parts.iter().for_each(|part| visit(Node::Cluster(*part))),
                Parts::Items(items) => items.iter().for_each(|item| visit(Node::Piece(self.piece(*item)))),
            },
        }
    }
}

impl Sums {
    fn add(&mut self, emission: &Emission<'_>, lump: &Lump) {
        let channels = emission.channels();
        for (zone, flux) in lump.zones.iter().zip(lump.flux.chunks_exact(channels)) {
            let sums = self.zones.entry(*zone).or_insert_with(|| vec![0.0; channels]);
            sums.iter_mut().zip(flux).for_each(|(sum, flux)| *sum += flux);
            let weight = emission.weighed(flux);
            self.weight += weight;
            self.moment += weight * lump.center_mm;
        }
    }

    fn merge(&mut self, other: Sums) {
        for (zone, flux) in other.zones {
            match self.zones.get_mut(&zone) {
                Some(sums) => sums.iter_mut().zip(flux).for_each(|(sum, flux)| *sum += flux),
                None => drop(self.zones.insert(zone, flux)),
            }
        }
        self.weight += other.weight;
        self.moment += other.moment;
        self.points_mm.extend(other.points_mm);
    }
}

/// Halves `items` where they reach farthest, so many times, and calls `visit` with what is not empty.
fn halved(items: &mut [(u32, DVec3)], times: u32, visit: &mut impl FnMut(&mut [(u32, DVec3)])) {
    if times == 0 || items.len() < 2 {
        if !items.is_empty() {
            visit(items);
        }
        return;
    }
    let (low, high) = items
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), (_, middle)| (low.min(*middle), high.max(*middle)));
    let size = (high - low).to_array();
    let axis = (1..3).fold(0, |longest, axis| if size[axis] > size[longest] { axis } else { longest });
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| a.1[axis].total_cmp(&b.1[axis]).then(a.0.cmp(&b.0)));
    let (first, second) = items.split_at_mut(middle);
    halved(first, times - 1, visit);
    halved(second, times - 1, visit);
}
