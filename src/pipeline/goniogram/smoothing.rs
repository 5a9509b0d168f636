//! From counts to angular distributions: the whole source's from a prior of even radiance, each zone's from the whole's radiance.

use super::ancestry::Ancestry;
use super::sphere::SphereGrid;
use crate::smoothing::{
    Caution, Counted, DIRECTIONS, Edge, Levels, PLACES, Refined, Sharing, Trust, refine, refine_all,
};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

/// Part of a prior that is the counts themselves, blurred: no direction that light was seen in is dark beforehand.
const SEEN: f64 = 1e-3;
/// Least cosine by which radiances of zones are compared: below it a surface shows its edge.
const GRAZING: f64 = 1e-3;
/// Part of the flux that zones of a kind may send elsewhere than the kind does while they count as alike.
const EVEN: f64 = 0.05;
/// How often a group of zones was halved into those that are estimated from it.
const HALVINGS: u32 = 2;
/// Rounds of proportional fitting, after which zones add up to the whole.
const ROUNDS: usize = 4;

/// A grid of directions with the neighbourhoods of its cells.
pub struct Directions<'a> {
    grid: &'a SphereGrid,
    levels: Levels,
    /// The rings of cells of one γ.
    rings: Levels,
    solid_angles_sr: Vec<f64>,
    /// Directions spread over each cell, and the solid angle that each stands for.
    samples: Vec<Vec<(DVec3, f64)>>,
}

/// Directions along each side of a cell at which what is not linear in it is looked at.
const SAMPLES: usize = 3;

/// Directions spread over each cell of `grid`, and the solid angle that each stands for.
fn samples(grid: &SphereGrid) -> Vec<Vec<(DVec3, f64)>> {
    let (last, planes) = (grid.gamma_nodes() - 1, grid.c_planes());
    let dc = TAU / planes as f64;
    let nodes = grid.cell_nodes();
    let of_cell = |(cell, (c, _)): (usize, &(f64, f64))| {
        let cap = cell == 0 || cell + 1 == nodes.len();
        let (width, columns) = if cap { (TAU, SAMPLES * planes) } else { (dc, SAMPLES) };
        let node = if cell == 0 { 0 } else { ((cell - 1) / planes + 1).min(last) };
        let [low, high] = grid.gamma_borders(node);
        let at = |row: usize| low + (high - low) * row as f64 / SAMPLES as f64;
        let row = |row: usize| {
            let (from, to) = (at(row), at(row + 1));
            let (gamma, sr) = (0.5 * (from + to), (from.cos() - to.cos()) * width / columns as f64);
            (0..columns).map(move |column| {
                let c = c - 0.5 * width + width * (column as f64 + 0.5) / columns as f64;
                (DVec3::new(gamma.sin() * c.cos(), gamma.sin() * c.sin(), -gamma.cos()), sr)
            })
        };
        (0..SAMPLES).flat_map(row).collect()
    };
    nodes.par_iter().enumerate().map(of_cell).collect()
}

