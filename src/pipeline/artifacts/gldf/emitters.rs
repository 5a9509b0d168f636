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
    let mut groups = vec![(0..zones.len()).filter(lit).collect::<Vec<usize>>()];
    while groups.len() < MOST {
        // The group whose light is the most and the widest apart is cut in two.
        let Some((widest, _)) =
            groups.iter().enumerate().filter(|(_, group)| group.len() > 1).max_by(|(_, a), (_, b)| {
                let weight = |group: &[usize]| lumens(model, group) * (1e-9 + extent_mm(model, group).max_element());
                weight(a).total_cmp(&weight(b))
            })
        else {
            break;
        };
        let group = groups.swap_remove(widest);
        groups.extend(halves(model, group));
    }
    groups.sort_by_key(|group| group.first().copied());
    groups.into_iter().filter(|group| !group.is_empty()).map(|group| emitter(model, group)).collect()
}

fn lumens(model: &Model, group: &[usize]) -> f64 {
    group.iter().filter_map(|at| model.goniograms.zones[*at].goniogram.flux.luminous_lm).sum()
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
