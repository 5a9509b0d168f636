//! Irradiance E = ∫ M q cos⁺θ′ / r² dA, or ∫ j q cos⁺θ′ / r² dV, by adaptive quadrature: the part whose error may be largest is looked at more
//! closely until what all errors sum to is small enough.
//!
//! A part seen from the point is one point at the middle of its flux. Its error is at most what it could send at all: its flux, times the most of
//! its goniograms in the directions to the point, times the cosine, by the least squared distance. Where it is small against its distance, lies on
//! one side of the plane, and its goniograms either change little in these directions or have few nodes there, its error follows from what
//! changes when it is evaluated in parts.

use super::ceiling::Ceilings;
use super::clusters::{Clusters, Node};
use super::emission::Emission;
use super::lump::{Lump, Piece};
use crate::error::Error;
use crate::vocabulary::space::Bounds;
use glam::DVec3;
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::{PI, TAU};

/// A part is small where its radius is at most this part of its distance.
const SMALL: f64 = 0.25;
/// The error of a small part is taken to be so many times what changed when it was evaluated in parts. To second order it is a third of that; where
/// second derivatives along and across cancel, what is left is of higher order, and the change does not show it.
const SAFETY: f64 = 6.0;
/// A part is resolved where the directions to it touch at most so many steps of γ, and reach so many steps of C to either side.
const STEPS: usize = 4;
const PLANES: f64 = 1.5;
/// What a part sends is even where the least of its goniograms is at least this part of the most.
const EVEN: f64 = 0.5;
/// Least edge of a part of a triangle or cell. What is smaller and still as near as it is wide is bounded by the solid angle it can have.
const LEAST_EDGE: f64 = 1.0 / (1 << 26) as f64;
/// Errors may be this part of what an even source of the same flux would send there, however dark the place is.
const DARK: f64 = 1e-3;
/// Looks at parts after which sums are formed anew, so that rounding does not pile up.
const ANEW: usize = 512;

/// What sends light.
pub struct Quadrature<'e, 'a> {
    emission: &'e Emission<'a>,
    clusters: Clusters,
    ceilings: Ceilings,
    /// Least of the steps of C, radians.
    c_step: f64,
}

/// A plane's point.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// Where, mm.
    pub point_mm: DVec3,
    /// Unit normal, towards the side that is lit.
    pub normal: DVec3,
}

/// How closely is looked.
#[derive(Clone, Copy, Debug)]
pub struct Care {
    /// Error against the result.
    pub tolerance: f64,
    /// Most parts that are looked at more closely.
    pub most_splits: usize,
}

/// What one thread needs.
#[derive(Default)]
pub struct Scratch {
    lump: Lump,
    waiting: BinaryHeap<Waiting>,
    /// Values and errors of waiting parts, `[slot][channel]`.
    values: Vec<f64>,
    errors: Vec<f64>,
    free: Vec<usize>,
    parts: Vec<Node>,
    value: Vec<f64>,
    most: Vec<f64>,
    coarse: Vec<f64>,
    /// Points evaluated.
    pub evaluations: u64,
}

/// A part that can be looked at more closely.
struct Waiting {
    error: f64,
    number: u64,
    node: Node,
    slot: usize,
}

impl Ord for Waiting {
    fn cmp(&self, other: &Waiting) -> Ordering {
        self.error.total_cmp(&other.error).then(other.number.cmp(&self.number))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Waiting) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Waiting) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Waiting {}

/// How a part is judged.
enum Judged {
    /// It lies behind the plane, or sends nothing here.
    Dark,
    /// Its error is at most what it could send.
    Bounded,
    /// It is small: its parts tell its error.
    Small,
}

impl<'e, 'a> Quadrature<'e, 'a> {
    /// Of a model.
    pub fn new(emission: &'e Emission<'a>) -> Quadrature<'e, 'a> {
        let light = emission.light();
        let planes = light.grid.c_planes().max(light.spectral_grid.c_planes());
        let c_step = if planes > 1 { TAU / planes as f64 } else { TAU };
        Quadrature { emission, clusters: Clusters::new(emission), ceilings: Ceilings::new(emission), c_step }
    }

