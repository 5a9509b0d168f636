//! Evaluation against closed forms, of models that are exact by themselves: nothing here is made of rays.

use super::*;
use crate::flux::Amounts;
use crate::goniogram::{Goniogram, Mixture, SphereGrid};
use crate::hull::Mesh;
use crate::source::{Columns, Spectral};
use crate::vocabulary::space::{Axis, Bounds, Frame};
use crate::vocabulary::spectrum::Bands;
use crate::vocabulary::watch::{NoProgress, Stage, Watch};
use crate::volume::Volume;
use crate::volume::lattice::VolumeLattice;
use std::f64::consts::PI;

/// A model whose parts are its own.
pub struct Lamp {
    vertices_mm: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    pub vertices: Amounts,
    mixtures: Vec<Mixture>,
    grid: SphereGrid,
    zones: Vec<Goniogram>,
    volume: Option<Volume>,
    spectral: Spectral,
}

impl<'a> From<&'a Lamp> for Light<'a> {
    fn from(lamp: &'a Lamp) -> Light<'a> {
        Light {
            mesh: Mesh { vertices_mm: &lamp.vertices_mm, triangles: &lamp.triangles },
            vertices: &lamp.vertices,
            mixtures: &lamp.mixtures,
            frame: Frame::looking(Axis::PosZ),
            grid: &lamp.grid,
            spectral_grid: &lamp.grid,
            zones: lamp.zones.iter().collect(),
            total: &lamp.zones[0],
            volume: lamp.volume.as_ref(),
            spectral: &lamp.spectral,
        }
    }
}

pub fn amounts(radiant_w: Vec<f64>) -> Amounts {
    let rays = vec![0.0; radiant_w.len()];
    Amounts { rays, radiant_w: Some(radiant_w), luminous_lm: None, columns: Vec::new(), column_count: 0 }
}

/// A goniogram of what `intensity` is at γ, radians, alike in all C.
fn round(grid: &SphereGrid, intensity: impl Fn(f64) -> f64) -> Goniogram {
    let plane: Vec<f64> = (0..grid.gamma_nodes()).map(|node| intensity(grid.gamma(node))).collect();
    Goniogram { radiant_w_per_sr: Some(plane.repeat(grid.c_planes())), ..Goniogram::default() }
}

pub fn lambertian(gamma: f64) -> f64 {
    // cos 90° is not exactly 0.
    if gamma < 0.4999 * PI { gamma.cos() } else { 0.0 }
}

/// A square of `edge_mm` in z = 0 of exitance 1 W/mm², in `cells` squares along each side.
pub fn square(edge_mm: f64, cells: usize, grid: SphereGrid, intensity: impl Fn(f64) -> f64) -> Lamp {
    let side = cells + 1;
    let at = |k: usize| edge_mm * (k as f64 / cells as f64 - 0.5);
    let vertices_mm: Vec<DVec3> =
        (0..side * side).map(|vertex| DVec3::new(at(vertex % side), at(vertex / side), 0.0)).collect();
    let quad = |cell: usize| {
        let low = (cell / cells * side + cell % cells) as u32;
        let up = low + side as u32;
        [[low, low + 1, up + 1], [low, up + 1, up]]
    };
    let triangles: Vec<[u32; 3]> = (0..cells * cells).flat_map(quad).collect();
    let areas_mm2 = Mesh { vertices_mm: &vertices_mm, triangles: &triangles }.vertex_areas_mm2();
    let zones = vec![round(&grid, intensity)];
    Lamp {
        mixtures: vec![Mixture::hard(0); vertices_mm.len()],
        vertices: amounts(areas_mm2),
        vertices_mm,
        triangles,
        grid,
        zones,
        volume: None,
        spectral: Spectral { bands: Bands::new(vec![380.0, 780.0]).unwrap(), columns: Columns::None },
    }
}

/// A box of 2 x 1 x 1 mm from the origin on that glows evenly with 1 W/mm³.
pub fn glowing_box() -> Lamp {
    let bounds = Bounds { min: DVec3::ZERO, max: DVec3::new(2.0, 1.0, 1.0) };
    let lattice = VolumeLattice::all_lit(bounds, 2000.0);
    let volumes_mm3 = lattice.volumes_mm3();
    let nodes = amounts(volumes_mm3.clone());
    Lamp { volume: Some(Volume { lattice, nodes, volumes_mm3 }), ..square(1.0, 1, SphereGrid::new(36, 1), |_| 1.0) }
}

