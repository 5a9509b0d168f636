//! Vertices, triangles, areas, normals.

use super::focal::FocalGrid;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::space::Bounds;
use glam::DVec3;
use serde::Serialize;

/// How a triangle came to be (the paper's figure 2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Label {
    /// From one view's level grid (red).
    Projected,
    /// Joins the levels of views (green).
    Stitched,
    /// Completed from its surroundings (blue).
    Filled,
}

/// A triangle surface in the source frame. Triangles wind counter-clockwise seen from outside (where the light goes).
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    /// Vertices, mm.
    pub vertices_mm: Vec<DVec3>,
    /// Indices into the vertices.
    pub triangles: Vec<[u32; 3]>,
    /// One per triangle.
    pub labels: Vec<Label>,
    /// Connected part of each vertex, numbered from 0 in the order of the smallest vertex.
    pub part_of_vertex: Vec<u32>,
    /// Face of each vertex, numbered from 0: a part without creases, or what lies between them.
    pub face_of_vertex: Vec<u32>,
    /// Place of each vertex: the vertices of all faces that meet at a point of a crease have one place.
    pub place_of_vertex: Vec<u32>,
    /// Edge lengths of a lattice cell, mm: the surface's resolution. Components of a flat cloud's missing dimension are tiny, never 0.
    pub cell_mm: DVec3,
    /// Cells along the longest edge that were used.
    pub resolution: u32,
    /// The size filter that was used, mm.
    pub max_edge_mm: f64,
    /// The grid of a focal surface, whose triangles come first; `None` where every ray keeps its origin.
    pub focal: Option<FocalGrid>,
    /// What happened on the way.
    pub notices: Notices,
}

/// Vertices and triangles alone, whoever holds them.
#[derive(Clone, Copy, Debug)]
pub struct Mesh<'a> {
    /// Vertices, mm.
    pub vertices_mm: &'a [DVec3],
    /// Indices into the vertices.
    pub triangles: &'a [[u32; 3]],
}

impl Mesh<'_> {
    /// Corners of a triangle, mm.
    #[inline]
    pub fn corners_mm(&self, triangle: usize) -> [DVec3; 3] {
        // Each ray asks for those of several triangles: `map` would be a call.
        let [a, b, c] = self.triangles[triangle];
        [self.vertices_mm[a as usize], self.vertices_mm[b as usize], self.vertices_mm[c as usize]]
    }

    /// Cross product of two edges: twice the area, along the outward normal, mm².
    fn double_area_normal_mm2(&self, triangle: usize) -> DVec3 {
        let [a, b, c] = self.corners_mm(triangle);
        (b - a).cross(c - a)
    }

    /// Area of a triangle, mm².
    pub fn area_mm2(&self, triangle: usize) -> f64 {
        0.5 * self.double_area_normal_mm2(triangle).length()
    }

    /// Outward unit normal of a triangle.
    pub fn normal(&self, triangle: usize) -> DVec3 {
        self.double_area_normal_mm2(triangle).normalize_or_zero()
    }

    /// A third of the areas of each vertex's triangles, mm²: A_l of `pipeline/README.md` 3.
    pub fn vertex_areas_mm2(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.vertices_mm.len()];
        for (triangle, corners) in self.triangles.iter().enumerate() {
            for corner in corners {
                areas[*corner as usize] += self.area_mm2(triangle) / 3.0;
            }
        }
        areas
    }
}

impl Hull {
    /// Its vertices and triangles.
    pub fn mesh(&self) -> Mesh<'_> {
        Mesh { vertices_mm: &self.vertices_mm, triangles: &self.triangles }
    }

    /// Corners of a triangle, mm.
    #[inline]
    pub fn corners_mm(&self, triangle: usize) -> [DVec3; 3] {
        self.mesh().corners_mm(triangle)
    }

    /// Area of a triangle, mm².
    pub fn area_mm2(&self, triangle: usize) -> f64 {
        self.mesh().area_mm2(triangle)
    }

    /// Outward unit normal of a triangle.
    pub fn normal(&self, triangle: usize) -> DVec3 {
        self.mesh().normal(triangle)
    }

    /// Area of the whole surface, mm².
    pub fn total_area_mm2(&self) -> f64 {
        (0..self.triangles.len()).map(|triangle| self.area_mm2(triangle)).sum()
    }

    /// A third of the areas of each vertex's triangles, mm²: A_l of `pipeline/README.md` 3.
    pub fn vertex_areas_mm2(&self) -> Vec<f64> {
        self.mesh().vertex_areas_mm2()
    }

    /// Area-weighted unit normals of the vertices, outward.
    pub fn vertex_normals(&self) -> Vec<DVec3> {
        let mut normals = vec![DVec3::ZERO; self.vertices_mm.len()];
        for (triangle, corners) in self.triangles.iter().enumerate() {
            for corner in corners {
                normals[*corner as usize] += self.mesh().double_area_normal_mm2(triangle);
            }
        }
        normals.iter().map(|normal| normal.normalize_or(DVec3::Z)).collect()
    }

    /// Number of connected parts.
    pub fn part_count(&self) -> usize {
        self.part_of_vertex.iter().max().map_or(0, |last| *last as usize + 1)
    }

    /// Number of faces.
    pub fn face_count(&self) -> usize {
        self.face_of_vertex.iter().max().map_or(0, |last| *last as usize + 1)
    }

    /// The box of the surface, mm.
    pub fn bounds_mm(&self) -> Bounds {
        Bounds::of(self.vertices_mm.iter().copied())
    }

    /// Triangles with `label`.
    pub fn count(&self, label: Label) -> usize {
        self.labels.iter().filter(|other| **other == label).count()
    }
}