    /// Irradiance at a point and the bound of its error, flux/mm², one number a channel each. `pause` is asked now and then whether to go on.
    ///
    /// # Errors
    /// That of `pause`.
    pub fn irradiance(
        &self,
        at: Receiver,
        care: Care,
        scratch: &mut Scratch,
        (into, bound): (&mut [f64], &mut [f64]),
        pause: impl Fn() -> Result<(), Error>,
    ) -> Result<(), Error> {
        let channels = self.emission.channels();
        scratch.clear(channels);
        self.look(self.clusters.root(), at, 0, scratch);
        let floor = self.floor(at);
        let mut number = 1;
        let (mut value, mut error) = scratch.sums(self.emission);
        for split in 1..=care.most_splits {
            let enough = care.tolerance * (value + floor);
            // Sums of what was added and taken away again drift where large errors were among them.
            if error <= enough || split % ANEW == 0 {
                pause()?;
                (value, error) = scratch.sums(self.emission);
                if error <= enough {
                    break;
                }
            }
            let Some(Waiting { node, slot, error: own, .. }) = scratch.waiting.pop() else { break };
            value -= scratch.weighed(self.emission, slot);
            error -= own;
            scratch.free.push(slot);
            let mut parts = std::mem::take(&mut scratch.parts);
            parts.clear();
            self.clusters.split(node, |part| parts.push(part));
            for part in &parts {
                number += 1;
                if let Some((more, wrong)) = self.look(*part, at, number, scratch) {
                    value += more;
                    error += wrong;
                }
            }
            scratch.parts = parts;
            if error.is_nan() || error.is_infinite() {
                (value, error) = scratch.sums(self.emission);
            }
        }
        into.fill(0.0);
        bound.fill(0.0);
        scratch.waiting.drain().for_each(|waiting| {
            let from = waiting.slot * channels;
            into.iter_mut().zip(&scratch.values[from..]).for_each(|(sum, value)| *sum += value);
            bound.iter_mut().zip(&scratch.errors[from..]).for_each(|(sum, error)| *sum += error);
        });
        Ok(())
    }

    /// Irradiance that an even source of the same flux would have there, times [`DARK`].
    fn floor(&self, at: Receiver) -> f64 {
        let Node::Cluster(root) = self.clusters.root() else { return 0.0 };
        let whole = self.clusters.cluster(root);
        let (_, flux) = self.clusters.light_of(root);
        let flux: f64 = flux.chunks_exact(self.emission.channels()).map(|flux| self.emission.weighed(flux)).sum();
        let square_mm2 = whole.center_mm.distance_squared(at.point_mm) + whole.radius_mm.powi(2);
        DARK * flux / (4.0 * PI * square_mm2.max(f64::MIN_POSITIVE))
    }

    /// Puts a part among those that wait; its value and its error as one number. Nothing where it sends nothing.
    fn look(&self, node: Node, at: Receiver, number: u64, scratch: &mut Scratch) -> Option<(f64, f64)> {
        let judged = self.evaluate(node, at, scratch, true);
        if matches!(judged, Judged::Dark) {
            return None;
        }
        let slot = scratch.slot();
        let channels = self.emission.channels();
        let range = slot * channels..(slot + 1) * channels;
        if matches!(judged, Judged::Small) {
            std::mem::swap(&mut scratch.value, &mut scratch.coarse);
            scratch.values[range.clone()].fill(0.0);
            scratch.errors[range.clone()].copy_from_slice(&scratch.most);
            self.clusters.split(node, |part| {
                self.evaluate(part, at, scratch, false);
                scratch.values[range.clone()].iter_mut().zip(&scratch.value).for_each(|(sum, value)| *sum += value);
            });
            let changes = scratch.values[range.clone()]
                .iter()
                .zip(&scratch.coarse)
                .map(|(fine, coarse)| SAFETY * (fine - coarse).abs());
            scratch.errors[range.clone()].iter_mut().zip(changes).for_each(|(most, change)| *most = most.min(change));
        } else {
            scratch.values[range.clone()].copy_from_slice(&scratch.value);
            scratch.errors[range.clone()].copy_from_slice(&scratch.most);
        }
        let value = self.emission.weighed(&scratch.values[range.clone()]);
        let error = self.emission.weighed(&scratch.errors[range]);
        scratch.waiting.push(Waiting { error, number, node, slot });
        Some((value, error))
    }