pub fn answer(lamp: &Lamp, view: View) -> Answer {
    let watch = StageWatch::enter(&NoProgress, Stage::Model).unwrap();
    evaluate(lamp, "lamp", &Request::of(view), watch).unwrap()
}

/// One number and its bound, per mm².
fn irradiance(lamp: &Lamp, point_mm: DVec3, normal: DVec3) -> (f64, f64) {
    let plane = Plane {
        center_mm: point_mm,
        normal: Some(normal),
        up: None,
        width_mm: 1e-9,
        height_mm: 1e-9,
        columns: 1,
        rows: 1,
    };
    let found = answer(lamp, View::Plane(plane));
    (found.channels[0].values[0] * 1e-6, found.channels[0].bounds[0] * 1e-6)
}

/// The error is within the bound, and the bound within what was asked for.
fn check(lamp: &Lamp, point_mm: DVec3, normal: DVec3, exact: f64, grid_error: f64) {
    let (found, bound) = irradiance(lamp, point_mm, normal);
    let error = (found - exact).abs();
    println!("{point_mm} {normal}: {found:.9} of {exact:.9}, off {error:.1e}, bound {bound:.1e}");
    assert!(error <= bound + grid_error * exact + 1e-12, "{point_mm}: {found} of {exact}, bound {bound}");
    // What an even source would send there has a part in what the error may be.
    let even = Light::from(lamp).sites().total().primary() / (4.0 * PI * point_mm.length_squared());
    assert!(bound <= 1.001 * TOLERANCE * (exact + 1e-3 * even), "{point_mm}: {bound} of {exact}");
}

/// ∫∫ f over the rectangle from (x₀, y₀) to (x₁, y₁), from its antiderivative.
fn corners(x: [f64; 2], y: [f64; 2], f: impl Fn(f64, f64) -> f64) -> f64 {
    f(x[1], y[1]) - f(x[0], y[1]) - f(x[1], y[0]) + f(x[0], y[0])
}

const POINTS: [[f64; 3]; 8] = [
    [0.0, 0.0, 10.0],
    [0.0, 0.0, 1.0],
    [0.3, -0.2, 0.1],
    [0.101, 0.207, 1e-3],
    [0.101, 0.207, 1e-5],
    [1.5, 0.4, 0.3],
    [-3.0, 2.0, 0.5],
    [0.4999, 0.1, 0.01],
];

/// A square that sends alike in all directions: E = F/(4πA) Ω on a plane in parallel, Ω its solid angle, Σ ± atan(x y / (h r)).
#[test]
fn irradiance_of_an_even_square_is_its_solid_angle() {
    let lamp = square(1.0, 8, SphereGrid::new(72, 24), |_| 1.0);
    for [x, y, h] in POINTS {
        let angle = |x: f64, y: f64| (x * y / (h * (x * x + y * y + h * h).sqrt())).atan();
        let exact = corners([-0.5 - x, 0.5 - x], [-0.5 - y, 0.5 - y], angle) / (4.0 * PI);
        check(&lamp, DVec3::new(x, y, h), DVec3::NEG_Z, exact, 0.0);
    }
}

/// Points all over, as near as a hundredth of the edge and as far as five: none is off by more than its bound.
#[test]
fn no_point_is_off_by_more_than_its_bound() {
    let lamp = square(1.0, 7, SphereGrid::new(36, 12), |_| 1.0);
    for k in 0..120 {
        let [u, v, w] = [2_f64, 3.0, 5.0].map(|prime| (f64::from(k) * prime.sqrt()).fract());
        let (x, y, h) = (4.0 * u - 2.0, 4.0 * v - 2.0, 0.01 * 500_f64.powf(w));
        let angle = |x: f64, y: f64| (x * y / (h * (x * x + y * y + h * h).sqrt())).atan();
        let exact = corners([-0.5 - x, 0.5 - x], [-0.5 - y, 0.5 - y], angle) / (4.0 * PI);
        check(&lamp, DVec3::new(x, y, h), DVec3::NEG_Z, exact, 0.0);
    }
}

