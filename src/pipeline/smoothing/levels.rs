//! Neighbouring sites, and the same sites in ever larger clusters: what the smoother calls scales.
//!
//! A site is a vertex of a surface, a cell of directions or a cell of a volume. On each level, amounts spread by a lazy random walk
//! along the edges (half stays, half goes to the neighbours by their weights), which conserves them whatever the form of the graph.

use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Steps of the walk that make one level's smoothing: a standard deviation of 0.7 spacings.
const STEPS: usize = 2;
/// Standard deviation of the interpolation between clusters, in their spacing: half of it would show them, twice would blur.
const BLUR: f64 = 0.7;
/// The coarsest level has at most this many clusters, or is the last that is coarser than the one before.
const FEWEST: usize = 4;
/// Most levels: 2²⁴ times the spacing.
const MOST_LEVELS: usize = 24;

/// How an amount that was counted is shared by the sites round it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sharing {
    /// It belongs to one site.
    None,
    /// By barycentric coordinates among the corners of a triangle.
    ThreeCorners,
    /// By products of distances among the corners of a cell of a lattice.
    EightCorners,
}

impl Sharing {
    /// Mean of the sum of the squares of the shares.
    fn noise(self) -> f64 {
        match self {
            Sharing::None => 1.0,
            Sharing::ThreeCorners => 0.5,
            Sharing::EightCorners => 8.0 / 27.0,
        }
    }
}

/// Numbers that are smoothed together, side by side: one, or an array of such.
pub trait Numbers: Copy {
    /// None of any.
    const ZERO: Self;
    /// Adds `weight` times `more`.
    fn add(&mut self, weight: f64, more: &Self);
}

impl Numbers for f64 {
    const ZERO: f64 = 0.0;
    #[inline]
    fn add(&mut self, weight: f64, more: &f64) {
        *self += weight * more;
    }
}

impl<T: Numbers, const N: usize> Numbers for [T; N] {
    const ZERO: [T; N] = [T::ZERO; N];
    #[inline]
    fn add(&mut self, weight: f64, more: &[T; N]) {
        self.iter_mut().zip(more).for_each(|(sum, more)| sum.add(weight, more));
    }
}

/// An undirected edge: two sites and how strongly they are joined.
pub type Edge = (u32, u32, f64);

/// Columns and what stands in them.
type Entries = Vec<(u32, f32)>;

/// A sparse matrix by rows; its numbers need no more digits than rays have.
#[derive(Default)]
struct Rows {
    starts: Vec<usize>,
    entries: Entries,
}

/// Rows that are made at a time.
const BATCH: usize = 4096;

impl Rows {
    /// `count` rows; `make` puts the entries of each into an empty list.
    fn of(count: usize, make: impl Fn(usize, &mut Vec<(u32, f64)>) + Sync) -> Rows {
        let batch = |first: usize| {
            let (mut lengths, mut entries, mut row) = (Vec::new(), Vec::new(), Vec::new());
            for k in first..(first + BATCH).min(count) {
                row.clear();
                make(k, &mut row);
                lengths.push(row.len());
                entries.extend(row.iter().map(|(site, weight)| (*site, *weight as f32)));
            }
            (lengths, entries)
        };
        let batches: Vec<(Vec<usize>, Entries)> = (0..count).into_par_iter().step_by(BATCH).map(batch).collect();
        let mut rows = Rows { starts: vec![0], entries: Vec::with_capacity(batches.iter().map(|of| of.1.len()).sum()) };
        for (lengths, entries) in batches {
            for length in lengths {
                rows.starts.push(rows.starts[rows.starts.len() - 1] + length);
            }
            rows.entries.extend(entries);
        }
        rows
    }

    fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    fn row(&self, k: usize) -> &[(u32, f32)] {
        &self.entries[self.starts[k]..self.starts[k + 1]]
    }

    /// The products with vectors that lie side by side.
    fn apply<T: Numbers>(&self, values: &[T]) -> Vec<T> {
        let product = |k: usize| {
            let mut sums = T::ZERO;
            self.row(k).iter().for_each(|(other, weight)| sums.add(f64::from(*weight), &values[*other as usize]));
            sums
        };
        (0..self.len()).map(product).collect()
    }

    /// Adds the product of the row `first` and this matrix to `product`, by columns.
    fn times(&self, first: &[(u32, f32)], product: &mut Vec<(u32, f64)>) {
        for (middle, a) in first {
            product.extend(self.row(*middle as usize).iter().map(|(last, b)| (*last, f64::from(*a) * f64::from(*b))));
        }
        product.sort_unstable_by_key(|(site, _)| *site);
        product.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            if same {
                kept.1 += next.1;
            }
            same
        });
    }
}

