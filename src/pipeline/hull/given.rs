//! A surface whose vertices and triangles are given, as a model's own file has them: what else a hull knows is found from them.

use super::disjoint_sets::Groups;
use super::mesh::{Hull, Label};
use crate::vocabulary::notice::Notices;
use crate::vocabulary::space::Bounds;
use glam::DVec3;
use std::collections::BTreeMap;

/// Smallest edge of a cell, mm: a missing dimension of a flat surface is tiny, never 0.
const SMALLEST_MM: f64 = 1e-9;

impl Hull {
    /// Of triangles that name existing vertices; `labels` one per triangle. Vertices at one point are one place, and faces are what hangs
    /// together by vertices; a cell is as large as the mean box of a triangle.
    pub fn given(vertices_mm: Vec<DVec3>, triangles: Vec<[u32; 3]>, labels: Vec<Label>) -> Hull {
        let place_of_vertex = places(&vertices_mm);
        let count = vertices_mm.len();
        let (mut faces, mut parts) = (Groups::new(count), Groups::new(count));
        for [a, b, c] in &triangles {
            for (from, to) in [(a, b), (b, c)] {
                faces.join(*from, *to);
                parts.join(place_of_vertex[*from as usize], place_of_vertex[*to as usize]);
            }
        }
        let face_of_vertex = numbered((0..count as u32).map(|vertex| faces.of(vertex)));
        let part_of_vertex = numbered(place_of_vertex.iter().map(|place| parts.of(*place)));
        let corners = |triangle: &[u32; 3]| triangle.map(|vertex| vertices_mm[vertex as usize]);
        let sizes: DVec3 = triangles.iter().map(|triangle| Bounds::of(corners(triangle)).size()).sum();
        let cell_mm = (sizes / triangles.len().max(1) as f64).max(DVec3::splat(SMALLEST_MM));
        let longest_mm = |triangle: &[u32; 3]| {
            let [a, b, c] = corners(triangle);
            a.distance(b).max(b.distance(c)).max(c.distance(a))
        };
        let max_edge_mm = triangles.iter().map(longest_mm).fold(0.0, f64::max);
        let whole_mm = Bounds::of(vertices_mm.iter().copied()).size();
        let resolution = (whole_mm / cell_mm).max_element().clamp(1.0, 1e9).round() as u32;
        Hull {
            vertices_mm,
            triangles,
            labels,
            part_of_vertex,
            face_of_vertex,
            place_of_vertex,
            cell_mm,
            resolution,
            max_edge_mm,
            focal: None,
            notices: Notices::default(),
        }
    }

    /// Both surfaces as one. Nothing is joined: what lies at one point stays two places.
    #[must_use]
    pub fn beside(mut self, other: &Hull) -> Hull {
        let offset = |list: &[u32]| list.iter().max().map_or(0, |last| last + 1);
        let mut append = |own: fn(&mut Hull) -> &mut Vec<u32>, more: &[u32]| {
            let list = own(&mut self);
            let first = offset(list);
            list.extend(more.iter().map(|number| first + number));
        };
        append(|hull| &mut hull.part_of_vertex, &other.part_of_vertex);
        append(|hull| &mut hull.face_of_vertex, &other.face_of_vertex);
        append(|hull| &mut hull.place_of_vertex, &other.place_of_vertex);
        let first = self.vertices_mm.len() as u32;
        self.vertices_mm.extend(&other.vertices_mm);
        self.triangles.extend(other.triangles.iter().map(|corners| corners.map(|vertex| first + vertex)));
        self.labels.extend(&other.labels);
        self.cell_mm = self.cell_mm.min(other.cell_mm);
        self.resolution = self.resolution.max(other.resolution);
        self.max_edge_mm = self.max_edge_mm.max(other.max_edge_mm);
        self
    }
}

/// Vertices at exactly one point have one place, numbered in the order of the first of them.
fn places(vertices_mm: &[DVec3]) -> Vec<u32> {
    let mut known = BTreeMap::new();
    let mut place = |point_mm: &DVec3| {
        let next = known.len() as u32;
        // Adding zero turns -0 into 0.
        *known.entry(point_mm.to_array().map(|mm| (mm + 0.0).to_bits())).or_insert(next)
    };
    vertices_mm.iter().map(&mut place).collect()
}

/// Names as numbers from 0, in the order in which they come first.
fn numbered(names: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut known = BTreeMap::new();
    let mut number = |name| {
        let next = known.len() as u32;
        *known.entry(name).or_insert(next)
    };
    names.map(&mut number).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two unit squares at right angles, each with vertices of its own along the edge where they meet.
    fn bent() -> Hull {
        let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
        let floor = [at(0.0, 0.0, 0.0), at(1.0, 0.0, 0.0), at(1.0, 1.0, 0.0), at(0.0, 1.0, 0.0)];
        let wall = [at(1.0, 0.0, -0.0), at(1.0, 0.0, 1.0), at(1.0, 1.0, 1.0), at(1.0, 1.0, 0.0)];
        let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        Hull::given([floor, wall].concat(), triangles, vec![Label::Projected; 4])
    }

    #[test]
    fn places_parts_and_faces_are_found() {
        let hull = bent();
        assert_eq!(hull.place_of_vertex, [0, 1, 2, 3, 1, 4, 5, 2]);
        assert_eq!((hull.part_count(), hull.face_count()), (1, 2));
        assert_eq!((hull.total_area_mm2(), hull.max_edge_mm), (2.0, 2.0_f64.sqrt()));
        assert!(hull.check().is_empty(), "{:?}", hull.check());
        // Two triangles of 1 x 1 x 0 and two of 0 x 1 x 1.
        assert_eq!((hull.cell_mm, hull.resolution), (DVec3::new(0.5, 1.0, 0.5), 2));
    }

    #[test]
    fn surfaces_side_by_side_stay_two() {
        let both = bent().beside(&bent());
        assert_eq!((both.vertices_mm.len(), both.triangles.len(), both.labels.len()), (16, 8, 8));
        assert_eq!((both.part_count(), both.face_count(), both.total_area_mm2()), (2, 4, 4.0));
        assert!(both.check().is_empty(), "{:?}", both.check());
    }
}
