//! Clouds with known surfaces. Expected areas, parts and Euler characteristics are closed forms of the shapes.

use super::*;
use crate::vocabulary::watch::{NoProgress, Stage};
use glam::{DVec3, Vec3Swizzles};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Uniform numbers in [0, 1).
struct Dice(ChaCha8Rng);

impl Dice {
    fn new(seed: u64) -> Dice {
        Dice(ChaCha8Rng::seed_from_u64(seed))
    }

    fn roll(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn sphere(&mut self) -> DVec3 {
        let (z, phi) = (2.0 * self.roll() - 1.0, TAU * self.roll());
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * phi.cos(), r * phi.sin(), z)
    }

    /// A Lambertian direction about `normal`.
    fn lambert(&mut self, normal: DVec3) -> DVec3 {
        (normal + self.sphere()).normalize_or(normal)
    }

    fn square(&mut self) -> DVec3 {
        DVec3::new(self.roll() - 0.5, self.roll() - 0.5, 0.0)
    }
}

fn ray(origin_mm: DVec3, direction: DVec3) -> Ray {
    Ray { origin_mm, direction, radiant_w: 1.0, luminous_lm: 0.0, column: 0, xz_lm: [0.0; 2] }
}

fn cloud(count: usize, seed: u64, mut make: impl FnMut(&mut Dice) -> (DVec3, DVec3)) -> Vec<Ray> {
    let mut dice = Dice::new(seed);
    (0..count)
        .map(|_| {
            let (origin_mm, direction) = make(&mut dice);
            ray(origin_mm, direction)
        })
        .collect()
}

fn try_wrap(rays: &[Ray], options: &HullOptions, limits: &Limits) -> Result<Hull, Error> {
    let pass = |_: StageWatch<'_>, visit: &(dyn Fn(&[Ray]) + Sync)| {
        rays.par_chunks(1000).for_each(visit);
        Ok(())
    };
    let watch = StageWatch::enter(&NoProgress, Stage::Hull)?;
    wrap_points(&pass, Bounds::of(rays.iter().map(|ray| ray.origin_mm)), options, limits, watch)
}

fn wrapped(rays: &[Ray]) -> Hull {
    wrapped_at(rays, None)
}

fn wrapped_at(rays: &[Ray], resolution: Option<u32>) -> Hull {
    let hull = try_wrap(rays, &HullOptions { resolution, ..HullOptions::default() }, &Limits::default()).unwrap();
    assert_eq!(hull.check(), []);
    hull
}

fn assert_near(found: f64, expected: f64, share: f64) {
    assert!((found / expected - 1.0).abs() < share, "{found}, expected {expected} within {share}");
}

