//! Glowing shapes: what is drawn from them and what is true of them, per watt. Frame: the part's own, looking along +Z.

use super::aspheric;
use crate::vocabulary::space::Bounds;
use glam::{DMat3, DVec3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Points nearer to a surface than this, mm, lie on it.
const ON_SURFACE_MM: f64 = 1e-6;

/// A shape and the way it glows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A flat Lambertian rectangle. Glows towards `half_u` × `half_v`.
    Rectangle {
        /// Middle, mm.
        center: DVec3,
        /// Half of one edge, mm.
        half_u: DVec3,
        /// Half of the other edge, mm; at right angles to the first.
        half_v: DVec3,
    },
    /// A flat Lambertian ring in z = 0, glowing towards +Z.
    Ring {
        /// Middle, mm.
        center: DVec3,
        /// Inner radius, mm.
        inner_mm: f64,
        /// Outer radius, mm.
        outer_mm: f64,
    },
    /// The upper half of a clear ball lens, seen from outside, with a Lambertian glowing ball at its centre; the lower half
    /// is black. By Snell's law and the invariance of L/n² each point of the dome sends constant radiance into a cone
    /// round its normal of half-angle α, sin α = n·(radius of the glowing ball)/(radius of the lens), and nothing
    /// outside it: position and direction are coupled as under a real dome, and yet everything has a closed form.
    /// (A flat chip under a dome has none.) Reflection losses are left out.
    Dome {
        /// Radius of the lens, mm; its centre is the origin.
        radius_mm: f64,
        /// sin α.
        sin_cone: f64,
    },
    /// A disc chip under an aspheric lens; [`aspheric`] has its size.
    AsphericDome,
    /// A ball about the origin that glows evenly in its volume, into all directions, and absorbs its own light: what leaves along a chord of
    /// length l has the radiance (1 − exp(−absorption·l)) × that of an opaque ball of the same glow. Of infinite absorption it is a
    /// Lambertian ball. Rays start where they were emitted.
    Ball {
        /// Radius, mm.
        radius_mm: f64,
        /// Absorption coefficient, 1/mm.
        absorption_per_mm: f64,
    },
    /// A cylinder about the z axis whose clear volume glows evenly and equally into all directions.
    Cylinder {
        /// Radius, mm.
        radius_mm: f64,
        /// Height, mm, from z = 0 up.
        height_mm: f64,
    },
    /// A flat square in z = 0 that glows in one lobe: intensity falls as a power of the cosine to `toward`.
    Lobe {
        /// Half of an edge, mm.
        half_mm: f64,
        /// Unit direction of the peak.
        toward: DVec3,
        /// The power; 40 is 21° wide at half maximum.
        power: f64,
    },
}

impl Shape {
    /// Area of the surface light comes out of, mm².
    pub fn area_mm2(&self) -> f64 {
        match *self {
            Shape::Rectangle { half_u, half_v, .. } => 4.0 * half_u.length() * half_v.length(),
            Shape::Ring { inner_mm, outer_mm, .. } => PI * (outer_mm * outer_mm - inner_mm * inner_mm),
            Shape::Dome { radius_mm, .. } => TAU * radius_mm * radius_mm,
            Shape::AsphericDome => aspheric::area_mm2(),
            Shape::Ball { radius_mm, .. } => 4.0 * PI * radius_mm * radius_mm,
            Shape::Cylinder { radius_mm, height_mm } => TAU * radius_mm * (radius_mm + height_mm),
            Shape::Lobe { half_mm, .. } => 4.0 * half_mm * half_mm,
        }
    }

    /// Box of the origins, mm.
    pub fn bounds_mm(&self) -> Bounds {
        match *self {
            Shape::Rectangle { center, half_u, half_v } => {
                let reach = half_u.abs() + half_v.abs();
                Bounds { min: center - reach, max: center + reach }
            }
            Shape::Ring { center, outer_mm: r, .. } => {
                Bounds { min: center - DVec3::new(r, r, 0.0), max: center + DVec3::new(r, r, 0.0) }
            }
            Shape::AsphericDome => aspheric::bounds_mm(),
            Shape::Ball { radius_mm: r, .. } => Bounds { min: DVec3::splat(-r), max: DVec3::splat(r) },
            Shape::Dome { radius_mm: r, .. } => Bounds { min: DVec3::new(-r, -r, 0.0), max: DVec3::splat(r) },
            Shape::Cylinder { radius_mm: r, height_mm } => {
                Bounds { min: DVec3::new(-r, -r, 0.0), max: DVec3::new(r, r, height_mm) }
            }
            Shape::Lobe { half_mm: r, .. } => Bounds { min: DVec3::new(-r, -r, 0.0), max: DVec3::new(r, r, 0.0) },
        }
    }