/// The sites of one level.
struct Level {
    /// The cluster of each site of level 0.
    cluster: Vec<u32>,
    /// The cluster of each cluster of the next finer level.
    parent: Vec<u32>,
    /// One step of the walk for amounts: what leaves adds up to what was there.
    spread: Rows,
    /// From numbers of the next coarser level to numbers of this one; empty on the coarsest.
    finer: Rows,
    /// The middle of each cluster.
    middles: Vec<DVec3>,
    /// The variance of a smoothed amount, of those of independent rays.
    noise: Rows,
}

/// What kind of field the sites hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Field {
    /// Steps of the walk on the next coarser level over which signal and noise are averaged.
    window: usize,
}

/// Places: the window is three times as wide as the smoothing, so that an edge is seen where it is.
pub const PLACES: Field = Field { window: 4 };
/// The sphere of directions: the window is wider, because over few sites noise passes for a signal now and then.
pub const DIRECTIONS: Field = Field { window: 7 };

/// Sites, from the finest level to the coarsest.
pub struct Levels {
    levels: Vec<Level>,
    /// The variance of an unsmoothed amount of level 0, in parts of that of a ray that goes to one site.
    own_noise: f64,
    /// What the sites hold.
    field: Field,
}

/// One scale of smoothing: a level, smoothed or (the last, on level 0) as counted.
#[derive(Clone, Copy)]
pub struct Scale {
    level: usize,
    smoothed: bool,
}

impl Levels {
    /// Levels of sites at `points` whose typical distance is `spacing`. Sites whose `kinds` differ share no cluster.
    pub fn new(
        points: &[DVec3],
        kinds: &[u32],
        edges: &[Edge],
        spacing: f64,
        sharing: Sharing,
        field: Field,
    ) -> Levels {
        let shared = sharing != Sharing::None;
        let own: Vec<u32> = (0..points.len() as u32).collect();
        let mut levels = vec![Level::new(own.clone(), own, points, edges, shared)];
        let mut edges = edges.to_vec();
        for doubling in 1..MOST_LEVELS {
            let finer = &levels[levels.len() - 1];
            let count = finer.spread.len();
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
            let coarser = Level::new(cluster, parent, points, &edges, false);
            if let Some(finer) = levels.last_mut() {
                finer.finer = coarser.interpolation(&finer.middles, pitch);
            }
            levels.push(coarser);
        }
        Levels { levels, own_noise: sharing.noise(), field }
    }

    /// From coarse to fine.
    pub fn scales(&self) -> impl Iterator<Item = Scale> + '_ {
        let smoothed = (0..self.levels.len()).rev().map(|level| Scale { level, smoothed: true });
        smoothed.chain([Scale { level: 0, smoothed: false }])
    }

    /// Amounts of sites as amounts of the scale's clusters.
    pub fn gather<T: Numbers>(&self, scale: Scale, amounts: &[T]) -> Vec<T> {
        let level = &self.levels[scale.level];
        sums(amounts, &level.cluster, level.spread.len())
    }

    /// Amounts of clusters, smoothed.
    pub fn smooth<T: Numbers>(&self, scale: Scale, amounts: Vec<T>) -> Vec<T> {
        let steps = if scale.smoothed { STEPS } else { 0 };
        (0..steps).fold(amounts, |amounts, _| self.levels[scale.level].spread.apply(&amounts))
    }

    /// Variance of [`Levels::smooth`] of `amounts` that rays of amount 1 make up.
    pub fn variance<T: Numbers>(&self, scale: Scale, amounts: &[T]) -> Vec<T> {
        if scale.smoothed {
            return self.levels[scale.level].noise.apply(amounts);
        }
        let own = |amount: &T| {
            let mut variance = T::ZERO;
            variance.add(self.own_noise, amount);
            variance
        };
        amounts.iter().map(own).collect()
    }

    /// Sums of amounts over the surroundings of each cluster.
    pub fn surroundings<T: Numbers>(&self, scale: Scale, amounts: Vec<T>) -> Vec<T> {
        let walk = |level: &Level, amounts: Vec<T>| {
            (0..self.field.window).fold(amounts, |amounts, _| level.spread.apply(&amounts))
        };
        let Some(coarser) = self.levels.get(scale.level + 1) else { return walk(&self.levels[scale.level], amounts) };
        let sums = walk(coarser, sums(&amounts, &coarser.parent, coarser.spread.len()));
        coarser.parent.iter().map(|parent| sums[*parent as usize]).collect()
    }

    /// Amounts spread over the surroundings of a scale of about four spacings, as amounts again: density times `measures`.
    pub fn blurred(&self, amounts: &[f64], measures: &[f64]) -> Vec<f64> {
        let scale = Scale { level: self.levels.len().saturating_sub(1).min(2), smoothed: true };
        let both: Vec<[f64; 2]> = amounts.iter().zip(measures).map(|(amount, room)| [*amount, *room]).collect();
        let both = self.smooth(scale, self.gather(scale, &both));
        let density = both.into_iter().map(|[given, room]| if room > 0.0 { given / room } else { 0.0 }).collect();
        self.interpolate(scale, density).iter().zip(measures).map(|(density, measure)| density * measure).collect()
    }

    /// Numbers per cluster as numbers per site, without steps from cluster to cluster.
    pub fn interpolate<T: Numbers>(&self, scale: Scale, values: Vec<T>) -> Vec<T> {
        (0..scale.level).rev().fold(values, |values, finer| self.levels[finer].finer.apply(&values))
    }
}

