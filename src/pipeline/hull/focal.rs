//! Focal surfaces: a plane or a part of a sphere where the light is sharper than where the rays start. Rays are slid there along
//! their lines, which changes no light outside. The surface is a regular grid, so a ray's cell is known without a search.

use super::symmetry::Symmetry;
use crate::source::Ray;
use glam::{DMat3, DVec2, DVec3};

/// Rays that meet the surface with a smaller cosine, 1°, are slid too far to be put anywhere with certainty.
const GRAZING: f64 = 0.02;
/// A ball is covered up to this square of the equal-area distance from its apex over its radius: 4 would be the whole ball.
const FARTHEST: f64 = 3.2;
/// No corner of the grid lies farther out: beyond 4 there is no ball.
const FARTHEST_CORNER: f64 = 3.9;

/// A plane or a sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FocalSurface {
    /// Where its axis meets it, mm.
    pub apex_mm: DVec3,
    /// Columns: two unit vectors across, and the axis, which points where the light goes. Right-handed.
    pub axes: DMat3,
    /// 1/mm: 0 of a plane; positive where the sphere's centre lies ahead (the light crosses a bowl), negative where it lies behind (it
    /// leaves a cap).
    pub curvature_per_mm: f64,
}

/// Where a line meets a focal surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Coordinates along the axes across, mm; on a sphere at the equal-area distance from the apex (Lambert's azimuthal projection).
    pub at_mm: DVec2,
    /// Unit normal there on the side the light leaves to, in the source frame.
    pub normal: DVec3,
    /// Cosine of the direction to it.
    pub cosine: f64,
}

impl FocalSurface {
    /// Across `axis` through `apex_mm`.
    pub fn new(apex_mm: DVec3, axis: DVec3, curvature_per_mm: f64) -> FocalSurface {
        let (x, y) = axis.any_orthonormal_pair();
        FocalSurface { apex_mm, axes: DMat3::from_cols(x, y, axis), curvature_per_mm }
    }

    /// Where a ray crosses it outward, ahead of its origin or behind it; `None` where it does not, or too far round the ball.
    pub fn meet(&self, origin_mm: DVec3, direction: DVec3) -> Option<Crossing> {
        let inverse = self.axes.transpose();
        let (origin, direction) = (inverse * (origin_mm - self.apex_mm), inverse * direction);
        if self.curvature_per_mm == 0.0 {
            let at_mm = (origin - origin.z / direction.z * direction).truncate();
            return (direction.z > 0.0 && at_mm.is_finite()).then_some(Crossing {
                at_mm,
                normal: self.axes.z_axis,
                cosine: direction.z,
            });
        }
        let radius_mm = 1.0 / self.curvature_per_mm;
        let centre = DVec3::Z * radius_mm;
        let from_centre = origin - centre;
        let along = from_centre.dot(direction);
        let square = along * along - from_centre.length_squared() + radius_mm * radius_mm;
        if square.is_nan() || square <= 0.0 {
            return None;
        }
        let t = -along - square.sqrt().copysign(radius_mm);
        let point = origin + t * direction;
        let normal = ((centre - point) * self.curvature_per_mm).normalize_or_zero();
        let at_mm = point.truncate() * (2.0 / (1.0 + normal.z)).sqrt();
        (at_mm.length_squared() <= FARTHEST * radius_mm * radius_mm).then(|| Crossing {
            at_mm,
            normal: self.axes * normal,
            cosine: normal.dot(direction),
        })
    }

    /// The point with the coordinates `at_mm`, source frame.
    fn point_mm(&self, at_mm: DVec2) -> DVec3 {
        let square = (at_mm.length_squared() * self.curvature_per_mm.powi(2)).min(FARTHEST_CORNER);
        let at_mm = if self.curvature_per_mm == 0.0 {
            at_mm.extend(0.0)
        } else {
            let at_mm = at_mm.clamp_length_max(FARTHEST_CORNER.sqrt() / self.curvature_per_mm.abs());
            (at_mm * (1.0 - square / 4.0).sqrt()).extend(0.5 * square / self.curvature_per_mm)
        };
        self.apex_mm + self.axes * at_mm
    }
}

/// The part of a focal surface that is used: a rectangle of its coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FocalPatch {
    /// The surface.
    pub surface: FocalSurface,
    /// Least coordinates, mm.
    pub min_mm: DVec2,
    /// Greatest coordinates, mm.
    pub max_mm: DVec2,
    /// The area that would hold all rays if they lay everywhere as close as they lie around most of them, mm².
    pub lit_mm2: f64,
    /// Every ray stands for all of its mirror images, which have equal parts of its flux.
    pub symmetry: Symmetry,
}

