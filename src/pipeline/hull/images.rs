//! Mirror images of the places of a symmetric grid. What lands in one sector of the grid stands for what lands at all of its images, so a ray
//! is landed once, and its images are added when all rays have landed.

use super::focal::FocalGrid;
use super::mesh::Hull;
use crate::error::Error;
use std::collections::BTreeMap;

/// Where the vertices and triangles of a symmetric grid, which are the first of the hull, have their images; by the numbers of
/// [`FocalGrid::image`].
#[derive(Clone, Debug)]
pub struct Images {
    /// `[number][vertex]`.
    vertices: Vec<Vec<u32>>,
    /// `[number][triangle]`.
    triangles: Vec<Vec<u32>>,
    /// Whether a vertex lies in the sector that rays land in, or on its border.
    is_in_sector: Vec<bool>,
}

impl Images {
    /// Of the grid of `hull`; `None` where its light is not symmetric.
    ///
    /// # Errors
    /// [`Error::Internal`] where the grid is not as symmetric as its light, which no grid of ours is.
    pub fn of(hull: &Hull) -> Result<Option<Images>, Error> {
        let Some(grid) = hull.focal.as_ref().filter(|grid| grid.images() > 1) else { return Ok(None) };
        let images = Images::of_grid(hull, grid);
        images.map(Some).ok_or_else(|| Error::Internal("a grid has no images of some of its places".to_owned()))
    }

    fn of_grid(hull: &Hull, grid: &FocalGrid) -> Option<Images> {
        let of_grid = &hull.triangles[..grid.triangle_count];
        let count = of_grid.iter().flatten().max().map_or(0, |last| *last as usize + 1);
        let vertex_at = |place: (usize, [f64; 2])| {
            let (triangle, shares) = grid.land_at(place)?;
            let corner = (0..3).max_by(|a, b| shares[*a].total_cmp(&shares[*b]))?;
            Some(hull.triangles[triangle][corner])
        };
        let corners = (0..grid.cell_count())
            .flat_map(|cell| [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(|at| (cell, at)))
            .filter_map(|place| Some((place, vertex_at(place)? as usize)));
        let (mut vertices, mut is_in_sector) = (vec![vec![0; count]; grid.images()], vec![false; count]);
        for (place, vertex) in corners {
            is_in_sector[vertex] |= grid.into_sector(place) == 0;
            for (number, images) in vertices.iter_mut().enumerate() {
                images[vertex] = vertex_at(grid.image_of_place(number, place))?;
            }
        }
        let sorted = |mut corners: [u32; 3]| {
            corners.sort_unstable();
            corners
        };
        let by_corners: BTreeMap<[u32; 3], u32> =
            of_grid.iter().enumerate().map(|(triangle, corners)| (sorted(*corners), triangle as u32)).collect();
        let triangle_images = |images: &Vec<u32>| {
            let image =
                |corners: &[u32; 3]| by_corners.get(&sorted(corners.map(|vertex| images[vertex as usize]))).copied();
            of_grid.iter().map(image).collect::<Option<Vec<u32>>>()
        };
        let triangles = vertices.iter().map(triangle_images).collect::<Option<Vec<Vec<u32>>>>()?;
        Some(Images { vertices, triangles, is_in_sector })
    }

    /// How many images there are, the place itself included.
    pub fn count(&self) -> usize {
        self.vertices.len()
    }

    /// The vertices that stand for `vertex` of the sector: all of its images, by number; itself alone where it is not of the grid.
    pub fn of_vertex(&self, vertex: usize) -> impl Iterator<Item = usize> + '_ {
        of(&self.vertices, vertex)
    }

    /// The same of a triangle.
    pub fn of_triangle(&self, triangle: usize) -> impl Iterator<Item = usize> + '_ {
        of(&self.triangles, triangle)
    }

    /// Whether rays that stand for their images land at this vertex of the grid.
    pub fn is_in_sector(&self, vertex: usize) -> bool {
        self.is_in_sector.get(vertex).is_some_and(|inside| *inside)
    }

    /// Whether a vertex is of the grid.
    pub fn is_on_grid(&self, vertex: usize) -> bool {
        vertex < self.is_in_sector.len()
    }
}

fn of(images: &[Vec<u32>], site: usize) -> impl Iterator<Item = usize> + '_ {
    let is_of_grid = images.first().is_some_and(|sites| site < sites.len());
    let of_number = move |sites: &Vec<u32>| if is_of_grid { sites[site] as usize } else { site };
    images.iter().take(if is_of_grid { images.len() } else { 1 }).map(of_number)
}
