//! Neighbouring sites, and the same sites in ever larger clusters: what the smoother calls scales.
//!
//! A site is a vertex of a surface, a cell of directions or a cell of a volume. On each level, amounts spread by a lazy random walk
//! along the edges (half stays, half goes to the neighbours by their weights), which conserves them whatever the form of the graph.

use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Steps of the walk that make one level's smoothing: a standard deviation of 0.7 spacings.
const STEPS: usize = 2;
/// Steps of the walk on the next coarser level over which signal and noise are averaged: three times as wide as the smoothing.
const WINDOW_STEPS: usize = 4;
/// The coarsest level has at most this many clusters, or is the last that is coarser than the one before.
const FEWEST: usize = 4;
/// Most levels: 2²⁴ times the spacing.
const MOST_LEVELS: usize = 24;

/// An undirected edge: two sites and how strongly they are joined.
pub type Edge = (u32, u32, f64);

/// A sparse square matrix by rows.
struct Rows {
    starts: Vec<usize>,
    entries: Vec<(u32, f64)>,
}

impl Rows {
    fn of(rows: Vec<Vec<(u32, f64)>>) -> Rows {
        let mut starts = vec![0];
        starts.extend(rows.iter().scan(0, |end, row| {
            *end += row.len();
            Some(*end)
        }));
        Rows { starts, entries: rows.into_iter().flatten().collect() }
    }

    fn len(&self) -> usize {
        self.starts.len() - 1
    }

    fn row(&self, k: usize) -> &[(u32, f64)] {
        &self.entries[self.starts[k]..self.starts[k + 1]]
    }

    fn apply(&self, values: &[f64]) -> Vec<f64> {
        let sum = |k: usize| self.row(k).iter().map(|(other, weight)| weight * values[*other as usize]).sum();
        (0..self.len()).map(sum).collect()
    }

    /// The product with `other`, `self · other`.
    fn times(&self, other: &Rows) -> Rows {
        let row = |k: usize| {
            let mut sums = BTreeMap::new();
            for (middle, first) in self.row(k) {
                for (last, second) in other.row(*middle as usize) {
                    *sums.entry(*last).or_insert(0.0) += first * second;
                }
            }
            sums.into_iter().collect()
        };
        Rows::of((0..self.len()).into_par_iter().map(row).collect())
    }

    /// Element by element with `other`; elements that one of them lacks are 0.
    fn matched(&self, other: &Rows) -> Rows {
        let row = |k: usize| {
            let others: BTreeMap<u32, f64> = other.row(k).iter().copied().collect();
            self.row(k).iter().filter_map(|(site, a)| Some((*site, a * others.get(site)?))).collect()
        };
        Rows::of((0..self.len()).map(row).collect())
    }
}

/// The sites of one level.
pub struct Level {
    /// The cluster of each site of level 0.
    cluster: Vec<u32>,
    /// The cluster of each cluster of the next finer level.
    parent: Vec<u32>,
    /// One step of the walk for amounts: what leaves adds up to what was there.
    spread: Rows,
    /// One step for densities: the mean over oneself and the neighbours.
    average: Rows,
    /// [`STEPS`] steps for amounts.
    kernel: Rows,
    /// The variance of a smoothed amount, of those of independent rays.
    noise: Rows,
}

/// Sites, from the finest level to the coarsest.
pub struct Levels {
    levels: Vec<Level>,
    /// The variance of an unsmoothed amount of level 0, in parts of that of a ray that goes to one site.
    own_noise: f64,
}

/// One scale of smoothing: a level, smoothed or (the last, on level 0) as counted.
#[derive(Clone, Copy)]
pub struct Scale {
    level: usize,
    smoothed: bool,
}

impl Levels {
    /// Levels of sites at `points` whose typical distance is `spacing`. Sites whose `kinds` differ share no cluster. `shared`: an
    /// amount is shared by the sites round it, as a ray's by the corners of its triangle; otherwise it belongs to one site.
    pub fn new(points: &[DVec3], kinds: &[u32], edges: &[Edge], spacing: f64, shared: bool) -> Levels {
        let own: Vec<u32> = (0..points.len() as u32).collect();
        let mut levels = vec![Level::new(own.clone(), own, edges, shared)];
        let mut edges = edges.to_vec();
        for doubling in 1..MOST_LEVELS {
            let finer = &levels[levels.len() - 1];
            let count = finer.kernel.len();
            if count <= FEWEST {
                break;
            }
            let pitch = spacing * f64::from(1u32 << doubling);
            let (cluster, clusters) = clusters(points, kinds, pitch);
            let mut parent = vec![0; count];
            for (child, cluster) in finer.cluster.iter().zip(&cluster) {
                parent[*child as usize] = *cluster;
            }
            if clusters == count {
                continue;
            }
            edges = joined(&edges, &parent);
            levels.push(Level::new(cluster, parent, &edges, false));
        }
        Levels { levels, own_noise: if shared { 0.5 } else { 1.0 } }
    }

