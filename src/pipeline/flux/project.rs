//! One ray: hit, snapped or rejected, counted exactly once.
//!
//! Sliding a ray along its own line changes no light outside (`MODEL.md` 3), so a ray lands where its line leaves the hull:
//! - the first crossing ahead leads out: the origin is inside (a glowing volume, or just under the surface), it lands there;
//! - otherwise the origin is outside: it lands on the nearest crossing behind that leads out, the surface it came from;
//! - a line that only enters lands where it enters, if that is near: stray light from the back of a one-sided sheet;
//! - a line that meets nothing snaps to the nearest triangle within the tolerance; the rest is rejected.

use super::super::hull::Hull;
use super::super::rays::Ray;
use super::super::vocabulary::space::Bounds;
use super::bvh::Bvh;
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
    hull: &'a Hull,
    bvh: Bvh,
    /// Farther than this from the surface nothing is snapped, mm: a cell's diagonal.
    tolerance_mm: f64,
}

impl<'a> Projector<'a> {
    /// Indexes `hull`.
    pub fn new(hull: &'a Hull) -> Projector<'a> {
        let boxes: Vec<Bounds> =
            (0..hull.triangles.len()).map(|triangle| Bounds::of(hull.corners_mm(triangle))).collect();
        Projector { hull, bvh: Bvh::new(&boxes), tolerance_mm: hull.cell_mm.length() }
    }

    /// Where `ray` lands; `None` when it is rejected.
    pub fn land(&self, ray: &Ray) -> Option<Landing> {
        let landing = |(triangle, t): (usize, f64)| {
            let point_mm = ray.origin_mm + t * ray.direction;
            Landing { triangle, shares: barycentric(self.hull.corners_mm(triangle), point_mm), fate: Fate::Hit }
        };
        self.crossing(ray).map(landing).or_else(|| self.snap(ray.origin_mm))
    }

    /// Triangle and signed distance along the ray where its line lands.
    fn crossing(&self, ray: &Ray) -> Option<(usize, f64)> {
        let any = |_: f64| true;
        let out = |cosine: f64| cosine > 0.0;
        let ahead = self.first(ray, 1.0, f64::INFINITY, any);
        if let Some((triangle, t)) = ahead
            && out(ray.direction.dot(self.hull.normal(triangle)))
        {
            // Inside, unless a surface that leads out lies closer behind than the hull is accurate.
            let behind = self.first(ray, -1.0, t.abs().min(self.tolerance_mm), out);
            return Some(behind.filter(|(_, back)| back.abs() < t.abs()).unwrap_or((triangle, t)));
        }
        let near = |hit: &(usize, f64)| hit.1.abs() <= self.tolerance_mm;
        self.first(ray, -1.0, f64::INFINITY, out)
            .or_else(|| self.first(ray, 1.0, f64::INFINITY, out))
            .or_else(|| ahead.filter(near))
            .or_else(|| self.first(ray, -1.0, self.tolerance_mm, any))
    }

    /// First crossing ahead (`sense` +1) or behind (−1) whose cosine to the outward normal is `wanted`; signed distance.
    fn first(&self, ray: &Ray, sense: f64, limit_mm: f64, wanted: impl Fn(f64) -> bool) -> Option<(usize, f64)> {
        let meet = |triangle: usize| {
            let (t, cosine) = meet(self.hull.corners_mm(triangle), ray.origin_mm, ray.direction)?;
            wanted(cosine).then_some(sense * t).filter(|t| *t >= -1e-9 * self.tolerance_mm)
        };
        let (triangle, t) = self.bvh.first_along(ray.origin_mm, sense * ray.direction, limit_mm, meet)?;
        Some((triangle, sense * t))
    }

    /// The nearest triangle within the tolerance; ties go to the smaller index.
    fn snap(&self, point_mm: DVec3) -> Option<Landing> {
        let mut best: Option<(f64, usize, DVec3)> = None;
        self.bvh.near(point_mm, self.tolerance_mm, |triangle| {
            let nearest_mm = nearest_point(self.hull.corners_mm(triangle), point_mm);
            let distance_mm = nearest_mm.distance(point_mm);
            let closer = best.is_none_or(|(least, other, _)| (distance_mm, triangle) < (least, other));
            if distance_mm <= self.tolerance_mm && closer {
                best = Some((distance_mm, triangle, nearest_mm));
            }
        });
        best.map(|(_, triangle, nearest_mm)| Landing {
            triangle,
            shares: barycentric(self.hull.corners_mm(triangle), nearest_mm),
            fate: Fate::Snapped,
        })
    }
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
    let s = origin_mm - a;
    let u = s.dot(p) / determinant;
    let q = s.cross(ab);
    let v = direction.dot(q) / determinant;
    let t = ac.dot(q) / determinant;
    let slack = 1e-9;
    // The determinant is −direction · (ab × ac): negative when leaving.
    (u >= -slack && v >= -slack && u + v <= 1.0 + slack && t.is_finite()).then_some((t, -determinant))
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