    /// One point's worth of a part into `scratch.value`, and the most it could be into `scratch.most`, where that is `judged`.
    fn evaluate(&self, node: Node, at: Receiver, scratch: &mut Scratch, judged: bool) -> Judged {
        scratch.value.fill(0.0);
        scratch.most.fill(0.0);
        let Scratch { lump, value, most, evaluations, .. } = scratch;
        let (center_mm, radius_mm, bounds_mm, zones, flux) = match node {
            Node::Cluster(cluster) => {
                let own = self.clusters.cluster(cluster);
                let (zones, flux) = self.clusters.light_of(cluster);
                (own.center_mm, own.radius_mm, own.bounds_mm, zones, flux)
            }
            Node::Piece(piece) => {
                piece.fill(self.emission, lump);
                let bounds_mm = lump.bounds_mm.unwrap_or(Bounds::EMPTY);
                (lump.center_mm, lump.radius_mm, bounds_mm, lump.zones.as_slice(), lump.flux.as_slice())
            }
        };
        let heights_mm = heights_mm(bounds_mm, at);
        let beside_mm = at.point_mm.clamp(bounds_mm.min, bounds_mm.max).distance(at.point_mm);
        // A point of the surface itself has another irradiance just above it: that is no darkness.
        if heights_mm[1] < 0.0 || (heights_mm[1] <= 0.0 && beside_mm > 0.0) {
            return Judged::Dark;
        }
        *evaluations += 1;
        let to_point = at.point_mm - center_mm;
        let (height_mm, distance_mm) = (-to_point.dot(at.normal), to_point.length());
        let toward = (distance_mm > 0.0).then(|| self.emission.toward(to_point / distance_mm));
        let channels = self.emission.channels();
        if let Some(toward) = toward.as_ref().filter(|_| height_mm > 0.0) {
            let factor = height_mm / distance_mm.powi(3);
            for (zone, flux) in zones.iter().zip(flux.chunks_exact(channels)) {
                self.emission.add(*zone as usize, toward, flux, factor, value);
            }
        }
        if !judged {
            return Judged::Bounded;
        }
        let reach = if radius_mm < distance_mm { (radius_mm / distance_mm).asin() } else { PI };
        let gamma = toward.as_ref().map_or(0.0, |toward| toward.angles.1);
        let range = self.ceilings.range(self.emission, gamma, reach);
        let nearest_mm = beside_mm.max(distance_mm - radius_mm);
        let is_apart = radius_mm < distance_mm && nearest_mm > 0.0;
        let factor = match is_apart {
            true => (heights_mm[1] / nearest_mm).min(1.0) / (nearest_mm * nearest_mm),
            false => self.nearness(node, lump),
        };
        let mut changes = [0.0; 2];
        for (zone, flux) in zones.iter().zip(flux.chunks_exact(channels)) {
            let extremes = self.ceilings.extremes(*zone as usize, range);
            let all = self.emission.weighed(flux);
            changes.iter_mut().zip(extremes).for_each(|(sum, own)| *sum += own * all);
            let ceiling = factor * extremes[0];
            // No light of a channel is none, however near.
            let part = |flux: &f64| if *flux > 0.0 && ceiling > 0.0 { flux * ceiling } else { 0.0 };
            most.iter_mut().zip(flux).for_each(|(sum, flux)| *sum += part(flux));
        }
        if most.iter().all(|most| *most <= 0.0) {
            return Judged::Dark;
        }
        // Near the poles all C planes meet, and what lies between them changes little.
        let is_polar = gamma.min(PI - gamma) <= 2.0 * reach;
        let is_resolved = range.steps() <= STEPS && (is_polar || reach <= PLANES * self.c_step * gamma.sin());
        let is_even = changes[1] >= EVEN * changes[0];
        let is_apart = radius_mm <= SMALL * distance_mm && heights_mm[0] >= 0.0;
        let is_small = is_apart && (is_even || is_resolved) && !self.clusters.is_of_pieces(node);
        if is_small { Judged::Small } else { Judged::Bounded }
    }

    /// Bound of cos⁺/r² over a part that is as near as it is wide, as a mean over its extent, 1/mm²: of a volume that of 1/r² over the ball that
    /// holds it, of a surface twice the 2π sr that it can have. Of a surface that can be cut further there is no bound yet.
    fn nearness(&self, node: Node, lump: &Lump) -> f64 {
        match node {
            Node::Piece(_) if lump.extent <= 0.0 => 0.0,
            Node::Piece(Piece::Cell(..)) => 8.0 * PI * lump.radius_mm / lump.extent,
            Node::Piece(piece) if piece.edge() <= LEAST_EDGE => 2.0 * TAU / lump.extent,
            _ => f64::INFINITY,
        }
    }
}

/// The least and the most that the points of a box can be above the plane, mm.
fn heights_mm(bounds_mm: Bounds, at: Receiver) -> [f64; 2] {
    let middle_mm = (bounds_mm.center() - at.point_mm).dot(at.normal);
    let half_mm = 0.5 * bounds_mm.size().dot(at.normal.abs());
    [middle_mm - half_mm, middle_mm + half_mm]
}

impl Scratch {
    fn clear(&mut self, channels: usize) {
        self.waiting.clear();
        self.values.clear();
        self.errors.clear();
        self.free.clear();
        for numbers in [&mut self.value, &mut self.most, &mut self.coarse] {
            numbers.clear();
            numbers.resize(channels, 0.0);
        }
    }

    fn slot(&mut self) -> usize {
        self.free.pop().unwrap_or_else(|| {
            let channels = self.value.len();
            let slot = self.values.len() / channels.max(1);
            self.values.resize(self.values.len() + channels, 0.0);
            self.errors.resize(self.errors.len() + channels, 0.0);
            slot
        })
    }

    fn weighed(&self, emission: &Emission<'_>, slot: usize) -> f64 {
        let channels = emission.channels();
        emission.weighed(&self.values[slot * channels..][..channels])
    }

    /// Value and error of all parts.
    fn sums(&self, emission: &Emission<'_>) -> (f64, f64) {
        self.waiting.iter().fold((0.0, 0.0), |(value, error), waiting| {
            (value + self.weighed(emission, waiting.slot), error + waiting.error)
        })
    }
}
