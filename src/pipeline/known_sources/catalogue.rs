//! The known sources by name.

use super::glow::EmissionSpectrum;
use super::shape::Shape;
use super::{KnownSource, Part};
use crate::vocabulary::space::Bounds;
use glam::DVec3;
use std::f64::consts::FRAC_1_SQRT_2;

/// Blue die, nm and weight per nm: a triangle about 450 nm, 20 nm wide at half height.
const BLUE: &[(f64, f64)] = &[(430.0, 0.0), (450.0, 1.0), (470.0, 0.0)];
/// Cyan die.
const CYAN: &[(f64, f64)] = &[(485.0, 0.0), (500.0, 1.0), (520.0, 0.0)];
/// Green die: lopsided, as InGaN is.
const GREEN: &[(f64, f64)] = &[(500.0, 0.0), (525.0, 1.0), (570.0, 0.0)];
/// Red die.
const RED: &[(f64, f64)] = &[(605.0, 0.0), (632.0, 1.0), (645.0, 0.0)];
/// Yellow phosphor: wide and rounded.
const PHOSPHOR: &[(f64, f64)] = &[
    (480.0, 0.0),
    (510.0, 0.45),
    (540.0, 0.95),
    (560.0, 1.0),
    (590.0, 0.85),
    (640.0, 0.4),
    (700.0, 0.08),
    (760.0, 0.0),
];

/// All known sources, looking along +Z.
pub fn all() -> Vec<KnownSource> {
    let sources = [
        flat_chip(),
        four_chips(),
        dome(),
        cylinder(),
        tilted_strip(),
        phosphor_ring(),
        two_lobes(),
        boxed_chip(),
        lit_sides(),
        opaque_ball(),
        absorbing_ball(),
        aspheric_dome(),
        beside_ring(),
        narrow_beam(),
        collimated(),
    ];
    sources.into_iter().flatten().collect()
}

/// The known source of this name.
pub fn by_name(name: &str) -> Option<KnownSource> {
    all().into_iter().find(|source| source.name == name)
}

fn part(shape: Shape, radiant_w: f64, spectrum: &[(f64, f64)]) -> Option<Part> {
    Some(Part { shape, radiant_w, glow: EmissionSpectrum::new(spectrum)? })
}

/// A rectangle in z = 0, glowing up.
fn chip(x: f64, y: f64, width: f64, height: f64) -> Shape {
    Shape::Rectangle {
        center: DVec3::new(x, y, 0.0),
        half_u: DVec3::new(0.5 * width, 0.0, 0.0),
        half_v: DVec3::new(0.0, 0.5 * height, 0.0),
    }
}

fn flat_chip() -> Option<KnownSource> {
    let parts = vec![part(chip(0.0, 0.0, 1.0, 1.0), 1.0, BLUE)?];
    Some(KnownSource::new("flat-chip", "A blue Lambertian chip, 1 x 1 mm in z = 0, 1 W.", parts))
}

fn four_chips() -> Option<KnownSource> {
    let parts = vec![
        part(chip(-0.6, -0.6, 1.0, 1.0), 0.9, BLUE)?,
        part(chip(0.6, -0.6, 1.0, 1.0), 0.3, CYAN)?,
        part(chip(-0.6, 0.6, 1.0, 1.0), 0.5, GREEN)?,
        part(chip(0.6, 0.6, 1.0, 1.0), 0.7, RED)?,
    ];
    let told =
        "Four Lambertian chips of 1 x 1 mm in z = 0 with gaps of 0.2 mm: blue 0.9, cyan 0.3, green 0.5, red 0.7 W.";
    Some(KnownSource::new("four-chips", told, parts))
}

fn dome() -> Option<KnownSource> {
    let parts = vec![part(Shape::Dome { radius_mm: 1.5, sin_cone: 0.5 }, 1.0, PHOSPHOR)?];
    let told = "A glowing ball of radius 0.5 mm at the centre of a ball lens of radius 1.5 mm and index 1.5 whose lower half is \
                black, seen on the lens: every point of the dome sends even radiance into a cone of 30 degrees round its normal, 1 W.";
    Some(KnownSource::new("dome", told, parts))
}

fn cylinder() -> Option<KnownSource> {
    let parts = vec![part(Shape::Cylinder { radius_mm: 0.5, height_mm: 4.0 }, 2.0, PHOSPHOR)?];
    let told =
        "A clear cylinder of radius 0.5 mm from z = 0 to 4 mm, glowing evenly in its volume into all directions, 2 W.";
    Some(KnownSource::new("cylinder", told, parts))
}

fn tilted_strip() -> Option<KnownSource> {
    let shape = Shape::Rectangle {
        center: DVec3::ZERO,
        half_u: DVec3::new(FRAC_1_SQRT_2, 0.0, -FRAC_1_SQRT_2),
        half_v: DVec3::new(0.0, 2.0, 0.0),
    };
    let told =
        "A Lambertian strip of 2 x 4 mm about the y axis, tilted by 45 degrees: it looks between +X and +Z, 1 W.";
    Some(KnownSource::new("tilted-strip", told, vec![part(shape, 1.0, RED)?]))
}

fn phosphor_ring() -> Option<KnownSource> {
    let parts = vec![
        part(chip(0.0, 0.0, 1.0, 1.0), 0.6, BLUE)?,
        part(Shape::Ring { center: DVec3::ZERO, inner_mm: 0.8, outer_mm: 1.5 }, 0.8, PHOSPHOR)?,
    ];
    let told =
        "A blue Lambertian chip of 1 x 1 mm in z = 0, 0.6 W, in a phosphor ring from radius 0.8 to 1.5 mm, 0.8 W.";
    Some(KnownSource::new("phosphor-ring", told, parts))
}

