//! Mirror images in what is counted: a ray that stands for all of its images is counted once, in a group of vertices whose images lie in the
//! same zones, and goes to all of these zones when all rays are counted.

use super::sphere::SphereGrid;
use crate::hull::Hull;
use crate::hull::images::Images;
use crate::vocabulary::space::Frame;
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;

/// How far the image of a node may lie from a node and be it.
const NEARLY: f64 = 1e-9;

/// Vertices whose images lie in the same zones.
pub struct Groups {
    /// The group of each vertex that rays are counted at.
    pub of_vertex: Vec<u32>,
    /// The zones of each group, by the number of the image; of a vertex that has no others, its own.
    pub zones: Vec<Vec<u32>>,
}

impl Groups {
    /// By the zone of each vertex; where nothing has images, groups are the zones.
    pub fn new(zone_of_vertex: &[u32], images: Option<&Images>) -> Groups {
        let Some(images) = images else {
            let zones = zone_of_vertex.iter().max().map_or(0, |last| last + 1);
            return Groups { of_vertex: zone_of_vertex.to_vec(), zones: (0..zones).map(|zone| vec![zone]).collect() };
        };
        let mut numbers: BTreeMap<Vec<u32>, u32> = BTreeMap::new();
        let mut group = |vertex: usize| {
            // No ray is counted at the other vertices of the grid.
            if images.is_on_grid(vertex) && !images.is_in_sector(vertex) {
                return 0;
            }
            let next = numbers.len() as u32;
            *numbers.entry(images.of_vertex(vertex).map(|image| zone_of_vertex[image]).collect()).or_insert(next)
        };
        let of_vertex: Vec<u32> = (0..zone_of_vertex.len()).map(&mut group).collect();
        let mut zones: Vec<(u32, Vec<u32>)> = numbers.into_iter().map(|(zones, number)| (number, zones)).collect();
        zones.sort_unstable();
        Groups { of_vertex, zones: zones.into_iter().map(|(_, zones)| zones).collect() }
    }
}

/// How many images of a ray have its γ: those all round the axis of C.
pub fn all_round(hull: &Hull, frame: &Frame) -> usize {
    let nadir = frame.nadir.vector();
    let stays = |map: &&DMat3| (**map * nadir).distance(nadir) < NEARLY;
    hull.focal.as_ref().map_or(1, |grid| grid.maps().iter().filter(stays).count().max(1))
}

/// Cells of directions and their images by `maps` of directions in the source frame, `[number][cell]`; `None` where nodes do not lie at the
/// images of nodes.
pub fn images_of_cells(grid: &SphereGrid, frame: &Frame, maps: &[DMat3]) -> Option<Vec<Vec<u32>>> {
    let nodes: Vec<DVec3> = grid.cell_nodes().into_iter().map(|(c, gamma)| frame.direction(c, gamma)).collect();
    let image = |map: &DMat3, node: &DVec3| {
        let wanted = *map * *node;
        let (c, gamma) = frame.angles(wanted);
        let cell = grid.cell(c, gamma);
        (nodes[cell].distance(wanted) < NEARLY).then_some(cell as u32)
    };
    maps.iter().map(|map| nodes.iter().map(|node| image(map, node)).collect()).collect()
}
