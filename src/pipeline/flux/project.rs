//! One ray: hit, snapped or rejected, counted exactly once.
//!
//! Sliding a ray along its own line changes no light outside (`pipeline/README.md` 3), so a ray lands where its line leaves the hull:
//! - the first crossing ahead leads out: the origin is inside (a glowing volume, or just under the surface), it lands there;
//! - otherwise the origin is outside: it lands on the nearest crossing behind that leads out, the surface it came from;
//! - a line that only enters lands where it enters, if that is near: stray light from the back of a one-sided sheet;
//! - a line that meets nothing snaps to the nearest triangle within the tolerance; the rest is rejected.
//!
//! Most rays start on the surface: the few triangles in the cell of the start settle them, the tree is asked for the others.

use super::bvh::Bvh;
use super::cells::{Cells, Near};
use crate::hull::Hull;
use crate::hull::focal::FocalGrid;
use crate::source::Ray;
use crate::vocabulary::space::Bounds;
use glam::DVec3;

/// How a ray came to the surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// Its line meets the hull.
    Hit,
    /// Laid on the nearest triangle.
    Snapped,
}

/// Where a ray landed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landing {
    /// The triangle.
    pub triangle: usize,
    /// Barycentric coordinates p of the point: shares of the triangle's corners, not negative, sum 1.
    pub shares: [f64; 3],
    /// How it came there.
    pub fate: Fate,
    /// Of a ray that stands for all of its mirror images: the number of the image that landed here. The others lie at the images of this place.
    pub image: Option<usize>,
}

impl Landing {
    fn hit((triangle, shares): (usize, [f64; 3])) -> Landing {
        Landing { triangle, shares, fate: Fate::Hit, image: None }
    }
}

/// Lays rays on a hull.
pub struct Projector<'a> {
    /// The grid that rays are slid to, with the first triangles of the hull.
    focal: Option<&'a FocalGrid>,
    /// How many triangles the index leaves to it.
    first: usize,
    /// The others, in their order.
    facets: Vec<Facet>,
    cells: Cells,
    bvh: Bvh,
    /// Farther than this from the surface nothing is snapped, mm: a cell's diagonal.
    tolerance_mm: f64,
}

