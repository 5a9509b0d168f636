//! Which zones a vertex has, and how much of each: so that the light changes gradually from zone to zone.

use super::ancestry::Ancestry;
use crate::hull::Hull;
use glam::DVec3;
use std::collections::BTreeMap;

/// Most zones of a vertex: what fits one vertex attribute.
pub const MOST: usize = 4;

/// Where a vertex has all zones of its kind near, they reach so many times the distance of the farthest.
const BEYOND_LAST: f64 = 1.2;
/// Rounds in which the distributions are sharpened; more bring nothing.
const ROUNDS: usize = 12;

/// Zones of a vertex and their weights, which sum to 1. Places that are not used hold the first zone and weight 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixture {
    /// Zone ids, the weightiest first.
    pub zones: [u32; MOST],
    /// Weight of each.
    pub weights: [f64; MOST],
}

impl Mixture {
    /// One zone alone.
    pub fn hard(zone: u32) -> Mixture {
        Mixture { zones: [zone; MOST], weights: [1.0, 0.0, 0.0, 0.0] }
    }

    /// Zones and their weights.
    pub fn parts(&self) -> impl Iterator<Item = (usize, f64)> {
        let pairs = self.zones.into_iter().map(|zone| zone as usize).zip(self.weights);
        pairs.filter(|(_, weight)| *weight > 0.0)
    }

    /// Of the zones whose middles are nearest to a point, each weighted by (1 − d²/R²)², R the distance of the next one.
    fn near(point_mm: DVec3, zones: &[(u32, DVec3)]) -> Mixture {
        let mut near: Vec<(f64, u32)> = zones.iter().map(|(id, middle)| (middle.distance(point_mm), *id)).collect();
        let by_distance = |a: &(f64, u32), b: &(f64, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        if near.len() > MOST {
            near.select_nth_unstable_by(MOST, by_distance);
            near.truncate(MOST + 1);
        }
        near.sort_by(by_distance);
        let reach = if near.len() > MOST { near[MOST].0 } else { BEYOND_LAST * near.last().map_or(0.0, |last| last.0) };
        let weight =
            |distance: f64| if reach > 0.0 { (1.0 - (distance / reach).powi(2)).max(0.0).powi(2) } else { 1.0 };
        let first = near.first().map_or(0, |nearest| nearest.1);
        let mut mixture = Mixture::hard(first);
        let sum: f64 = near.iter().take(MOST).map(|(distance, _)| weight(*distance)).sum();
        if sum > 0.0 {
            for (place, (distance, zone)) in near.iter().take(MOST).enumerate() {
                mixture.zones[place] = *zone;
                mixture.weights[place] = weight(*distance) / sum;
            }
        }
        mixture
    }
}

/// The mixture of each vertex, of zones of its own zone's kind; `middles_mm` of the zones.
pub fn blend(hull: &Hull, middles_mm: &[DVec3], zone_of_vertex: &[u32], family: &[Ancestry]) -> Vec<Mixture> {
    let mut middles: Vec<Vec<(u32, DVec3)>> = vec![Vec::new(); Ancestry::kinds(family) as usize];
    let numbered = (0..).zip(middles_mm).zip(family);
    numbered.for_each(|((id, middle_mm), zone)| middles[zone.kind as usize].push((id, *middle_mm)));
    let of = |(vertex, zone): (&DVec3, &u32)| Mixture::near(*vertex, &middles[family[*zone as usize].kind as usize]);
    hull.vertices_mm.iter().zip(zone_of_vertex).map(of).collect()
}

/// Shares of the light of each zone's own vertices that its neighbours have by their mixtures: rows of `(zone, share)`, each row's sum
/// is 1. `flux` per vertex.
pub struct Shares {
    rows: Vec<Vec<(u32, f64)>>,
}

impl Shares {
    /// Of mixtures.
    pub fn of(mixtures: &[Mixture], zone_of_vertex: &[u32], flux: &[f64], zones: usize) -> Shares {
        let mut sums: Vec<BTreeMap<u32, f64>> = vec![BTreeMap::new(); zones];
        for ((mixture, own), flux) in mixtures.iter().zip(zone_of_vertex).zip(flux) {
            for (zone, weight) in mixture.parts() {
                *sums[*own as usize].entry(zone as u32).or_insert(0.0) += weight * flux;
            }
        }
        let row = |(own, sums): (usize, BTreeMap<u32, f64>)| {
            let total: f64 = sums.values().sum();
            if total > 0.0 {
                sums.into_iter().map(|(zone, sum)| (zone, sum / total)).collect()
            } else {
                vec![(own as u32, 1.0)]
            }
        };
        Shares { rows: sums.into_iter().enumerate().map(row).collect() }
    }

    /// Amounts of vertices' own zones handed to the zones of their mixtures. `amounts`: one list per zone.
    pub fn hand_over(&self, amounts: &[&[f64]]) -> Vec<Vec<f64>> {
        let length = amounts.first().map_or(0, |amounts| amounts.len());
        let mut handed = vec![vec![0.0; length]; self.rows.len()];
        for (row, amounts) in self.rows.iter().zip(amounts) {
            for (zone, share) in row {
                handed[*zone as usize].iter_mut().zip(*amounts).for_each(|(sum, amount)| *sum += share * amount);
            }
        }
        handed
    }

    /// Distributions of zones which, mixed, give what each zone's own vertices sent: handing over blurs, and rounds of Richardson and
    /// Lucy (1972, 1974) take that back. The zones' fluxes are those of [`Shares::hand_over`].
    pub fn sharpen(&self, own: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let lists: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
        let fluxes: Vec<f64> = own.iter().map(|amounts| amounts.iter().sum()).collect();
        let mut zones = self.hand_over(&lists);
        let zone_flux: Vec<f64> = zones.iter().map(|amounts| amounts.iter().sum()).collect();
        for _ in 0..ROUNDS {
            // Per own zone: what the mixture of the present distributions gives, and by how much more was sent.
            let ratios: Vec<Vec<f64>> = self
                .rows
                .iter()
                .enumerate()
                .map(|(of, row)| {
                    let mut mixed = vec![0.0; own[of].len()];
                    for (zone, share) in row {
                        let flux = zone_flux[*zone as usize];
                        let scale = if flux > 0.0 { share * fluxes[of] / flux } else { 0.0 };
                        mixed.iter_mut().zip(&zones[*zone as usize]).for_each(|(sum, amount)| *sum += scale * amount);
                    }
                    let ratio = |(sent, mixed): (&f64, &f64)| if *mixed > 0.0 { sent / mixed } else { 1.0 };
                    own[of].iter().zip(&mixed).map(ratio).collect()
                })
                .collect();
            let mut factors = vec![vec![0.0; own.first().map_or(0, Vec::len)]; zones.len()];
            for (of, row) in self.rows.iter().enumerate() {
                for (zone, share) in row {
                    let flux = zone_flux[*zone as usize];
                    let scale = if flux > 0.0 { share * fluxes[of] / flux } else { 0.0 };
                    factors[*zone as usize].iter_mut().zip(&ratios[of]).for_each(|(sum, ratio)| *sum += scale * ratio);
                }
            }
            for ((amounts, factors), flux) in zones.iter_mut().zip(&factors).zip(&zone_flux) {
                amounts.iter_mut().zip(factors).for_each(|(amount, factor)| *amount *= factor);
                let sum: f64 = amounts.iter().sum();
                amounts.iter_mut().for_each(|amount| *amount *= if sum > 0.0 { flux / sum } else { 0.0 });
            }
        }
        zones
    }
}
