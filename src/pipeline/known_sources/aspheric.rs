//! A disc chip in z = 0 under an aspheric lens, half of an ellipsoid of index 1.5: what no plane and no sphere makes sharp. Its radiance
//! along any line follows from Snell's law and the invariance of L/n²; its intensity is the integral of that. The lens is so high and the
//! chip so small that no light is totally reflected; reflection losses are left out.

use crate::vocabulary::space::Bounds;
use glam::DVec3;
use std::f64::consts::PI;
use std::sync::LazyLock;

/// Radius of the chip, mm.
pub const CHIP_MM: f64 = 0.5;
/// Half axes of the lens across and along the axis, mm.
const ACROSS_MM: f64 = 1.4;
const HEIGHT_MM: f64 = 1.7;
const INDEX: f64 = 1.5;
/// Steps of the tabled intensity over 180 degrees, and lines of sight across the lens in each of its integrals.
const STEPS: usize = 360;
const LINES: usize = 256;

/// Takes the ellipsoid to the unit sphere.
const TO_SPHERE: DVec3 = DVec3::new(1.0 / ACROSS_MM, 1.0 / ACROSS_MM, 1.0 / HEIGHT_MM);

/// Intensity per watt, 1/sr, at even steps from the axis.
static INTENSITY_PER_SR: LazyLock<Vec<f64>> =
    LazyLock::new(|| (0..=STEPS).map(|step| integrated_intensity_per_sr(PI * step as f64 / STEPS as f64)).collect());

/// Area of the lens, mm²: half of a prolate spheroid.
pub fn area_mm2() -> f64 {
    let eccentricity = (1.0 - (ACROSS_MM / HEIGHT_MM).powi(2)).sqrt();
    PI * ACROSS_MM * (ACROSS_MM + HEIGHT_MM * eccentricity.asin() / eccentricity)
}

/// Box of the lens, mm.
pub fn bounds_mm() -> Bounds {
    Bounds { min: DVec3::new(-ACROSS_MM, -ACROSS_MM, 0.0), max: DVec3::new(ACROSS_MM, ACROSS_MM, HEIGHT_MM) }
}

/// Where light of the chip leaves the lens, and its direction there.
pub fn refracted(chip_mm: DVec3, direction: DVec3) -> (DVec3, DVec3) {
    let point_mm = last_crossing_mm(chip_mm, direction).unwrap_or(chip_mm);
    (point_mm, bent(direction, normal(point_mm), INDEX))
}

/// Radiance per watt along a line outside, 1/(mm² sr).
pub fn radiance_per_mm2_sr(point_mm: DVec3, direction: DVec3) -> f64 {
    let Some(exit_mm) = last_crossing_mm(point_mm, direction).filter(|exit_mm| exit_mm.z >= 0.0) else { return 0.0 };
    let inside = bent(direction, normal(exit_mm), 1.0 / INDEX);
    let chip_mm = exit_mm - inside * (exit_mm.z / inside.z);
    let is_lit = inside.z > 0.0 && chip_mm.length() <= CHIP_MM;
    if is_lit { 1.0 / (PI * PI * CHIP_MM * CHIP_MM * INDEX * INDEX) } else { 0.0 }
}

/// Intensity per watt in a unit direction, 1/sr.
pub fn intensity_per_sr(direction: DVec3) -> f64 {
    let at = direction.z.clamp(-1.0, 1.0).acos() / PI * STEPS as f64;
    let step = (at as usize).min(STEPS - 1);
    let (here, next) = (INTENSITY_PER_SR[step], INTENSITY_PER_SR[step + 1]);
    here + (next - here) * (at - step as f64)
}

/// I = ∫ L dA over a plane across the direction, at `theta` from the axis; both halves beside it are the same.
fn integrated_intensity_per_sr(theta: f64) -> f64 {
    let (sin, cos) = theta.sin_cos();
    let (direction, up) = (DVec3::new(sin, 0.0, cos), DVec3::new(-cos, 0.0, sin));
    let (middle_mm, half_mm) = (0.5 * HEIGHT_MM * DVec3::Z, HEIGHT_MM);
    let line_mm = 2.0 * half_mm / LINES as f64;
    let offset_mm = |line: usize| (line as f64 + 0.5) * line_mm;
    let lines = (0..LINES * LINES / 2)
        .map(|k| middle_mm + offset_mm(k % (LINES / 2)) * DVec3::Y + (offset_mm(k / (LINES / 2)) - half_mm) * up);
    2.0 * line_mm * line_mm * lines.map(|point_mm| radiance_per_mm2_sr(point_mm, direction)).sum::<f64>()
}

/// Where a line leaves the ellipsoid, mm.
fn last_crossing_mm(point_mm: DVec3, direction: DVec3) -> Option<DVec3> {
    let (from, along) = (point_mm * TO_SPHERE, direction * TO_SPHERE);
    let (square, middle) = (along.length_squared(), from.dot(along));
    let root = middle * middle - square * (from.length_squared() - 1.0);
    (root >= 0.0).then(|| point_mm + direction * ((root.sqrt() - middle) / square))
}

/// Outward normal of the ellipsoid.
fn normal(point_mm: DVec3) -> DVec3 {
    (point_mm * TO_SPHERE * TO_SPHERE).normalize()
}

/// A direction behind a surface whose `normal` it has positive cosine to; `ratio`: index before over index behind (Snell).
fn bent(direction: DVec3, normal: DVec3, ratio: f64) -> DVec3 {
    let cosine = direction.dot(normal);
    let behind = (1.0 - ratio * ratio * (1.0 - cosine * cosine)).max(0.0).sqrt();
    (ratio * direction + (behind - ratio * cosine) * normal).normalize()
}
