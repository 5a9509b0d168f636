//! Whether rays stand in the file in random order. Programs that take only the first rays of a sorted file see another source
//!; this one takes all of them.
//!
//! Two statistics for each of nine quantities, both standard normal for a shuffled file:
//! the serial correlation of neighbours, r √m over m pairs (A. Wald and J. Wolfowitz 1943: mean −1/(n − 1), variance 1/m), and
//! the mean of the first tenth against all, (x̄ₕ − x̄) / (σ √(1/h − 1/n)) (sampling without replacement).

use glam::DVec3;
use schemars::JsonSchema;
use serde::Serialize;

/// |z| above which order is not chance: two-sided normal tail 5.7e-7.
pub const ALARM_Z: f64 = 5.0;
/// Chance that a shuffled file is called sorted: 9 one-sided and 9 two-sided statistics at [`ALARM_Z`].
pub const FALSE_ALARMS: f64 = 8e-6;
/// Correlation of neighbours that does no harm, however sure it is.
const HARMLESS_CORRELATION: f64 = 0.05;
/// Shift of the first tenth, in standard deviations of single rays, that does no harm.
const HARMLESS_SHIFT: f64 = 0.05;
/// In files of more rays than this, an eighth of them is compared, ...
const ALL_BELOW: u64 = 1 << 16;
/// ... in stretches of 128 neighbours, one in every 1024 rays.
const STRETCH: u64 = 128;
const PERIOD: u64 = 1024;
/// Below this, σ² over squared size is rounding of values and of their sums: the quantity is the same for all rays.
const ROUNDING: f64 = 1e-9;

const QUANTITIES: usize = 9;
/// What is compared. Distance: squared, from the first ray's origin, so that sorting by radius is seen too.
const NAMES: [&str; QUANTITIES] = ["x", "y", "z", "l", "m", "n", "flux", "distance", "wavelength"];

/// Whether rays stand in random order.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Order {
    /// Rays that were compared.
    pub rays_compared: u64,
    /// The quantity whose neighbours are most alike: serial correlation.
    pub neighbors: Option<Statistic>,
    /// The quantity in which the first tenth differs most: shift of its mean in standard deviations of single rays.
    pub first_tenth: Option<Statistic>,
    /// |z| above which a statistic raises the alarm, if it is large enough to do harm.
    pub alarm_z: f64,
    /// Chance that a shuffled file raises the alarm.
    pub false_alarm_rate: f64,
    /// The alarm was raised: rays are sorted.
    pub sorted: bool,
}

/// One statistic.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Statistic {
    /// Of which quantity: x, y, z (origin), l, m, n (direction), flux, distance (from the first ray), wavelength.
    #[schemars(extend("enum" = NAMES))]
    pub quantity: &'static str,
    /// Its value.
    pub value: f64,
    /// Its value as a standard normal deviate under random order.
    pub z: f64,
}

/// Sums over stretches of rays.
#[derive(Clone, Debug, PartialEq)]
pub struct Sums {
    /// Rays of the file: which of them are compared and which are the first tenth.
    ray_count: u64,
    rays: u64,
    pairs: u64,
    head_rays: u64,
    sum: [f64; QUANTITIES],
    square: [f64; QUANTITIES],
    product: [f64; QUANTITIES],
    /// Σ over pairs of both members.
    both: [f64; QUANTITIES],
    head: [f64; QUANTITIES],
    last: Option<(u64, [f64; QUANTITIES])>,
}

impl Sums {
    /// Nothing seen of a file of `ray_count` rays.
    pub fn new(ray_count: u64) -> Sums {
        let none = [0.0; QUANTITIES];
        let (sum, square, product, both, head) = (none, none, none, none, none);
        Sums { ray_count, rays: 0, pairs: 0, head_rays: 0, sum, square, product, both, head, last: None }
    }

