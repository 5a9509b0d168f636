//! Smoothing that takes from the counted rays what they can support, and the rest from a prior: a Wiener filter, in each place and on
//! each scale, on the ratio of what was counted to what was expected.
//!
//! From coarse to fine: where counts, smoothed on that scale, differ from the expectation by more than their noise explains, the
//! expectation follows them; where they do not, it stays. So noise is averaged over as much as there is to average, and an edge that
//! the rays can see stays an edge. The width follows from the rays in each place, not from a number of them that somebody chose.

/// Neighbouring sites, and the same sites in ever larger clusters.
mod levels;

pub use levels::{Edge, Levels};

/// How much more than expected noise must explain before a difference counts: 1 follows noise where the true ratio is flat, 2 blurs.
const CAUTION: f64 = 1.5;
/// The variance of a scale is at least this part of what it was before what coarser scales took of it.
const LEAST_NEW_NOISE: f64 = 0.25;
/// A part of a ray that stands under every sum, so that dark places have a ratio.
const FLOOR_RAYS: f64 = 1e-6;

/// A smoothed table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Refined {
    /// Amounts per site; their sum is that of the counted ones to rounding.
    pub amounts: Vec<f64>,
    /// Relative variance of each that comes from the counted rays.
    pub variance: Vec<f64>,
}

/// `counted` amounts per site, smoothed towards `prior` (not negative; only its form matters). `ray`: amount of a typical ray,
/// Σ w² / Σ w. A place without prior stays dark.
pub fn refine(levels: &Levels, counted: &[f64], prior: &[f64], ray: f64) -> Refined {
    let (total, expected): (f64, f64) = (counted.iter().sum(), prior.iter().sum());
    let sites = counted.len();
    if !(total > 0.0 && expected > 0.0) {
        return Refined { amounts: vec![0.0; sites], variance: vec![0.0; sites] };
    }
    let mut amounts: Vec<f64> = prior.iter().map(|amount| amount * (total / expected)).collect();
    let (mut taken, mut variance) = (vec![0.0; sites], vec![0.0; sites]);
    let floor = FLOOR_RAYS * ray;
    for scale in levels.scales() {
        let weighted: Vec<f64> = taken.iter().zip(&amounts).map(|(variance, amount)| variance * amount).collect();
        let [expected, seen, weighted] = [&amounts, counted, &weighted].map(|amounts| levels.gather(scale, amounts));
        let noise = levels.variance(scale, &expected);
        let smooth = levels.smooth(scale, &expected);
        let seen = levels.smooth(scale, &seen);
        let clusters = expected.len();
        let (mut excess, mut whole, mut fresh) = (vec![0.0; clusters], vec![0.0; clusters], vec![0.0; clusters]);
        for k in 0..clusters {
            let under = smooth[k] + floor;
            excess[k] = (seen[k] + floor) / under - 1.0;
            whole[k] = ray * noise[k] / (under * under);
            let before = if expected[k] > 0.0 { weighted[k] / expected[k] } else { 0.0 };
            fresh[k] = (whole[k] - before).max(LEAST_NEW_NOISE * whole[k]);
        }
        let noise: Vec<f64> = (0..clusters).map(|k| fresh[k] * expected[k]).collect();
        let signal: Vec<f64> = (0..clusters).map(|k| excess[k] * excess[k] * expected[k]).collect();
        let (noise, signal) = (levels.surroundings(scale, &noise), levels.surroundings(scale, &signal));
        let trust = |k: usize| {
            if signal[k] > 0.0 { (1.0 - CAUTION * noise[k] / signal[k]).clamp(0.0, 1.0) } else { 0.0 }
        };
        let trust: Vec<f64> = (0..clusters).map(trust).collect();
        let with = |values: &[f64], power: i32| -> Vec<f64> {
            let product = trust.iter().zip(values).map(|(trust, value)| trust.powi(power) * value).collect();
            levels.interpolate(scale, product)
        };
        let change = with(&excess, 1);
        taken = with(&whole, 1);
        variance.iter_mut().zip(with(&fresh, 2)).for_each(|(sum, more)| *sum += more);
        amounts.iter_mut().zip(change).for_each(|(amount, change)| *amount = (*amount * (1.0 + change)).max(0.0));
        let scaled = total / amounts.iter().sum::<f64>();
        amounts.iter_mut().for_each(|amount| *amount *= scaled);
    }
    Refined { amounts, variance }
}
