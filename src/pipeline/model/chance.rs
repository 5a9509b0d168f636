//! Random numbers that a seed and the number of a ray give, whatever other rays are drawn; and choices by weights, each in constant time.

use crate::inspection::sample::hash;
use std::hint::select_unpredictable;

/// The random numbers of one ray: those of SplitMix64 (Steele, Lea, Flood 2014) from a place in its sequence that is itself a hash of the
/// seed and the ray's number. Of 10⁹ rays, about one pair shares a stretch of numbers, used for different things.
pub struct Numbers {
    at: u64,
}

impl Numbers {
    /// Of ray number `ray` of the rays of `seed`.
    pub fn of(seed: u64, ray: u64) -> Numbers {
        Numbers { at: hash(hash(seed) ^ ray) }
    }

    /// 64 even bits.
    pub fn bits(&mut self) -> u64 {
        self.at = self.at.wrapping_add(1);
        hash(self.at)
    }

    /// Uniform in (0, 1): the middles of 2^52 cells.
    pub fn uniform(&mut self) -> f64 {
        const CELL: f64 = 1.0 / (1_u64 << 52) as f64;
        ((self.bits() >> 12) as f64 + 0.5) * CELL
    }
}

/// One place of a table of choices: itself, where the rest of the number is below `keep` (of 2^32), else another one.
#[derive(Clone, Copy, Debug)]
pub struct Choice {
    keep: u32,
    other: u32,
}

/// Appends the table of `weights` to `table`, as many places: Walker's alias method, made as Vose (1991) does. False, with a table of no
/// meaning, where no weight is positive. Weights are rounded to 2^-32 of their mean.
pub fn choices(weights: &[f64], table: &mut Vec<Choice>) -> bool {
    let first = table.len();
    table.extend((0..weights.len() as u32).map(|other| Choice { keep: u32::MAX, other }));
    let (total, count) = (weights.iter().sum::<f64>(), weights.len() as f64);
    let is_lit = total > 0.0 && total.is_finite();
    if !is_lit {
        return false;
    }
    let table = &mut table[first..];
    let mut parts: Vec<f64> = weights.iter().map(|weight| weight / total * count).collect();
    let heaviest = (0..parts.len()).fold(0, |best, at| if parts[at] > parts[best] { at } else { best });
    let (mut light, mut heavy): (Vec<usize>, Vec<usize>) = (0..parts.len()).partition(|at| parts[*at] < 1.0);
    while let (Some(small), Some(large)) = (light.last().copied(), heavy.last().copied()) {
        light.pop();
        table[small] = Choice { keep: (parts[small] * 2_f64.powi(32)) as u32, other: large as u32 };
        parts[large] -= 1.0 - parts[small];
        if parts[large] < 1.0 {
            heavy.pop();
            light.push(large);
        }
    }
    // What is left has the part 1 but for rounding, unless it has none at all.
    for left in light.into_iter().filter(|left| weights[*left] == 0.0) {
        table[left] = Choice { keep: 0, other: heaviest as u32 };
    }
    true
}

/// The place that 64 even bits pick, as often as its weight says.
pub fn pick(table: &[Choice], bits: u64) -> usize {
    let place = u128::from(bits) * table.len() as u128;
    let at = (place >> 64) as usize;
    let Choice { keep, other } = table[at];
    // No processor guesses which.
    select_unpredictable(((place >> 32) as u32) < keep, at, other as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every place is picked as often as its weight says, and one without weight never: found by going evenly through all numbers.
    #[test]
    fn places_are_picked_as_often_as_they_weigh() {
        let weights = [3.0, 0.0, 0.125, 7.0, 1.0, 0.0, 0.875];
        let mut table = vec![Choice { keep: 0, other: 0 }];
        assert!(choices(&weights, &mut table));
        let steps = 1_200_000_u64;
        let mut counted = [0_u64; 7];
        (0..steps).for_each(|step| counted[pick(&table[1..], step * (u64::MAX / steps))] += 1);
        for (count, weight) in counted.iter().zip(weights) {
            assert!((*count as f64 - weight / 12.0 * steps as f64).abs() <= 8.0, "{counted:?}");
        }
        assert!(!choices(&[0.0, 0.0], &mut Vec::new()) && !choices(&[], &mut Vec::new()));
    }

    /// The numbers of a ray are the same whatever was drawn before, and those of neighbours and of other seeds are others.
    #[test]
    fn numbers_belong_to_a_seed_and_a_ray() {
        let first = |seed, ray| Numbers::of(seed, ray).bits();
        assert_eq!(first(7, 5), first(7, 5));
        assert!(first(7, 5) != first(7, 6) && first(7, 5) != first(8, 5));
        let mean = (0..100_000).map(|ray| Numbers::of(1, ray).uniform()).sum::<f64>() / 1e5;
        // The mean of 10^5 even numbers has a standard deviation of 1/√(12·10^5): six of them.
        assert!((mean - 0.5).abs() < 6.0 * 0.000_913, "{mean}");
    }
}
