//! Whether rays stand in the file in random order. Programs that take only the first rays of a sorted file see another source
//! (`USERS.md` 7); this one takes all of them.
//!
//! Two statistics for each of nine quantities, both standard normal for a shuffled file:
//! the serial correlation of neighbours, r √m over m pairs (A. Wald and J. Wolfowitz 1943: mean −1/(n − 1), variance 1/m), and
//! the mean of the first tenth against all, (x̄ₕ − x̄) / (σ √(1/h − 1/n)) (sampling without replacement).

use glam::DVec3;
use serde::Serialize;

/// |z| above which order is not chance: two-sided normal tail 5.7e-7.
pub const ALARM_Z: f64 = 5.0;
/// Chance that a shuffled file is called sorted: 18 statistics at [`ALARM_Z`].
pub const FALSE_ALARMS: f64 = 1.1e-5;
/// Correlation of neighbours that does no harm, however sure it is.
const HARMLESS_CORRELATION: f64 = 0.05;
/// Shift of the first tenth, in standard deviations of single rays, that does no harm.
const HARMLESS_SHIFT: f64 = 0.05;
/// In files of more rays than this, a quarter of them is compared, ...
const ALL_BELOW: u64 = 1 << 16;
/// ... in stretches of 256 neighbours, one in every 1024 rays.
const STRETCH: u64 = 256;
const PERIOD: u64 = 1024;
/// Below this, σ² over squared size is rounding of f32: the quantity is the same for all rays.
const ROUNDING: f64 = 1e-13;

const QUANTITIES: usize = 9;
/// What is compared. Distance: squared, from the first ray's origin, so that sorting by radius is seen too.
const NAMES: [&str; QUANTITIES] = ["x", "y", "z", "l", "m", "n", "flux", "distance", "wavelength"];

/// What was found of the order.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Order {
    /// Rays that were compared.
    pub rays_compared: u64,
    /// The quantity whose neighbours are most alike: serial correlation.
    pub neighbors: Option<Statistic>,
    /// The quantity in which the first tenth differs most: shift of its mean in standard deviations of single rays.
    pub first_tenth: Option<Statistic>,
    /// |z| above which a statistic raises the alarm, if it is large enough to do harm.
    pub alarm_z: f64,
    /// Chance that a shuffled file raises it.
    pub false_alarm_rate: f64,
    /// It was raised.
    pub sorted: bool,
}

/// One statistic.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Statistic {
    /// Of which quantity: x, y, z (origin), l, m, n (direction), flux, distance (from the first ray), wavelength.
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
        for k in 0..QUANTITIES {
            self.sum[k] += values[k];
            self.square[k] += values[k] * values[k];
        }
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
        let worst =
            |which: usize| all.iter().map(|pair| &pair[which]).max_by(|a, b| a.z.abs().total_cmp(&b.z.abs())).cloned();
        let alarm = |which: usize, harmless: f64| {
            all.iter().any(|pair| pair[which].z.abs() > ALARM_Z && pair[which].value.abs() > harmless)
        };
        Order {
            rays_compared: self.rays,
            neighbors: worst(0),
            first_tenth: worst(1),
            alarm_z: ALARM_Z,
            false_alarm_rate: FALSE_ALARMS,
            sorted: alarm(0, HARMLESS_CORRELATION) || alarm(1, HARMLESS_SHIFT),
        }
    }
}