/// The same on a plane across it that half of it lies behind: ∫∫ x/r³ over what lies before, from -asinh(y/√(x² + h²)).
#[test]
fn what_lies_behind_the_plane_does_not_count() {
    let lamp = square(1.0, 8, SphereGrid::new(72, 24), |_| 1.0);
    for [x, y, h] in POINTS {
        let before = [(-0.5 - x).max(0.0), (0.5 - x).max(0.0)];
        let arc = |x: f64, y: f64| -(y / (x * x + h * h).sqrt()).asinh();
        let exact = corners(before, [-0.5 - y, 0.5 - y], arc) / (4.0 * PI);
        check(&lamp, DVec3::new(x, y, h), DVec3::X, exact, 0.0);
    }
}

/// A Lambertian square: the form factor of a rectangle seen from a plane in parallel. Nodes 0.25° apart have cos γ within 2.4e-6.
#[test]
fn irradiance_of_a_lambertian_square_is_its_form_factor() {
    let lamp = square(1.0, 8, SphereGrid::new(720, 1), lambertian);
    for [x, y, h] in POINTS.into_iter().filter(|[.., h]| *h > 0.05) {
        let factor = |x: f64, y: f64| {
            let [a, b] = [(x * x + h * h).sqrt(), (y * y + h * h).sqrt()];
            (x / a * (y / a).atan() + y / b * (x / b).atan()) / (2.0 * PI)
        };
        let exact = corners([-0.5 - x, 0.5 - x], [-0.5 - y, 0.5 - y], factor);
        // Beyond 85° the last step to 90° is a larger part of what is left.
        check(&lamp, DVec3::new(x, y, h), DVec3::NEG_Z, exact, if h < 0.2 * x.hypot(y) { 1e-3 } else { 5e-6 });
    }
}

/// A beam of 0.5° that no part's middle points along: where all of it comes from within the square, E = M.
#[test]
fn no_narrow_beam_is_missed() {
    let gamma_deg = (0..=40).map(|k| f64::from(k) * 0.05).chain((3..=180).map(f64::from)).collect();
    let beam = |gamma: f64| if gamma.to_degrees() < 0.475 { 1.0 } else { 0.0 };
    let lamp = square(10.0, 16, SphereGrid::uneven(gamma_deg, 4), beam);
    for [x, y, h] in [[0.01, 0.02, 5.0], [3.07, -4.11, 20.0], [0.3, 0.1, 0.01], [1.0, 2.0, 100.0]] {
        check(&lamp, DVec3::new(x, y, h), DVec3::NEG_Z, 1.0, 0.0);
    }
    // Beside the beam there is no light at all.
    assert!(irradiance(&lamp, DVec3::new(9.0, 0.0, 20.0), DVec3::NEG_Z).0 < 1e-9);
}

/// The attraction of a box (Nagy 1966): ∫∫∫ z/r³ = Σ ± (z atan(xy/(z r)) - x ln(y + r) - y ln(x + r)).
#[test]
fn irradiance_of_a_glowing_box_is_its_attraction() {
    let lamp = glowing_box();
    for [x, y, z] in [[1.0, 0.5, 3.0], [1.0, 0.5, 1.2], [0.3, 0.9, 1.01], [4.0, -2.0, 2.0]] {
        let sum = |x: f64, y: f64, z: f64| {
            let r = (x * x + y * y + z * z).sqrt();
            z * (x * y / (z * r)).atan() - x * (y + r).ln() - y * (x + r).ln()
        };
        let [from, to] = [z - 1.0, z];
        let at = |depth: f64| corners([-x, 2.0 - x], [-y, 1.0 - y], |x, y| sum(x, y, depth));
        check(&lamp, DVec3::new(x, y, z), DVec3::NEG_Z, (at(to) - at(from)) / (4.0 * PI), 0.0);
    }
}