fn volume_mm3(hull: &Hull) -> f64 {
    (0..hull.triangles.len()).map(|t| hull.corners_mm(t)).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

fn chip(count: usize) -> Vec<Ray> {
    cloud(count, 1, |dice| (dice.square() + DVec3::Z, dice.lambert(DVec3::Z)))
}

fn ball(count: usize, r: f64) -> Vec<Ray> {
    cloud(count, 2, |dice| {
        let normal = dice.sphere();
        (r * normal, dice.lambert(normal))
    })
}

fn dome(count: usize) -> Vec<Ray> {
    cloud(count, 3, |dice| {
        let normal = dice.sphere();
        let normal = normal.with_z(normal.z.abs());
        (2.0 * normal, dice.lambert(normal))
    })
}

/// 2 × 1 mm, turned by 45° about y.
fn strip(count: usize) -> Vec<Ray> {
    let (along, normal) = (DVec3::new(1.0, 0.0, 1.0).normalize(), DVec3::new(-1.0, 0.0, 1.0).normalize());
    cloud(count, 4, |dice| (2.0 * along * dice.roll() + DVec3::Y * dice.roll(), dice.lambert(normal)))
}

#[test]
fn a_flat_chip_is_one_open_sheet_of_its_own_area() {
    let rays = chip(200_000);
    let hull = wrapped(&rays);
    let size = Bounds::of(rays.iter().map(|ray| ray.origin_mm)).size();
    assert_near(hull.total_area_mm2(), size.x * size.y, 1e-12);
    assert_eq!((hull.part_count(), hull.euler_characteristics()), (1, vec![1]));
    assert_eq!(hull.count(Label::Projected), hull.triangles.len());
    assert!((0..hull.triangles.len()).all(|triangle| hull.normal(triangle).distance(DVec3::Z) < 1e-12));
    assert!(hull.vertices_mm.iter().all(|vertex| (vertex.z - 1.0).abs() < 1e-9), "the level is the points' own");
    assert_eq!(hull.notices.to_vec(), []);
}

#[test]
fn a_slightly_tilted_chip_is_one_flat_sheet() {
    let (sin, cos) = 0.15_f64.sin_cos();
    let turn = |v: DVec3| DVec3::new(cos * v.x - sin * v.z, v.y, sin * v.x + cos * v.z);
    let hull = wrapped(&cloud(200_000, 5, |dice| (turn(dice.square()), turn(dice.lambert(DVec3::Z)))));
    assert_eq!((hull.part_count(), hull.euler_characteristics()), (1, vec![1]));
    assert_near(hull.total_area_mm2(), 1.0, 0.03);
}

#[test]
fn a_flat_emitter_of_both_sides_is_closed() {
    let hull = wrapped(&cloud(200_000, 6, |dice| (dice.square(), dice.sphere())));
    assert_eq!((hull.boundary_edges(), hull.euler_characteristics()), (0, vec![2]));
    assert_near(hull.total_area_mm2(), 2.0, 0.01);
}

#[test]
fn a_sphere_is_closed_and_as_large_as_it_should_be() {
    // Chords and means of points lie inside of a sphere: up to 2 % of its radius on the coarsest of these lattices.
    for (count, resolution) in [(10_000, None), (200_000, None), (1_000_000, None), (400_000, Some(20))] {
        let hull = wrapped_at(&ball(count, 3.0), resolution);
        assert_eq!((hull.boundary_edges(), hull.euler_characteristics()), (0, vec![2]));
        assert_near(hull.total_area_mm2(), 4.0 * PI * 9.0, 0.03);
        assert_near(volume_mm3(&hull), 4.0 / 3.0 * PI * 27.0, 0.05);
        let off = hull.vertices_mm.iter().map(|vertex| (vertex.length() - 3.0).abs()).fold(0.0, f64::max);
        assert!(off < 0.5 * hull.cell_mm.max_element(), "{off} at {}", hull.cell_mm);
    }
}

#[test]
fn few_points_on_a_fine_lattice_still_make_a_closed_sphere() {
    let hull = wrapped_at(&ball(10_000, 3.0), Some(32));
    assert_eq!(hull.boundary_edges(), 0);
    assert!(hull.count(Label::Filled) > 0);
    assert_near(volume_mm3(&hull), 4.0 / 3.0 * PI * 27.0, 0.1);
}

#[test]
fn a_dome_is_its_outside_only() {
    let hull = wrapped(&dome(400_000));
    assert_eq!((hull.part_count(), hull.euler_characteristics()), (1, vec![1]));
    assert_near(hull.total_area_mm2(), 2.0 * PI * 4.0, 0.03);
    for triangle in 0..hull.triangles.len() {
        let middle = hull.corners_mm(triangle).into_iter().sum::<DVec3>();
        assert!(hull.normal(triangle).dot(middle) > 0.0);
    }
}

#[test]
fn a_glowing_cylinder_is_closed() {
    let hull = wrapped(&cloud(400_000, 7, |dice| {
        let (r, phi) = (dice.roll().sqrt(), TAU * dice.roll());
        (DVec3::new(r * phi.cos(), 6.0 * dice.roll(), r * phi.sin()), dice.sphere())
    }));
    assert_eq!((hull.boundary_edges(), hull.euler_characteristics()), (0, vec![2]));
    assert_near(hull.total_area_mm2(), TAU * 6.0 + TAU, 0.04);
    assert_near(volume_mm3(&hull), PI * 6.0, 0.04);
}

#[test]
fn a_strip_at_45_degrees_is_flat() {
    let hull = wrapped(&strip(200_000));
    let normal = DVec3::new(-1.0, 0.0, 1.0).normalize();
    let square = hull.vertices_mm.iter().map(|vertex| vertex.dot(normal).powi(2)).sum::<f64>();
    let rms_mm = (square / hull.vertices_mm.len() as f64).sqrt();
    assert_eq!((hull.part_count(), hull.euler_characteristics()), (1, vec![1]));
    assert_near(hull.total_area_mm2(), 2.0, 0.03);
    assert!(rms_mm < 0.02 * hull.cell_mm.x, "{rms_mm} mm off the plane");
}

#[test]
fn four_chips_with_gaps_are_four_parts() {
    let hull = wrapped(&cloud(400_000, 8, |dice| {
        let side = |dice: &mut Dice| if dice.roll() < 0.5 { -0.6 } else { 0.6 };
        (DVec3::new(side(dice), side(dice), 0.0) + dice.square(), dice.lambert(DVec3::Z))
    }));
    assert_eq!(hull.euler_characteristics(), [1; 4]);
    assert_near(hull.total_area_mm2(), 4.0, 0.05);
}

#[test]
fn an_open_box_has_five_sides() {
    let faces = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z];
    let hull = wrapped(&cloud(500_000, 9, |dice| {
        let normal = faces[(5.0 * dice.roll()) as usize];
        let (u, v) = normal.any_orthonormal_pair();
        (0.5 * normal + (dice.roll() - 0.5) * u + (dice.roll() - 0.5) * v, dice.lambert(normal))
    }));
    assert_eq!((hull.part_count(), hull.euler_characteristics()), (1, vec![1]));
    assert_near(hull.total_area_mm2(), 5.0, 0.002);
    let bottom = hull.vertices_mm.iter().filter(|vertex| vertex.z < hull.bounds_mm().min.z + 1e-3).count();
    assert_eq!(hull.boundary_edges(), bottom, "the rim is the bottom");
}