impl<'a> Projector<'a> {
    /// Indexes `hull`.
    pub fn new(hull: &'a Hull) -> Projector<'a> {
        let focal = hull.focal.as_ref();
        let first = focal.map_or(0, |grid| grid.triangle_count);
        let corners_mm = || (first..hull.triangles.len()).map(|triangle| hull.corners_mm(triangle));
        let boxes: Vec<Bounds> = corners_mm().map(Bounds::of).collect();
        let cell_mm = focal.map_or(hull.cell_mm, |grid| grid.loose_cell_mm);
        let cells = Cells::new(&boxes, cell_mm.max_element());
        let facets = corners_mm().map(Facet::new).collect();
        Projector { focal, first, facets, cells, bvh: Bvh::new(&boxes), tolerance_mm: cell_mm.length() }
    }

    /// Where `ray` lands; `None` when it is rejected.
    pub fn land(&self, ray: &Ray) -> Option<Landing> {
        let on_grid = self.focal.and_then(|grid| grid.land(ray)).map(Landing::hit);
        on_grid.or_else(|| self.land_off_grid(ray))
    }

    /// Tells `each` where `ray` lands, of a symmetric light all of its mirror images: one that stands for all where the ray is slid to the
    /// grid ([`Landing::image`]), else each of them.
    pub fn land_images(&self, ray: &Ray, mut each: impl FnMut(&Ray, Option<Landing>)) {
        let Some(grid) = self.focal.filter(|grid| grid.images() > 1) else { return each(ray, self.land(ray)) };
        let on_grid = grid.place_of(ray).and_then(|place| {
            let number = grid.into_sector(place);
            let landing = Landing::hit(grid.land_at(grid.image_of_place(number, place))?);
            Some(Landing { image: Some(number), ..landing })
        });
        if on_grid.is_some() {
            return each(ray, on_grid);
        }
        for number in 0..grid.images() {
            let image = grid.image(number, ray);
            each(&image, self.land_off_grid(&image));
        }
    }

    /// Where a ray lands that is not slid to the grid.
    fn land_off_grid(&self, ray: &Ray) -> Option<Landing> {
        if self.facets.is_empty() {
            return None;
        }
        let hit = |crossing: Crossing| Landing::hit((crossing.triangle, crossing.shares()));
        let landing = self.crossing(ray).map(hit).or_else(|| self.snap(ray.origin_mm))?;
        Some(Landing { triangle: self.first + landing.triangle, ..landing })
    }

    /// Where the line of the ray lands.
    fn crossing(&self, ray: &Ray) -> Option<Crossing> {
        let near = self.cells.near(ray.origin_mm).and_then(|near| self.crossing_near(ray, &near));
        near.or_else(|| self.crossing_anywhere(ray))
    }

    /// The same, by the tree.
    fn crossing_anywhere(&self, ray: &Ray) -> Option<Crossing> {
        let any = |_: &Crossing| true;
        let ahead = self.first(ray, 1.0, f64::INFINITY, any);
        if let Some(crossing) = ahead.filter(Crossing::leads_out) {
            // Inside, unless a surface that leads out lies closer behind than the hull is accurate.
            let limit_mm = crossing.t.abs().min(self.tolerance_mm);
            let behind = if limit_mm > 0.0 { self.first(ray, -1.0, limit_mm, Crossing::leads_out) } else { None };
            return behind.filter(|behind| behind.t.abs() < crossing.t.abs()).or(ahead);
        }
        self.first(ray, -1.0, f64::INFINITY, Crossing::leads_out)
            .or_else(|| self.first(ray, 1.0, f64::INFINITY, Crossing::leads_out))
            .or_else(|| ahead.filter(|ahead| ahead.t.abs() <= self.tolerance_mm))
            .or_else(|| self.first(ray, -1.0, self.tolerance_mm, any))
    }

    /// The same, where what lies in the cell of the start is enough to tell: what is met within a cell is met before all that lies beyond.
    fn crossing_near(&self, ray: &Ray, near: &Near<'_>) -> Option<Crossing> {
        let [reach_behind, reach_ahead] = reach_mm(&near.cell, ray);
        let [mut ahead, mut behind]: [Option<Crossing>; 2] = [None, None];
        for item in near.items {
            let Some(crossing) = self.meet(*item as usize, ray) else { continue };
            let t = crossing.t;
            if self.is_on(t) && t <= reach_ahead && ahead.is_none_or(|nearest| t < nearest.t) {
                ahead = Some(crossing);
            }
            let is_behind = crossing.leads_out() && self.is_on(-t) && -t <= reach_behind;
            if is_behind && behind.is_none_or(|nearest| t > nearest.t) {
                behind = Some(crossing);
            }
        }
        match (ahead, behind) {
            (Some(crossing), _) if crossing.leads_out() => {
                let limit_mm = crossing.t.abs().min(self.tolerance_mm);
                let closer = behind.filter(|behind| {
                    let back_mm = behind.t.abs();
                    limit_mm > 0.0 && back_mm <= limit_mm && back_mm < crossing.t.abs()
                });
                (limit_mm <= reach_behind).then_some(closer.unwrap_or(crossing))
            }
            (Some(_), behind) => behind,
            (None, Some(nearest)) => {
                let back_mm = nearest.t.abs();
                behind.filter(|_| back_mm <= self.tolerance_mm && back_mm < reach_ahead)
            }
            (None, None) => None,
        }
    }

    /// Whether a crossing at `t` counts as ahead: rounding may put one at the start a hair behind it.
    fn is_on(&self, t: f64) -> bool {
        t >= -1e-9 * self.tolerance_mm
    }

    /// Where the line of a ray meets a triangle that is left to the index.
    fn meet(&self, triangle: usize, ray: &Ray) -> Option<Crossing> {
        self.facets[triangle].meet(triangle, ray)
    }

    /// First crossing ahead (`sense` +1) or behind (−1) that is `wanted`.
    fn first(&self, ray: &Ray, sense: f64, limit_mm: f64, wanted: impl Fn(&Crossing) -> bool) -> Option<Crossing> {
        let distance_mm = |triangle: usize| {
            let crossing = self.meet(triangle, ray).filter(&wanted)?;
            Some(sense * crossing.t).filter(|t| self.is_on(*t))
        };
        let (triangle, _) = self.bvh.first_along(ray.origin_mm, sense * ray.direction, limit_mm, distance_mm)?;
        self.meet(triangle, ray)
    }

    /// The nearest triangle within the tolerance; ties go to the smaller index.
    fn snap(&self, point_mm: DVec3) -> Option<Landing> {
        let mut best: Option<(f64, usize, DVec3)> = None;
        self.bvh.near(point_mm, self.tolerance_mm, |triangle| {
            let nearest_mm = nearest_point(self.facets[triangle].corners_mm(), point_mm);
            let distance_mm = nearest_mm.distance(point_mm);
            let closer = best.is_none_or(|(least, other, _)| (distance_mm, triangle) < (least, other));
            if distance_mm <= self.tolerance_mm && closer {
                best = Some((distance_mm, triangle, nearest_mm));
            }
        });
        best.map(|(_, triangle, nearest_mm)| Landing {
            triangle,
            shares: barycentric(self.facets[triangle].corners_mm(), nearest_mm),
            fate: Fate::Snapped,
            image: None,
        })
    }
}

/// A triangle as its lines are met: one corner and the edges from it.
#[derive(Clone, Copy)]
struct Facet {
    a_mm: DVec3,
    ab_mm: DVec3,
    ac_mm: DVec3,
}

/// Where a line meets a triangle.
#[derive(Clone, Copy)]
struct Crossing {
    /// The triangle, among those of the index.
    triangle: usize,
    /// Signed distance along the ray, mm.
    t: f64,
    /// Shares of the second and the third corner; edges belong to both neighbours, so one may be a hair below 0.
    at: [f64; 2],
    /// Direction · outward normal, not normalised: positive where the line leads out.
    slant: f64,
}

impl Facet {
    fn new([a, b, c]: [DVec3; 3]) -> Facet {
        Facet { a_mm: a, ab_mm: b - a, ac_mm: c - a }
    }