    /// Origin (mm) and unit direction that belong to five uniform numbers.
    pub fn draw(&self, [a, b, c, d, e]: [f64; 5]) -> (DVec3, DVec3) {
        match *self {
            Shape::Rectangle { center, half_u, half_v } => {
                let origin = center + (2.0 * a - 1.0) * half_u + (2.0 * b - 1.0) * half_v;
                (origin, around(half_u.cross(half_v).normalize()) * cone(1.0, c, d))
            }
            Shape::Ring { center, inner_mm, outer_mm } => {
                let radius = (inner_mm * inner_mm + a * (outer_mm * outer_mm - inner_mm * inner_mm)).sqrt();
                (center + polar(radius, b, 0.0), cone(1.0, c, d))
            }
            Shape::AsphericDome => aspheric::refracted(polar(aspheric::CHIP_MM * a.sqrt(), b, 0.0), cone(1.0, c, d)),
            Shape::Ball { radius_mm, absorption_per_mm } => {
                let normal = polar((4.0 * a * (1.0 - a)).sqrt(), b, 2.0 * a - 1.0);
                let thickness = 2.0 * radius_mm * absorption_per_mm;
                let cosine = exit_cosine(thickness, c);
                let direction = around(normal) * polar((1.0 - cosine * cosine).sqrt(), d, cosine);
                let depth_mm = -(1.0 - e * absorbed(thickness * cosine)).ln() / absorption_per_mm;
                (radius_mm * normal - depth_mm * direction, direction)
            }
            Shape::Dome { radius_mm, sin_cone } => {
                // Archimedes: on a sphere height is uniform.
                let normal = polar((1.0 - a * a).sqrt(), b, a);
                (radius_mm * normal, around(normal) * cone(sin_cone, c, d))
            }
            Shape::Cylinder { radius_mm, height_mm } => {
                let z = 2.0 * d - 1.0;
                (polar(radius_mm * a.sqrt(), b, c * height_mm), polar((1.0 - z * z).sqrt(), e, z))
            }
            Shape::Lobe { half_mm, toward, power } => {
                let origin = DVec3::new((2.0 * a - 1.0) * half_mm, (2.0 * b - 1.0) * half_mm, 0.0);
                let z = c.powf(1.0 / (power + 1.0));
                (origin, around(toward) * polar((1.0 - z * z).sqrt(), d, z))
            }
        }
    }

    /// Intensity per watt in a unit direction, 1/sr.
    pub fn intensity_per_sr(&self, direction: DVec3) -> f64 {
        match *self {
            Shape::Rectangle { half_u, half_v, .. } => direction.dot(half_u.cross(half_v).normalize()).max(0.0) / PI,
            Shape::Ring { .. } => direction.z.max(0.0) / PI,
            Shape::Dome { sin_cone, .. } => dome_disc(direction.z, sin_cone) / (TAU * PI * sin_cone * sin_cone),
            Shape::AsphericDome => aspheric::intensity_per_sr(direction),
            Shape::Ball { .. } | Shape::Cylinder { .. } => 1.0 / (4.0 * PI),
            Shape::Lobe { toward, power, .. } => (power + 1.0) / TAU * direction.dot(toward).max(0.0).powf(power),
        }
    }

