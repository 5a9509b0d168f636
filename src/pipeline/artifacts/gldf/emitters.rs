//! Light-emitting objects: each zone of the surface, or of many zones those that lie together.

use super::super::ldt;
use super::super::photometry::Part;
use crate::model::Model;
use crate::vocabulary::space::Bounds;

/// Most objects: lighting programs compute each by itself. Zones beyond are put together with their neighbours.
const MOST: usize = 64;

/// Zones that are one light-emitting object.
pub(super) struct Emitter {
    /// Ids of its zones, ascending.
    pub(super) zones: Vec<usize>,
    /// The sum of their luminous intensities, cd, `[c][gamma]`.
    candela: Vec<f64>,
    /// The box of what sends it, source frame, mm.
    pub(super) bounds_mm: Bounds,
}

impl Emitter {
    /// Its file of photometry; `number` of `count`.
    pub(super) fn ldt(&self, model: &Model, number: usize, count: usize) -> Vec<u8> {
        let part = Part {
            stem: format!("leo_{number:02}"),
            words: format!("light-emitting object {} of {count}", number + 1),
            rays: 0.0, // EULUMDAT has no place for it
            candela: &self.candela,
            bounds_mm: self.bounds_mm,
        };
        ldt::text_of(model, &part)
    }
}

/// The objects of a model whose luminous intensities are known, in the order of their first zones: all of its lit zones, each in one.
pub(super) fn emitters(model: &Model) -> Vec<Emitter> {
    let zones = &model.goniograms.zones;
    let lit = |at: &usize| zones[*at].goniogram.flux.luminous_lm.is_some_and(|lumens| lumens > 0.0);
    // Zones that face along different axes are no one rectangle: their boxes are thin in different directions.
    let faces = |at: usize| zones[at].bounds_mm.size().min_position();
    let facing = |axis: usize| (0..zones.len()).filter(lit).filter(|at| faces(*at) == axis).collect::<Vec<usize>>();
    let mut groups: Vec<Vec<usize>> = (0..3).map(facing).filter(|group| !group.is_empty()).collect();
    // First the group that covers the most of what is not its own, as the sides of a box do round its top; when there is none, the one whose
    // light is the most and the widest apart.
    let weight = |group: &[usize]| {
        let spread = lumens(model, group) * (1e-9 + extent_mm(model, group).max_element());
        (foreign_mm2(model, group), spread)
    };
    while groups.len() < MOST {
        let weighed =
            groups.iter().enumerate().filter(|(_, group)| group.len() > 1).map(|(at, group)| (weight(group), at));
        let Some((_, widest)) = weighed.max_by(|((a, c), _), ((b, d), _)| a.total_cmp(b).then(c.total_cmp(d))) else {
            break;
        };
        let group = groups.swap_remove(widest);
        groups.extend(halves(model, group));
    }
    groups.sort_by_key(|group| group.first().copied());
    groups.into_iter().map(|group| emitter(model, group)).collect()
}

fn lumens(model: &Model, group: &[usize]) -> f64 {
    group.iter().filter_map(|at| model.goniograms.zones[*at].goniogram.flux.luminous_lm).sum()
}

/// How much of the rectangle of a group is not its zones' own, mm² across γ = 0; 0 where it is less than theirs: they lie side by side.
fn foreign_mm2(model: &Model, group: &[usize]) -> f64 {
    let frame = &model.goniograms.frame;
    let across_mm2 = |bounds_mm: Bounds| {
        let [width_mm, length_mm] = [frame.c0.vector(), frame.y()].map(|axis| bounds_mm.size().dot(axis.abs()));
        width_mm * length_mm
    };
    let boxes = || group.iter().map(|at| model.goniograms.zones[*at].bounds_mm);
    let own_mm2: f64 = boxes().map(across_mm2).sum();
    let foreign_mm2 = across_mm2(boxes().fold(Bounds::EMPTY, Bounds::union)) - own_mm2;
    if foreign_mm2 > own_mm2 { foreign_mm2 } else { 0.0 }
}

fn extent_mm(model: &Model, group: &[usize]) -> glam::DVec3 {
    Bounds::of(group.iter().map(|at| model.goniograms.zones[*at].centroid_mm)).size()
}

/// Cut where half of the light lies on either side, across the direction in which the zones are the widest apart. Ids ascend within each.
fn halves(model: &Model, mut group: Vec<usize>) -> [Vec<usize>; 2] {
    let axis = extent_mm(model, &group).max_position();
    let place = |at: usize| model.goniograms.zones[at].centroid_mm[axis];
    group.sort_by(|a, b| place(*a).total_cmp(&place(*b)).then(a.cmp(b)));
    let half = 0.5 * lumens(model, &group);
    let mut below = 0.0;
    let cut = group.iter().take_while(|at| {
        below += lumens(model, &[**at]);
        below <= half
    });
    let cut = cut.count().clamp(1, group.len() - 1);
    let mut rest = group.split_off(cut);
    group.sort_unstable();
    rest.sort_unstable();
    [group, rest]
}

