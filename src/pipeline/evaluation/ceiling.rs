//! The most and the least that a zone sends into any direction of a range of γ: what bounds the light of a part that was not looked at closely,
//! and tells whether it changes much.

use super::emission::Emission;
use crate::goniogram::SphereGrid;

/// Most per run of γ nodes, whose lengths are powers of two.
struct Runs {
    /// `[level][node]`: the most of 2^level nodes from this one on.
    levels: Vec<Vec<f64>>,
}

impl Runs {
    fn new(values: Vec<f64>) -> Runs {
        let mut levels = vec![values];
        let mut step = 1;
        while let Some(last) = levels.last().filter(|last| last.len() > step) {
            levels.push(last.iter().zip(&last[step..]).map(|(a, b)| a.max(*b)).collect());
            step *= 2;
        }
        Runs { levels }
    }

    /// The most of nodes `first` to `last`.
    fn most(&self, first: usize, last: usize) -> f64 {
        let level = (last + 1 - first).ilog2() as usize;
        let run = &self.levels[level];
        run[first].max(run[last + 1 - (1 << level)])
    }
}

/// The most of a zone, and less than nothing by its least.
struct Extremes([Runs; 2]);

impl Extremes {
    fn new([most, least]: [Vec<f64>; 2]) -> Extremes {
        Extremes([Runs::new(most), Runs::new(least.into_iter().map(|value| -value).collect())])
    }

    fn of(&self, [first, last]: [usize; 2]) -> [f64; 2] {
        let Extremes([most, least]) = self;
        [most.most(first, last), -least.most(first, last)]
    }
}

/// Of all zones.
pub struct Ceilings {
    main: Vec<Extremes>,
    spectral: Vec<Option<Extremes>>,
}

/// Nodes of γ round a range.
#[derive(Clone, Copy)]
pub struct Range {
    main: [usize; 2],
    spectral: [usize; 2],
}

impl Range {
    /// How many steps of γ of the finer grid it touches.
    pub fn steps(&self) -> usize {
        self.main[1] - self.main[0]
    }
}

/// The nodes that what is interpolated from `low` to `high`, radians, depends on.
fn around(grid: &SphereGrid, low: f64, high: f64) -> [usize; 2] {
    let last = grid.gamma_nodes() - 1;
    let first = grid.gamma_below(low);
    [first, (grid.gamma_below(high) + 1).clamp(first, last)]
}

impl Ceilings {
    /// Of the zones of a model.
    pub fn new(emission: &Emission<'_>) -> Ceilings {
        let zones = 0..emission.zone_count();
        let main = zones.clone().map(|zone| Extremes::new(emission.extremes(zone))).collect();
        let spectral = zones.map(|zone| emission.spectral_extremes(zone).map(Extremes::new)).collect();
        Ceilings { main, spectral }
    }

    /// Directions at most `reach` radians away from γ.
    pub fn range(&self, emission: &Emission<'_>, gamma: f64, reach: f64) -> Range {
        let light = emission.light();
        let (low, high) = (gamma - reach, gamma + reach);
        Range { main: around(light.grid, low, high), spectral: around(light.spectral_grid, low, high) }
    }

    /// The most and the least that a zone sends into directions of the range, 1/sr.
    pub fn extremes(&self, zone: usize, range: Range) -> [f64; 2] {
        let [most, least] = self.main[zone].of(range.main);
        let spectral = self.spectral[zone].as_ref().map(|own| own.of(range.spectral));
        spectral.map_or([most, least], |own| [most.max(own[0]), least.min(own[1])])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_know_the_most_of_any_range() {
        let values: Vec<f64> = (0..37).map(|k| (f64::from(k) * 2_f64.sqrt()).fract()).collect();
        let runs = Runs::new(values.clone());
        for first in 0..37 {
            for last in first..37 {
                let most = values[first..=last].iter().copied().fold(0.0, f64::max);
                assert_eq!(runs.most(first, last), most, "{first} to {last}");
            }
        }
    }
}