impl FocalPatch {
    /// The same surface with a rectangle as symmetric as the light.
    #[must_use]
    pub fn with(self, symmetry: Symmetry) -> FocalPatch {
        let mut reach_mm = self.min_mm.abs().max(self.max_mm.abs());
        if symmetry == Symmetry::FourMirrors {
            reach_mm = DVec2::splat(reach_mm.max_element());
        }
        FocalPatch { min_mm: -reach_mm, max_mm: reach_mm, symmetry, ..self }
    }

    /// All images of `rays`, each with its part of the flux.
    pub fn images(&self, rays: &[Ray]) -> Vec<Ray> {
        let part = 1.0 / self.symmetry.images() as f64;
        let of_map = |map: DMat3| {
            rays.iter().map(move |ray| Ray {
                radiant_w: part * ray.radiant_w,
                luminous_lm: part * ray.luminous_lm,
                xz_lm: ray.xz_lm.map(|value| part * value),
                ..self.image(&map, ray)
            })
        };
        self.maps().into_iter().flat_map(of_map).collect()
    }

    /// From directions to those of their images, in the source frame; of the image 4s + 2y + x the places across are swapped where s is
    /// set, and then mirrored along the axes that are set.
    fn maps(&self) -> Vec<DMat3> {
        let axes = self.surface.axes;
        let map = |number: usize| {
            if number == 0 {
                return DMat3::IDENTITY;
            }
            let swapped = if number < 4 { DMat3::IDENTITY } else { DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::Z) };
            let sign = |bit: usize| if number & bit == 0 { 1.0 } else { -1.0 };
            axes * DMat3::from_diagonal(DVec3::new(sign(1), sign(2), 1.0)) * swapped * axes.transpose()
        };
        (0..self.symmetry.images()).map(map).collect()
    }

    /// A ray with place and direction of its image by `map`.
    fn image(&self, map: &DMat3, ray: &Ray) -> Ray {
        if *map == DMat3::IDENTITY {
            return *ray;
        }
        let apex_mm = self.surface.apex_mm;
        Ray { origin_mm: apex_mm + *map * (ray.origin_mm - apex_mm), direction: *map * ray.direction, ..*ray }
    }

    /// Where a ray is slid to; `None` for a ray that does not fit: it meets the surface outside of the patch, grazing or not at all, and
    /// keeps its origin.
    pub fn meet(&self, ray: &Ray) -> Option<Crossing> {
        let crossing = self.surface.meet(ray.origin_mm, ray.direction)?;
        let inside = crossing.at_mm.cmpge(self.min_mm).all() && crossing.at_mm.cmple(self.max_mm).all();
        (inside && crossing.cosine >= GRAZING).then_some(crossing)
    }
}

/// A grid over a patch, two triangles to each cell that holds light or lies beside one that does.
#[derive(Clone, Debug, PartialEq)]
pub struct FocalGrid {
    patch: FocalPatch,
    /// From directions to those of their images.
    maps: Vec<DMat3>,
    cells: [usize; 2],
    /// First of the two triangles of each cell, `[y][x]`; `u32::MAX` where the cell is dark.
    first_triangle: Vec<u32>,
    /// How many triangles there are: the first ones of the hull.
    pub triangle_count: usize,
    /// Size of a cell of the lattice of the rays that did not fit, mm.
    pub loose_cell_mm: DVec3,
}

impl FocalGrid {
    /// A grid of `cells` over `patch`, and the mesh over the cells that are `lit`, `[y][x]`, or beside one.
    pub fn new(patch: FocalPatch, cells: [usize; 2], lit: &[bool]) -> (FocalGrid, Vec<DVec3>, Vec<[u32; 3]>) {
        let mut grid = FocalGrid {
            patch,
            maps: patch.maps(),
            cells,
            first_triangle: vec![u32::MAX; cells[0] * cells[1]],
            triangle_count: 0,
            loose_cell_mm: DVec3::ZERO,
        };
        let (vertices_mm, triangles) = grid.mesh(lit);
        (grid, vertices_mm, triangles)
    }

    /// Size of a cell along the axes across, mm.
    pub fn size_mm(patch: &FocalPatch, cells: [usize; 2]) -> DVec2 {
        let [x, y] = cells.map(|count| count as f64);
        (patch.max_mm - patch.min_mm) / DVec2::new(x, y)
    }

