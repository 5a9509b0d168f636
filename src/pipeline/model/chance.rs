//! The numbers of a ray, which a seed and the ray's number give whatever other rays are drawn; and choices by weights.

use crate::inspection::sample::hash;
use std::hint::select_unpredictable;

/// What a number of a ray decides. The first ones decide most, and are those of a sequence of low discrepancy where one is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// The triangle that it starts on, or the cell that it starts in.
    Place,
    /// The node of the goniogram round which it goes.
    Node,
    /// The zone of those of a corner.
    Zone,
    /// The corner whose zones it goes by.
    SecondCorner,
    /// The band of its wavelength.
    Band,
    /// Where between the nodes it goes: along γ, along C, and on which side of the node.
    AlongGamma,
    /// See there.
    AlongC,
    /// See there.
    Side,
    /// Where it starts in a triangle (three numbers in order) or in a cell (along x, y and z).
    Inside,
    /// See there.
    AgainInside,
    /// See there.
    OnceMoreInside,
    /// The corner whose light it is a part of.
    Corner,
    /// Whether a direction is kept.
    Kept,
    /// The wavelength within its band.
    WithinBand,
}

/// Numbers of a ray that are made at once.
const LANES: usize = 14;

/// 32 even bits for each decision of a ray: those of SplitMix64 (Steele, Lea, Flood 2014) from a place in its sequence that is itself a hash
/// of the seed and the ray's number. Of 10⁹ rays, about one pair shares a stretch of numbers, used for different things.
#[derive(Clone, Copy, Debug)]
pub struct Numbers {
    lanes: [u32; LANES],
    at: u64,
}

impl Numbers {
    /// Of ray number `ray` of the rays of `seed`.
    #[inline]
    pub fn of(seed: u64, ray: u64) -> Numbers {
        Numbers::beginning_with([], seed, ray)
    }

    /// The same, but for the first of them, which are those of `beginning`.
    #[inline]
    pub fn beginning_with<const N: usize>(beginning: [u32; N], seed: u64, ray: u64) -> Numbers {
        let at = hash(hash(seed) ^ ray);
        let bits: [u64; LANES / 2] = std::array::from_fn(|pair| hash(at.wrapping_add(1 + pair as u64)));
        let by_chance = |lane: usize| (bits[lane / 2] >> (32 * (lane % 2))) as u32;
        let lanes = std::array::from_fn(|lane| beginning.get(lane).copied().unwrap_or_else(|| by_chance(lane)));
        Numbers { lanes, at: at.wrapping_add(LANES as u64 / 2) }
    }

    /// The number for a decision.
    pub fn get(&self, decision: Decision) -> u32 {
        self.lanes[decision as usize]
    }

    /// The same, in (0, 1): the middles of 2^32 cells.
    pub fn uniform(&self, decision: Decision) -> f64 {
        uniform(self.get(decision))
    }

    /// Two numbers in (0, 1) for whoever has to decide again.
    pub fn again(&mut self) -> [f64; 2] {
        self.at = self.at.wrapping_add(1);
        let bits = hash(self.at);
        [uniform((bits >> 32) as u32), uniform(bits as u32)]
    }
}

fn uniform(number: u32) -> f64 {
    const CELL: f64 = 1.0 / (1_u64 << 32) as f64;
    (f64::from(number) + 0.5) * CELL
}

/// Choices by weight that stand in an order, to which larger numbers lead: the cumulated weights turned round. Where to begin to look stands
/// in a table (Chen and Asau 1974), so that one step more is enough most times. Weights are rounded to 2^-32 of their sum.
#[derive(Clone, Debug)]
pub struct Choices {
    /// The first number beyond each choice.
    ends: Vec<u32>,
    /// For each stretch of numbers that begin alike the first choice of its first number.
    guide: Vec<u32>,
    /// Bits of a number that differ within a stretch.
    shift: u32,
}

impl Choices {
    /// One for each of `weights`; `None` where none is positive.
    pub fn new(weights: &[f64]) -> Option<Choices> {
        let total: f64 = weights.iter().sum();
        let last = weights.iter().rposition(|weight| *weight > 0.0).filter(|_| total.is_finite())?;
        let mut sum = 0.0;
        let end = |weight: &f64| {
            sum += weight;
            (sum / total * 2_f64.powi(32)).round() as u32
        };
        let mut ends: Vec<u32> = weights.iter().map(end).collect();
        ends[last..].fill(u32::MAX);
        let bits = bits_of(ends.len()).min(31);
        let shift = 32 - bits;
        let mut at = 0;
        let first = |stretch: u32| {
            while ends[at] <= stretch << shift {
                at += 1;
            }
            at as u32
        };
        let guide = (0..1_u32 << bits).map(first).collect();
        Some(Choices { ends, guide, shift })
    }

    /// The choice that a number leads to.
    pub fn find(&self, number: u32) -> usize {
        // The last number has no end beyond it.
        let number = number.min(u32::MAX - 1);
        let mut at = self.guide[(number >> self.shift) as usize] as usize;
        // No processor guesses the first step.
        at += usize::from(self.ends[at] <= number);
        while self.ends[at] <= number {
            at += 1;
        }
        at
    }
}

/// One place of a table of choices: itself, where the rest of the number is below the upper bits of this one, else the place that the lower bits
/// name.
#[derive(Clone, Copy, Debug)]
pub struct Choice(u32);