    /// Radiance per watt along a line, 1/(mm² sr).
    pub fn radiance_per_mm2_sr(&self, point: DVec3, direction: DVec3) -> f64 {
        match *self {
            Shape::Rectangle { center, half_u, half_v } => {
                let normal = half_u.cross(half_v);
                let across = direction.dot(normal);
                let hit = point + direction * ((center - point).dot(normal) / across) - center;
                let inside = |half: DVec3| hit.dot(half).abs() <= half.length_squared();
                if across > 0.0 && inside(half_u) && inside(half_v) { 1.0 / (PI * self.area_mm2()) } else { 0.0 }
            }
            Shape::Ring { center, inner_mm, outer_mm } => {
                let hit = point - direction * (point.z / direction.z) - center;
                let radius = hit.x.hypot(hit.y);
                let lit = direction.z > 0.0 && radius >= inner_mm && radius <= outer_mm;
                if lit { 1.0 / (PI * self.area_mm2()) } else { 0.0 }
            }
            Shape::Dome { radius_mm, sin_cone } => {
                let foot = point - direction * point.dot(direction);
                let left = radius_mm * radius_mm - foot.length_squared();
                let exit = foot + direction * left.max(0.0).sqrt();
                let lit = exit.z >= 0.0 && foot.length() <= radius_mm * sin_cone;
                if lit { 1.0 / (self.area_mm2() * PI * sin_cone * sin_cone) } else { 0.0 }
            }
            Shape::AsphericDome => aspheric::radiance_per_mm2_sr(point, direction),
            Shape::Ball { radius_mm, absorption_per_mm } => {
                let foot = point - direction * point.dot(direction);
                let cosine = (1.0 - foot.length_squared() / (radius_mm * radius_mm)).max(0.0).sqrt();
                let thickness = 2.0 * radius_mm * absorption_per_mm;
                if cosine == 0.0 {
                    return 0.0;
                }
                absorbed(thickness * cosine) / (self.area_mm2() * TAU * exit_flux(thickness, 1.0))
            }
            Shape::Cylinder { radius_mm, height_mm } => {
                chord_mm(radius_mm, height_mm, point, direction) / (4.0 * PI * PI * radius_mm * radius_mm * height_mm)
            }
            Shape::Lobe { half_mm, .. } => {
                let hit = point - direction * (point.z / direction.z);
                let lit = hit.x.abs().max(hit.y.abs()) <= half_mm;
                if lit { self.intensity_per_sr(direction) / (self.area_mm2() * direction.z.abs()) } else { 0.0 }
            }
        }
    }

    /// Exitance per watt at a point, 1/mm²: 0 off the surface; `None` where the surface is lit unevenly or rays start below it.
    pub fn exitance_per_mm2(&self, point: DVec3) -> Option<f64> {
        let on = match *self {
            Shape::Rectangle { center, half_u, half_v } => {
                let from = point - center;
                let inside = |half: DVec3| from.dot(half).abs() <= half.length_squared() + ON_SURFACE_MM;
                inside(half_u) && inside(half_v) && from.dot(half_u.cross(half_v).normalize()).abs() <= ON_SURFACE_MM
            }
            Shape::Ring { center, inner_mm, outer_mm } => {
                let from = point - center;
                from.z.abs() <= ON_SURFACE_MM && (inner_mm..=outer_mm).contains(&from.x.hypot(from.y))
            }
            Shape::Ball { radius_mm, absorption_per_mm } if absorption_per_mm.is_infinite() => {
                (point.length() - radius_mm).abs() <= ON_SURFACE_MM
            }
            Shape::Dome { radius_mm, .. } => point.z >= 0.0 && (point.length() - radius_mm).abs() <= ON_SURFACE_MM,
            Shape::AsphericDome | Shape::Ball { .. } | Shape::Cylinder { .. } => return None,
            Shape::Lobe { half_mm, .. } => {
                point.z.abs() <= ON_SURFACE_MM && point.x.abs().max(point.y.abs()) <= half_mm + ON_SURFACE_MM
            }
        };
        Some(if on { 1.0 / self.area_mm2() } else { 0.0 })
    }

    /// Share of the origins within `region`, where it has a closed form: all, nothing, the cut of a rectangle, a slice of the
    /// cylinder. Only for shapes whose every part has the same angular distribution.
    pub fn share_within(&self, region: &Bounds) -> Option<f64> {
        let own = self.bounds_mm();
        if own.min.cmpge(region.min).all() && own.max.cmple(region.max).all() {
            return Some(1.0);
        }
        if own.min.cmpgt(region.max).any() || own.max.cmplt(region.min).any() {
            return Some(0.0);
        }
        match *self {
            Shape::Rectangle { center, half_u, half_v } => {
                let corners = [half_u + half_v, half_v - half_u, -half_u - half_v, half_u - half_v];
                Some(clipped_area(corners.map(|corner| center + corner).to_vec(), region) / self.area_mm2())
            }
            Shape::Cylinder { height_mm, .. } => {
                let across = [0, 1].iter().all(|k| region.min[*k] <= own.min[*k] && region.max[*k] >= own.max[*k]);
                across.then(|| (region.max.z.min(height_mm) - region.min.z.max(0.0)).max(0.0) / height_mm)
            }
            Shape::Ring { .. } | Shape::Dome { .. } | Shape::AsphericDome | Shape::Ball { .. } | Shape::Lobe { .. } => {
                None
            }
        }
    }
}

/// The point at `radius` and the share `turn` of a full turn in the plane at height `z`.
fn polar(radius: f64, turn: f64, z: f64) -> DVec3 {
    let (sin, cos) = (TAU * turn).sin_cos();
    DVec3::new(radius * cos, radius * sin, z)
}