    /// Ray `index` of the file. Neighbours are rays whose indices follow each other, within one chunk.
    pub fn add(&mut self, index: u64, origin: DVec3, direction: DVec3, flux: f64, wavelength_nm: f64) {
        if self.ray_count > ALL_BELOW && index % PERIOD >= STRETCH {
            return;
        }
        let (o, d) = (origin, direction);
        let values = [o.x, o.y, o.z, d.x, d.y, d.z, flux, o.length_squared(), wavelength_nm];
        self.rays += 1;
        self.sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        self.square.iter_mut().zip(values).for_each(|(sum, value)| *sum += value * value);
        if index < self.ray_count / 10 {
            self.head_rays += 1;
            (0..QUANTITIES).for_each(|k| self.head[k] += values[k]);
        }
        if let Some((_, before)) = self.last.filter(|(before, _)| before + 1 == index) {
            self.pairs += 1;
            for k in 0..QUANTITIES {
                self.product[k] += before[k] * values[k];
                self.both[k] += before[k] + values[k];
            }
        }
        self.last = Some((index, values));
    }

    /// Adds the sums of later rays.
    pub fn merge(&mut self, later: &Sums) {
        self.rays += later.rays;
        self.pairs += later.pairs;
        self.head_rays += later.head_rays;
        for k in 0..QUANTITIES {
            self.sum[k] += later.sum[k];
            self.square[k] += later.square[k];
            self.product[k] += later.product[k];
            self.both[k] += later.both[k];
            self.head[k] += later.head[k];
        }
    }

    /// Serial correlation and shift of the first tenth of quantity `k`, each with its z; `None` where all rays are the same.
    fn statistics(&self, k: usize) -> Option<[Statistic; 2]> {
        let (n, pairs, head) = (self.rays as f64, self.pairs as f64, self.head_rays as f64);
        let mean = self.sum[k] / n;
        let variance = self.square[k] / n - mean * mean;
        let size = self.square[k] / n;
        if !(variance.is_finite() && variance > ROUNDING * size) || pairs < 1.0 || head < 1.0 {
            return None;
        }
        let covariance = (self.product[k] - mean * self.both[k]) / pairs + mean * mean;
        let correlation = covariance / variance;
        let shift = (self.head[k] / head - mean) / variance.sqrt();
        let statistic = |value: f64, z: f64| Statistic { quantity: NAMES[k], value, z };
        Some([
            statistic(correlation, (correlation + 1.0 / (n - 1.0)) * pairs.sqrt()),
            statistic(shift, shift / (1.0 / head - 1.0 / n).max(f64::MIN_POSITIVE).sqrt()),
        ])
    }