/// Appends the table of `weights` to `table`, as many places: Walker's alias method, made as Vose (1991) does. False, with a table of no
/// meaning, where no weight is positive. Weights are rounded to 2^-31 of their sum.
pub fn choices(weights: &[f64], table: &mut Vec<Choice>) -> bool {
    let first = table.len();
    let bits = bits_of(weights.len());
    let most = u32::MAX >> bits;
    table.extend((0..weights.len() as u32).map(|itself| Choice(most << bits | itself)));
    let (total, count) = (weights.iter().sum::<f64>(), weights.len() as f64);
    let is_lit = total > 0.0 && total.is_finite();
    if !is_lit {
        return false;
    }
    let table = &mut table[first..];
    let keep = |part: f64| ((part * (f64::from(most) + 1.0)).round() as u32).min(most) << bits;
    let mut parts: Vec<f64> = weights.iter().map(|weight| weight / total * count).collect();
    let heaviest = (0..parts.len()).fold(0, |best, at| if parts[at] > parts[best] { at } else { best });
    let (mut light, mut heavy): (Vec<usize>, Vec<usize>) = (0..parts.len()).partition(|at| parts[*at] < 1.0);
    while let (Some(small), Some(large)) = (light.last().copied(), heavy.last().copied()) {
        light.pop();
        table[small] = Choice(keep(parts[small]) | large as u32);
        parts[large] -= 1.0 - parts[small];
        if parts[large] < 1.0 {
            heavy.pop();
            light.push(large);
        }
    }
    // What is left has the part 1 but for rounding, unless it has none at all.
    for left in light.into_iter().filter(|left| weights[*left] == 0.0) {
        table[left] = Choice(heaviest as u32);
    }
    true
}

/// The place that a number picks, as often as its weight says: in one step, in no order. For tables that are short, as bands are.
pub fn pick(table: &[Choice], number: u32) -> usize {
    let bits = bits_of(table.len());
    let place = u64::from(number) * table.len() as u64;
    let at = (place >> 32) as usize;
    let Choice(choice) = table[at];
    let other = choice & !(u32::MAX << bits);
    // No processor guesses which.
    select_unpredictable((place as u32) >> bits < choice >> bits, at, other as usize)
}

/// Bits of the numbers of so many places; at least one.
fn bits_of(places: usize) -> u32 {
    usize::BITS - (places.saturating_sub(1) | 1).leading_zeros()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WEIGHTS: [f64; 8] = [0.0, 3.0, 0.0, 0.125, 7.0, 1.0, 0.875, 0.0];

    /// How often each place is picked when numbers go evenly through all of them.
    fn counted(pick: impl Fn(u32) -> usize) -> [u64; 8] {
        let steps = 1_200_000_u32;
        let mut counted = [0; 8];
        (0..steps).for_each(|step| counted[pick(step * (u32::MAX / steps))] += 1);
        (0..1000).for_each(|back| assert!(WEIGHTS[pick(u32::MAX - back)] > 0.0));
        counted
    }

    /// Every place is picked as often as its weight says, and one without weight never.
    #[test]
    fn places_are_picked_as_often_as_they_weigh() {
        let mut table = vec![Choice(0)];
        assert!(choices(&WEIGHTS, &mut table));
        let ordered = Choices::new(&WEIGHTS).unwrap();
        for counted in [counted(|number| pick(&table[1..], number)), counted(|number| ordered.find(number))] {
            for (count, weight) in counted.iter().zip(WEIGHTS) {
                // A step is 2^-20 of all numbers, but for what 2^32 leaves over: 3e-4 of them.
                let expected = weight / 12.0 * 1.2e6;
                let allowed = if weight > 0.0 { 8.0 + 3e-4 * 1.2e6 } else { 0.0 };
                assert!((*count as f64 - expected).abs() <= allowed, "{counted:?}");
            }
        }
        assert!(!choices(&[0.0, 0.0], &mut Vec::new()) && !choices(&[], &mut Vec::new()));
        assert!(Choices::new(&[0.0, 0.0]).is_none() && Choices::new(&[]).is_none());
    }

    /// Larger numbers lead to later choices, in a long table of weights of all sizes as well, and each to the one whose part it lies in.
    #[test]
    fn choices_in_order_are_the_sums_turned_round() {
        let weights: Vec<f64> =
            (0..5000).map(|k| (hash(k) % 1000) as f64 * f64::powi(2.0, (hash(k) % 20) as i32)).collect();
        let ordered = Choices::new(&weights).unwrap();
        let total: f64 = weights.iter().sum();
        let (mut before, mut sum) = (0, weights[0]);
        for step in 0..1_000_000_u32 {
            let number = step * 4294;
            let found = ordered.find(number);
            while before < found {
                before += 1;
                sum += weights[before];
            }
            assert_eq!(before, found);
            let at = f64::from(number) / 2_f64.powi(32) * total;
            let rounding = total * 2_f64.powi(-31);
            assert!(at < sum + rounding && at > sum - weights[found] - rounding, "{number}: {found}");
        }
        assert_eq!([0, 7, u32::MAX].map(|number| Choices::new(&[2.0]).unwrap().find(number)), [0; 3]);
    }

    /// The numbers of a ray are the same whatever was drawn before, and those of neighbours and of other seeds are others.
    #[test]
    fn numbers_belong_to_a_seed_and_a_ray() {
        let first = |seed, ray| Numbers::of(seed, ray).lanes;
        assert_eq!(first(7, 5), first(7, 5));
        assert!(first(7, 5) != first(7, 6) && first(7, 5) != first(8, 5));
        let mean = |decision| (0..100_000).map(|ray| Numbers::of(1, ray).uniform(decision)).sum::<f64>() / 1e5;
        for decision in [Decision::Place, Decision::Node, Decision::WithinBand] {
            // The mean of 10^5 even numbers has a standard deviation of 1/√(12·10^5): six of them.
            assert!((mean(decision) - 0.5).abs() < 6.0 * 0.000_913, "{decision:?}");
        }
        let mut numbers = Numbers::of(1, 1);
        assert!(numbers.again() != numbers.again());
    }
}