    /// Cell of a point and where it lies in it, 0 to 1 each way.
    pub fn place(patch: &FocalPatch, cells: [usize; 2], at_mm: DVec2) -> (usize, [f64; 2]) {
        let at = (at_mm - patch.min_mm) / FocalGrid::size_mm(patch, cells);
        let along = |at: f64, count: usize| (at.max(0.0) as usize).min(count - 1);
        let (x, y) = (along(at.x, cells[0]), along(at.y, cells[1]));
        (y * cells[0] + x, [(at.x - x as f64).clamp(0.0, 1.0), (at.y - y as f64).clamp(0.0, 1.0)])
    }

    /// Triangle and barycentric coordinates of the point that a ray is slid to; `None` for a ray that does not fit.
    pub fn land(&self, ray: &Ray) -> Option<(usize, [f64; 3])> {
        self.land_at(self.place_of(ray)?)
    }

    /// Cell and place in it that a ray is slid to; `None` for a ray that does not fit.
    pub fn place_of(&self, ray: &Ray) -> Option<(usize, [f64; 2])> {
        self.patch.meet(ray).map(|crossing| FocalGrid::place(&self.patch, self.cells, crossing.at_mm))
    }

    /// How many images a ray has, itself included.
    pub fn images(&self) -> usize {
        self.maps.len()
    }

    /// From directions to those of their images, in the source frame.
    pub fn maps(&self) -> &[DMat3] {
        &self.maps
    }

    /// How many cells there are, dark ones included.
    pub fn cell_count(&self) -> usize {
        self.first_triangle.len()
    }

    /// The number of the image of a place that lies in the first sector: towards the least coordinates, and with eight images nearer to
    /// their first axis than to the second.
    pub fn into_sector(&self, (cell, at): (usize, [f64; 2])) -> usize {
        let [columns, rows] = self.cells;
        let from_middle = |place: usize, at: f64, count: usize| place as f64 + at - 0.5 * count as f64;
        let (x, y) = (from_middle(cell % columns, at[0], columns), from_middle(cell / columns, at[1], rows));
        let is_swapped = self.images() == 8 && y.abs() > x.abs();
        let (x, y) = if is_swapped { (y, x) } else { (x, y) };
        let bit = |number: usize, is_set: bool| if is_set { number } else { 0 };
        bit(1, x > 0.0) + bit(2, y > 0.0) + bit(4, is_swapped)
    }

    /// A ray with place and direction of one of its images; its flux is that of all.
    pub fn image(&self, number: usize, ray: &Ray) -> Ray {
        self.patch.image(&self.maps[number], ray)
    }

    /// Where the same image of a place lies.
    pub fn image_of_place(&self, number: usize, (cell, [mut a, mut b]): (usize, [f64; 2])) -> (usize, [f64; 2]) {
        let [columns, rows] = self.cells;
        let (mut x, mut y) = (cell % columns, cell / columns);
        if number & 4 != 0 {
            // Only square grids have so many images.
            (x, y, a, b) = (y, x, b, a);
        }
        if number & 1 != 0 {
            (x, a) = (columns - 1 - x, 1.0 - a);
        }
        if number & 2 != 0 {
            (y, b) = (rows - 1 - y, 1.0 - b);
        }
        (y * columns + x, [a, b])
    }

    /// Triangle and barycentric coordinates of a place; `None` where the grid is dark.
    pub fn land_at(&self, (cell, [a, b]): (usize, [f64; 2])) -> Option<(usize, [f64; 3])> {
        let first = self.first_triangle[cell];
        let (second, shares) = match self.falls(cell) {
            true if a + b <= 1.0 => (0, [1.0 - a - b, a, b]),
            true => (1, [1.0 - b, a + b - 1.0, 1.0 - a]),
            false if b <= a => (0, [1.0 - a, a - b, b]),
            false => (1, [1.0 - b, a, b - a]),
        };
        (first != u32::MAX).then_some((first as usize + second, shares))
    }

    /// Whether the cell is cut from its upper left to its lower right corner: cells are cut towards the middle of the grid, so that the
    /// mesh is as symmetric as the light.
    fn falls(&self, cell: usize) -> bool {
        let (x, y) = (cell % self.cells[0], cell / self.cells[0]);
        (2 * x >= self.cells[0]) != (2 * y >= self.cells[1])
    }

