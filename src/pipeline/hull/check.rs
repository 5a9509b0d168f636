//! What every hull must satisfy: product code: every report says what it found, every test asks it.

use super::mesh::Hull;
use std::collections::BTreeMap;

/// A broken rule, with its evidence.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Broken {
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are {vertices}")]
    IndexOutOfRange {
        /// The triangle.
        triangle: usize,
        /// What it names.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
    /// A list does not have one entry per triangle or vertex.
    #[error("{list} has {found} entries, not {expected}")]
    LengthMismatch {
        /// The list's name.
        list: &'static str,
        /// Its length.
        found: usize,
        /// The length it should have.
        expected: usize,
    },
    /// A coordinate is no number.
    #[error("vertex {vertex} has a coordinate that is not finite")]
    NotFinite {
        /// The vertex.
        vertex: usize,
    },
    /// No triangle names a vertex.
    #[error("vertex {vertex} belongs to no triangle")]
    UnusedVertex {
        /// The vertex.
        vertex: usize,
    },
    /// A triangle has no area.
    #[error("triangle {triangle} has area {area_mm2} mm²")]
    Degenerate {
        /// The triangle.
        triangle: usize,
        /// Its area, mm².
        area_mm2: f64,
    },
    /// Two triangles have the same vertices.
    #[error("triangles {first} and {second} have the same vertices")]
    Duplicate {
        /// The first of them.
        first: usize,
        /// The other.
        second: usize,
    },
    /// More than two triangles meet at an edge.
    #[error("{triangles} triangles meet at the edge of vertices {from} and {to}")]
    Crowded {
        /// The smaller vertex of the edge.
        from: u32,
        /// The greater one.
        to: u32,
        /// How many meet.
        triangles: usize,
    },
    /// Two triangles that meet at an edge wind against each other.
    #[error("the two triangles at the edge of vertices {from} and {to} wind against each other")]
    Winding {
        /// The smaller vertex of the edge.
        from: u32,
        /// The greater one.
        to: u32,
    },
}

impl Hull {
    /// All broken rules; empty for a sound hull. When indices are out of range nothing else is looked at.
    pub fn check(&self) -> Vec<Broken> {
        let vertices = self.vertices_mm.len();
        let mut broken: Vec<Broken> = self
            .triangles
            .iter()
            .enumerate()
            .flat_map(|(triangle, corners)| corners.map(|vertex| (triangle, vertex)))
            .filter(|(_, vertex)| *vertex as usize >= vertices)
            .map(|(triangle, vertex)| Broken::IndexOutOfRange { triangle, vertex, vertices })
            .collect();
        if broken.is_empty() {
            broken.extend(self.lengths());
            broken.extend(self.vertex_faults());
            broken.extend(self.triangle_faults());
            broken.extend(self.edge_faults());
        }
        broken
    }

    fn lengths(&self) -> Vec<Broken> {
        let lists = [
            ("labels", self.labels.len(), self.triangles.len()),
            ("part_of_vertex", self.part_of_vertex.len(), self.vertices_mm.len()),
            ("face_of_vertex", self.face_of_vertex.len(), self.vertices_mm.len()),
            ("place_of_vertex", self.place_of_vertex.len(), self.vertices_mm.len()),
        ];
        let wrong = lists.into_iter().filter(|(_, found, expected)| found != expected);
        wrong.map(|(list, found, expected)| Broken::LengthMismatch { list, found, expected }).collect()
    }

    fn vertex_faults(&self) -> Vec<Broken> {
        let mut used = vec![false; self.vertices_mm.len()];
        for vertex in self.triangles.iter().flatten() {
            used[*vertex as usize] = true;
        }
        let mut broken = Vec::new();
        for (vertex, place_mm) in self.vertices_mm.iter().enumerate() {
            if !place_mm.is_finite() {
                broken.push(Broken::NotFinite { vertex });
            }
            if !used[vertex] {
                broken.push(Broken::UnusedVertex { vertex });
            }
        }
        broken
    }

    fn triangle_faults(&self) -> Vec<Broken> {
        let (mut broken, mut seen) = (Vec::new(), BTreeMap::new());
        for (triangle, corners) in self.triangles.iter().enumerate() {
            let area_mm2 = self.area_mm2(triangle);
            if area_mm2 == 0.0 {
                broken.push(Broken::Degenerate { triangle, area_mm2 });
            }
            let mut sorted = *corners;
            sorted.sort_unstable();
            if let Some(first) = seen.insert(sorted, triangle) {
                broken.push(Broken::Duplicate { first, second: triangle });
            }
        }
        broken
    }

