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

    /// Of the weightiest of `parts`, zones and their weights; `None` where nothing has weight.
    fn of(mut parts: Vec<(u32, f64)>) -> Option<Mixture> {
        parts.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        parts.truncate(MOST);
        let sum: f64 = parts.iter().map(|(_, weight)| weight).sum();
        let mut mixture = Mixture::hard(parts.first()?.0);
        for (place, (zone, weight)) in parts.into_iter().enumerate() {
            (mixture.zones[place], mixture.weights[place]) = (zone, weight / sum);
        }
        (sum > 0.0).then_some(mixture)
    }

    /// Of the zones whose middles are nearest to a point with this `exitance`: each has the weight (1 − d²/R²)², R the distance of the next
    /// one, times how alike the exitances are, the lower over the higher. Light of another strength mostly comes from elsewhere and goes
    /// elsewhere.
    fn near(point_mm: DVec3, exitance: f64, zones: &[Middle]) -> Mixture {
        let mut near: Vec<(f64, &Middle)> = zones.iter().map(|zone| (zone.at_mm.distance(point_mm), zone)).collect();
        let by_distance = |a: &(f64, &Middle), b: &(f64, &Middle)| a.0.total_cmp(&b.0).then(a.1.zone.cmp(&b.1.zone));
        if near.len() > MOST {
            near.select_nth_unstable_by(MOST, by_distance);
            near.truncate(MOST + 1);
        }
        near.sort_by(by_distance);
        let reach = if near.len() > MOST { near[MOST].0 } else { BEYOND_LAST * near.last().map_or(0.0, |last| last.0) };
        let closeness =
            |distance: f64| if reach > 0.0 { (1.0 - (distance / reach).powi(2)).max(0.0).powi(2) } else { 1.0 };
        let likeness = |zone: &Middle| {
            let (lower, higher) = (exitance.min(zone.exitance), exitance.max(zone.exitance));
            if higher > 0.0 { lower / higher } else { 1.0 }
        };
        let first = near.first().map_or(0, |nearest| nearest.1.zone);
        let parts = near.iter().take(MOST);
        let parts = parts.map(|(distance, middle)| (middle.zone, closeness(*distance) * likeness(middle)));
        Mixture::of(parts.collect()).unwrap_or(Mixture::hard(first))
    }
}

/// The middle of a zone.
pub struct Middle {
    /// The zone.
    pub zone: u32,
    /// Where its flux has its mean, source frame, mm.
    pub at_mm: DVec3,
    /// Its flux over its area, flux/mm².
    pub exitance: f64,
}

/// The mixture of each vertex, of zones of its own zone's kind; `flux` of the vertices, and one middle for each zone.
pub fn blend(
    hull: &Hull,
    flux: &[f64],
    middles: Vec<Middle>,
    zone_of_vertex: &[u32],
    family: &[Ancestry],
) -> Vec<Mixture> {
    let mut of_kind: Vec<Vec<Middle>> = (0..Ancestry::kinds(family)).map(|_| Vec::new()).collect();
    middles.into_iter().zip(family).for_each(|(middle, zone)| of_kind[zone.kind as usize].push(middle));
    let exitances = exitances(hull, flux);
    let of = |((vertex, zone), exitance): ((&DVec3, &u32), f64)| {
        Mixture::near(*vertex, exitance, &of_kind[family[*zone as usize].kind as usize])
    };
    hull.vertices_mm.iter().zip(zone_of_vertex).zip(exitances).map(of).collect()
}

/// Mixtures with which each zone sends the flux ∫ M w dA that it has by `flux` and `mixtures` of the vertices. Exitance M and weights w are each
/// linear between vertices, and their product is not: what lies round a vertex beside brighter ones is mostly their light.
pub fn interpolated(hull: &Hull, flux: &[f64], mixtures: &[Mixture]) -> Vec<Mixture> {
    let exitances = exitances(hull, flux);
    let mut sums: Vec<BTreeMap<u32, f64>> = vec![BTreeMap::new(); mixtures.len()];
    for (triangle, corners) in hull.triangles.iter().enumerate() {
        let corners = corners.map(|corner| corner as usize);
        // ∫ of the product of two corners' shares is A/12, of one's square A/6.
        let part_mm2 = hull.area_mm2(triangle) / 12.0;
        for (at, from) in corners.iter().flat_map(|at| corners.map(|from| (*at, from))) {
            let light = if at == from { 2.0 } else { 1.0 } * part_mm2 * exitances[from];
            for (zone, weight) in mixtures[from].parts() {
                *sums[at].entry(zone as u32).or_insert(0.0) += weight * light;
            }
        }
    }
    let mixture = |(sums, own): (BTreeMap<u32, f64>, &Mixture)| Mixture::of(sums.into_iter().collect()).unwrap_or(*own);
    sums.into_iter().zip(mixtures).map(mixture).collect()
}

