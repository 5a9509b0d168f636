//! Rays against closed forms, and closed forms against each other. All estimates are judged by their own standard errors; the
//! seeds are fixed, and each |z| < 5 has a false-alarm rate of 6e-7 for a new seed.

use super::*;
use crate::rays::direction_cube::DirectionCube;

const RAYS: u64 = 1 << 17;

fn drawn(source: &KnownSource) -> Vec<RawRay> {
    let mut rays = Vec::new();
    source.rays(7, RAYS, 0, RAYS as usize, &mut rays);
    rays
}

/// z-score of `found` of `RAYS` rays where the share `expected` was due. Anscombe's (1948) transform of a binomial count, whose tails are a
/// normal distribution's also where few rays are due: (n − μ)/σ is beyond 5 seven times as often for 100 rays.
fn z_of_count(found: u64, expected: f64) -> f64 {
    let n = RAYS as f64;
    let angle = |count: f64| ((count + 0.375) / (n + 0.75)).min(1.0).sqrt().asin();
    2.0 * (n + 0.5).sqrt() * (angle(found as f64) - angle(n * expected))
}

/// Every known source, each turned another way, and all turned straight.
fn turned() -> Vec<KnownSource> {
    let other = all().into_iter().zip(Axis::ALL).map(|(source, axis)| source.rotate(axis));
    all().into_iter().chain(other).collect()
}

/// Uniform points in the cell of a direction cube, by subdividing: `∫ f dω` to about 1e-5.
fn integral_over_cell(cell: usize, f: impl Fn(DVec3) -> f64) -> f64 {
    const FINE: usize = 16;
    let middle = DirectionCube::center(cell);
    let axis = Axis::nearest(middle);
    let (k, half) = (axis.component(), 1.0 / crate::rays::direction_cube::CUBE_CELLS as f64);
    let on_face = middle / middle[k].abs();
    let (u, v) = ((k + 1) % 3, (k + 2) % 3);
    let offset = |i: usize| half * ((2 * i + 1) as f64 / FINE as f64 - 1.0);
    let mut sum = 0.0;
    for i in 0..FINE * FINE {
        let mut point = on_face;
        point[u] += offset(i / FINE);
        point[v] += offset(i % FINE);
        sum += f(point.normalize()) / point.length().powi(3);
    }
    sum * (2.0 * half / FINE as f64).powi(2)
}

#[test]
fn rays_go_where_the_intensity_says() {
    for source in turned() {
        let mut found = vec![0; DirectionCube::CELLS];
        for ray in drawn(&source) {
            found[DirectionCube::cell(DVec3::from_array(ray.direction))] += 1;
        }
        let mut sum = 0.0;
        for (cell, count) in found.iter().enumerate() {
            let expected = integral_over_cell(cell, |w| source.intensity_w_per_sr(w)) / source.radiant_w();
            let z = z_of_count(*count, expected);
            assert!(z.abs() < 5.0, "{} cell {cell}: {count} of {}, z {z}", source.name, RAYS as f64 * expected);
            sum += expected;
        }
        assert!((sum - 1.0).abs() < 1e-3, "{}: intensity integrates to {sum}", source.name);
    }
}

#[test]
fn cells_of_the_cube_cover_the_sphere() {
    let total: f64 = (0..DirectionCube::CELLS).map(DirectionCube::solid_angle_sr).sum();
    assert!((total - 4.0 * std::f64::consts::PI).abs() < 1e-12);
    for cell in 0..DirectionCube::CELLS {
        assert_eq!(DirectionCube::cell(DirectionCube::center(cell)), cell);
        let numeric = integral_over_cell(cell, |_| 1.0);
        assert!((numeric / DirectionCube::solid_angle_sr(cell) - 1.0).abs() < 1e-4);
    }
}

/// I(ω) = ∫ L dA over a plane across ω: radiance and intensity were derived apart.
#[test]
fn radiance_seen_from_afar_is_intensity() {
    const FINE: usize = 400;
    for source in turned() {
        let (center, reach) = (source.bounds_mm().center(), 0.51 * source.bounds_mm().size().length());
        for direction in [DVec3::new(0.3, 0.2, 0.93), DVec3::new(0.95, -0.1, 0.1), DVec3::new(-0.2, 0.97, -0.2)] {
            let direction = direction.normalize();
            let (x, y) = direction.any_orthonormal_pair();
            let offset = |i: usize| reach * ((2 * i + 1) as f64 / FINE as f64 - 1.0);
            let lines = (0..FINE * FINE).map(|i| center + offset(i / FINE) * x + offset(i % FINE) * y);
            let seen: f64 = lines.map(|point| source.radiance_w_per_mm2_sr(point, direction)).sum();
            let seen = seen * (2.0 * reach / FINE as f64).powi(2);
            let expected = source.intensity_w_per_sr(direction);
            assert!((seen - expected).abs() < 0.01 * source.radiant_w() / 12.0, "{}: {seen} {expected}", source.name);
        }
    }
}

/// Each ray lies on a line of positive radiance, starts within the box, and has the exitance of its place.
#[test]
fn every_ray_is_possible() {
    for source in turned().into_iter().filter(KnownSource::shows_itself) {
        let bounds = source.bounds_mm();
        for ray in drawn(&source).into_iter().step_by(16) {
            let (origin, direction) = (DVec3::from_array(ray.origin_mm), DVec3::from_array(ray.direction));
            assert!((direction.length() - 1.0).abs() < 1e-14);
            assert!(origin.cmpge(bounds.min - 1e-12).all() && origin.cmple(bounds.max + 1e-12).all());
            assert!(source.radiance_w_per_mm2_sr(origin, direction) > 0.0, "{} {ray:?}", source.name);
            assert!(source.exitance_w_per_mm2(origin).is_none_or(|exitance| exitance > 0.0), "{}", source.name);
            assert_eq!(source.exitance_w_per_mm2(bounds.max + 1.0).unwrap_or(0.0), 0.0);
        }
    }
}