    fn corners_mm(&self) -> [DVec3; 3] {
        [self.a_mm, self.a_mm + self.ab_mm, self.a_mm + self.ac_mm]
    }

    /// Where the line of `ray` meets it. Möller and Trumbore, J. Graphics Tools 2(1), 1997; edges belong to both neighbours, so no
    /// line slips between.
    fn meet(&self, triangle: usize, ray: &Ray) -> Option<Crossing> {
        let p = ray.direction.cross(self.ac_mm);
        let determinant = self.ab_mm.dot(p);
        if determinant == 0.0 {
            return None;
        }
        let per_determinant = 1.0 / determinant;
        let s = ray.origin_mm - self.a_mm;
        let slack = 1e-9;
        let u = s.dot(p) * per_determinant;
        if !(-slack..=1.0 + slack).contains(&u) {
            return None;
        }
        let q = s.cross(self.ab_mm);
        let v = ray.direction.dot(q) * per_determinant;
        let t = self.ac_mm.dot(q) * per_determinant;
        // The determinant is −direction · (ab × ac): negative when leaving.
        (v >= -slack && u + v <= 1.0 + slack && t.is_finite()).then_some(Crossing {
            triangle,
            t,
            at: [u, v],
            slant: -determinant,
        })
    }
}

impl Crossing {
    fn leads_out(&self) -> bool {
        self.slant > 0.0
    }