/// Exitance of each vertex, flux/mm².
fn exitances(hull: &Hull, flux: &[f64]) -> Vec<f64> {
    let per_mm2 = |(flux, mm2): (&f64, f64)| if mm2 > 0.0 { flux / mm2 } else { 0.0 };
    flux.iter().zip(hull.vertex_areas_mm2()).map(per_mm2).collect()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::focal::{FocalPatch, FocalSurface};
    use crate::hull::sheet;
    use crate::hull::symmetry::Symmetry;
    use glam::DVec2;

    /// A square of 2 mm in 4 x 4 cells.
    fn square() -> Hull {
        let surface = FocalSurface::new(DVec3::ZERO, DVec3::Z, 0.0);
        let (min_mm, max_mm) = (DVec2::splat(-1.0), DVec2::splat(1.0));
        let patch = FocalPatch { surface, min_mm, max_mm, lit_mm2: 4.0, symmetry: Symmetry::None };
        sheet::of_grid(patch, [4, 4], &[true; 16])
    }

    /// ∫ M w dA of each zone: the product of two linear functions, by the rule of the middles of the edges, which is exact for it.
    fn sent(hull: &Hull, flux: &[f64], mixtures: &[Mixture], zones: usize) -> Vec<f64> {
        let (exitances, mut sent) = (exitances(hull, flux), vec![0.0; zones]);
        for (triangle, corners) in hull.triangles.iter().enumerate() {
            let corners = corners.map(|corner| corner as usize);
            for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (corners[a], corners[b])) {
                let light = hull.area_mm2(triangle) / 3.0 * 0.5 * (exitances[a] + exitances[b]);
                for (zone, weight) in [a, b].into_iter().flat_map(|at| mixtures[at].parts()) {
                    sent[zone] += 0.5 * weight * light;
                }
            }
        }
        sent
    }

    #[test]
    fn zones_send_what_their_vertices_have_where_one_is_far_brighter() {
        let hull = square();
        // One vertex in the middle is a hundred times as bright, and a zone of its own.
        let middle = hull.vertices_mm.iter().position(|vertex| vertex.length() < 1e-9).unwrap();
        let areas_mm2 = hull.vertex_areas_mm2();
        let bright = |vertex: usize| if vertex == middle { 100.0 } else { 1.0 };
        let flux: Vec<f64> = areas_mm2.iter().enumerate().map(|(vertex, mm2)| bright(vertex) * mm2).collect();
        let zone = |vertex: usize| if vertex == middle { 1 } else { 0 };
        let own: Vec<Mixture> = (0..flux.len()).map(|vertex| Mixture::hard(zone(vertex))).collect();
        let wanted = [flux.iter().sum::<f64>() - flux[middle], flux[middle]];
        let [before, after] =
            [own.clone(), interpolated(&hull, &flux, &own)].map(|mixtures| sent(&hull, &flux, &mixtures, 2));
        // The neighbours' zone would send six times its light.
        assert!(before[0] > 2.0 * wanted[0], "{before:?} of {wanted:?}");
        assert!(after.iter().zip(wanted).all(|(sent, wanted)| (sent / wanted - 1.0).abs() < 1e-12), "{after:?}");
        // Where all is dark there is nothing to mix.
        assert_eq!(interpolated(&hull, &vec![0.0; flux.len()], &own), own);
    }

    #[test]
    fn a_point_mixes_zones_near_it_that_are_as_bright() {
        let middle = |zone: u32, x: f64, exitance: f64| Middle { zone, at_mm: DVec3::X * x, exitance };
        let zones = [middle(0, 0.0, 1.0), middle(1, 1.0, 1.0), middle(2, -1.0, 0.01), middle(3, 2.0, 1.0)];
        let mixture = Mixture::near(DVec3::ZERO, 1.0, &zones);
        let weight = |zone: usize| mixture.parts().find(|part| part.0 == zone).map_or(0.0, |part| part.1);
        assert!((mixture.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!((weight(2) / weight(1) - 0.01).abs() < 1e-12 && weight(0) > weight(1), "{mixture:?}");
        // A dark point goes by distance alone where all zones are dark.
        let dark = [middle(0, 3.0, 0.0), middle(1, 1.0, 0.0)];
        assert_eq!(Mixture::near(DVec3::ZERO, 0.0, &dark).zones[0], 1);
    }
}
