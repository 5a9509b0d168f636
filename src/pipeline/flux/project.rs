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
}

/// Lays rays on a hull.
pub struct Projector<'a> {
    /// The grid that rays are slid to, with the first triangles of the hull.
    focal: Option<&'a FocalGrid>,
    /// How many triangles the index leaves to it.
    first: usize,
    hull: &'a Hull,
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
        let boxes: Vec<Bounds> =
            (first..hull.triangles.len()).map(|triangle| Bounds::of(hull.corners_mm(triangle))).collect();
        let cell_mm = focal.map_or(hull.cell_mm, |grid| grid.loose_cell_mm);
        let cells = Cells::new(&boxes, cell_mm.max_element());
        Projector { focal, first, hull, cells, bvh: Bvh::new(&boxes), tolerance_mm: cell_mm.length() }
    }

    /// Where `ray` lands; `None` when it is rejected.
    pub fn land(&self, ray: &Ray) -> Option<Landing> {
        if let Some((triangle, shares)) = self.focal.and_then(|grid| grid.land(ray)) {
            return Some(Landing { triangle, shares, fate: Fate::Hit });
        }
        if self.first == self.hull.triangles.len() {
            return None;
        }
        let landing = |(triangle, t): (usize, f64)| {
            let point_mm = ray.origin_mm + t * ray.direction;
            Landing { triangle, shares: barycentric(self.corners_mm(triangle), point_mm), fate: Fate::Hit }
        };
        let landing = self.crossing(ray).map(landing).or_else(|| self.snap(ray.origin_mm))?;
        Some(Landing { triangle: self.first + landing.triangle, ..landing })
    }

    /// Triangle and signed distance along the ray where its line lands.
    fn crossing(&self, ray: &Ray) -> Option<(usize, f64)> {
        let near = self.cells.near(ray.origin_mm).and_then(|near| self.crossing_near(ray, &near));
        near.or_else(|| self.crossing_anywhere(ray))
    }

    /// The same, by the tree.
    fn crossing_anywhere(&self, ray: &Ray) -> Option<(usize, f64)> {
        let any = |_: f64| true;
        let out = |cosine: f64| cosine > 0.0;
        let ahead = self.first(ray, 1.0, f64::INFINITY, any);
        if let Some((triangle, t)) = ahead
            && self.leads_out(triangle, ray.direction)
        {
            // Inside, unless a surface that leads out lies closer behind than the hull is accurate.
            let limit_mm = t.abs().min(self.tolerance_mm);
            let behind = if limit_mm > 0.0 { self.first(ray, -1.0, limit_mm, out) } else { None };
            return Some(behind.filter(|(_, back)| back.abs() < t.abs()).unwrap_or((triangle, t)));
        }
        let near = |hit: &(usize, f64)| hit.1.abs() <= self.tolerance_mm;
        self.first(ray, -1.0, f64::INFINITY, out)
            .or_else(|| self.first(ray, 1.0, f64::INFINITY, out))
            .or_else(|| ahead.filter(near))
            .or_else(|| self.first(ray, -1.0, self.tolerance_mm, any))
    }

    /// The same, where what lies in the cell of the start is enough to tell: what is met within a cell is met before all that lies beyond.
    fn crossing_near(&self, ray: &Ray, near: &Near<'_>) -> Option<(usize, f64)> {
        let [reach_behind, reach_ahead] = reach_mm(&near.cell, ray);
        let [mut ahead, mut behind]: [Option<(usize, f64)>; 2] = [None, None];
        for item in near.items {
            let triangle = *item as usize;
            let Some((t, cosine)) = meet(self.corners_mm(triangle), ray.origin_mm, ray.direction) else { continue };
            if self.is_on(t) && t <= reach_ahead && ahead.is_none_or(|(_, least)| t < least) {
                ahead = Some((triangle, t));
            }
            if cosine > 0.0 && self.is_on(-t) && -t <= reach_behind && behind.is_none_or(|(_, least)| -t < -least) {
                behind = Some((triangle, t));
            }
        }
        match (ahead, behind) {
            (Some((triangle, t)), _) if self.leads_out(triangle, ray.direction) => {
                let limit_mm = t.abs().min(self.tolerance_mm);
                let closer =
                    behind.filter(|(_, back)| limit_mm > 0.0 && back.abs() <= limit_mm && back.abs() < t.abs());
                (limit_mm <= reach_behind).then_some(closer.unwrap_or((triangle, t)))
            }
            (Some(_), behind) => behind,
            (None, Some((_, back))) => behind.filter(|_| back.abs() <= self.tolerance_mm && back.abs() < reach_ahead),
            (None, None) => None,
        }
    }

    /// Whether a crossing at `t` counts as ahead: rounding may put one at the start a hair behind it.
    fn is_on(&self, t: f64) -> bool {
        t >= -1e-9 * self.tolerance_mm
    }

    /// Corners of a triangle that is left to the index.
    fn corners_mm(&self, triangle: usize) -> [DVec3; 3] {
        self.hull.corners_mm(self.first + triangle)
    }

    fn leads_out(&self, triangle: usize, direction: DVec3) -> bool {
        let [a, b, c] = self.corners_mm(triangle);
        direction.dot((b - a).cross(c - a)) > 0.0
    }

    /// First crossing ahead (`sense` +1) or behind (−1) whose cosine to the outward normal is `wanted`; signed distance.
    fn first(&self, ray: &Ray, sense: f64, limit_mm: f64, wanted: impl Fn(f64) -> bool) -> Option<(usize, f64)> {
        let meet = |triangle: usize| {
            let (t, cosine) = meet(self.corners_mm(triangle), ray.origin_mm, ray.direction)?;
            wanted(cosine).then_some(sense * t).filter(|t| self.is_on(*t))
        };
        let (triangle, t) = self.bvh.first_along(ray.origin_mm, sense * ray.direction, limit_mm, meet)?;
        Some((triangle, sense * t))
    }

    /// The nearest triangle within the tolerance; ties go to the smaller index.
    fn snap(&self, point_mm: DVec3) -> Option<Landing> {
        let mut best: Option<(f64, usize, DVec3)> = None;
        self.bvh.near(point_mm, self.tolerance_mm, |triangle| {
            let nearest_mm = nearest_point(self.corners_mm(triangle), point_mm);
            let distance_mm = nearest_mm.distance(point_mm);
            let closer = best.is_none_or(|(least, other, _)| (distance_mm, triangle) < (least, other));
            if distance_mm <= self.tolerance_mm && closer {
                best = Some((distance_mm, triangle, nearest_mm));
            }
        });
        best.map(|(_, triangle, nearest_mm)| Landing {
            triangle,
            shares: barycentric(self.corners_mm(triangle), nearest_mm),
            fate: Fate::Snapped,
        })
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

/// Signed distance along unit `direction` at which a line meets a triangle, and the sign-carrying cosine to its normal (not
/// normalised). Möller and Trumbore, J. Graphics Tools 2(1), 1997; edges belong to both neighbours, so no line slips between.
fn meet([a, b, c]: [DVec3; 3], origin_mm: DVec3, direction: DVec3) -> Option<(f64, f64)> {
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(ac);
    let determinant = ab.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let per_determinant = 1.0 / determinant;
    let s = origin_mm - a;
    let slack = 1e-9;
    let u = s.dot(p) * per_determinant;
    if !(-slack..=1.0 + slack).contains(&u) {
        return None;
    }
    let q = s.cross(ab);
    let v = direction.dot(q) * per_determinant;
    let t = ac.dot(q) * per_determinant;
    // The determinant is −direction · (ab × ac): negative when leaving.
    (v >= -slack && u + v <= 1.0 + slack && t.is_finite()).then_some((t, -determinant))
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
                if let Some((triangle, t)) = near {
                    settled += 1;
                    let (by_tree, t_by_tree) = projector.crossing_anywhere(&ray).unwrap();
                    assert!((t - t_by_tree).abs() < 1e-12, "ray {k}: {t} on {triangle}, {t_by_tree} on {by_tree}");
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
