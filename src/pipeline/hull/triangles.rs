//! From quads to triangles: sound ones, of the sizes that the filter admits, with no vertex left over.

use super::disjoint_sets::Groups;
use super::lattice::Lattice;
use super::mesh::{Hull, Label};
use super::vertices::Placed;
use super::weld::{Joined, Quad};
use crate::vocabulary::notice::Notices;
use glam::DVec3;

/// A triangle has turned too far when the cosine between its normal and the lattice's is smaller.
const TURNED: f64 = 0.2;
/// A triangle is degenerate when it has less of half its quad's area on the lattice.
const SHRUNK: f64 = 1e-3;
/// How often an unsound triangle's vertices go back half the way to the lattice before they go back all the way.
const HALVINGS: usize = 6;
/// Diagonals that differ by a smaller share are equally long.
const EQUAL: f64 = 1e-9;

/// Puts the hull together.
pub fn build(joined: &Joined, places: &[Placed], lattice: &Lattice, max_edge_mm: f64, notices: Notices) -> Hull {
    let vertices_mm = sound(joined, places, lattice);
    let (mut triangles, mut labels) = (Vec::new(), Vec::new());
    for quad in &joined.quads {
        for triangle in halves(quad, &vertices_mm) {
            let [a, b, c] = triangle.map(|vertex| vertices_mm[vertex as usize]);
            let longest_mm = a.distance(b).max(b.distance(c)).max(c.distance(a));
            if quad.label == Label::Projected || longest_mm <= max_edge_mm {
                triangles.push(triangle);
                labels.push(quad.label);
            }
        }
    }
    let mut hull = Hull {
        vertices_mm,
        triangles,
        labels,
        part_of_vertex: Vec::new(),
        face_of_vertex: Vec::new(),
        place_of_vertex: Vec::new(),
        cell_mm: lattice.cell_mm,
        resolution: lattice.resolution(),
        max_edge_mm,
        focal: None,
        notices,
    };
    drop_unused_vertices(&mut hull);
    number_parts(&mut hull);
    hull
}

/// Two triangles by the shorter diagonal; by the first vertex's when they are equally long.
fn halves(quad: &Quad, vertices_mm: &[DVec3]) -> [[u32; 3]; 2] {
    let [a, b, c, d] = quad.vertices;
    let length_mm = |from: u32, to: u32| vertices_mm[from as usize].distance(vertices_mm[to as usize]);
    if length_mm(b, d) < length_mm(a, c) * (1.0 - EQUAL) { [[a, b, d], [b, c, d]] } else { [[a, b, c], [a, c, d]] }
}

/// Takes vertices back towards their lattice nodes until every triangle is sound; on the lattice itself all are.
fn sound(joined: &Joined, places: &[Placed], lattice: &Lattice) -> Vec<DVec3> {
    let mut places_mm: Vec<DVec3> = places.iter().map(|place| place.at_mm).collect();
    let is_sound = |quad: &Quad, places_mm: &[DVec3]| {
        let outward =
            quad.vertices.iter().map(|vertex| places[*vertex as usize].normal).sum::<DVec3>().normalize_or_zero();
        halves(quad, places_mm).iter().all(|half| is_sound(*half, [quad.normal, outward], places_mm, lattice))
    };
    for round in 0.. {
        let mut unsound: Vec<u32> =
            joined.quads.iter().filter(|quad| !is_sound(quad, &places_mm)).flat_map(|quad| quad.vertices).collect();
        if unsound.is_empty() {
            break;
        }
        unsound.sort_unstable();
        unsound.dedup();
        let kept = if round < HALVINGS { 0.5 } else { 0.0 };
        for vertex in unsound {
            let (node_mm, place_mm) = (lattice.node_mm(joined.nodes[vertex as usize]), &mut places_mm[vertex as usize]);
            *place_mm = node_mm + kept * (*place_mm - node_mm);
        }
    }
    places_mm
}

/// A triangle has area and faces outward, by the normal of its quad on the lattice or by that of the surface: a riser between two
/// terraces of a slope ends up in the slope.
fn is_sound(triangle: [u32; 3], outward: [DVec3; 2], places_mm: &[DVec3], lattice: &Lattice) -> bool {
    let [a, b, c] = triangle.map(|vertex| places_mm[vertex as usize]);
    let area = (b - a).cross(c - a);
    let on_lattice = lattice.cell_mm.element_product() / lattice.cell_mm.dot(outward[0].abs());
    let faces_outward = outward.iter().any(|outward| area.dot(*outward) >= TURNED * area.length());
    faces_outward && area.length() >= SHRUNK * on_lattice
}

fn drop_unused_vertices(hull: &mut Hull) {
    let mut used = vec![false; hull.vertices_mm.len()];
    for vertex in hull.triangles.iter().flatten() {
        used[*vertex as usize] = true;
    }
    let mut next = 0;
    let renamed: Vec<u32> = used
        .iter()
        .map(|used| {
            next += u32::from(*used);
            next.wrapping_sub(1)
        })
        .collect();
    for vertex in hull.triangles.iter_mut().flatten() {
        *vertex = renamed[*vertex as usize];
    }
    let mut used = used.into_iter();
    hull.vertices_mm.retain(|_| used.next() == Some(true));
}

fn number_parts(hull: &mut Hull) {
    let mut groups = Groups::new(hull.vertices_mm.len());
    for [a, b, c] in &hull.triangles {
        groups.join(*a, *b);
        groups.join(*a, *c);
    }
    let (mut parts, mut next) = (Vec::with_capacity(hull.vertices_mm.len()), 0);
    for vertex in 0..hull.vertices_mm.len() as u32 {
        let first = groups.of(vertex);
        // A group is named by its smallest vertex, whose part is known by now.
        parts.push(if first == vertex { next } else { parts[first as usize] });
        next += u32::from(first == vertex);
    }
    hull.face_of_vertex.clone_from(&parts);
    hull.place_of_vertex = (0..parts.len() as u32).collect();
    hull.part_of_vertex = parts;
}