/// A direction with even radiance within a cone about +Z; the half space for `sin_cone` 1.
fn cone(sin_cone: f64, a: f64, b: f64) -> DVec3 {
    let sin = sin_cone * a.sqrt();
    polar(sin, b, (1.0 - sin * sin).sqrt())
}

/// A right-handed frame whose z is `normal`.
fn around(normal: DVec3) -> DMat3 {
    let (x, y) = normal.any_orthonormal_pair();
    DMat3::from_cols(x, y, normal)
}

/// Part of what glows along a path that is absorbed on it: 1 − exp(−thickness).
fn absorbed(thickness: f64) -> f64 {
    -(-thickness).exp_m1()
}

/// ∫ (1 − exp(−thickness·c)) c dc from 0 to `cosine`: what leaves an absorbing ball below that cosine to its normal.
fn exit_flux(thickness: f64, cosine: f64) -> f64 {
    let along = thickness * cosine;
    let inside = if thickness.is_infinite() { 0.0 } else { (1.0 - (-along).exp() * (1.0 + along)) / thickness.powi(2) };
    0.5 * cosine * cosine - inside
}

/// The cosine to the normal below which the share `u` of the light of an absorbing ball leaves it, by halving.
fn exit_cosine(thickness: f64, u: f64) -> f64 {
    let goal = u * exit_flux(thickness, 1.0);
    let halve = |[low, high]: [f64; 2]| {
        let middle = 0.5 * (low + high);
        if exit_flux(thickness, middle) < goal { [middle, high] } else { [low, middle] }
    };
    (0..48).fold([0.0, 1.0], |range, _| halve(range))[1]
}

/// Area, in squared lens radii, of the light disc of a dome seen at the cosine `z` from its axis: a disc of radius sin α, cut by
/// the dome's rim where both overlap. Integrated by parts from ∫ 2 arccos(−cot β cot θ) sin β cos β dβ, β = 0..α.
fn dome_disc(z: f64, sin_cone: f64) -> f64 {
    let (theta, alpha) = (z.clamp(-1.0, 1.0).acos(), sin_cone.asin());
    let square = sin_cone * sin_cone;
    if theta <= FRAC_PI_2 - alpha {
        return PI * square;
    }
    if theta >= FRAC_PI_2 + alpha {
        return 0.0;
    }
    let rim = (-theta.cos() / theta.sin() / alpha.tan()).clamp(-1.0, 1.0).acos();
    square * rim + theta.cos() * (alpha.cos() / theta.sin()).min(1.0).acos()
}

/// Length of a line within the cylinder, mm.
fn chord_mm(radius_mm: f64, height_mm: f64, point: DVec3, direction: DVec3) -> f64 {
    let across = direction.x * direction.x + direction.y * direction.y;
    let middle = point.x * direction.x + point.y * direction.y;
    let beside = point.x * point.x + point.y * point.y - radius_mm * radius_mm;
    let square = middle * middle - across * beside;
    let (mut from, mut to) = if across > 0.0 {
        let root = square.max(0.0).sqrt();
        ((-middle - root) / across, (-middle + root) / across)
    } else if beside <= 0.0 {
        (f64::NEG_INFINITY, f64::INFINITY)
    } else {
        return 0.0;
    };
    if direction.z == 0.0 {
        return if (0.0..=height_mm).contains(&point.z) { (to - from).max(0.0) } else { 0.0 };
    }
    let (a, b) = (-point.z / direction.z, (height_mm - point.z) / direction.z);
    from = from.max(a.min(b));
    to = to.min(a.max(b));
    (to - from).max(0.0)
}

/// Area of a flat convex polygon within a box, mm² (Sutherland and Hodgman).
fn clipped_area(mut corners: Vec<DVec3>, region: &Bounds) -> f64 {
    for axis in 0..3 {
        for (edge, side) in [(region.min[axis], 1.0), (region.max[axis], -1.0)] {
            let height = |point: DVec3| side * (point[axis] - edge);
            let mut kept = Vec::new();
            for (k, point) in corners.iter().enumerate() {
                let next = corners[(k + 1) % corners.len()];
                let (here, there) = (height(*point), height(next));
                if here >= 0.0 {
                    kept.push(*point);
                }
                if (here < 0.0) != (there < 0.0) {
                    kept.push(point.lerp(next, here / (here - there)));
                }
            }
            corners = kept;
        }
    }
    let Some(first) = corners.first().copied() else { return 0.0 };
    let fan = corners.windows(2).map(|pair| (pair[0] - first).cross(pair[1] - first));
    0.5 * fan.sum::<DVec3>().length()
}