/// Sums of amounts over the members of each of `count` groups.
fn sums<T: Numbers>(amounts: &[T], group: &[u32], count: usize) -> Vec<T> {
    let mut sums = vec![T::ZERO; count];
    amounts.iter().zip(group).for_each(|(amounts, group)| sums[*group as usize].add(1.0, amounts));
    sums
}

impl Level {
    fn new(cluster: Vec<u32>, parent: Vec<u32>, points: &[DVec3], edges: &[Edge], shared: bool) -> Level {
        let count = cluster.iter().max().map_or(0, |last| *last as usize + 1);
        let mut joined: Vec<Vec<(u32, f64)>> = vec![Vec::new(); count];
        for (a, b, weight) in edges {
            joined[*a as usize].push((*b, *weight));
            joined[*b as usize].push((*a, *weight));
        }
        joined.iter_mut().for_each(|row| row.sort_by_key(|(other, _)| *other));
        let degrees: Vec<f64> = joined.iter().map(|row| row.iter().map(|(_, weight)| weight).sum()).collect();
        let spread = Rows::of(count, |k, row| {
            row.push((k as u32, if degrees[k] > 0.0 { 0.5 } else { 1.0 }));
            row.extend(joined[k].iter().map(|(giver, weight)| (*giver, 0.5 * weight / degrees[*giver as usize])));
        });
        drop(joined);
        let noise = Rows::of(count, |k, row| {
            let kernel = walked(&spread, k, STEPS);
            // Rays shared between neighbours correlate them: as if each had walked one more step on one side of the product.
            let other = if shared { walked(&spread, k, STEPS + 1) } else { kernel.clone() };
            let mut others = other.iter().peekable();
            for (site, a) in &kernel {
                while others.next_if(|(at, _)| at < site).is_some() {}
                if let Some((_, b)) = others.peek().filter(|(at, _)| at == site) {
                    row.push((*site, a * b));
                }
            }
        });
        let (mut middles, mut members) = (vec![DVec3::ZERO; count], vec![0.0; count]);
        for (cluster, point) in cluster.iter().zip(points) {
            middles[*cluster as usize] += *point;
            members[*cluster as usize] += 1.0;
        }
        middles.iter_mut().zip(members).for_each(|(middle, members)| *middle /= members);
        Level { cluster, parent, spread, finer: Rows::default(), middles, noise }
    }

    /// How numbers of this level's clusters become numbers at the children's `middles`: means over the clusters that a child's own one
    /// is joined to by two steps, weighted by a Gaussian of the distance, so that no border of a cluster shows.
    fn interpolation(&self, middles: &[DVec3], pitch: f64) -> Rows {
        Rows::of(middles.len(), |child, row| {
            let weight = |other: u32| {
                let distance = middles[child].distance(self.middles[other as usize]) / (BLUR * pitch);
                (-0.5 * distance * distance).exp()
            };
            let parent = self.parent[child];
            // The noise has an entry for each cluster within two steps.
            row.extend(self.noise.row(parent as usize).iter().map(|(other, _)| (*other, weight(*other))));
            let sum: f64 = row.iter().map(|(_, weight)| weight).sum();
            if sum > 0.0 {
                row.iter_mut().for_each(|(_, weight)| *weight /= sum);
            } else {
                *row = vec![(parent, 1.0)];
            }
        })
    }
}

/// Where an amount of the sites from which `steps` of the walk lead to site `k` ends up there: row `k` of that power of `spread`.
fn walked(spread: &Rows, k: usize, steps: usize) -> Vec<(u32, f64)> {
    let mut row: Vec<(u32, f64)> = vec![(k as u32, 1.0)];
    for _ in 0..steps {
        let first: Vec<(u32, f32)> = row.iter().map(|(site, weight)| (*site, *weight as f32)).collect();
        row.clear();
        spread.times(&first, &mut row);
    }
    row
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
