//! Faces of a hull: it is cut along its creases, so that a vertex on the edge of a box is one vertex for each face that meets there.
//! Exitance and angular distribution may then differ from face to face, and nothing is smoothed across an edge.

use super::disjoint_sets::Groups;
use super::mesh::Hull;
use std::collections::BTreeMap;

/// Triangles whose normals have a smaller cosine, 50°, meet in a crease.
const CREASE: f64 = 0.643;
/// A face of fewer triangles is a rough place of its neighbour.
const FEWEST_TRIANGLES: u32 = 24;
/// A face holds at least this part of its surface's area.
const LEAST_AREA: f64 = 0.005;

/// The same surface with a vertex for each face, and the faces numbered in the order of their first vertices.
pub fn cut(hull: Hull) -> Hull {
    let faces = faces(&hull);
    let mut copies: Vec<BTreeMap<u32, u32>> = vec![BTreeMap::new(); hull.vertices_mm.len()];
    for (corners, face) in hull.triangles.iter().zip(&faces) {
        corners.iter().for_each(|corner| {
            copies[*corner as usize].insert(*face, 0);
        });
    }
    let (mut vertices_mm, mut part_of_vertex) = (Vec::new(), Vec::new());
    let (mut face_of_vertex, mut place_of_vertex) = (Vec::new(), Vec::new());
    let mut numbers = BTreeMap::new();
    for (vertex, copies) in copies.iter_mut().enumerate() {
        for (face, copy) in copies.iter_mut() {
            let next = numbers.len() as u32;
            *copy = vertices_mm.len() as u32;
            vertices_mm.push(hull.vertices_mm[vertex]);
            part_of_vertex.push(hull.part_of_vertex[vertex]);
            place_of_vertex.push(vertex as u32);
            face_of_vertex.push(*numbers.entry(*face).or_insert(next));
        }
    }
    let corner = |corner: u32, face: &u32| copies[corner as usize].get(face).copied().unwrap_or(0);
    let triangles =
        hull.triangles.iter().zip(&faces).map(|(corners, face)| corners.map(|vertex| corner(vertex, face))).collect();
    Hull { vertices_mm, part_of_vertex, face_of_vertex, place_of_vertex, triangles, ..hull }
}

/// The face of each triangle, named by its smallest triangle.
fn faces(hull: &Hull) -> Vec<u32> {
    let count = hull.triangles.len();
    let (mut faces, mut parts) = (Groups::new(count), Groups::new(count));
    let pairs = pairs(hull);
    let normals: Vec<_> = (0..count).map(|triangle| hull.normal(triangle)).collect();
    for ([a, b], _) in &pairs {
        parts.join(*a, *b);
        if normals[*a as usize].dot(normals[*b as usize]) >= CREASE {
            faces.join(*a, *b);
        }
    }
    // Rough places join the face with which they have the longest edge in common, the smallest of them first.
    loop {
        let mut areas = vec![(0.0, 0.0); count];
        for triangle in 0..count as u32 {
            let area_mm2 = hull.area_mm2(triangle as usize);
            areas[faces.of(triangle) as usize].0 += area_mm2;
            areas[parts.of(triangle) as usize].1 += area_mm2;
        }
        let sizes = faces.sizes();
        let mut edges: BTreeMap<(u32, u32), f64> = BTreeMap::new();
        for ([a, b], length_mm) in &pairs {
            let (a, b) = (faces.of(*a), faces.of(*b));
            if a != b {
                *edges.entry((a, b)).or_insert(0.0) += length_mm;
                *edges.entry((b, a)).or_insert(0.0) += length_mm;
            }
        }
        let mut joined = false;
        for face in 0..count as u32 {
            let whole = areas[parts.of(face) as usize].1;
            let small =
                |face: u32| sizes[face as usize] < FEWEST_TRIANGLES || areas[face as usize].0 < LEAST_AREA * whole;
            if sizes[face as usize] == 0 || !small(face) {
                continue;
            }
            let neighbours = edges.range((face, 0)..=(face, u32::MAX));
            let longest = neighbours.max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(a.0)));
            if let Some(((_, other), _)) = longest {
                faces.join(face, *other);
                joined = true;
            }
        }
        if !joined {
            return (0..count as u32).map(|triangle| faces.of(triangle)).collect();
        }
    }
}