    /// Shares of the corners: not negative, sum 1.
    fn shares(&self) -> [f64; 3] {
        let [u, v] = self.at;
        let parts = [1.0 - u - v, u, v].map(|part| part.max(0.0));
        let sum: f64 = parts.iter().sum();
        parts.map(|part| part / sum)
    }
}

/// How far the line of a ray runs within a box that it starts in, backwards and forwards, mm.
fn reach_mm(bounds: &Bounds, ray: &Ray) -> [f64; 2] {
    (0..3).fold([f64::INFINITY; 2], |[behind, ahead], axis| {
        let along = |side: f64| (side - ray.origin_mm[axis]) / ray.direction[axis];
        let [a, b] = [along(bounds.min[axis]), along(bounds.max[axis])];
        // Along an axis that the ray does not move in, 0 / 0 is no number, which `min` and `max` leave out.
        [behind.min((-a.min(b)).max(0.0)), ahead.min(a.max(b).max(0.0))]
    })
}

/// Barycentric coordinates of a point in the triangle's plane, clipped to the triangle: not negative, sum 1.
fn barycentric([a, b, c]: [DVec3; 3], point_mm: DVec3) -> [f64; 3] {
    let normal = (b - a).cross(c - a);
    let part = |from: DVec3, to: DVec3| ((to - from).cross(point_mm - from).dot(normal)).max(0.0);
    let parts = [part(b, c), part(c, a), part(a, b)];
    let sum: f64 = parts.iter().sum();
    if sum > 0.0 { parts.map(|part| part / sum) } else { [1.0, 0.0, 0.0] }
}

/// The point of a triangle nearest to `point_mm` (Ericson, Real-Time Collision Detection, 2005, 5.1.5).
fn nearest_point([a, b, c]: [DVec3; 3], point_mm: DVec3) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, point_mm - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = point_mm - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let cp = point_mm - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let (vc, vb, va) = (d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4);
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let inside = 1.0 / (va + vb + vc);
    a + ab * (vb * inside) + ac * (vc * inside)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::Label;
    use crate::vocabulary::notice::Notices;

    fn hull(vertices_mm: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Hull {
        Hull {
            labels: vec![Label::Projected; triangles.len()],
            part_of_vertex: vec![0; vertices_mm.len()],
            face_of_vertex: vec![0; vertices_mm.len()],
            place_of_vertex: (0..vertices_mm.len() as u32).collect(),
            vertices_mm,
            triangles,
            cell_mm: DVec3::splat(0.1),
            resolution: 1,
            max_edge_mm: 1.0,
            focal: None,
            notices: Notices::default(),
        }
    }

    /// The unit square at z = 0, facing +Z.
    fn sheet() -> Hull {
        hull(vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y], vec![[0, 1, 2], [0, 2, 3]])
    }

    /// The unit cube, faces outward.
    fn cube() -> Hull {
        let corner = |k: u32| DVec3::new((k & 1) as f64, (k >> 1 & 1) as f64, (k >> 2 & 1) as f64);
        let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let triangles = quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        hull((0..8).map(corner).collect(), triangles)
    }

    fn ray(origin_mm: DVec3, direction: DVec3) -> Ray {
        let direction = direction.normalize();
        Ray { origin_mm, direction, radiant_w: 1.0, luminous_lm: 0.0, column: 0, xz_lm: [0.0; 2] }
    }

    fn landed(hull: &Hull, landing: Landing) -> DVec3 {
        let corners = hull.corners_mm(landing.triangle);
        corners.iter().zip(landing.shares).map(|(corner, share)| *corner * share).sum()
    }

    /// Numbers in 0..1 without a generator: multiples of irrational numbers.
    fn scatter(k: usize) -> [f64; 4] {
        [2f64.sqrt(), 3f64.sqrt(), 5f64.sqrt(), 7f64.sqrt()].map(|root| (k as f64 * root).fract())
    }