fn emitter(model: &Model, zones: Vec<usize>) -> Emitter {
    let mut candela = vec![0.0; model.goniograms.grid.c_planes() * model.goniograms.grid.gamma_nodes()];
    let mut bounds_mm = Bounds::EMPTY;
    for zone in zones.iter().map(|at| &model.goniograms.zones[*at]) {
        bounds_mm = bounds_mm.union(zone.bounds_mm);
        let own = zone.goniogram.luminous_cd.iter().flatten();
        candela.iter_mut().zip(own).for_each(|(sum, value)| *sum += value);
    }
    Emitter { zones, candela, bounds_mm }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::fixture;
    use crate::goniogram::Zone;
    use glam::DVec3;

    #[test]
    fn each_zone_is_an_object_and_many_are_put_together_with_their_neighbours() {
        let mut model = fixture::model();
        assert_eq!(emitters(&model).iter().map(|emitter| emitter.zones.clone()).collect::<Vec<_>>(), [[0], [1]]);
        let first = model.goniograms.zones[0].clone();
        let zone = |at: u32| Zone {
            id: at,
            centroid_mm: DVec3::new(f64::from(at % 20), f64::from(at / 20), 0.0),
            ..first.clone()
        };
        model.goniograms.zones = (0..200).map(zone).collect();
        let found = emitters(&model);
        assert_eq!(found.len(), MOST);
        let mut all: Vec<usize> = found.iter().flat_map(|emitter| emitter.zones.clone()).collect();
        all.sort_unstable();
        assert_eq!(all, (0..200).collect::<Vec<usize>>());
        // 200 equal zones in 64 objects are 3 or 4 each, or 2 of a group that was cut once more, and those lie side by side.
        for emitter in &found {
            assert!((2..=4).contains(&emitter.zones.len()), "{:?}", emitter.zones);
            assert!(extent_mm(&model, &emitter.zones).max_element() <= 3.0, "{:?}", emitter.zones);
            let peak = first.goniogram.luminous_cd.as_ref().unwrap()[0] * emitter.zones.len() as f64;
            assert!((emitter.candela[0] / peak - 1.0).abs() < 1e-12);
        }
    }

    /// A chip of 5.6 mm x 3.2 mm on a box with four dim sides: no side's object lies across the top, or across another side's.
    #[test]
    fn no_object_lies_across_others() {
        let mut model = fixture::model();
        let first = model.goniograms.zones[0].clone();
        let zone = |id: usize, min: DVec3, max: DVec3, lumens: f64| {
            let mut zone =
                Zone { id: id as u32, centroid_mm: 0.5 * (min + max), bounds_mm: Bounds { min, max }, ..first.clone() };
            zone.goniogram.flux.luminous_lm = Some(lumens);
            zone
        };
        let mut zones = Vec::new();
        for at in 0..196 {
            let min = DVec3::new(0.4 * f64::from(at % 14) - 2.8, 3.2 / 14.0 * f64::from(at / 14) - 1.6, 1.0);
            zones.push(zone(zones.len(), min, min + DVec3::new(0.4, 3.2 / 14.0, 0.0), 1.0));
        }
        for (from, along) in [
            (DVec3::new(-2.8, -1.6, 0.0), DVec3::X),
            (DVec3::new(-2.8, 1.6, 0.0), DVec3::X),
            (DVec3::new(-2.8, -1.6, 0.0), DVec3::Y),
            (DVec3::new(2.8, -1.6, 0.0), DVec3::Y),
        ] {
            let length = if along == DVec3::X { 5.6 } else { 3.2 } / 5.0;
            for part in 0..5 {
                let min = from + f64::from(part) * length * along;
                zones.push(zone(zones.len(), min, min + length * along + DVec3::Z, 0.01));
            }
        }
        model.goniograms.zones = zones;
        let found = emitters(&model);
        assert_eq!((found.len(), found.iter().map(|emitter| emitter.zones.len()).sum::<usize>()), (MOST, 216));
        for emitter in found.iter().filter(|emitter| emitter.zones.iter().any(|at| *at >= 196)) {
            let (min, max) = (emitter.bounds_mm.min, emitter.bounds_mm.max);
            let covers = |at: &usize| {
                let place = model.goniograms.zones[*at].centroid_mm;
                let is_within = [0, 1].into_iter().all(|k| min[k] < place[k] && place[k] < max[k]);
                is_within || (*at < 196 && emitter.zones.contains(at))
            };
            assert_eq!((0..216).find(covers), None, "{:?} {:?}", emitter.zones, emitter.bounds_mm);
        }
    }

    #[test]
    fn zones_at_one_place_are_cut_too_and_dark_ones_are_left_out() {
        let mut model = fixture::model();
        let first = model.goniograms.zones[0].clone();
        model.goniograms.zones = (0..100).map(|id| Zone { id, ..first.clone() }).collect();
        model.goniograms.zones[7].goniogram.flux.luminous_lm = Some(0.0);
        let found = emitters(&model);
        assert_eq!(found.len(), MOST);
        assert_eq!(found.iter().map(|emitter| emitter.zones.len()).sum::<usize>(), 99);
    }
}