    /// What the sums say.
    pub fn judge(&self) -> Order {
        let all: Vec<[Statistic; 2]> = (0..QUANTITIES).filter_map(|k| self.statistics(k)).collect();
        // Neighbours that differ more than chance has it are interleaved (as split rays are), which biases no part of a file.
        let alike = |statistic: &Statistic| statistic.z;
        let shifted = |statistic: &Statistic| statistic.z.abs();
        let alarm = all.iter().any(|[near, head]| {
            alike(near) > ALARM_Z && near.value > HARMLESS_CORRELATION
                || shifted(head) > ALARM_Z && head.value.abs() > HARMLESS_SHIFT
        });
        Order {
            rays_compared: self.rays,
            neighbors: all.iter().map(|pair| &pair[0]).max_by(|a, b| alike(a).total_cmp(&alike(b))).cloned(),
            first_tenth: all.iter().map(|pair| &pair[1]).max_by(|a, b| shifted(a).total_cmp(&shifted(b))).cloned(),
            alarm_z: ALARM_Z,
            false_alarm_rate: FALSE_ALARMS,
            sorted: alarm,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspection::sample::hash;
    use std::f64::consts::TAU;

    /// One ray: origin, direction, flux, wavelength.
    type Drawn = (DVec3, DVec3, f64, f64);

    /// Ray `k` of a stream: a Lambertian disc of radius 1 whose rays carry exponentially spread flux and a wavelength.
    fn ray(seed: u64, k: u64) -> Drawn {
        let uniform = |n: u64| ((hash((seed << 40) + 8 * k + n) >> 11) as f64 + 0.5) / (1_u64 << 53) as f64;
        let (r, c, sine, turn) = (uniform(0).sqrt(), TAU * uniform(1), uniform(2).sqrt(), TAU * uniform(3));
        let direction = DVec3::new(sine * turn.cos(), sine * turn.sin(), (1.0 - sine * sine).sqrt());
        (DVec3::new(r * c.cos(), r * c.sin(), 0.0), direction, -uniform(4).ln(), 400.0 + 300.0 * uniform(5))
    }

    fn sums(rays: &[Drawn]) -> Sums {
        let mut sums = Sums::new(rays.len() as u64);
        for (index, (origin, direction, flux, nm)) in rays.iter().enumerate() {
            sums.add(index as u64, *origin - rays[0].0, *direction, *flux, *nm);
        }
        sums
    }

    fn shuffled(seed: u64, count: u64) -> Vec<Drawn> {
        (0..count).map(|k| ray(seed, k)).collect()
    }

    /// The statistics of shuffled files are standard normal: of 300 files x 16 (z does not vary) 13 are expected beyond 3;
    /// Poisson exceeds 40 with probability 1e-9. Their mean square is 1 within 10 standard errors, twice the usual 5
    /// because the statistics of one file are not quite independent. And none is called sorted.
    #[test]
    fn shuffled_files_raise_false_alarms_at_the_stated_rate_only() {
        let (mut beyond, mut square, mut count) = (0, 0.0, 0.0);
        for seed in 1..=300 {
            let sums = sums(&shuffled(seed, 2_000));
            for statistic in (0..QUANTITIES).filter_map(|k| sums.statistics(k)).flatten() {
                beyond += i32::from(statistic.z.abs() > 3.0);
                square += statistic.z * statistic.z;
                count += 1.0;
            }
            assert!(!sums.judge().sorted, "{seed}: {:?}", sums.judge());
        }
        assert_eq!(count, 4800.0);
        assert!((1..40).contains(&beyond), "{beyond}");
        assert!((square / count - 1.0_f64).abs() < 10.0 * (2.0_f64 / 4800.0).sqrt(), "{}", square / count);
    }

    #[test]
    fn a_file_sorted_by_anything_is_caught_in_small_and_large_files() {
        type Key = fn(&Drawn) -> f64;
        let keys: [(&str, Key); 6] = [
            ("x", |ray| ray.0.x),
            ("radius", |ray| ray.0.length()),
            ("falling radius", |ray| -ray.0.length()),
            ("polar angle", |ray| -ray.1.z),
            ("flux", |ray| ray.2),
            ("wavelength", |ray| ray.3),
        ];
        // Sorted from the rim inwards only the distance tells, by half a σ: that takes a few thousand rays to be sure.
        for count in [5000, 70_000] {
            for (name, key) in keys {
                let mut rays = shuffled(7, count);
                rays.sort_by(|a, b| key(a).total_cmp(&key(b)));
                assert!(sums(&rays).judge().sorted, "{count} rays by {name}: {:?}", sums(&rays).judge());
            }
            // Blocks of 100, each sorted: the first tenth is as good as any, only neighbours tell.
            let mut rays = shuffled(8, count);
            rays.chunks_mut(100).for_each(|block| block.sort_by(|a, b| a.0.x.total_cmp(&b.0.x)));
            assert!(sums(&rays).judge().sorted, "{count} rays in blocks");
        }
    }

    #[test]
    fn quantities_that_do_not_vary_say_nothing() {
        // Sums of 60 000 equal numbers that are no binary fractions are off by more than one rounding.
        let one = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.6, 0.0, 0.8), 1.0 / 60_000.0, 550.1);
        let order = sums(&vec![one; 60_000]).judge();
        assert_eq!((order.neighbors, order.first_tenth, order.sorted), (None, None, false));
        assert!(!Sums::new(0).judge().sorted);
    }
}