#[test]
fn intensity_is_that_of_lambert() {
    let lamp = square(2.0, 3, SphereGrid::new(720, 4), lambertian);
    let found = answer(&lamp, View::Grid { c_step_deg: 90.0, gamma_step_deg: 15.0 });
    assert_eq!((found.columns, found.rows, found.channels[0].unit), (4, 13, "W/sr"));
    for (cell, value) in found.channels[0].values.iter().enumerate() {
        let exact = 4.0 / PI * lambertian((15.0 * (cell / 4) as f64).to_radians());
        assert!((value - exact).abs() < 1e-5, "{cell}: {value} of {exact}");
    }
    let aslant = answer(&lamp, View::Directions(vec![DVec3::new(1.0, 1.0, 1.0), DVec3::NEG_Z]));
    assert!((aslant.channels[0].values[0] - 4.0 / PI / 3_f64.sqrt()).abs() < 2e-5);
    assert_eq!(aslant.channels[0].values[1], 0.0);
    let angles = answer(&lamp, View::Angles(vec![[33.0, 60.0]]));
    assert!((angles.channels[0].values[0] - 2.0 / PI).abs() < 1e-5);
}

fn camera(eye_mm: DVec3, width: Width, samples: usize) -> View {
    View::Camera(Camera { eye_mm, target_mm: DVec3::ZERO, up: None, width, columns: 40, rows: 20, samples })
}

/// A Lambertian square looks alike from everywhere, M/π, and nothing else is lit; the edges of its triangles do not show.
#[test]
fn a_lambertian_square_has_one_luminance() {
    let lamp = square(1.0, 8, SphereGrid::new(720, 1), lambertian);
    for (eye, slant) in
        [([0.0, 0.0, 9.0], 1.0_f64), ([3_f64.sqrt(), 0.0, 1.0], 0.5), ([0.0, -1.0, 1.0], 0.5_f64.sqrt())]
    {
        // 4 x 2 mm in cells of 0.1 mm, whose middles lie 0.05 mm from the edges of the square and on diagonals of its triangles.
        let found = answer(&lamp, camera(eye.into(), Width::Orthographic(4.0), 1));
        let lit: Vec<f64> = found.channels[0].values.iter().copied().filter(|value| *value > 0.0).collect();
        assert!((lit.len() as f64 * 0.01 - slant).abs() < 0.11, "{eye:?}: {} cells", lit.len());
        assert!(lit.iter().all(|value| (value * 1e-6 * PI - 1.0).abs() < 1e-5), "{eye:?}");
        assert!(found.channels[0].bounds.iter().all(|bound| *bound == 0.0));
    }
    // From behind it is dark.
    let behind = answer(&lamp, camera(DVec3::NEG_Z, Width::Orthographic(4.0), 1));
    assert!(behind.channels[0].values.iter().all(|value| *value == 0.0));
}

/// Means over cells have the square's flux to their bounds, also where cells do not fit its edges.
#[test]
fn means_of_cells_are_within_their_bounds() {
    let lamp = square(1.0, 8, SphereGrid::new(720, 1), lambertian);
    let width_mm = 3.7;
    let found = answer(&lamp, camera(DVec3::Z, Width::Orthographic(width_mm), 4));
    let cell_mm2 = (width_mm / 40.0) * (width_mm / 40.0);
    let sum = |numbers: &[f64]| numbers.iter().sum::<f64>() * 1e-6 * cell_mm2;
    let (value, bound) = (sum(&found.channels[0].values), sum(&found.channels[0].bounds));
    assert!((value - 1.0 / PI).abs() <= bound && bound < 0.1 / PI, "{value} +- {bound}");
    // The overlap of each cell with the square is known.
    for (cell, (value, bound)) in found.channels[0].values.iter().zip(&found.channels[0].bounds).enumerate() {
        let overlap = |at: usize, of: usize| {
            let from = (at as f64 - 0.5 * of as f64) * width_mm / 40.0;
            ((from + width_mm / 40.0).min(0.5) - from.max(-0.5)).max(0.0) / (width_mm / 40.0)
        };
        let exact = overlap(cell % 40, 40) * overlap(cell / 40, 20) / PI;
        assert!((value * 1e-6 - exact).abs() <= bound * 1e-6 + 1e-5, "{cell}: {value} of {exact}");
    }
}

