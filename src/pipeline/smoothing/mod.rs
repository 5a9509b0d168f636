//! Smoothing that takes from the counted rays what they can support, and the rest from a prior: a Wiener filter, in each place and on
//! each scale, on the ratio of what was counted to what was expected.
//!
//! From coarse to fine: where counts, smoothed on that scale, differ from the expectation by more than their noise explains, the
//! expectation follows them; where they do not, it stays. So noise is averaged over as much as there is to average, and an edge that
//! the rays can see stays an edge. The width follows from the rays in each place, not from a number of them that somebody chose.

/// Neighbouring sites, and the same sites in ever larger clusters.
mod levels;

pub use levels::{DIRECTIONS, Edge, Levels, PLACES, Sharing};

use rayon::prelude::*;

/// How much more than expected noise must explain before a difference counts, where a scale shows nothing but noise: 1 follows noise where
/// the true ratio is flat, 2 blurs.
const CAUTION: f64 = 1.5;
/// The same where a scale of a field with edges shows much more than noise.
const CAUTION_OF_EDGES: f64 = 0.7;
/// The same of a row of sites.
const CAUTION_IN_A_ROW: f64 = 3.0;
/// Signal on a scale, in parts of its noise, at which the caution is halfway between those of [`Caution::ends`].
const HALFWAY: f64 = 0.5;
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

/// By whose noise the difference between what was counted at a place and what was expected is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trust {
    /// Its own: a place that is smaller than its surroundings, as the pole beside the rings of a sphere, follows them.
    Own,
    /// That of its surroundings together: it may be bright where little light was expected.
    Surroundings,
}

/// What was counted at the sites, and what was expected.
pub struct Counted<'a> {
    /// Amounts per site.
    pub amounts: &'a [f64],
    /// What they are expected to be: not negative, only its form matters.
    pub prior: &'a [f64],
    /// Amount of a typical ray, Σ w² / Σ w.
    pub ray: f64,
    /// By whose noise a difference is judged.
    pub trust: Trust,
    /// How cautious it is.
    pub caution: Caution,
}

/// How much of a difference noise must explain where a scale shows much more than noise: then most of a difference is signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Caution {
    /// As much as where it shows nothing but noise: the field is smooth, as the intensity of a whole source is.
    Smooth,
    /// Less: the field has edges, as surfaces and volumes have, and the light of their parts where it differs from that of the whole.
    Edges,
    /// More: sites stand in one row, so that few are averaged and noise passes for a signal more often.
    Row,
}

impl Caution {
    /// Where a scale shows nothing but noise, and where it shows much more.
    fn ends(self) -> [f64; 2] {
        match self {
            Caution::Smooth => [CAUTION; 2],
            Caution::Edges => [CAUTION, CAUTION_OF_EDGES],
            Caution::Row => [CAUTION_IN_A_ROW; 2],
        }
    }
}

impl<'a> Counted<'a> {
    /// Judged by the noise of the surroundings of each place.
    pub fn new(amounts: &'a [f64], prior: &'a [f64], ray: f64, caution: Caution) -> Counted<'a> {
        Counted { amounts, prior, ray, trust: Trust::Surroundings, caution }
    }
}

/// As many are smoothed together, as the vector units of common processors hold well.
pub const LANES: usize = 4;