impl<'a> Directions<'a> {
    /// The cells of `grid`, each joined to its neighbours as strongly as their common edge is long and their nodes are close; uneven nodes of
    /// γ count as even ones, so that a narrow beam is seen as wide as its grid shows it.
    pub fn new(grid: &'a SphereGrid) -> Directions<'a> {
        let nodes = SphereGrid::new(grid.gamma_nodes() - 1, grid.c_planes()).cell_nodes();
        let at = |(c, gamma): &(f64, f64)| DVec3::new(gamma.sin() * c.cos(), gamma.sin() * c.sin(), gamma.cos());
        let points: Vec<DVec3> = nodes.iter().map(at).collect();
        let (last, planes) = (grid.gamma_nodes() - 1, grid.c_planes());
        let (dg, dc) = (PI / last as f64, TAU / planes as f64);
        let mut edges: Vec<Edge> = Vec::new();
        for c in 0..planes {
            for k in 0..last {
                let [from, to] = [k, k + 1].map(|k| grid.cell_of_node(c, k) as u32);
                edges.push((from, to, ((k as f64 + 0.5) * dg).sin() * dc / dg));
            }
            for k in (1..last).filter(|_| planes > 1) {
                let [from, to] = [c, (c + 1) % planes].map(|c| grid.cell_of_node(c, k) as u32);
                edges.push((from, to, dg / ((k as f64 * dg).sin() * dc)));
            }
        }
        let spacing = (4.0 * PI / points.len() as f64).sqrt();
        let levels = Levels::new(&points, &vec![0; points.len()], &edges, spacing, Sharing::None, DIRECTIONS);
        let gammas: Vec<DVec3> = (0..=last).map(|k| DVec3::new(0.0, 0.0, k as f64 * dg)).collect();
        let steps: Vec<Edge> = (0..last as u32).map(|k| (k, k + 1, ((f64::from(k) + 0.5) * dg).sin())).collect();
        let rings = Levels::new(&gammas, &vec![0; last + 1], &steps, dg, Sharing::None, PLACES);
        Directions { grid, levels, rings, solid_angles_sr: grid.cell_solid_angles_sr(), samples: samples(grid) }
    }

    /// Projected solid angles: ∫ max(0, n · ω) dω over each cell, for the normals of each of `zones` (in the photometric frame: γ = 0 at
    /// −z) times their weights; the light of surfaces of radiance 1. sr.
    pub fn projected_sr(&self, zones: &[Vec<(DVec3, f64)>]) -> Vec<Vec<f64>> {
        let of_zone = |normals: &Vec<(DVec3, f64)>| {
            let cosine = |direction: &DVec3| normals.iter().map(|(n, w)| w * n.dot(*direction).max(0.0)).sum::<f64>();
            self.fluxes(cosine)
        };
        zones.par_iter().map(of_zone).collect()
    }

    /// Flux into each cell of an intensity, given in directions with γ = 0 at −z.
    pub fn fluxes(&self, intensity: impl Fn(&DVec3) -> f64) -> Vec<f64> {
        let of_cell = |cell: &Vec<(DVec3, f64)>| cell.iter().map(|(direction, sr)| sr * intensity(direction)).sum();
        self.samples.iter().map(of_cell).collect()
    }

    /// `prior` with the distribution over γ that was counted, smoothed: what a source that is alike all round would send.
    fn turned(&self, counted: &[f64], prior: &[f64], ray: f64, caution: Caution) -> Refined {
        let last = self.grid.gamma_nodes() - 1;
        let mut ring_of_cell = vec![0; prior.len()];
        for (c, k) in (0..self.grid.c_planes()).flat_map(|c| (0..=last).map(move |k| (c, k))) {
            ring_of_cell[self.grid.cell_of_node(c, k)] = k;
        }
        let ring_sums = |cells: &[f64]| {
            let mut sums = vec![0.0; last + 1];
            cells.iter().zip(&ring_of_cell).for_each(|(amount, ring)| sums[*ring] += amount);
            sums
        };
        let expected = ring_sums(prior);
        let sums = ring_sums(counted);
        let counted = Counted { trust: Trust::Own, ..Counted::new(&sums, &expected, ray, caution) };
        let refined = refine(&self.rings, &counted);
        let factor = |ring: usize| if expected[ring] > 0.0 { refined.amounts[ring] / expected[ring] } else { 0.0 };
        Refined {
            amounts: prior.iter().zip(&ring_of_cell).map(|(amount, ring)| amount * factor(*ring)).collect(),
            variance: ring_of_cell.iter().map(|ring| refined.variance[*ring]).collect(),
        }
    }

    /// Flux per cell of a source that sends equally into all directions, as far as `counted` does not say otherwise.
    pub fn even(&self, counted: &[f64], ray: f64) -> Refined {
        self.estimate(counted, &self.turned(counted, &self.solid_angles_sr, ray, Caution::Row), ray)
    }

    /// Flux per cell of a source whose cells counted `counted`, from the form `prior`.
    fn estimate(&self, counted: &[f64], prior: &Refined, ray: f64) -> Refined {
        self.estimates(&[(counted, prior)], ray, Caution::Smooth).pop().unwrap_or_default()
    }

    /// As [`Directions::estimate`], of several sources.
    fn estimates(&self, sources: &[(&[f64], &Refined)], ray: f64, caution: Caution) -> Vec<Refined> {
        let expected = |(counted, prior): &(&[f64], &Refined)| -> Vec<f64> {
            let total: f64 = counted.iter().sum();
            let scale = |values: &[f64]| total / values.iter().sum::<f64>().max(f64::MIN_POSITIVE);
            let blurred = self.levels.blurred(counted, &self.solid_angles_sr);
            let (a, b) = ((1.0 - SEEN) * scale(&prior.amounts), SEEN * scale(&blurred));
            prior.amounts.iter().zip(&blurred).map(|(prior, seen)| a * prior + b * seen).collect()
        };
        let expected: Vec<Vec<f64>> = sources.par_iter().map(expected).collect();
        let counted =
            sources.iter().zip(&expected).map(|((amounts, _), prior)| Counted::new(amounts, prior, ray, caution));
        let mut refined = refine_all(&self.levels, &counted.collect::<Vec<_>>());
        for (refined, (_, prior)) in refined.iter_mut().zip(sources) {
            // The prior is made of the same rays, and has their noise.
            refined.variance.iter_mut().zip(&prior.variance).for_each(|(sum, more)| *sum += more);
        }
        refined
    }

    /// The primary flux of each zone per cell, smoothed: the whole source first, then zones of one kind together, then ever smaller groups
    /// of them, then each. `counted` and `projected_sr` per zone; `ray`: what a typical ray brings to a cell, and with its images to a ring of
    /// cells of one γ.
    pub fn zones(
        &self,
        counted: &[&[f64]],
        projected_sr: &[Vec<f64>],
        family: &[Ancestry],
        [ray, ray_of_ring]: [f64; 2],
    ) -> Estimates {
        let own = |zone: usize| Light { counted: counted[zone].to_vec(), even: projected_sr[zone].clone() };
        let zones: Vec<Light> = (0..counted.len()).map(own).collect();
        let kind_count = Ancestry::kinds(family);
        let members = |kind: u32| (0..zones.len()).filter(move |zone| family[*zone].kind == kind);
        let groups: Vec<Light> =
            (0..kind_count).map(|kind| Light::sum(members(kind).map(|zone| &zones[zone]))).collect();
        let whole = Light::sum(groups.iter());
        let turned = self.turned(&whole.counted, &whole.even, ray_of_ring, Caution::Row);
        let refined = self.estimate(&whole.counted, &turned, ray);
        let of_kinds = self.parted(&whole, &refined, &groups.iter().collect::<Vec<_>>(), ray);
        let mut all: Vec<Refined> = vec![Refined::default(); zones.len()];
        let mut even_kinds = Vec::new();
        for ((kind, group), refined) in (0..).zip(&groups).zip(&of_kinds) {
            let ids: Vec<usize> = members(kind).collect();
            let parts = self.descended(group, refined, &zones, (&ids, family), 0, ray);
            let moved: f64 = parts.iter().map(|(_, part)| difference(&part.amounts, &refined.amounts)).sum();
            even_kinds.push(moved <= EVEN * group.flux());
            parts.into_iter().for_each(|(zone, part)| all[zone] = part);
        }
        Estimates { whole: refined, zones: all, kinds: of_kinds, even_kinds }
    }

    /// The zones `ids` of a whole, each with its number: groups of them, which were parted from each other last, from the whole's
    /// radiance, then their zones likewise. `depth`: how often the whole itself was halved.
    fn descended(
        &self,
        whole: &Light,
        refined: &Refined,
        zones: &[Light],
        (ids, family): (&[usize], &[Ancestry]),
        depth: u32,
        ray: f64,
    ) -> Vec<(usize, Refined)> {
        if let [zone] = ids {
            return vec![(*zone, refined.clone())];
        }
        let mut groups: BTreeMap<(u32, Option<usize>), Vec<usize>> = BTreeMap::new();
        for zone in ids {
            // Zones that were never parted, those of a lattice, are groups of their own.
            let alone = family[*zone].is_whole_at(depth).then_some(*zone);
            groups.entry((family[*zone].at(depth + HALVINGS), alone)).or_default().push(*zone);
        }
        let groups: Vec<(Light, Vec<usize>)> =
            groups.into_values().map(|ids| (Light::sum(ids.iter().map(|zone| &zones[*zone])), ids)).collect();
        let parts = self.parted(whole, refined, &groups.iter().map(|(light, _)| light).collect::<Vec<_>>(), ray);
        let descended = |((light, ids), part): (&(Light, Vec<usize>), &Refined)| {
            self.descended(light, part, zones, (ids, family), depth + HALVINGS, ray)
        };
        groups.par_iter().zip(&parts).flat_map_iter(descended).collect()
    }

    /// The parts of a whole, each from the whole's radiance, so that they add up to it.
    fn parted(&self, whole: &Light, refined: &Refined, parts: &[&Light], ray: f64) -> Vec<Refined> {
        if parts.len() == 1 {
            return vec![refined.clone()];
        }
        let turned = |part: &&Light| {
            let of = |cell: usize| {
                let grazing = GRAZING * self.solid_angles_sr[cell];
                refined.amounts[cell] * (part.even[cell] + grazing) / (whole.even[cell] + grazing)
            };
            let prior: Vec<f64> = (0..self.solid_angles_sr.len()).map(of).collect();
            let mut turned = self.turned(&part.counted, &prior, ray, Caution::Smooth);
            turned.variance.iter_mut().zip(&refined.variance).for_each(|(sum, more)| *sum += more);
            turned
        };
        let turned: Vec<Refined> = parts.par_iter().map(turned).collect();
        let sources = parts.iter().zip(&turned).map(|(part, turned)| (part.counted.as_slice(), turned));
        let mut zones = self.estimates(&sources.collect::<Vec<_>>(), ray, Caution::Edges);
        add_up(&mut zones, &refined.amounts);
        zones
    }

    /// Other quantities, each counted beside one whose form is nearly its own.
    pub fn like(&self, counted: &[Counted<'_>]) -> Vec<Vec<f64>> {
        refine_all(&self.levels, counted).into_iter().map(|refined| refined.amounts).collect()
    }
}

/// What was found of the zones.
pub struct Estimates {
    /// The flux of all zones together per cell.
    pub whole: Refined,
    /// The flux of each zone per cell.
    pub zones: Vec<Refined>,
    /// The flux of all zones of a kind together.
    pub kinds: Vec<Refined>,
    /// Whether zones of a kind send their light alike, as far as the rays tell.
    pub even_kinds: Vec<bool>,
}

impl Estimates {
    /// What was found of zones of even kinds gives way to what was found of their kind; `zone_of_zone` and `family` as
    /// the zoning's `merge` leaves them.
    pub fn merge(&mut self, zone_of_zone: &[u32], family: &[Ancestry]) {
        let merged = |(zone, ancestry): (usize, &Ancestry)| {
            let kind = ancestry.kind as usize;
            if self.even_kinds[kind] {
                return std::mem::take(&mut self.kinds[kind]);
            }
            let own = zone_of_zone.iter().position(|new| *new as usize == zone);
            own.map(|own| std::mem::take(&mut self.zones[own])).unwrap_or_default()
        };
        self.zones = family.iter().enumerate().map(merged).collect();
    }
}

/// Σ |a − b of the same sum|: the flux of `a` that goes elsewhere, twice.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    let (flux, whole): (f64, f64) = (a.iter().sum(), b.iter().sum());
    let scale = if whole > 0.0 { flux / whole } else { 0.0 };
    a.iter().zip(b).map(|(a, b)| (a - scale * b).abs()).sum()
}

/// What one or more zones send into each cell.
struct Light {
    /// As counted.
    counted: Vec<f64>,
    /// What a surface with their normals would send at radiance 1: flux-weighted mean of their projected solid angles, sr.
    even: Vec<f64>,
}

impl Light {
    fn flux(&self) -> f64 {
        self.counted.iter().sum()
    }