/// In perspective a square of 1 mm at 1 mm has a width of 2 atan(1/2); one behind the camera is not seen.
#[test]
fn perspective_is_that_of_a_pinhole() {
    let lamp = square(1.0, 8, SphereGrid::new(72, 1), |_| 1.0);
    let found = answer(&lamp, camera(DVec3::Z, Width::Perspective(90.0), 1));
    for (cell, value) in found.channels[0].values.iter().enumerate() {
        let [x, y] = [(cell % 40) as f64 - 19.5, (cell / 40) as f64 - 9.5].map(|at| 2.0 * at / 40.0);
        let is_lit = x.abs() < 0.5 && y.abs() < 0.5;
        // L = M/(4π |cos θ|).
        let exact = if is_lit { (1.0 + x * x + y * y).sqrt() / (4.0 * PI) } else { 0.0 };
        assert!((value * 1e-6 - exact).abs() < 1e-9, "{cell}: {value} of {exact}");
    }
    let away = Camera {
        eye_mm: DVec3::Z,
        target_mm: 2.0 * DVec3::Z,
        up: None,
        width: Width::Perspective(90.0),
        columns: 4,
        rows: 4,
        samples: 1,
    };
    assert!(answer(&lamp, View::Camera(away)).channels[0].values.iter().all(|value| *value == 0.0));
}

/// L = j/(4π) times the path through the box; an eye within it sees what is before it.
#[test]
fn luminance_of_a_glowing_box_is_the_path() {
    let lamp = glowing_box();
    let look = |eye: DVec3, target: DVec3, width: Width| {
        let camera = Camera { eye_mm: eye, target_mm: target, up: None, width, columns: 1, rows: 1, samples: 1 };
        answer(&lamp, View::Camera(camera)).channels[0].values[0] * 1e-6 * 4.0 * PI
    };
    let middle = DVec3::new(1.0, 0.5, 0.5);
    assert!((look(middle + 5.0 * DVec3::Z, middle, Width::Orthographic(1.0)) - 1.0).abs() < 1e-9);
    assert!((look(middle + 5.0 * DVec3::X, middle, Width::Orthographic(1.0)) - 2.0).abs() < 1e-9);
    assert!((look(middle, middle + DVec3::X, Width::Perspective(10.0)) - 1.0).abs() < 1e-9);
    assert_eq!(look(middle + 5.0 * DVec3::X, middle + 6.0 * DVec3::X, Width::Perspective(10.0)), 0.0);
}

/// A square of two zones: its left half sends the band at 450 nm up, its right half that at 520 nm evenly.
fn two_colors() -> Lamp {
    let grid = SphereGrid::new(720, 1);
    let lamp = square(1.0, 8, grid.clone(), lambertian);
    let zones = vec![round(&grid, lambertian), round(&grid, |_| 1.0)];
    let bands = Bands::new(vec![449.5, 450.5, 519.5, 520.5]).unwrap();
    let is_left = |vertex: &DVec3| vertex.x < 0.0;
    let mixtures = lamp.vertices_mm.iter().map(|vertex| Mixture::hard(u32::from(!is_left(vertex)))).collect();
    let watts = lamp.vertices.radiant_w.clone().unwrap();
    let row = |(vertex, watt): (&DVec3, &f64)| {
        if is_left(vertex) { [*watt, 0.0, 0.0, 0.0] } else { [0.0, 0.0, *watt, 0.0] }
    };
    let columns = lamp.vertices_mm.iter().zip(&watts).flat_map(row).collect();
    let vertices = Amounts { columns, column_count: 4, ..lamp.vertices };
    Lamp { zones, mixtures, vertices, spectral: Spectral { bands, columns: Columns::Bands }, ..lamp }
}

fn of_kind(lamp: &Lamp, view: View, kind: Kind) -> Answer {
    let watch = StageWatch::enter(&NoProgress, Stage::Model).unwrap();
    evaluate(lamp, "lamp", &Request { kind: Some(kind), ..Request::of(view) }, watch).unwrap()
}