/// Counted amounts of the same sites, each smoothed towards its prior. A place without prior stays dark.
pub fn refine_all(levels: &Levels, all: &[Counted<'_>]) -> Vec<Refined> {
    let together = |part: &[Counted<'_>]| match part.len() {
        1 => refined::<1>(levels, part),
        2 => refined::<2>(levels, part),
        _ => refined::<LANES>(levels, part),
    };
    all.par_chunks(LANES).flat_map_iter(together).collect()
}

/// As [`refine_all`], of one.
pub fn refine(levels: &Levels, counted: &Counted<'_>) -> Refined {
    let [refined] = lanes(levels, [counted]);
    refined
}

/// As [`refine_all`], of one to `L`; the first fills the lanes that are left.
fn refined<const L: usize>(levels: &Levels, part: &[Counted<'_>]) -> Vec<Refined> {
    let filled = std::array::from_fn(|lane| part.get(lane).unwrap_or(&part[0]));
    lanes::<L>(levels, filled).into_iter().take(part.len()).collect()
}

/// As [`refine_all`], side by side: the lanes do not touch each other.
fn lanes<const L: usize>(levels: &Levels, counted: [&Counted<'_>; L]) -> [Refined; L] {
    let sites = counted[0].amounts.len();
    let side_by_side = |of: &dyn Fn(usize, usize) -> f64| -> Vec<[f64; L]> {
        (0..sites).map(|site| std::array::from_fn(|lane| of(lane, site))).collect()
    };
    let totals = counted.map(|of| of.amounts.iter().sum::<f64>());
    let scales: [f64; L] = std::array::from_fn(|lane| {
        let expected: f64 = counted[lane].prior.iter().sum();
        if totals[lane] > 0.0 && expected > 0.0 { totals[lane] / expected } else { 0.0 }
    });
    let (rays, trusts) = (counted.map(|of| of.ray), counted.map(|of| of.trust));
    let seen = side_by_side(&|lane, site| counted[lane].amounts[site]);
    let mut amounts = side_by_side(&|lane, site| counted[lane].prior[site] * scales[lane]);
    let (mut taken, mut variance) = (vec![[0.0; L]; sites], vec![[0.0; L]; sites]);
    for scale in levels.scales() {
        let of_site = |site: usize| {
            [amounts[site], seen[site], std::array::from_fn(|lane| taken[site][lane] * amounts[site][lane])]
        };
        let clusters: Vec<[[f64; L]; 3]> = levels.gather(scale, &(0..sites).map(of_site).collect::<Vec<_>>());
        let noise = levels.variance(scale, &clusters.iter().map(|[expected, ..]| *expected).collect::<Vec<_>>());
        let smooth = levels.smooth(scale, clusters.iter().map(|[expected, seen, _]| [*expected, *seen]).collect());
        let of_cluster = |k: usize| compared(&clusters[k], &smooth[k], &noise[k], &rays);
        let found: Vec<[[f64; L]; 3]> = (0..clusters.len()).map(of_cluster).collect();
        let powers = found.iter().zip(&clusters).map(|(found, [expected, ..])| powers(found, expected));
        let powers: Vec<[[f64; L]; 3]> = powers.collect();
        let cautions = cautions(&powers, counted.map(|of| of.caution));
        let powers = levels.surroundings(scale, powers);
        let trusted = found.iter().zip(&powers).map(|(found, powers)| trusted(found, powers, &trusts, &cautions));
        let trusted = levels.interpolate(scale, trusted.collect());
        let mut sums = [0.0; L];
        for (site, [change, whole, fresh]) in trusted.into_iter().enumerate() {
            taken[site] = whole;
            for lane in 0..L {
                variance[site][lane] += fresh[lane];
                amounts[site][lane] = (amounts[site][lane] * (1.0 + change[lane])).max(0.0);
                sums[lane] += amounts[site][lane];
            }
        }
        let scaled: [f64; L] = std::array::from_fn(|lane| totals[lane] / sums[lane]);
        amounts.iter_mut().for_each(|of| of.iter_mut().zip(scaled).for_each(|(amount, scaled)| *amount *= scaled));
    }
    std::array::from_fn(|lane| {
        if scales[lane] == 0.0 {
            return Refined { amounts: vec![0.0; sites], variance: vec![0.0; sites] };
        }
        let of = |values: &[[f64; L]]| values.iter().map(|of| of[lane]).collect();
        Refined { amounts: of(&amounts), variance: of(&variance) }
    })
}

/// Of a cluster's expected and counted amounts, both also smoothed, how far the counts are above the expectation, the noise of that, and what
/// of the noise coarser scales have not taken. The third of `cluster`: what they have taken, times the expectation.
fn compared<const L: usize>(
    [expected, _, taken]: &[[f64; L]; 3],
    [smooth, seen]: &[[f64; L]; 2],
    noise: &[f64; L],
    rays: &[f64; L],
) -> [[f64; L]; 3] {
    let mut found = [[0.0; L]; 3];
    for lane in 0..L {
        let floor = FLOOR_RAYS * rays[lane];
        let under = smooth[lane] + floor;
        let whole = rays[lane] * noise[lane] / (under * under);
        let before = if expected[lane] > 0.0 { taken[lane] / expected[lane] } else { 0.0 };
        found[0][lane] = (seen[lane] + floor) / under - 1.0;
        found[1][lane] = whole;
        found[2][lane] = (whole - before).max(LEAST_NEW_NOISE * whole);
    }
    found
}

/// The powers of noise and of signal in what was found, and the weight of both.
fn powers<const L: usize>([excess, _, fresh]: &[[f64; L]; 3], expected: &[f64; L]) -> [[f64; L]; 3] {
    let mut powers = [[0.0; L], [0.0; L], *expected];
    for lane in 0..L {
        powers[0][lane] = fresh[lane] * expected[lane];
        powers[1][lane] = excess[lane] * excess[lane] * expected[lane];
    }
    powers
}

/// How much of a difference on a scale noise must explain, by the `powers` of all of its clusters.
fn cautions<const L: usize>(powers: &[[[f64; L]; 3]], wanted: [Caution; L]) -> [f64; L] {
    std::array::from_fn(|lane| {
        let sum = |which: usize| -> f64 { powers.iter().map(|powers| powers[which][lane]).sum() };
        let (noise, seen) = (sum(0), sum(1));
        let signal = if noise > 0.0 { (seen / noise - 1.0).max(0.0) } else { 0.0 };
        let [of_noise, of_signal] = wanted[lane].ends();
        of_signal + (of_noise - of_signal) / (1.0 + signal / HALFWAY)
    })
}

/// The part of what was found that is signal, by the powers in its surroundings.
fn trusted<const L: usize>(
    [excess, whole, fresh]: &[[f64; L]; 3],
    [noise, signal, weight]: &[[f64; L]; 3],
    trusts: &[Trust; L],
    cautions: &[f64; L],
) -> [[f64; L]; 3] {
    let mut trusted = [[0.0; L]; 3];
    for lane in 0..L {
        let noise = noise[lane] / weight[lane];
        let power = signal[lane] / weight[lane] - cautions[lane] * noise;
        let own = if trusts[lane] == Trust::Own { fresh[lane] } else { noise };
        let trust = if power > 0.0 { power / (power + cautions[lane] * own) } else { 0.0 };
        trusted[0][lane] = trust * excess[lane];
        trusted[1][lane] = trust * whole[lane];
        trusted[2][lane] = trust * trust * fresh[lane];
    }
    trusted
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn one(levels: &Levels, amounts: &[f64], prior: &[f64], ray: f64) -> Refined {
        refine(levels, &Counted::new(amounts, prior, ray, Caution::Edges))
    }

    /// A square of `side`² sites, each joined to its neighbours.
    fn square(side: u32) -> Levels {
        let points: Vec<DVec3> =
            (0..side * side).map(|k| DVec3::new(f64::from(k % side), f64::from(k / side), 0.0)).collect();
        let right = (0..side * side).filter(|k| k % side + 1 < side).map(|k| (k, k + 1, 1.0));
        let down = (0..side * side).filter(|k| k / side + 1 < side).map(|k| (k, k + side, 1.0));
        let edges: Vec<Edge> = right.chain(down).collect();
        Levels::new(&points, &vec![0; points.len()], &edges, 1.0, Sharing::None, PLACES)
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
        let found = one(&levels, &counted, &even, 1.0);
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
        let found = one(&levels, &prior, &prior, 1.0).amounts;
        prior.iter().zip(found).for_each(|(prior, found)| assert!((found / prior - 1.0).abs() < 1e-9));
    }

    #[test]
    fn places_without_prior_stay_dark_and_nothing_comes_of_nothing() {
        let levels = square(8);
        let prior: Vec<f64> = (0..64).map(|k| f64::from(u8::from(k >= 8))).collect();
        let found = one(&levels, &vec![5.0; 64], &prior, 1.0).amounts;
        assert!(found[..8].iter().all(|amount| *amount == 0.0) && found[8..].iter().all(|amount| *amount > 0.0));
        assert_eq!(one(&levels, &vec![0.0; 64], &prior, 1.0).amounts, vec![0.0; 64]);
    }

    /// However many are smoothed together, each is as it is alone, to the bit; one without light leaves the others alone.
    #[test]
    fn neighbours_in_the_processor_are_strangers() {
        let levels = square(16);
        let of = |k: u32| counts(move |x, y| f64::from(20 * k + x * k + y), 16);
        let (counted, prior): (Vec<Vec<f64>>, Vec<Vec<f64>>) = (0..7).map(|k| (of(3 * k), of(k + 1))).unzip();
        let alone: Vec<Refined> = (0..7).map(|k| one(&levels, &counted[k], &prior[k], 1.0 + k as f64)).collect();
        let dark = vec![0.0; 256];
        assert_eq!(one(&levels, &dark, &prior[0], 1.0).amounts, dark);
        for count in 1..=7 {
            let of = |k: usize| Counted::new(&counted[k], &prior[k], 1.0 + k as f64, Caution::Edges);
            assert_eq!(refine_all(&levels, &(0..count).map(of).collect::<Vec<_>>()), alone[..count]);
            let beside = [Counted::new(&dark, &prior[0], 1.0, Caution::Edges), of(count - 1)];
            assert_eq!(refine_all(&levels, &beside)[1], alone[count - 1]);
        }
    }

    /// Sixteen times fewer rays reach one site than each of its neighbours: its own count, four times as uncertain, moves it little.
    #[test]
    fn a_place_of_few_rays_follows_its_surroundings() {
        let side = 32;
        let levels = square(side);
        let middle = (side / 2 * side + side / 2) as usize;
        let share = |site: usize| if site == middle { 1.0 / 16.0 } else { 1.0 };
        let prior: Vec<f64> = (0..(side * side) as usize).map(share).collect();
        // The truth is twice the prior on one half, so that the counts are followed.
        let truth = |site: usize| share(site) * if site as u32 % side < side / 2 { 100.0 } else { 200.0 };
        let mut counted: Vec<f64> = counts(|x, y| truth((y * side + x) as usize), side);
        counted[middle] = 0.5 * truth(middle);
        let own = Counted { trust: Trust::Own, ..Counted::new(&counted, &prior, 1.0, Caution::Edges) };
        let found = refine(&levels, &own).amounts[middle] / truth(middle);
        assert!((found - 1.0).abs() < 0.25, "{found:.2} of the truth, counted 0.50 of it");
    }

    /// A single site, sites without neighbours, two kinds side by side.
    #[test]
    fn odd_graphs_are_levels_too() {
        let alone = Levels::new(&[DVec3::ZERO], &[0], &[], 1.0, Sharing::ThreeCorners, PLACES);
        assert_eq!(one(&alone, &[3.0], &[1.0], 1.0).amounts, [3.0]);
        let points = [DVec3::ZERO, DVec3::X, 5.0 * DVec3::X, 6.0 * DVec3::X];
        let apart =
            Levels::new(&points, &[0, 0, 1, 1], &[(0, 1, 1.0), (2, 3, 1.0)], 1.0, Sharing::ThreeCorners, PLACES);
        let found = one(&apart, &[900.0, 900.0, 100.0, 100.0], &[1.0; 4], 1.0).amounts;
        assert!(found[0] > 850.0 && found[3] < 150.0, "{found:?}");
    }
}
