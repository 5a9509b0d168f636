//! Numbers that fill their space more evenly than chance: Sobol's sequence with the direction numbers of S. Joe and F. Y. Kuo (Constructing
//! Sobol sequences with better two-dimensional projections, SIAM J. Sci. Comput. 30, 2635, 2008; file new-joe-kuo-6.21201), scrambled as A. B.
//! Owen does, by a hash (B. Burley, Practical hash-based Owen scrambling, JCGT 9(4), 2020). Over seeds, each number alone is as even as chance has it, and
//! what ray i gets depends on the seed and on i alone. Points that follow each other lie far from each other, always in the same way; so the rays of
//! each 256 get theirs in random order.

use super::chance::Numbers;
use crate::inspection::sample::hash;
use std::ops::Range;

/// Numbers of each ray that are such: those of its first decisions.
pub const DIMENSIONS: usize = 10;

/// Degree and inner coefficients of each dimension's primitive polynomial, and its first direction numbers; the first dimension has none.
const PRIMITIVE: [(u32, u64, &[u64]); DIMENSIONS - 1] = [
    (1, 0, &[1]),
    (2, 1, &[1, 3]),
    (3, 1, &[1, 3, 1]),
    (3, 2, &[1, 1, 1]),
    (4, 1, &[1, 1, 3, 3]),
    (4, 4, &[1, 3, 5, 13]),
    (5, 2, &[1, 1, 5, 5, 17]),
    (5, 4, &[1, 1, 5, 5, 5]),
    (5, 7, &[1, 1, 7, 11, 19]),
];

/// Bits of the number of a point: for 10^12 of them.
const BITS: usize = 40;
/// Points in random order, and the bits of their numbers that differ.
const BLOCK: usize = 1 << LAST_BITS;
const LAST_BITS: u32 = 8;

/// The points of a seed.
#[derive(Clone, Debug)]
pub struct Sequence {
    seed: u64,
    /// What each bit of the number of a point adds.
    columns: [[u32; DIMENSIONS]; BITS],
    /// What the last bits add together.
    within_block: Vec<[u32; DIMENSIONS]>,
    scrambles: [u32; DIMENSIONS],
}

impl Sequence {
    /// The points of `seed`.
    pub fn new(seed: u64) -> Sequence {
        let mut columns = [[0; DIMENSIONS]; BITS];
        for dimension in 0..DIMENSIONS {
            let numbers = direction_numbers(dimension);
            columns.iter_mut().zip(numbers).for_each(|(column, number)| column[dimension] = number);
        }
        let within_block = (0..BLOCK as u64).map(|point| sum(&columns, point)).collect();
        let scrambles = std::array::from_fn(|dimension| hash(hash(seed ^ SALT) ^ dimension as u64) as u32);
        Sequence { seed, columns, within_block, scrambles }
    }

    /// Appends the numbers of these rays. What is not of the sequence is as it is by chance.
    pub fn numbers(&self, rays: Range<u64>, into: &mut Vec<Numbers>) {
        let mut from = rays.start;
        while from < rays.end {
            let block = from >> LAST_BITS;
            let to = rays.end.min((block + 1) << LAST_BITS);
            let first = sum(&self.columns, block << LAST_BITS);
            let order = self.order(block);
            into.extend((from..to).map(|ray| {
                let last = self.within_block[usize::from(order[ray as usize % BLOCK])];
                let of = |dimension: usize| scrambled(first[dimension] ^ last[dimension], self.scrambles[dimension]);
                Numbers::beginning_with(std::array::from_fn::<u32, DIMENSIONS, _>(of), self.seed, ray)
            }));
            from = to;
        }
    }

    /// The order of the points of a block: each of all possible ones by the same chance (Fisher and Yates).
    fn order(&self, block: u64) -> [u8; BLOCK] {
        let mut order = std::array::from_fn(|point| point as u8);
        let start = hash(hash(self.seed ^ ORDER_SALT) ^ block);
        for last in (1..BLOCK).rev() {
            let bits = hash(start.wrapping_add(last as u64)) >> 32;
            order.swap(last, ((bits * (last as u64 + 1)) >> 32) as usize);
        }
        order
    }
}

/// What makes the scrambles of a seed others than its random numbers.
const SALT: u64 = 0x736f_626f_6c00_0000;
/// The same for the order of its points.
const ORDER_SALT: u64 = 0x6f72_6465_7200_0000;

/// What the bits of the number of a point add together, without carry.
fn sum(columns: &[[u32; DIMENSIONS]; BITS], point: u64) -> [u32; DIMENSIONS] {
    let set = columns.iter().enumerate().filter(|(bit, _)| point >> bit & 1 == 1);
    set.fold([0; DIMENSIONS], |sum, (_, column)| std::array::from_fn(|dimension| sum[dimension] ^ column[dimension]))
}

/// The direction numbers of a dimension, as the first 32 binary places.
fn direction_numbers(dimension: usize) -> [u32; BITS] {
    let mut numbers = [1_u64; BITS];
    if let Some((degree, inner, first)) = dimension.checked_sub(1).map(|at| PRIMITIVE[at]) {
        for bit in 0..BITS {
            let back = |step: u32| numbers[bit - step as usize] << step;
            numbers[bit] = match first.get(bit) {
                Some(first) => *first,
                None => (1..degree)
                    .filter(|step| inner >> (degree - 1 - step) & 1 == 1)
                    .fold(back(degree) ^ numbers[bit - degree as usize], |sum, step| sum ^ back(step)),
            };
        }
    }
    // Number j of these is a whole number of 2^-j.
    std::array::from_fn(|bit| (numbers[bit] << (63 - bit) >> 32) as u32)
}