/// Lines at 450 and 520 nm have the chromaticities of the CIE's table: (0.1566, 0.0177) and (0.0743, 0.8338).
#[test]
fn colors_are_those_of_the_spectral_locus() {
    let lamp = two_colors();
    let found = of_kind(&lamp, camera(DVec3::Z, Width::Orthographic(2.0), 1), Kind::Color);
    let names: Vec<&str> = found.channels.iter().map(|channel| channel.name.as_str()).collect();
    assert_eq!(names, ["X", "Y", "Z", "x", "y"]);
    // Row 10, 0.4 mm to the left and to the right.
    for (cell, x, y) in [(10 * 40 + 12, 0.1566, 0.0177), (10 * 40 + 27, 0.0743, 0.8338)] {
        let [found_x, found_y] = [3, 4].map(|channel| found.channels[channel].values[cell]);
        assert!((found_x - x).abs() < 5e-4 && (found_y - y).abs() < 5e-4, "{found_x} {found_y}");
    }
    // Y of 1 W/mm² at 520 nm, V = 0.71, that goes evenly into 4π.
    let exact = 683.0 * 0.71 / (4.0 * PI) * 1e6;
    assert!((found.channels[1].values[10 * 40 + 27] / exact - 1.0).abs() < 2e-3);
    let spectrum = of_kind(&lamp, View::Angles(vec![[0.0, 0.0], [0.0, 120.0]]), Kind::Spectrum);
    let bands: Vec<[f64; 2]> = spectrum.channels.iter().map(|channel| channel.band_nm.unwrap()).collect();
    assert_eq!(bands, [[449.5, 450.5], [450.5, 519.5], [519.5, 520.5]]);
    // Both bands and both distributions change linearly over the column of 1/8 mm in the middle: ∫ s² = 1/3 of its light goes as that of its own
    // side, ∫ s (1 - s) = 1/6 as that of the other one, 1/π upwards on the left and 1/(4π) everywhere on the right.
    let [own, other] = [1.0 / 24.0, 1.0 / 48.0];
    let left = spectrum.channels[0].values[0] * PI;
    assert!((left - (0.375 + own + other / 4.0)).abs() < 1e-5, "{left}");
    assert!((spectrum.channels[0].values[1] * 4.0 * PI - other).abs() < 1e-9);
    assert!((spectrum.channels[2].values[1] * 4.0 * PI - (0.5 + own)).abs() < 1e-9);
    assert_eq!(spectrum.channels[1].values[0], 0.0);
}

/// Each band of an irradiance is what that half alone sends, and the sum of bands is the radiant one.
#[test]
fn bands_sum_to_the_radiant_irradiance() {
    let lamp = two_colors();
    let plane =
        Plane { center_mm: 0.7 * DVec3::Z, normal: None, up: None, width_mm: 3.0, height_mm: 2.0, columns: 6, rows: 4 };
    let [bands, radiant] = [Kind::Spectrum, Kind::Radiant].map(|kind| of_kind(&lamp, View::Plane(plane), kind));
    for cell in 0..24 {
        let sum: f64 = bands.channels.iter().map(|channel| channel.values[cell]).sum();
        let bound: f64 = bands.channels.iter().map(|channel| channel.bounds[cell]).sum();
        let [whole, of_whole] = [&radiant.channels[0].values, &radiant.channels[0].bounds].map(|own| own[cell]);
        assert!((sum - whole).abs() <= bound + of_whole && bound <= 1.01 * TOLERANCE * sum, "{cell}: {sum} of {whole}");
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let lamp = two_colors();
    let plane =
        Plane { center_mm: 0.2 * DVec3::Z, normal: None, up: None, width_mm: 2.0, height_mm: 2.0, columns: 9, rows: 9 };
    for view in [View::Plane(plane), camera(DVec3::ONE, Width::Perspective(70.0), 2)] {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| of_kind(&lamp, view.clone(), Kind::Color))
        };
        assert!(on(1) == on(3), "{view:?}");
    }
}

/// A surface that sends alike to all directions sends half of its exitance to either side.
#[test]
fn points_of_the_surface_have_the_exitance_to_their_side() {
    let lamp = square(1.0, 8, SphereGrid::new(72, 1), |_| 1.0);
    for normal in [DVec3::NEG_Z, DVec3::Z] {
        let (found, bound) = irradiance(&lamp, DVec3::new(0.01, 0.02, 0.0), normal);
        assert!((found - 0.5).abs() <= 0.005 + bound && bound < 0.01, "{found} {bound}");
    }
}