    fn edge_faults(&self) -> Vec<Broken> {
        let fault = |edge: &[Edge]| {
            let Edge { from, to, .. } = edge[0];
            match edge.len() {
                1 => None,
                2 => (edge[0].forward == edge[1].forward).then_some(Broken::Winding { from, to }),
                triangles => Some(Broken::Crowded { from, to, triangles }),
            }
        };
        self.edges().chunk_by(Edge::same).filter_map(fault).collect()
    }

    /// The edges of all triangles between places, equal ones side by side: a crease is one edge.
    fn edges(&self) -> Vec<Edge> {
        let mut edges: Vec<Edge> = self
            .triangles
            .iter()
            .map(|corners| corners.map(|vertex| self.place_of_vertex[vertex as usize]))
            .flat_map(|[a, b, c]| [(a, b), (b, c), (c, a)])
            .map(|(a, b)| Edge { from: a.min(b), to: a.max(b), forward: a < b })
            .collect();
        edges.sort_unstable();
        edges
    }

    /// Edges with a triangle on one side only: 0 for a closed surface.
    pub fn boundary_edges(&self) -> usize {
        self.edges().chunk_by(Edge::same).filter(|edge| edge.len() == 1).count()
    }

    /// Vertices − edges + triangles of each part: 2 for a closed surface without handles, 1 for a sheet without holes.
    /// The hull must be sound.
    pub fn euler_characteristics(&self) -> Vec<i64> {
        let mut euler = vec![0; self.part_count()];
        let parts: BTreeMap<u32, u32> =
            self.place_of_vertex.iter().copied().zip(self.part_of_vertex.iter().copied()).collect();
        for part in parts.values() {
            euler[*part as usize] += 1;
        }
        for edge in self.edges().chunk_by(Edge::same) {
            euler[parts[&edge[0].from] as usize] -= 1;
        }
        for [first, ..] in &self.triangles {
            euler[self.part_of_vertex[*first as usize] as usize] += 1;
        }
        euler
    }
}

/// One side of an edge.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    from: u32,
    to: u32,
    forward: bool,
}

impl Edge {
    fn same(&self, other: &Edge) -> bool {
        (self.from, self.to) == (other.from, other.to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::mesh::Label;
    use crate::vocabulary::notice::Notices;
    use glam::DVec3;

    fn hull(vertices_mm: &[DVec3], triangles: &[[u32; 3]]) -> Hull {
        Hull {
            vertices_mm: vertices_mm.to_vec(),
            triangles: triangles.to_vec(),
            labels: vec![Label::Projected; triangles.len()],
            part_of_vertex: vec![0; vertices_mm.len()],
            face_of_vertex: vec![0; vertices_mm.len()],
            place_of_vertex: (0..vertices_mm.len() as u32).collect(),
            cell_mm: DVec3::ONE,
            resolution: 1,
            max_edge_mm: 1.0,
            focal: None,
            notices: Notices::default(),
        }
    }

    const TETRAHEDRON: [DVec3; 4] = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];

    #[test]
    fn a_tetrahedron_is_sound_and_closed() {
        let sound = hull(&TETRAHEDRON, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]);
        assert_eq!(sound.check(), []);
        assert_eq!((sound.boundary_edges(), sound.euler_characteristics()), (0, vec![2]));
    }

    #[test]
    fn every_rule_can_be_broken() {
        let (o, x, y) = (DVec3::ZERO, DVec3::X, DVec3::Y);
        assert_eq!(
            hull(&[o, x, y], &[[0, 1, 3]]).check(),
            [Broken::IndexOutOfRange { triangle: 0, vertex: 3, vertices: 3 }]
        );
        let mut short = hull(&[o, x, y], &[[0, 1, 2]]);
        short.labels.clear();
        assert_eq!(short.check(), [Broken::LengthMismatch { list: "labels", found: 0, expected: 1 }]);
        assert_eq!(hull(&[o, x, y, o], &[[0, 1, 2]]).check(), [Broken::UnusedVertex { vertex: 3 }]);
        assert!(hull(&[o, x, DVec3::NAN], &[[0, 1, 2]]).check().contains(&Broken::NotFinite { vertex: 2 }));
        assert_eq!(hull(&[o, x, 2.0 * x], &[[0, 1, 2]]).check(), [Broken::Degenerate { triangle: 0, area_mm2: 0.0 }]);
        assert!(hull(&[o, x, y], &[[0, 1, 2], [0, 2, 1]]).check().contains(&Broken::Duplicate { first: 0, second: 1 }));
        assert_eq!(hull(&TETRAHEDRON, &[[0, 1, 2], [0, 1, 3]]).check(), [Broken::Winding { from: 0, to: 1 }]);
        let three = [o, x, y, DVec3::Z, -y];
        assert_eq!(
            hull(&three, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]]).check(),
            [Broken::Crowded { from: 0, to: 1, triangles: 3 }]
        );
    }
}