    /// From coarse to fine.
    pub fn scales(&self) -> impl Iterator<Item = Scale> + '_ {
        let smoothed = (0..self.levels.len()).rev().map(|level| Scale { level, smoothed: true });
        smoothed.chain([Scale { level: 0, smoothed: false }])
    }

    /// Amounts of sites as amounts of the scale's clusters.
    pub fn gather(&self, scale: Scale, amounts: &[f64]) -> Vec<f64> {
        let level = &self.levels[scale.level];
        let mut sums = vec![0.0; level.kernel.len()];
        amounts.iter().zip(&level.cluster).for_each(|(amount, cluster)| sums[*cluster as usize] += amount);
        sums
    }

    /// Amounts of clusters, smoothed.
    pub fn smooth(&self, scale: Scale, amounts: &[f64]) -> Vec<f64> {
        if scale.smoothed { self.levels[scale.level].kernel.apply(amounts) } else { amounts.to_vec() }
    }

    /// Variance of [`Levels::smooth`] of `amounts` that rays of amount 1 make up.
    pub fn variance(&self, scale: Scale, amounts: &[f64]) -> Vec<f64> {
        if scale.smoothed {
            self.levels[scale.level].noise.apply(amounts)
        } else {
            amounts.iter().map(|amount| self.own_noise * amount).collect()
        }
    }

    /// Sums of amounts over the surroundings of each cluster.
    pub fn surroundings(&self, scale: Scale, amounts: &[f64]) -> Vec<f64> {
        let Some(coarser) = self.levels.get(scale.level + 1) else {
            let level = &self.levels[scale.level];
            return (0..WINDOW_STEPS).fold(amounts.to_vec(), |amounts, _| level.spread.apply(&amounts));
        };
        let mut sums = vec![0.0; coarser.kernel.len()];
        amounts.iter().zip(&coarser.parent).for_each(|(amount, parent)| sums[*parent as usize] += amount);
        let sums = (0..WINDOW_STEPS).fold(sums, |sums, _| coarser.spread.apply(&sums));
        coarser.parent.iter().map(|parent| sums[*parent as usize]).collect()
    }

    /// Amounts spread over the surroundings of a scale of about four spacings, as amounts again: density times `measures`.
    pub fn blurred(&self, amounts: &[f64], measures: &[f64]) -> Vec<f64> {
        let scale = Scale { level: self.levels.len().saturating_sub(1).min(2), smoothed: true };
        let [given, room] = [amounts, measures].map(|values| self.smooth(scale, &self.gather(scale, values)));
        let density = given.iter().zip(room).map(|(given, room)| if room > 0.0 { given / room } else { 0.0 }).collect();
        self.interpolate(scale, density).iter().zip(measures).map(|(density, measure)| density * measure).collect()
    }

    /// A number per cluster as a number per site, without steps from cluster to cluster.
    pub fn interpolate(&self, scale: Scale, values: Vec<f64>) -> Vec<f64> {
        (0..scale.level).rev().fold(values, |values, finer| {
            let children = self.levels[finer + 1].parent.iter().map(|parent| values[*parent as usize]).collect();
            (0..STEPS).fold(children, |values: Vec<f64>, _| self.levels[finer].average.apply(&values))
        })
    }
}

impl Level {
    fn new(cluster: Vec<u32>, parent: Vec<u32>, edges: &[Edge], shared: bool) -> Level {
        let count = cluster.iter().max().map_or(0, |last| *last as usize + 1);
        let mut joined: Vec<Vec<(u32, f64)>> = vec![Vec::new(); count];
        for (a, b, weight) in edges {
            joined[*a as usize].push((*b, *weight));
            joined[*b as usize].push((*a, *weight));
        }
        joined.iter_mut().for_each(|row| row.sort_by_key(|(other, _)| *other));
        let degrees: Vec<f64> = joined.iter().map(|row| row.iter().map(|(_, weight)| weight).sum()).collect();
        let walk = |share: &dyn Fn(usize, usize) -> f64| {
            let row = |k: usize| {
                let stay = if degrees[k] > 0.0 { 0.5 } else { 1.0 };
                let mut row = vec![(k as u32, stay)];
                row.extend(joined[k].iter().map(|(other, weight)| (*other, 0.5 * weight / share(k, *other as usize))));
                row
            };
            Rows::of((0..count).map(row).collect())
        };
        let spread = walk(&|_, giver| degrees[giver]);
        let average = walk(&|taker, _| degrees[taker]);
        let kernel = (1..STEPS).fold(spread.times(&identity(count)), |kernel, _| kernel.times(&spread));
        // Rays shared between neighbours correlate them: as if each had walked one more step on one side of the product.
        let noise = if shared { kernel.matched(&kernel.times(&spread)) } else { kernel.matched(&kernel) };
        Level { cluster, parent, spread, average, kernel, noise }
    }
}

fn identity(count: usize) -> Rows {
    Rows::of((0..count as u32).map(|k| vec![(k, 1.0)]).collect())
}

/// The cluster of each point on a lattice of `pitch`, numbered in the order of their first points; and how many there are.
fn clusters(points: &[DVec3], kinds: &[u32], pitch: f64) -> (Vec<u32>, usize) {
    let mut known = BTreeMap::new();
    let cluster = |(point, kind): (&DVec3, &u32)| {
        let place = (*point / pitch).floor();
        let next = known.len() as u32;
        *known.entry((*kind, place.x as i64, place.y as i64, place.z as i64)).or_insert(next)
    };
    let cluster = points.iter().zip(kinds).map(cluster).collect();
    (cluster, known.len())
}

/// The edges between clusters: as strong as all edges between their members.
fn joined(edges: &[Edge], parent: &[u32]) -> Vec<Edge> {
    let mut sums = BTreeMap::new();
    for (a, b, weight) in edges {
        let (a, b) = (parent[*a as usize], parent[*b as usize]);
        if a != b {
            *sums.entry((a.min(b), a.max(b))).or_insert(0.0) += weight;
        }
    }
    sums.into_iter().map(|((a, b), weight)| (a, b, weight)).collect()
}
