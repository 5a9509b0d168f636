//! Numbers that look like chance and follow from a seed.

use crate::inspection::sample::hash;

/// A sequence of random numbers, at random access.
#[derive(Clone, Copy, Debug)]
pub struct Chance(u64);

impl Chance {
    /// The sequence of this seed.
    pub fn new(seed: u64) -> Chance {
        Chance(hash(hash(seed)))
    }

    /// Another sequence for each `number`.
    pub fn part(self, number: u64) -> Chance {
        Chance(hash(self.0 ^ hash(number)))
    }

    /// Number `k` of the sequence, evenly from `0..end`; 0 where `end` is 0.
    pub fn below(self, end: u64, k: u64) -> u64 {
        let bits = hash(self.0 ^ hash(k));
        ((u128::from(bits) * u128::from(end)) >> 64) as u64
    }
}