#[test]
fn lines_and_points_have_hulls() {
    let line = wrapped(&cloud(10_000, 10, |dice| (DVec3::X * dice.roll(), dice.lambert(DVec3::Z))));
    assert_eq!((line.part_count(), line.resolution), (1, 96));
    let bounds = line.bounds_mm().size();
    assert!(bounds.x > 0.999 && bounds.y < 0.01 * bounds.x);

    let point = wrapped(&cloud(1000, 11, |dice| (DVec3::ONE, dice.lambert(DVec3::Z))));
    assert_eq!((point.boundary_edges(), point.notices.count_of("hull.point_cloud")), (0, 1));
    assert_near(point.total_area_mm2(), 6e-6, 1e-6);
    assert_eq!(point.part_count(), 1);

    let pair = wrapped(&[ray(DVec3::ZERO, DVec3::Z), ray(DVec3::ONE, DVec3::Z)]);
    assert_eq!(pair.part_count(), 2);
}

#[test]
fn one_stray_point_does_not_spoil_the_lattice() {
    let mut rays = chip(100_000);
    let alone = wrapped(&rays);
    rays.insert(500, ray(DVec3::new(1000.0, -700.0, 300.0), DVec3::Z));
    let hull = wrapped(&rays);
    assert_eq!(hull.notices.count_of("hull.stray_points"), 1);
    assert_eq!((&hull.vertices_mm, &hull.triangles), (&alone.vertices_mm, &alone.triangles));
}

#[test]
fn neither_order_nor_threads_show() {
    for mut rays in [ball(50_000, 1.0), strip(50_000)] {
        let hull = wrapped(&rays);
        let mut dice = Dice::new(12);
        for k in (1..rays.len()).rev() {
            rays.swap(k, (dice.roll() * (k + 1) as f64) as usize);
        }
        assert_eq!(wrapped(&rays), hull);
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(alone.install(|| wrapped(&rays)), hull);
    }
}

#[test]
fn turning_the_cloud_turns_the_hull() {
    for rays in [ball(100_000, 1.0), dome(100_000), strip(100_000), chip(100_000)] {
        let hull = wrapped(&rays);
        for turn in [|v: DVec3| v.yzx(), |v: DVec3| DVec3::new(-v.y, v.x, v.z), |v: DVec3| DVec3::new(v.z, -v.y, v.x)] {
            let turned: Vec<Ray> =
                rays.iter().map(|r| Ray { origin_mm: turn(r.origin_mm), direction: turn(r.direction), ..*r }).collect();
            let turned = wrapped(&turned);
            for label in [Label::Projected, Label::Stitched, Label::Filled] {
                assert_eq!(turned.count(label), hull.count(label), "{label:?}");
            }
            assert_near(turned.total_area_mm2(), hull.total_area_mm2(), 1e-6);
            assert_eq!(turned.euler_characteristics(), hull.euler_characteristics());
        }
    }
}

#[test]
fn the_size_filter_drops_what_is_stitched_and_never_what_is_projected() {
    let rays = dome(100_000);
    let all = wrapped(&rays);
    let options = HullOptions { max_edge_mm: Some(0.1 * all.cell_mm.min_element()), ..HullOptions::default() };
    let hull = try_wrap(&rays, &options, &Limits::default()).unwrap();
    assert_eq!(hull.check(), []);
    assert!(all.count(Label::Stitched) > 0 && hull.count(Label::Stitched) < all.count(Label::Stitched) / 10);
    assert_eq!(hull.count(Label::Projected), all.count(Label::Projected));
}

#[test]
fn options_out_of_range_are_refused_with_their_codes() {
    let rays = chip(100);
    let code =
        |options: HullOptions, limits: Limits| try_wrap(&rays, &options, &limits).map(|_| ()).unwrap_err().code();
    let few = Limits { max_lattice_cells: 50, ..Limits::default() };
    assert_eq!(
        code(HullOptions { resolution: Some(3), ..HullOptions::default() }, Limits::default()),
        "options.hull_resolution"
    );
    assert_eq!(
        code(HullOptions { max_edge_mm: Some(0.0), ..HullOptions::default() }, Limits::default()),
        "options.hull_max_edge"
    );
    assert_eq!(code(HullOptions { resolution: Some(8), ..HullOptions::default() }, few), "hull.too_fine");
    assert_eq!(code(HullOptions::default(), few), "hull.too_fine");
}
