//! What an inspection collects in its one pass over the rays. Constant memory: sums, and a sample of at most 20 000 rays.

use super::far_field::Meridians;
use super::{focus, order};
use crate::formats::record::RawRay;
use crate::rays::check::{Checked, Flaw};
use crate::rays::survey::RayVisitor;
use glam::DVec3;

/// Rays expected in the sample of a large file, ...
const SAMPLE_RAYS: f64 = 18_000.0;
/// ... and most of them: 15 standard deviations more.
pub const SAMPLE_LIMIT: usize = 20_000;

/// A sampled ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampled {
    /// Start, mm.
    pub origin_mm: DVec3,
    /// Unit direction.
    pub direction: DVec3,
    /// Flux at scale 1: W, or lm where only lm are known.
    pub weight: f64,
}

/// Everything collected. The same bits for any number of threads, because chunks are merged in order.
#[derive(Clone, Debug, PartialEq)]
pub struct Evidence {
    /// What positions in `focus` and `order` are relative to, mm: the first ray's origin.
    pub pivot: DVec3,
    /// Sums for the virtual focus and the main direction.
    pub focus: focus::Sums,
    /// Sums for the order of rays.
    pub order: order::Sums,
    /// Intensity in the three planes of the axes.
    pub meridians: Meridians,
    /// Rays picked by their index alone; all of them in files of up to [`SAMPLE_LIMIT`] rays.
    pub sample: Vec<Sampled>,
    /// Smallest and largest flux of a ray at scale 1.
    pub weights: (f64, f64),
    /// Largest error of a direction's length, refused rays included.
    pub worst_length_error: f64,
    /// A ray is in the sample when the hash of its index is at most this.
    keep_up_to: u64,
}

impl Evidence {
    /// Nothing seen of a file of `ray_count` rays whose first starts at `pivot`.
    pub fn new(ray_count: u64, pivot: DVec3) -> Evidence {
        let share = if ray_count <= SAMPLE_LIMIT as u64 { 1.0 } else { SAMPLE_RAYS / ray_count as f64 };
        Evidence {
            pivot,
            focus: focus::Sums::default(),
            order: order::Sums::new(ray_count),
            meridians: Meridians::dark(),
            sample: Vec::new(),
            weights: (f64::INFINITY, 0.0),
            worst_length_error: 0.0,
            keep_up_to: (share * u64::MAX as f64) as u64,
        }
    }
}

impl RayVisitor for Evidence {
    fn visit(&mut self, index: u64, raw: &RawRay, checked: &Checked, weight: f64) {
        let origin_mm = DVec3::from_array(raw.origin_mm);
        let (relative, direction) = (origin_mm - self.pivot, checked.direction);
        self.focus.add(relative, direction, weight);
        self.order.add(index, relative, direction, weight, raw.wavelength_nm);
        self.meridians.add(direction, weight);
        if weight < self.weights.0 {
            self.weights.0 = weight;
        }
        if weight > self.weights.1 {
            self.weights.1 = weight;
        }
        if checked.length_error > self.worst_length_error {
            self.worst_length_error = checked.length_error;
        }
        if hash(index) <= self.keep_up_to && self.sample.len() < SAMPLE_LIMIT {
            self.sample.push(Sampled { origin_mm, direction, weight });
        }
    }

    fn visit_flawed(&mut self, raw: &RawRay, flaw: Flaw) {
        if flaw == Flaw::DirectionLength {
            let error = (DVec3::from_array(raw.direction).length() - 1.0).abs();
            self.worst_length_error = self.worst_length_error.max(error);
        }
    }

    fn merge(&mut self, later: Evidence) {
        self.focus.merge(&later.focus);
        self.order.merge(&later.order);
        self.meridians.merge(&later.meridians);
        self.weights = (self.weights.0.min(later.weights.0), self.weights.1.max(later.weights.1));
        self.worst_length_error = self.worst_length_error.max(later.worst_length_error);
        let room = SAMPLE_LIMIT.saturating_sub(self.sample.len());
        self.sample.extend(later.sample.into_iter().take(room));
    }
}

/// SplitMix64 (Steele, Lea, Flood 2014): a permutation of the indices that looks like chance.
pub fn hash(index: u64) -> u64 {
    let mut z = index.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_the_published_one() {
        // First outputs of SplitMix64 from state 0, as printed with the reference code by S. Vigna.
        assert_eq!([0, 1, 2].map(hash), [0xe220_a839_7b1d_cdaf, 0x6e78_9e6a_a1b9_65f4, 0x06c4_5d18_8009_454f]);
    }
}