    #[test]
    fn rays_from_within_leave_where_a_box_says() {
        let cube = cube();
        let projector = Projector::new(&cube);
        for k in 1..5000 {
            let [x, y, z, w] = scatter(k);
            let ray = ray(DVec3::new(x, y, z), DVec3::new(z - 0.5, w - 0.5, (x * 7.0).fract() - 0.5));
            let landing = projector.land(&ray).unwrap();
            // Slab test: the exit is at the least distance to the three faces ahead.
            let exit = (0..3)
                .map(|axis| {
                    ((if ray.direction[axis] > 0.0 { 1.0 } else { 0.0 }) - ray.origin_mm[axis]) / ray.direction[axis]
                })
                .fold(f64::INFINITY, f64::min);
            // Closer to the surface behind than the tolerance there is none that leads out.
            assert!(landed(&cube, landing).distance(ray.origin_mm + exit * ray.direction) < 1e-12, "ray {k}");
            assert_eq!(landing.fate, Fate::Hit);
            assert!((landing.shares.iter().sum::<f64>() - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn rays_from_outside_land_on_the_side_they_came_from() {
        let cube = cube();
        let projector = Projector::new(&cube);
        for k in 1..1000 {
            let [x, y, ..] = scatter(k);
            let start = DVec3::new(0.2 + 0.6 * x, 0.2 + 0.6 * y, 1.0);
            let direction = DVec3::new(0.1 * (y - 0.5), 0.1 * (x - 0.5), 1.0).normalize();
            let landing = projector.land(&ray(start + 5.0 * direction, direction)).unwrap();
            assert!(landed(&cube, landing).distance(start) < 1e-12);
        }
    }

    #[test]
    fn a_sheet_takes_rays_a_hair_off_it_even_grazing_and_from_behind() {
        let sheet = sheet();
        let projector = Projector::new(&sheet);
        for z in [-1e-7, 0.0, 1e-7] {
            for direction in [DVec3::Z, DVec3::new(1.0, 0.3, 1e-3), DVec3::NEG_Z] {
                let start = DVec3::new(0.3, 0.6, z);
                let landing = projector.land(&ray(start, direction)).unwrap();
                assert_eq!(landing.fate, Fate::Hit, "z {z}, {direction}");
                assert!(landed(&sheet, landing).distance(start) < 2e-4);
            }
        }
    }

    #[test]
    fn what_misses_snaps_near_and_is_rejected_far() {
        let sheet = sheet();
        let projector = Projector::new(&sheet);
        // The tolerance is 0.1 √3 = 0.173 mm.
        let beside = projector.land(&ray(DVec3::new(1.1, 0.25, 0.0), DVec3::Z)).unwrap();
        assert_eq!(beside.fate, Fate::Snapped);
        assert!(landed(&sheet, beside).distance(DVec3::new(1.0, 0.25, 0.0)) < 1e-15);
        assert_eq!(projector.land(&ray(DVec3::new(1.2, 0.25, 0.0), DVec3::Z)), None);
        assert_eq!(
            projector.land(&ray(DVec3::new(0.5, 0.5, 0.5), DVec3::NEG_Z)),
            None,
            "light that comes in from outside"
        );
    }

    /// What the cell of the start settles is what the tree finds.
    #[test]
    fn near_rays_land_where_the_tree_lands_them() {
        for hull in [cube(), sheet()] {
            let projector = Projector::new(&hull);
            let mut settled = 0;
            for k in 1..5000 {
                let [x, y, z, w] = scatter(k);
                let off_mm = [0.0, 1e-9, -1e-9, 0.02 * (z - 0.5), 0.3 * (z - 0.5)][k % 5];
                let direction = DVec3::new(z - 0.5, w - 0.5, (x * 7.0).fract() - 0.3);
                let ray = ray(DVec3::new(x, y, off_mm), direction);
                let near = projector.cells.near(ray.origin_mm).and_then(|near| projector.crossing_near(&ray, &near));
                if let Some(Crossing { triangle, t, .. }) = near {
                    settled += 1;
                    let tree = projector.crossing_anywhere(&ray).unwrap();
                    assert!((t - tree.t).abs() < 1e-12, "ray {k}: {t} on {triangle}, {} on {}", tree.t, tree.triangle);
                }
            }
            assert!(settled > 500, "only {settled} of 4999 were compared");
        }
    }

    #[test]
    fn lines_through_edges_and_corners_do_not_slip_through() {
        let cube = cube();
        let projector = Projector::new(&cube);
        for target in
            [DVec3::splat(1.0), DVec3::new(1.0, 0.5, 0.5), DVec3::new(1.0, 1.0, 0.5), DVec3::new(0.5, 0.5, 1.0)]
        {
            let from = DVec3::splat(0.5);
            let landing = projector.land(&ray(from, target - from)).unwrap();
            assert_eq!(landing.fate, Fate::Hit);
            assert!(landed(&cube, landing).distance(target) < 1e-12);
        }
    }
}