    fn sum<'l>(parts: impl Iterator<Item = &'l Light> + Clone) -> Light {
        let total: f64 = parts.clone().map(Light::flux).sum();
        let cells = parts.clone().next().map_or(0, |part| part.counted.len());
        let mut whole = Light { counted: vec![0.0; cells], even: vec![0.0; cells] };
        for part in parts {
            add(&mut whole.counted, &part.counted, 1.0);
            add(&mut whole.even, &part.even, if total > 0.0 { part.flux() / total } else { 0.0 });
        }
        whole
    }
}

/// Adds `factor` times `more`.
pub fn add(sums: &mut [f64], more: &[f64], factor: f64) {
    sums.iter_mut().zip(more).for_each(|(sum, more)| *sum += factor * more);
}

/// Zones that add up to `whole` in each cell, as nearly as each zone's flux allows.
pub fn add_up(zones: &mut [Refined], whole: &[f64]) {
    let fluxes: Vec<f64> = zones.iter().map(|zone| zone.amounts.iter().sum()).collect();
    (0..ROUNDS).for_each(|_| fit(zones, whole, &fluxes));
}

/// One round: the zones of a cell in proportion to the whole's, then each zone in proportion to its flux.
fn fit(zones: &mut [Refined], whole: &[f64], fluxes: &[f64]) {
    let mut sums = vec![0.0; whole.len()];
    zones.iter().for_each(|zone| add(&mut sums, &zone.amounts, 1.0));
    let factors: Vec<f64> = sums
        .iter()
        .zip(whole)
        .map(|(sum, whole)| if *sum > 0.0 { (whole / sum).clamp(0.05, 20.0) } else { 1.0 })
        .collect();
    zones.par_iter_mut().zip(fluxes).for_each(|(zone, flux)| {
        zone.amounts.iter_mut().zip(&factors).for_each(|(amount, factor)| *amount *= factor);
        let sum: f64 = zone.amounts.iter().sum();
        let scale = if sum > 0.0 { flux / sum } else { 0.0 };
        zone.amounts.iter_mut().for_each(|amount| *amount *= scale);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    /// Counts of `rays` rays of the distribution `share` (per cell, sum 1).
    fn count(share: &[f64], rays: usize, seed: u64) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut sums = vec![0.0];
        share.iter().for_each(|share| sums.push(sums[sums.len() - 1] + share));
        let mut counts = vec![0.0; share.len()];
        for _ in 0..rays {
            let at = random.next_u64() as f64 / u64::MAX as f64 * sums[share.len()];
            counts[sums.partition_point(|sum| *sum <= at).clamp(1, share.len()) - 1] += 1.0;
        }
        counts
    }

    /// Relative L2 error of intensities.
    fn error(found: &[f64], exact: &[f64], solid_angles_sr: &[f64]) -> f64 {
        let sum = |of: &dyn Fn(usize) -> f64| (0..exact.len()).map(|k| of(k).powi(2) / solid_angles_sr[k]).sum::<f64>();
        let (scale, total) = (exact.iter().sum::<f64>(), found.iter().sum::<f64>());
        (sum(&|k| found[k] / total - exact[k] / scale) / sum(&|k| exact[k] / scale)).sqrt()
    }

    /// A distribution that rises with the cosine to `axis` to the power `m`; sum 1.
    fn lobe(directions: &Directions<'_>, axis: DVec3, m: f64) -> Vec<f64> {
        let of = |((c, gamma), sr): ((f64, f64), &f64)| {
            let direction = DVec3::new(gamma.sin() * c.cos(), gamma.sin() * c.sin(), -gamma.cos());
            sr * direction.dot(axis.normalize()).max(0.0).powf(m)
        };
        let lobe: Vec<f64> =
            directions.grid.cell_nodes().into_iter().zip(&directions.solid_angles_sr).map(of).collect();
        let sum: f64 = lobe.iter().sum();
        lobe.into_iter().map(|value| value / sum).collect()
    }

    /// Of the counts' own error at most the part stands: more is left where the prior is farther off, and nothing is added where it is
    /// right. The counts' error is that of independent rays, √(cells/rays) for an even field.
    #[test]
    fn estimates_are_better_than_counts() {
        let grid = SphereGrid::new(72, 72);
        let directions = Directions::new(&grid);
        let solid_angles_sr = directions.solid_angles_sr.clone();
        let even: Vec<f64> = solid_angles_sr.iter().map(|sr| sr / (4.0 * PI)).collect();
        let [lambert, tilted, narrow] =
            [(DVec3::NEG_Z, 1.0), (DVec3::new(0.3, 0.0, -1.0), 1.0), (DVec3::new(0.6, 0.0, -0.8), 10.0)]
                .map(|(axis, m)| lobe(&directions, axis, m));
        for rays in [10_000, 100_000, 1_000_000] {
            for (name, exact, prior, part) in [
                ("even", &even, &even, 0.1),
                ("a cosine", &lambert, &lambert, 0.1),
                ("a tilted cosine from an upright one", &tilted, &lambert, 0.4),
                ("a tilted beam from a cosine", &narrow, &lambert, 0.6),
            ] {
                let counted = count(exact, rays, 1);
                let raw = error(&counted, exact, &solid_angles_sr);
                let turned = directions.turned(&counted, prior, 1.0, Caution::Row);
                let even = Refined { amounts: prior.clone(), variance: vec![0.0; prior.len()] };
                for from in [&even, &turned] {
                    let found = directions.estimate(&counted, from, 1.0);
                    let left = error(&found.amounts, exact, &solid_angles_sr) / raw;
                    println!("{rays} rays, {name}: {left:.3} of {raw:.4} is left");
                    assert!(left < part, "{rays} rays, {name}: {left:.3} of {raw:.4} is left");
                    let sum: f64 = found.amounts.iter().sum();
                    assert!((sum / rays as f64 - 1.0).abs() < 1e-12, "{name}: {sum} of {rays} rays");
                }
            }
        }
    }

    /// A round beam with a flat top and a steep side, counted with eight images of each ray round the axis: images are no more rays, so what
    /// is left of the profile's noise is less than the rays' own, which is √(cells / rays) for rings.
    #[test]
    fn images_are_no_more_rays_all_round() {
        let grid = SphereGrid::new(72, 72);
        let directions = Directions::new(&grid);
        let planes = grid.c_planes();
        let side = |gamma: f64| 1.0 / (1.0 + ((gamma.to_degrees() - 60.0) / 4.0).exp());
        let beam: Vec<f64> = grid
            .cell_nodes()
            .iter()
            .zip(&directions.solid_angles_sr)
            .map(|((_, gamma), sr)| sr * side(*gamma))
            .collect();
        let rays = 100_000;
        let counted = count(&beam, rays, 1);
        let mut all_round = vec![0.0; counted.len()];
        for (c, k) in (0..planes).flat_map(|c| (0..grid.gamma_nodes()).map(move |k| (c, k))) {
            let images = (0..8).map(|image| counted[grid.cell_of_node((c + image * planes / 8) % planes, k)]);
            all_round[grid.cell_of_node(c, k)] = images.sum::<f64>() / 8.0;
        }
        let profile = |cells: &[f64]| -> Vec<f64> {
            (0..grid.gamma_nodes()).map(|k| (0..planes).map(|c| cells[grid.cell_of_node(c, k)]).sum()).collect()
        };
        let sr = profile(&directions.solid_angles_sr);
        let exact = profile(&beam);
        let raw = error(&profile(&counted), &exact, &sr);
        let cosine = vec![directions.projected_sr(&[vec![(DVec3::NEG_Z, 1.0)]]).remove(0)];
        let found = |ray_of_ring: f64| {
            let found = directions.zones(&[&all_round], &cosine, &[Ancestry::whole(0)], [0.125, ray_of_ring]);
            error(&profile(&found.whole.amounts), &exact, &sr) / raw
        };
        let (rightly, as_many_rays) = (found(1.0), found(0.125));
        println!("of {raw:.4}, {rightly:.3} is left; taken for eight rays, {as_many_rays:.3}");
        assert!(rightly < 0.7 && rightly < as_many_rays, "{rightly} of {raw} is left, {as_many_rays}");
    }

    /// ∫ max(0, n · ω) dω = π whatever n, and the half of it that a square of the sphere holds for a normal in its border.
    #[test]
    fn projected_solid_angles_sum_to_pi() {
        for (gamma, c) in [(36, 36), (72, 72), (180, 24)] {
            let grid = SphereGrid::new(gamma, c);
            let directions = Directions::new(&grid);
            for normal in [DVec3::NEG_Z, DVec3::X, DVec3::new(0.3, -0.5, 0.7).normalize()] {
                let sum: f64 = directions.projected_sr(&[vec![(normal, 0.25), (normal, 0.75)]])[0].iter().sum();
                assert!((sum / PI - 1.0).abs() < 2e-3, "{gamma} x {c}: {sum}");
            }
        }
    }
}