#[test]
fn what_cannot_be_answered_is_told() {
    let lamp = square(1.0, 2, SphereGrid::new(72, 1), |_| 1.0);
    let code = |request: Request, watch: &dyn Watch| {
        let watch = StageWatch::enter(watch, Stage::Model).unwrap();
        evaluate(&lamp, "lamp", &request, watch).unwrap_err().code()
    };
    let view = || View::Angles(vec![[0.0, 0.0]]);
    let of_kind = |kind| Request { kind: Some(kind), ..Request::of(view()) };
    for kind in [Kind::Luminous, Kind::Spectrum, Kind::Color] {
        assert_eq!(code(of_kind(kind), &NoProgress), "evaluation.unknown_quantity");
    }
    let tolerance = |tolerance| Request { tolerance, ..Request::of(view()) };
    for wrong in [0.0, 0.5, f64::NAN] {
        assert_eq!(code(tolerance(wrong), &NoProgress), "evaluation.tolerance");
    }
    assert_eq!(code(Request { most_kept: 3, ..Request::of(view()) }, &NoProgress), "evaluation.too_large");
    assert_eq!(code(Request::of(View::Directions(Vec::new())), &NoProgress), "evaluation.directions");
    assert_eq!(code(Request::of(View::Directions(vec![DVec3::ZERO])), &NoProgress), "evaluation.geometry");
    assert_eq!(code(Request::of(View::Angles(vec![[f64::NAN, 0.0]])), &NoProgress), "evaluation.geometry");
    /// Nobody waits, once it has begun.
    struct Gone(AtomicUsize);
    impl Watch for Gone {
        fn progress(&self, _: Stage, _: f64) {}
        fn cancelled(&self) -> bool {
            self.0.fetch_add(1, Ordering::Relaxed) > 3
        }
    }
    let view = camera(DVec3::Z, Width::Orthographic(2.0), 1);
    assert_eq!(code(Request::of(view), &Gone(AtomicUsize::new(0))), "run.cancelled");
    let list = answer(&lamp, View::Angles(vec![[0.0, 0.0]]));
    assert_eq!(list.write(Form::Svg).unwrap_err().code(), "evaluation.no_picture");
}

/// Every form of every view, as it is read again.
#[test]
fn files_hold_the_numbers() {
    let lamp = two_colors();
    let plane =
        Plane { center_mm: DVec3::Z, normal: None, up: None, width_mm: 2.0, height_mm: 1.0, columns: 5, rows: 3 };
    let views = [
        View::Grid { c_step_deg: 120.0, gamma_step_deg: 45.0 },
        View::Directions(vec![DVec3::Z, DVec3::ONE]),
        View::Angles(vec![[10.0, 20.0]]),
        View::Plane(plane),
        camera(DVec3::ONE, Width::Orthographic(2.0), 2),
        camera(DVec3::ONE, Width::Perspective(40.0), 1),
    ];
    let schema = jsonschema::validator_for(&schema()).unwrap();
    for (view, kind) in
        views.into_iter().flat_map(|view| [Kind::Radiant, Kind::Spectrum, Kind::Color].map(|kind| (view.clone(), kind)))
    {
        let found = of_kind(&lamp, view, kind);
        let json: serde_json::Value = serde_json::from_slice(&found.write(Form::Json).unwrap().bytes).unwrap();
        if let Err(error) = schema.validate(&json) {
            panic!("{error}: {json}");
        }
        let table = String::from_utf8(found.write(Form::Csv).unwrap().bytes).unwrap();
        let lines: Vec<&str> = table.trim_end().split("\r\n").collect();
        assert_eq!(lines.len(), found.columns * found.rows + 1);
        let columns = lines[0].split(',').count();
        let last: Vec<f64> = lines[lines.len() - 1].split(',').map(|number| number.parse().unwrap()).collect();
        assert_eq!(last.len(), columns, "{}", lines[0]);
        for (at, channel) in found.channels.iter().enumerate() {
            let value = channel.values[channel.values.len() - 1];
            let read = last[columns - 2 * (found.channels.len() - at)];
            assert!((read - value).abs() <= 1e-8 * value.abs());
            let rows = json["channels"][at]["values"].as_array().unwrap();
            let numbers: Vec<f64> =
                rows.iter().flat_map(|row| row.as_array().unwrap()).map(|number| number.as_f64().unwrap()).collect();
            assert!(
                numbers.iter().zip(&channel.values).all(|(read, value)| (read - value).abs() <= 1e-8 * value.abs())
            );
            assert_eq!(numbers.len(), channel.values.len());
        }
        assert!(found.write(Form::Tiff).unwrap().bytes.starts_with(b"II"));
        match found.write(Form::Svg) {
            Ok(drawing) => assert!(String::from_utf8(drawing.bytes).unwrap().ends_with("</svg>\n")),
            Err(error) => assert_eq!((error.code(), found.rows), ("evaluation.no_picture", 1)),
        }
    }
}