    /// The mesh over the cells that are `lit` or beside one.
    fn mesh(&mut self, lit: &[bool]) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let [columns, rows] = self.cells;
        let beside = |x: usize, y: usize| {
            let near = |at: usize, count: usize| at.saturating_sub(1)..=(at + 1).min(count - 1);
            near(y, rows).any(|y| near(x, columns).any(|x| lit[y * columns + x]))
        };
        let size_mm = FocalGrid::size_mm(&self.patch, self.cells);
        let patch_corner = |x: usize, y: usize| self.patch.min_mm + DVec2::new(x as f64, y as f64) * size_mm;
        let (mut vertices_mm, mut triangles) = (Vec::new(), Vec::new());
        let mut number = vec![u32::MAX; (columns + 1) * (rows + 1)];
        for (cell, is_lit) in lit.iter().enumerate() {
            let (x, y) = (cell % columns, cell / columns);
            let far = patch_corner(x + usize::from(2 * x >= columns), y + usize::from(2 * y >= rows));
            let beyond = far.length_squared() * self.patch.surface.curvature_per_mm.powi(2) > FARTHEST_CORNER;
            if !beside(x, y) || (beyond && !is_lit) {
                continue;
            }
            let mut corner = |x: usize, y: usize| {
                let number = &mut number[y * (columns + 1) + x];
                if *number == u32::MAX {
                    *number = vertices_mm.len() as u32;
                    vertices_mm.push(self.patch.surface.point_mm(patch_corner(x, y)));
                }
                *number
            };
            let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
            self.first_triangle[cell] = triangles.len() as u32;
            triangles.extend(if self.falls(cell) { [[a, b, d], [b, c, d]] } else { [[a, b, c], [a, c, d]] });
        }
        self.triangle_count = triangles.len();
        (vertices_mm, triangles)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Numbers in 0..1 without a generator: multiples of irrational numbers.
    fn scatter(k: usize) -> [f64; 4] {
        [2f64.sqrt(), 3f64.sqrt(), 5f64.sqrt(), 7f64.sqrt()].map(|root| (k as f64 * root).fract())
    }

    fn ray(origin_mm: DVec3, direction: DVec3) -> Ray {
        let direction = direction.normalize();
        Ray { origin_mm, direction, radiant_w: 1.0, luminous_lm: 3.0, column: 0, xz_lm: [1.0, 2.0] }
    }

    fn axis() -> DVec3 {
        DVec3::new(0.3, -0.4, 0.8).normalize()
    }

    /// A ray that starts anywhere on its line comes to the point of the surface that it was aimed through.
    #[test]
    fn rays_come_to_the_point_they_go_through() {
        let apex_mm = DVec3::new(1.0, 2.0, -0.5);
        for curvature in [0.0, 0.5, -0.8] {
            let surface = FocalSurface::new(apex_mm, axis(), curvature);
            for k in 1..1000 {
                let [x, y, z, w] = scatter(k);
                let at_mm = DVec2::new(x - 0.5, y - 0.5);
                let point_mm = surface.point_mm(at_mm);
                let normal = match curvature {
                    0.0 => axis(),
                    _ => (apex_mm + axis() / curvature - point_mm) * curvature,
                };
                // Any direction on the side of the normal.
                let direction = (normal + 0.9 * DVec3::new(z - 0.5, w - 0.5, (7.0 * z).fract() - 0.5)).normalize();
                let crossing = surface.meet(point_mm + (10.0 * w - 5.0) * direction, direction).unwrap();
                assert!(crossing.at_mm.distance(at_mm) < 1e-9, "{curvature}: {crossing:?} for {at_mm}");
                assert!((crossing.cosine - normal.dot(direction)).abs() < 1e-9);
            }
        }
    }

    /// Equal areas of the coordinates are equal areas of the sphere: a cap of height h has 2π R h, which is π r² of its rim.
    #[test]
    fn coordinates_of_a_sphere_are_of_equal_area() {
        let surface = FocalSurface::new(DVec3::ZERO, DVec3::Z, -0.5);
        for radius_mm in [0.1, 1.0, 2.0, 3.0] {
            let height_mm = -surface.point_mm(DVec2::new(radius_mm, 0.0)).z;
            assert!((TAU * 2.0 * height_mm / (0.5 * TAU * radius_mm * radius_mm) - 1.0).abs() < 1e-12);
        }
    }

    fn patch(curvature: f64, symmetry: Symmetry) -> FocalPatch {
        let surface = FocalSurface::new(DVec3::new(1.0, 2.0, -0.5), axis(), curvature);
        let (min_mm, max_mm) = (DVec2::splat(-0.6), DVec2::splat(0.6));
        FocalPatch { surface, min_mm, max_mm, lit_mm2: 1.44, symmetry: Symmetry::None }.with(symmetry)
    }