/// Origins against the exitance: shares of the half boxes; by symmetry or by the closed form of the region.
#[test]
fn rays_start_where_the_exitance_says() {
    for source in turned().into_iter().filter(KnownSource::shows_itself) {
        let whole = source.bounds_mm();
        for axis in 0..3 {
            let mut region = whole;
            region.max[axis] = whole.min[axis] + 0.3 * whole.size()[axis];
            let along = source.source_from_parts() * DVec3::new(0.1, 0.1, 1.0).normalize();
            let Some(part) = source.intensity_of_region_w_per_sr(&region, along) else { continue };
            if source.parts().len() > 1 || source.name == "dome" || whole.size()[axis] == 0.0 {
                continue;
            }
            let expected = part / source.intensity_w_per_sr(along);
            let within = |ray: &&RawRay| ray.origin_mm[axis] <= region.max[axis];
            let z = z_of_count(drawn(&source).iter().filter(within).count() as u64, expected);
            assert!((expected - 0.3).abs() < 1e-9 && z.abs() < 5.0, "{} axis {axis}: {expected} z {z}", source.name);
        }
    }
    // Unequal chips: each quadrant holds its chip's flux; the blue one has 0.9 W of 2.4 W.
    let chips = by_name("four-chips").unwrap();
    let lower_left = Bounds { min: DVec3::splat(-9.0), max: DVec3::new(0.0, 0.0, 9.0) };
    let up = chips.intensity_of_region_w_per_sr(&lower_left, DVec3::Z).unwrap();
    assert!((up - 0.9 / std::f64::consts::PI).abs() < 1e-12);
    let found = drawn(&chips).iter().filter(|ray| ray.origin_mm[0] < 0.0 && ray.origin_mm[1] < 0.0).count();
    assert!(z_of_count(found as u64, 0.9 / 2.4).abs() < 5.0);
    // Dome: by Archimedes half of the flux starts above half the height. Ring: by area.
    let dome = drawn(&by_name("dome").unwrap());
    assert!(z_of_count(dome.iter().filter(|ray| ray.origin_mm[2] > 0.75).count() as u64, 0.5).abs() < 5.0);
    let ring = drawn(&by_name("phosphor-ring").unwrap());
    let inner = ring.iter().filter(|ray| (0.8..1.2).contains(&ray.origin_mm[0].hypot(ray.origin_mm[1]))).count();
    let expected = 0.8 / 1.4 * (1.44 - 0.64) / (2.25 - 0.64);
    assert!(z_of_count(inner as u64, expected).abs() < 5.0);
}

#[test]
fn wavelengths_follow_the_spectrum() {
    let bands = Bands::regular(380.0, 780.0, 20.0).unwrap();
    for source in all() {
        let mut found = vec![0; bands.len()];
        drawn(&source).iter().for_each(|ray| found[bands.band(ray.wavelength_nm).unwrap()] += 1);
        for (band, watt) in source.bands_w(&bands).into_iter().enumerate() {
            let z = z_of_count(found[band], watt / source.radiant_w());
            assert!(z.abs() < 5.0, "{} band {band}: z {z}", source.name);
        }
    }
}

/// The dome's formula at the three places where it is known otherwise, and a cap by hand: θ = 90° halves the disc.
#[test]
fn the_dome_seen_from_special_sides() {
    let dome = by_name("dome").unwrap();
    let at = |degrees: f64| {
        let theta = degrees.to_radians();
        dome.intensity_w_per_sr(DVec3::new(theta.sin(), 0.0, theta.cos()))
    };
    let full = 1.0 / std::f64::consts::TAU;
    for (degrees, expected) in [(0.0, full), (59.9, full), (90.0, 0.5 * full), (120.1, 0.0), (180.0, 0.0)] {
        assert!((at(degrees) - expected).abs() < 1e-12, "{degrees}: {}", at(degrees));
    }
    assert!((at(75.0) + at(105.0) - full).abs() < 1e-12);
}

#[test]
fn any_range_is_the_same_rays() {
    let source = by_name("four-chips").unwrap();
    let (mut whole, mut parts) = (Vec::new(), Vec::new());
    source.rays(3, 100, 0, 40_000, &mut whole);
    for (first, count) in [(0, 1), (1, 16_382), (16_383, 2), (16_385, 20_000), (36_385, 3_615)] {
        source.rays(3, 100, first, count, &mut parts);
    }
    assert_eq!(whole, parts);
    let mut other = Vec::new();
    source.rays(4, 100, 0, 1, &mut other);
    assert_ne!(whole[0], other[0]);
}

#[test]
fn turns_are_proper_and_lead_z_to_the_axis() {
    for axis in Axis::ALL {
        let turn = by_name("flat-chip").unwrap().rotate(axis).source_from_parts();
        assert_eq!(turn.determinant(), 1.0);
        assert_eq!(turn * DVec3::Z, axis.vector());
        assert_eq!(turn * Frame::looking(Axis::PosZ).x(), Frame::looking(axis).x());
        assert_eq!(turn * Frame::looking(Axis::PosZ).y(), Frame::looking(axis).y());
    }
}