/// Pairs of triangles with an edge in common, and its length, mm.
fn pairs(hull: &Hull) -> Vec<([u32; 2], f64)> {
    let mut edges: BTreeMap<(u32, u32), Vec<u32>> = BTreeMap::new();
    for (triangle, [a, b, c]) in hull.triangles.iter().enumerate() {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            edges.entry((*from.min(to), *from.max(to))).or_default().push(triangle as u32);
        }
    }
    let length = |(a, b): (u32, u32)| hull.vertices_mm[a as usize].distance(hull.vertices_mm[b as usize]);
    let pair = |(edge, triangles): ((u32, u32), Vec<u32>)| match triangles[..] {
        [a, b] => Some(([a, b], length(edge))),
        _ => None,
    };
    edges.into_iter().filter_map(pair).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::mesh::Label;
    use crate::vocabulary::notice::Notices;
    use glam::DVec3;

    /// A box of `n`³ cells with `n`² quads on each side, bent by `bend`.
    fn block(n: u32, bend: impl Fn(DVec3) -> DVec3) -> Hull {
        let mut places: BTreeMap<[u32; 3], u32> = BTreeMap::new();
        let mut vertices_mm = Vec::new();
        let mut triangles = Vec::new();
        for (axis, far) in [(0, false), (0, true), (1, false), (1, true), (2, false), (2, true)] {
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let corner = |(u, v): (u32, u32)| {
                    let mut place = [if far { n } else { 0 }; 3];
                    (place[(axis + 1) % 3], place[(axis + 2) % 3]) = (u, v);
                    place
                };
                let quad = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|at| {
                    let place = corner(at);
                    *places.entry(place).or_insert_with(|| {
                        vertices_mm.push(bend(DVec3::from(place.map(f64::from)) / f64::from(n) - 0.5));
                        vertices_mm.len() as u32 - 1
                    })
                });
                let [a, b, c, d] = if far { quad } else { [quad[3], quad[2], quad[1], quad[0]] };
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        let count = vertices_mm.len();
        Hull {
            labels: vec![Label::Projected; triangles.len()],
            part_of_vertex: vec![0; count],
            face_of_vertex: vec![0; count],
            place_of_vertex: (0..count as u32).collect(),
            vertices_mm,
            triangles,
            cell_mm: DVec3::splat(1.0 / f64::from(n)),
            resolution: n,
            max_edge_mm: 1.0,
            focal: None,
            notices: Notices::default(),
        }
    }

    #[test]
    fn a_box_has_six_faces_and_stays_closed() {
        let whole = block(8, |place| place);
        let hull = cut(whole.clone());
        assert_eq!(hull.face_count(), 6);
        assert_eq!(hull.vertices_mm.len(), 6 * 81);
        assert_eq!((hull.check(), hull.boundary_edges(), hull.euler_characteristics()), (vec![], 0, vec![2]));
        assert!((hull.total_area_mm2() - whole.total_area_mm2()).abs() < 1e-12);
        for (vertex, normal) in hull.vertex_normals().iter().enumerate() {
            assert!(normal.abs().max_element() > 1.0 - 1e-12, "vertex {vertex} looks along {normal}");
        }
    }

    #[test]
    fn a_ball_has_one_face_and_is_left_as_it_is() {
        let ball = block(8, |place| place.normalize_or_zero());
        assert_eq!(cut(ball.clone()), ball);
    }

    /// One raised corner is no face of its own.
    #[test]
    fn a_rough_place_is_part_of_its_face() {
        let hull =
            cut(block(8, |place| if place.x == 0.0 && place.y == 0.0 && place.z == 0.5 { 1.4 * place } else { place }));
        assert_eq!(hull.face_count(), 6);
    }
}