    /// Barycentric coordinates in the triangle of the grid give the crossing, but for the flatness of the triangle.
    #[test]
    fn a_ray_lands_in_the_triangle_below_it() {
        for curvature in [0.0, -0.8] {
            let patch = patch(curvature, Symmetry::None);
            let (grid, vertices_mm, triangles) = FocalGrid::new(patch, [20, 30], &[true; 600]);
            assert_eq!(triangles.len(), 1200);
            for k in 1..1000 {
                let [x, y, z, w] = scatter(k);
                let point_mm = patch.surface.point_mm(DVec2::new(1.2 * x - 0.6, 1.2 * y - 0.6));
                let direction = axis() + DVec3::new(z - 0.5, w - 0.5, 0.0);
                let ray = ray(point_mm - direction, direction);
                let (triangle, shares) = grid.land(&ray).unwrap();
                assert!(shares.iter().all(|share| *share >= 0.0) && (shares.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                let corners = triangles[triangle].map(|vertex| vertices_mm[vertex as usize]);
                let landed_mm: DVec3 = corners.iter().zip(shares).map(|(corner, share)| *corner * share).sum();
                let sagitta_mm = curvature.abs() * 0.06 * 0.06;
                assert!(landed_mm.distance(point_mm) <= sagitta_mm + 1e-9, "{landed_mm} for {point_mm}");
                let [a, b, c] = corners;
                assert!((b - a).cross(c - a).dot(axis()) > 0.0, "triangles look where the light goes");
            }
        }
    }

    #[test]
    fn images_share_the_flux_and_mirror_each_other() {
        for symmetry in [Symmetry::TwoMirrors, Symmetry::FourMirrors] {
            let patch = patch(-0.8, symmetry);
            let one = ray(patch.surface.point_mm(DVec2::new(0.3, 0.1)), axis() + DVec3::new(0.1, 0.0, 0.0));
            let images = patch.images(&[one]);
            assert_eq!((images.len(), images[0].origin_mm), (symmetry.images(), one.origin_mm));
            assert_eq!(images.iter().map(|image| image.radiant_w).sum::<f64>(), 1.0);
            assert_eq!(images.iter().map(|image| image.luminous_lm).sum::<f64>(), 3.0);
            let mut at: Vec<[f64; 2]> = images
                .iter()
                .map(|image| patch.meet(image).unwrap().at_mm.to_array().map(|at| (at * 1e6).round() / 1e6))
                .collect();
            assert!(at.iter().all(|[x, y]| [x.abs(), y.abs()] == [0.3, 0.1] || [x.abs(), y.abs()] == [0.1, 0.3]));
            at.sort_by(|a, b| a.partial_cmp(b).unwrap());
            at.dedup();
            assert_eq!(at.len(), symmetry.images(), "{at:?}");
            let slants: Vec<f64> = images.iter().map(|image| image.direction.dot(axis())).collect();
            assert!(slants.iter().all(|slant| (slant - slants[0]).abs() < 1e-12));
        }
    }

    /// Where the images of a ray land follows from where the ray lands: the same as sliding every image.
    #[test]
    fn images_land_at_the_images_of_the_place() {
        for (symmetry, curvature) in [(Symmetry::TwoMirrors, 0.0), (Symmetry::FourMirrors, -0.8)] {
            let patch = patch(curvature, symmetry);
            let (grid, ..) = FocalGrid::new(patch, [20, 20], &[true; 400]);
            for k in 1..500 {
                let [x, y, z, w] = scatter(k);
                let point_mm = patch.surface.point_mm(DVec2::new(1.2 * x - 0.6, 1.2 * y - 0.6));
                let one = ray(point_mm, axis() + DVec3::new(z - 0.5, w - 0.5, 0.0));
                let place = grid.place_of(&one).unwrap();
                for (number, slid) in patch.images(&[one]).iter().enumerate() {
                    let (triangle, shares) = grid.land(slid).unwrap();
                    let image = grid.image(number, &one);
                    assert_eq!((image.origin_mm, image.direction), (slid.origin_mm, slid.direction));
                    let (same, near) = grid.land_at(grid.image_of_place(number, place)).unwrap();
                    assert_eq!(same, triangle, "image {number} of ray {k}");
                    assert!(shares.iter().zip(near).all(|(a, b)| (a - b).abs() < 1e-9), "{shares:?} {near:?}");
                }
            }
        }
    }
}
