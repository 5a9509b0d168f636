//! Smoothing that takes from the counted rays what they can support, and the rest from a prior: a Wiener filter, in each place and on
//! each scale, on the ratio of what was counted to what was expected.
//!
//! From coarse to fine: where counts, smoothed on that scale, differ from the expectation by more than their noise explains, the
//! expectation follows them; where they do not, it stays. So noise is averaged over as much as there is to average, and an edge that
//! the rays can see stays an edge. The width follows from the rays in each place, not from a number of them that somebody chose.

/// Neighbouring sites, and the same sites in ever larger clusters.
mod levels;

pub use levels::{Edge, Levels, Sharing};

/// How much more than expected noise must explain before a difference counts: 1 follows noise where the true ratio is flat, 2 blurs.
const CAUTION: f64 = 1.5;
/// The variance of a scale is at least this part of what it was before what coarser scales took of it.
const LEAST_NEW_NOISE: f64 = 0.25;
/// Steps of the walk on the next coarser level over which signal and noise are averaged, where the sites have edges: three times as wide
/// as the smoothing, so that an edge is seen where it is.
pub const WINDOW: usize = 4;
/// The same where they have none, on the sphere of directions: wider, because over few sites noise passes for a signal now and then.
pub const WIDE_WINDOW: usize = 7;
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
        let sites: Vec<[f64; 3]> =
            (0..sites).map(|site| [amounts[site], counted[site], taken[site] * amounts[site]]).collect();
        let clusters = levels.gather(scale, &sites);
        let noise = levels.variance(scale, &clusters.iter().map(|[expected, ..]| *expected).collect::<Vec<f64>>());
        let smooth = levels.smooth(scale, clusters.iter().map(|[expected, seen, _]| [*expected, *seen]).collect());
        // In each cluster how far the counts are above the expectation, its noise, and what of the noise coarser scales have not taken.
        let found = |k: usize| {
            let ([expected, _, weighted], [smooth, seen]) = (clusters[k], smooth[k]);
            let under = smooth + floor;
            let whole = ray * noise[k] / (under * under);
            let before = if expected > 0.0 { weighted / expected } else { 0.0 };
            [(seen + floor) / under - 1.0, whole, (whole - before).max(LEAST_NEW_NOISE * whole)]
        };
        let found: Vec<[f64; 3]> = (0..clusters.len()).map(found).collect();
        let powers = found
            .iter()
            .zip(&clusters)
            .map(|([excess, _, fresh], [expected, ..])| [fresh * expected, excess * excess * expected]);
        let powers = levels.surroundings(scale, powers.collect());
        let trusted = found.iter().zip(powers).map(|([excess, whole, fresh], [noise, signal])| {
            let trust = if signal > 0.0 { (1.0 - CAUTION * noise / signal).clamp(0.0, 1.0) } else { 0.0 };
            [trust * excess, trust * whole, trust * trust * fresh]
        });
        let trusted = levels.interpolate(scale, trusted.collect());
        for (site, [change, whole, fresh]) in trusted.into_iter().enumerate() {
            taken[site] = whole;
            variance[site] += fresh;
            amounts[site] = (amounts[site] * (1.0 + change)).max(0.0);
        }
        let scaled = total / amounts.iter().sum::<f64>();
        amounts.iter_mut().for_each(|amount| *amount *= scaled);
    }
    Refined { amounts, variance }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// A square of `side`² sites, each joined to its neighbours.
    fn square(side: u32) -> Levels {
        let points: Vec<DVec3> =
            (0..side * side).map(|k| DVec3::new(f64::from(k % side), f64::from(k / side), 0.0)).collect();
        let right = (0..side * side).filter(|k| k % side + 1 < side).map(|k| (k, k + 1, 1.0));
        let down = (0..side * side).filter(|k| k / side + 1 < side).map(|k| (k, k + side, 1.0));
        let edges: Vec<Edge> = right.chain(down).collect();
        Levels::new(&points, &vec![0; points.len()], &edges, 1.0, Sharing::None, WINDOW)
    }

    /// Numbers that scatter like counts of `mean` rays: ± √mean by a fixed pattern.
    fn counts(mean: impl Fn(u32, u32) -> f64, side: u32) -> Vec<f64> {
        let noise = |k: u32| if (k.wrapping_mul(2_654_435_761) >> 7).is_multiple_of(2) { 1.0 } else { -1.0 };
        let count = |k: u32| {
            let mean = mean(k % side, k / side);
            (mean + noise(k) * mean.sqrt()).max(0.0)
        };
        (0..side * side).map(count).collect()
    }

    #[test]
    fn noise_goes_and_an_edge_stays() {
        let side = 64;
        let levels = square(side);
        let bright = |x: u32, _: u32| if x < 32 { 400.0 } else { 100.0 };
        let counted = counts(bright, side);
        let even = vec![1.0; counted.len()];
        let found = refine(&levels, &counted, &even, 1.0);
        let (sum, total): (f64, f64) = (found.amounts.iter().sum(), counted.iter().sum());
        assert!((sum / total - 1.0).abs() < 1e-12, "{sum} of {total}");
        // Counts are off by 0.05 on the bright side and 0.1 on the other; at the edge at most half as much again is left.
        for (columns, most) in [(0..29, 0.02), (29..32, 0.075), (32..35, 0.15), (35..64, 0.03)] {
            let at = (0..side).flat_map(|y| columns.clone().map(move |x| (x, y)));
            let square = |(x, y): (u32, u32)| (found.amounts[(y * side + x) as usize] / bright(x, y) - 1.0).powi(2);
            let count = f64::from(side * (columns.end - columns.start));
            let off = (at.map(square).sum::<f64>() / count).sqrt();
            println!("columns {columns:?}: {off:.3} r.m.s.");
            assert!(off < most, "columns {columns:?}: {off:.3} r.m.s.");
        }
    }

    #[test]
    fn what_follows_the_prior_is_the_prior() {
        let levels = square(32);
        let prior: Vec<f64> = (0..1024).map(|k| 100.0 + f64::from(k % 32)).collect();
        let found = refine(&levels, &prior, &prior, 1.0).amounts;
        prior.iter().zip(found).for_each(|(prior, found)| assert!((found / prior - 1.0).abs() < 1e-9));
    }

    #[test]
    fn places_without_prior_stay_dark_and_nothing_comes_of_nothing() {
        let levels = square(8);
        let prior: Vec<f64> = (0..64).map(|k| f64::from(u8::from(k >= 8))).collect();
        let found = refine(&levels, &vec![5.0; 64], &prior, 1.0).amounts;
        assert!(found[..8].iter().all(|amount| *amount == 0.0) && found[8..].iter().all(|amount| *amount > 0.0));
        assert_eq!(refine(&levels, &vec![0.0; 64], &prior, 1.0).amounts, vec![0.0; 64]);
    }

    /// A single site, sites without neighbours, two kinds side by side.
    #[test]
    fn odd_graphs_are_levels_too() {
        let alone = Levels::new(&[DVec3::ZERO], &[0], &[], 1.0, Sharing::ThreeCorners, WINDOW);
        assert_eq!(refine(&alone, &[3.0], &[1.0], 1.0).amounts, [3.0]);
        let points = [DVec3::ZERO, DVec3::X, 5.0 * DVec3::X, 6.0 * DVec3::X];
        let apart =
            Levels::new(&points, &[0, 0, 1, 1], &[(0, 1, 1.0), (2, 3, 1.0)], 1.0, Sharing::ThreeCorners, WINDOW);
        let found = refine(&apart, &[900.0, 900.0, 100.0, 100.0], &[1.0; 4], 1.0).amounts;
        assert!(found[0] > 850.0 && found[3] < 150.0, "{found:?}");
    }
}