fn two_lobes() -> Option<KnownSource> {
    let lobe = |x: f64, y: f64| Shape::Lobe { half_mm: 0.5, toward: DVec3::new(x, y, 1.0).normalize(), power: 40.0 };
    let parts = vec![part(lobe(1.0, 0.0), 1.0, GREEN)?, part(lobe(0.0, 1.0), 0.5, GREEN)?];
    let told = "A chip of 1 x 1 mm in z = 0 with a lobe of 1 W towards +X+Z and one of 0.5 W towards +Y+Z, each 21 degrees wide: \
                tells which way round a file is.";
    Some(KnownSource::new("two-lobes", told, parts))
}

fn boxed_chip() -> Option<KnownSource> {
    let shape =
        Shape::Rectangle { center: DVec3::new(-0.6, 0.8, -0.4), half_u: 0.5 * DVec3::X, half_v: 0.5 * DVec3::Y };
    let told = "A green Lambertian chip of 1 x 1 mm at (-0.6, 0.8, -0.4) mm whose rays start where they leave the box of the package, \
                6 x 6 mm, from z = -0.5 to 0.02 mm, 1 W: the file does not show where the light is.";
    let source = KnownSource::new("boxed-chip", told, vec![part(shape, 1.0, GREEN)?]);
    let start = Bounds { min: DVec3::new(-3.0, -3.0, -0.5), max: DVec3::new(3.0, 3.0, 0.02) };
    Some(KnownSource { start: Some(start), ..source })
}

fn lit_sides() -> Option<KnownSource> {
    const HEIGHT_MM: f64 = 0.3;
    let side = |x: f64, y: f64| {
        let outward = DVec3::new(x, y, 0.0);
        let half_v = 0.5 * HEIGHT_MM * DVec3::Z;
        // half_u × half_v looks outward.
        let shape = Shape::Rectangle { center: 0.5 * outward + half_v, half_u: 0.5 * DVec3::Z.cross(outward), half_v };
        part(shape, 0.08, BLUE)
    };
    let top = Shape::Rectangle { center: HEIGHT_MM * DVec3::Z, half_u: 0.5 * DVec3::X, half_v: 0.5 * DVec3::Y };
    let parts = vec![part(top, 0.68, BLUE)?, side(1.0, 0.0)?, side(-1.0, 0.0)?, side(0.0, 1.0)?, side(0.0, -1.0)?];
    let told = "A blue chip of 1 x 1 x 0.3 mm, Lambertian on its top, 0.68 W, and on its four sides, 0.08 W each.";
    Some(KnownSource::new("lit-sides", told, parts))
}

fn opaque_ball() -> Option<KnownSource> {
    let shape = Shape::Ball { radius_mm: 0.5, absorption_per_mm: f64::INFINITY };
    let told = "An opaque Lambertian ball of radius 0.5 mm, 1 W.";
    Some(KnownSource::new("opaque-ball", told, vec![part(shape, 1.0, PHOSPHOR)?]))
}

fn absorbing_ball() -> Option<KnownSource> {
    let shape = Shape::Ball { radius_mm: 0.5, absorption_per_mm: 4.0 };
    let told = "A ball of radius 0.5 mm that glows evenly in its volume and absorbs its own light, 4 per mm, 1 W: neither a clear volume nor a Lambertian surface.";
    Some(KnownSource::new("absorbing-ball", told, vec![part(shape, 1.0, PHOSPHOR)?]))
}

fn aspheric_dome() -> Option<KnownSource> {
    let told = "A disc chip of radius 0.5 mm under an aspheric lens, half of an ellipsoid of half axes 1.4 and 1.7 mm and index 1.5; rays start on the lens, 1 W.";
    Some(KnownSource::new("aspheric-dome", told, vec![part(Shape::AsphericDome, 1.0, GREEN)?]))
}

fn beside_ring() -> Option<KnownSource> {
    let ring = Shape::Ring { center: DVec3::new(0.3, 0.2, 0.0), inner_mm: 0.8, outer_mm: 1.5 };
    let parts = vec![part(chip(0.0, 0.0, 0.6, 0.6), 0.6, BLUE)?, part(ring, 0.8, PHOSPHOR)?];
    let told = "A blue Lambertian chip of 0.6 x 0.6 mm in z = 0, 0.6 W, in a phosphor ring from radius 0.8 to 1.5 mm about (0.3, 0.2) mm, 0.8 W.";
    Some(KnownSource::new("beside-ring", told, parts))
}

fn narrow_beam() -> Option<KnownSource> {
    let shape = Shape::Lobe { half_mm: 0.5, toward: DVec3::Z, power: 182.0 };
    let told = "A chip of 1 x 1 mm in z = 0 with a beam 10 degrees wide at half maximum, 1 W.";
    Some(KnownSource::new("narrow-beam", told, vec![part(shape, 1.0, RED)?]))
}

fn collimated() -> Option<KnownSource> {
    let shape = Shape::Lobe { half_mm: 5.0, toward: DVec3::Z, power: 18_200.0 };
    let told = "A square of 10 x 10 mm in z = 0 with a beam 1 degree wide at half maximum, 1 W.";
    Some(KnownSource::new("collimated", told, vec![part(shape, 1.0, RED)?]))
}