/// Permutes the binary places of a number, each by those before it: what begins alike goes on to begin alike. On the places turned round by the
/// hash of Laine and Karras, with Burley's constants.
fn scrambled(number: u32, scramble: u32) -> u32 {
    let mut places = number.reverse_bits().wrapping_add(scramble);
    for factor in [0x6c50_b47c_u32, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6] {
        places ^= places.wrapping_mul(factor);
    }
    places.reverse_bits()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::chance::Decision;

    /// Points 1, 2, 3, 5 and 1000 as scipy 1.17 (`stats.qmc.Sobol`, which has the same file) makes them, times 2^32.
    #[test]
    fn points_are_those_of_another_program() {
        let columns = Sequence::new(0).columns;
        let half = 1_u32 << 31;
        assert_eq!(sum(&columns, 1), [half; DIMENSIONS]);
        let quarters = |of: [u32; DIMENSIONS]| of.map(|quarters| quarters << 30);
        assert_eq!(sum(&columns, 2), quarters([1, 3, 3, 3, 1, 1, 3, 1, 1, 1]));
        assert_eq!(sum(&columns, 3), quarters([3, 1, 1, 1, 3, 3, 1, 3, 3, 3]));
        let eighths = [5, 1, 7, 5, 5, 7, 1, 1, 1, 3].map(|eighths: u32| eighths << 29);
        assert_eq!(sum(&columns, 5), eighths);
        let thousandth = [
            398_458_880,
            692_060_160,
            1_933_574_144,
            3_904_897_024,
            4_265_607_168,
            700_448_768,
            71_303_168,
            2_747_269_120,
            4_290_772_992,
            524_288_000,
        ];
        assert_eq!(sum(&columns, 1000), thousandth);
    }

    /// Each 2^k points (256 or more) from a multiple of that on lie one in each of 2^k equal parts of every axis, and of the square of the first two axes in each
    /// of 2^k equal rectangles of any shape; of whatever seed, far out as well. Another seed has other points.
    #[test]
    fn points_fill_every_part() {
        let points = |seed, from: u64| -> Vec<Numbers> {
            let mut numbers = Vec::new();
            Sequence::new(seed).numbers(from..from + 1024, &mut numbers);
            numbers
        };
        let is_filled = |part: &dyn Fn(&Numbers) -> u32, points: &[Numbers]| {
            let mut parts: Vec<u32> = points.iter().map(part).collect();
            parts.sort_unstable();
            parts.iter().zip(0..).all(|(part, number)| *part == number)
        };
        for (seed, from) in [(0, 0), (1, 1024), (7, 1024 * 977), (u64::MAX, 1 << 39)] {
            let points = points(seed, from);
            for decision in [Decision::Place, Decision::Node, Decision::Band, Decision::AgainInside] {
                assert!(is_filled(&|point| point.get(decision) >> 22, &points), "{seed} {from} {decision:?}");
            }
            for wide in 1..10 {
                let part = |point: &Numbers| {
                    let [x, y] = [Decision::Place, Decision::Node].map(|decision| point.get(decision));
                    x >> (32 - wide) << (10 - wide) | y >> (22 + wide)
                };
                assert!(is_filled(&part, &points), "{seed} {from} 2^{wide}");
            }
        }
        assert!(points(1, 0)[0].get(Decision::Place) != points(2, 0)[0].get(Decision::Place));
    }

    /// The rays of a block get its points in an order of their own: neighbours are as unlike as chance has it, within six standard deviations.
    #[test]
    fn neighbours_have_nothing_in_common() {
        let mut numbers = Vec::new();
        Sequence::new(3).numbers(0..40_000, &mut numbers);
        for decision in [Decision::Place, Decision::Node, Decision::Band] {
            let at: Vec<f64> = numbers.iter().map(|numbers| numbers.uniform(decision) - 0.5).collect();
            let correlation = at.windows(2).map(|pair| 12.0 * pair[0] * pair[1]).sum::<f64>() / 40_000_f64.sqrt();
            assert!(correlation.abs() < 6.0, "{decision:?}: {correlation}");
            let halves = at.windows(2).filter(|pair| (pair[0] < 0.0) == (pair[1] < 0.0)).count();
            assert!((halves as f64 - 20_000.0).abs() < 6.0 * 100.0, "{decision:?}: {halves}");
        }
        // In pieces, from the middle of a block on, they are the same.
        let mut pieces = Vec::new();
        [0..100, 100..300, 300..1000].into_iter().for_each(|rays| Sequence::new(3).numbers(rays, &mut pieces));
        let all =
            |numbers: &[Numbers]| numbers[..1000].iter().map(|numbers| numbers.get(Decision::Node)).collect::<Vec<_>>();
        assert_eq!(all(&pieces), all(&numbers));
    }

    /// Whatever begins a number, all that follows is as often 0 as 1 over seeds: within six standard deviations for each place.
    #[test]
    fn scrambles_have_no_bias() {
        for number in [0_u32, 0x8000_0000, 0x5555_5555, u32::MAX] {
            let mut ones = [0_i32; 32];
            for seed in 0..4096 {
                let found = scrambled(number, hash(seed) as u32);
                ones.iter_mut().enumerate().for_each(|(place, ones)| *ones += (found >> place & 1) as i32);
            }
            assert!(ones.iter().all(|ones| (ones - 2048).abs() < 6 * 32), "{number:x}: {ones:?}");
        }
    }
}
