//! Where the light is put, what is said of it, and rays drawn from the model.

use super::models::{Way, made};
use glam::{DQuat, DVec3};
use pipeline::goniogram::SphereGrid;
use pipeline::known_sources::{KnownSource, by_name, uniform};
use pipeline::model::evaluation::{Evaluator, Quantity};
use pipeline::model::sampling::Sampler;
use pipeline::model::study::View;
use pipeline::{Axis, Declared, Emission, Error, Input, LengthUnit, Limits, NoProgress, Options, Outcome, run};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use support::statistics::{ALARM_Z, cell_mean, chi_square_z};

const RAYS: u64 = 200_000;
const BEAM_RAYS: u64 = 100_000;

fn built(source: &KnownSource, options: &Options) -> Result<Outcome, Error> {
    super::known_sources::built(source, RAYS, options)
}

fn by_default(name: &str) -> Arc<Outcome> {
    made(name, RAYS, Way::Default)
}

fn with(emission: Emission) -> Options {
    let mut options = Options::default();
    options.hull.emission = Some(emission);
    options
}

/// Irradiance over the middle of a Lambertian square of 1 mm that sends 1 W: Howell, A Catalog of Radiation Heat Transfer Configuration
/// Factors, B-3, four times.
fn above_the_chip_w_per_mm2(height_mm: f64) -> f64 {
    let a = 0.5 / height_mm;
    4.0 / PI * (a / a.hypot(1.0)) * (a / a.hypot(1.0)).atan()
}

/// The file shows a box; the chip is found within, and the light above it is right, which it is not on the box.
#[test]
fn a_chip_whose_rays_start_on_a_box_is_found_in_its_plane() {
    let source = by_name("boxed-chip").unwrap();
    let chip_mm = DVec3::new(-0.6, 0.8, -0.4);
    let off = |outcome: &Outcome, height_mm: f64| {
        let evaluator = Evaluator::new(&outcome.model, Quantity::Radiant).unwrap();
        let found = evaluator.irradiance(chip_mm + height_mm * DVec3::Z, DVec3::NEG_Z);
        found / above_the_chip_w_per_mm2(height_mm) - 1.0
    };
    let focal = by_default("boxed-chip");
    let study = focal.model.study.as_ref().unwrap();
    let chosen = study.surface().unwrap();
    assert_eq!((chosen.surface(), study.candidates[0].surface()), ("plane", "origins"));
    let apex_mm = chosen.carrier.patch().unwrap().surface.apex_mm;
    assert!((apex_mm.z - chip_mm.z).abs() < 0.03, "{apex_mm}");
    let balance = &focal.model.surface.balance;
    assert!(balance.every_ray_once() && balance.error() < 1e-9, "{balance:?}");
    assert_eq!(focal.model.hull.check(), []);
    let boxed = built(&source, &with(Emission::Origins)).unwrap();
    for height_mm in [0.6, 1.0, 3.0] {
        let (focal, boxed) = (off(&focal, height_mm), off(&boxed, height_mm));
        println!("{height_mm} mm above the chip: {focal:+.3}, on the box {boxed:+.3}");
        assert!(focal.abs() < 0.03, "{height_mm} mm above: {focal:+.3}");
    }
    assert!(off(&boxed, 0.6).abs() > 0.1);
    for figure in &study.figures {
        println!("{}: {figure}", figure.view);
        assert!(!figure.is_worse_than_rays(), "{}: {figure}", figure.view);
    }
    assert!(study.figures.iter().any(|figure| figure.view == View::FarField));
}

/// Where light differs in colour from place to place, the proof compares the colours as well; light of one spectrum has none to compare.
#[test]
fn the_proof_compares_colours_where_they_differ() {
    let figures = |name: &str| {
        let study = by_default(name).model.study.clone().unwrap();
        study.figures.into_iter().filter(|figure| figure.view.is_spectral()).collect::<Vec<_>>()
    };
    let colours = figures("four-chips");
    let views = [View::SpectralPlane(0.5), View::SpectralPlane(2.0), View::SpectralFarField];
    assert_eq!(colours.iter().map(|figure| figure.view).collect::<Vec<_>>(), views);
    for figure in colours {
        println!("{}: {figure}", figure.view);
        // Of 52 000 rays in six groups of bands and 144 cells the rays themselves are off by 10 %: 1/√(60 rays) in a typical cell.
        assert!(figure.rays > 0.05 && figure.model < 0.5 * figure.rays, "{}: {figure}", figure.view);
    }
    assert_eq!(figures("flat-chip").len(), 0);
}

/// A dome is symmetric, so every ray stands for its images; each is still counted once.
#[test]
fn images_of_rays_are_counted_as_one_ray() {
    let source = by_name("dome").unwrap();
    let outcome = built(&source, &with(Emission::Focus)).unwrap();
    let chosen = outcome.model.study.as_ref().unwrap().surface().unwrap();
    assert!(chosen.carrier.patch().unwrap().symmetry.images() > 1, "{chosen}");
    let balance = &outcome.model.surface.balance;
    assert!(balance.every_ray_once() && balance.error() < 1e-9, "{balance:?}");
    let zones: f64 = outcome.model.goniograms.zones.iter().map(|zone| zone.goniogram.flux.radiant_w.unwrap()).sum();
    assert!((zones / source.radiant_w() - 1.0).abs() < 1e-6, "{zones}");
}

#[test]
fn light_from_everywhere_has_no_focal_surface() {
    let cylinder = by_name("cylinder").unwrap();
    assert_eq!(built(&cylinder, &with(Emission::Focus)).unwrap_err().code(), "emission.no_focus");
    let auto = by_default("cylinder");
    assert_eq!(auto.model.study.as_ref().unwrap().surface().unwrap().surface(), "volume");
}

/// A cylinder that glows inside and can be seen through is a volume: its radiance is what the known source's integral along the line says,
/// which that of its hull is not, and the nodes have all of its light.
#[test]
fn a_glowing_cylinder_is_a_volume() {
    let source = by_name("cylinder").unwrap();
    let outcome = by_default("cylinder");
    let volume = &outcome.model;
    let nodes = &volume.volume.as_ref().unwrap().nodes;
    let sum: f64 = nodes.radiant_w.as_ref().unwrap().iter().sum();
    assert!((sum / source.radiant_w() - 1.0).abs() < 1e-9, "{sum} W");
    let columns: f64 = nodes.columns.iter().sum();
    let on_vertices: f64 = volume.surface.vertices.columns.iter().sum();
    assert!((columns / on_vertices - 1.0).abs() < 1e-9, "{columns} of {on_vertices} W in the bands");
    let evaluator = Evaluator::new(volume, Quantity::Radiant).unwrap();
    let bounds = volume.hull.bounds_mm();
    let (mut square, mut power, mut lines) = (0.0, 0.0, 0);
    for (k, l, turn) in (0..20).flat_map(|k| (0..20).flat_map(move |l| (0..4).map(move |turn| (k, l, turn)))) {
        let at = |part: f64, axis: usize| bounds.min[axis] + part * bounds.size()[axis];
        let point_mm =
            DVec3::new(at((f64::from(k) + 0.5) / 20.0, 0), bounds.center().y, at((f64::from(l) + 0.5) / 20.0, 2));
        let angle = TAU * (f64::from(turn) + 0.4) / 8.0;
        let direction = DVec3::new(angle.cos() * 0.4, 0.8, angle.sin() * 0.4).normalize();
        // Where the line has left the source.
        let outside_mm = point_mm + 10.0 * direction;
        let exact = source.radiance_w_per_mm2_sr(outside_mm, direction);
        let found = evaluator.radiance_along(outside_mm, direction).unwrap();
        (square, power, lines) =
            (square + (found - exact).powi(2), power + exact * exact, lines + i32::from(exact > 0.0));
    }
    let error = (square / power).sqrt();
    println!("radiance of {lines} lines: {error:.3} r.m.s.");
    assert!(lines > 1000 && error < 0.1, "{lines} lines, {error:.3} r.m.s.");
}

/// Who asks for a volume has one, whatever the cloud: here of a flat chip.
#[test]
fn a_flat_source_may_be_asked_for_as_a_volume() {
    let chip = built(&by_name("flat-chip").unwrap(), &with(Emission::Volume)).unwrap().model;
    let volume = chip.volume.as_ref().unwrap();
    assert_eq!(volume.lattice.cells[2], 1);
    let sum: f64 = volume.nodes.radiant_w.as_ref().unwrap().iter().sum();
    assert!((sum / chip.flux.radiant_w.unwrap() - 1.0).abs() < 1e-9, "{sum} W");
}

/// The model of the rays in a text file in mm.
fn of_text(text: String) -> Outcome {
    let declared = Declared { length_unit: Some(LengthUnit::Millimetre), ..Declared::default() };
    let input = Input {
        name: "rays.txt".into(),
        sha256: "0".repeat(64),
        bytes: Arc::new(text.into_bytes()),
        declared,
        notices: Vec::new(),
    };
    run(&[input], &Options::default(), &Limits::default(), &NoProgress).unwrap()
}

/// Lambertian light round Z from two random numbers.
fn lambertian(u: f64, v: f64) -> DVec3 {
    let (sin, cos) = (TAU * v).sin_cos();
    DVec3::new(u.sqrt() * cos, u.sqrt() * sin, (1.0 - u).sqrt())
}

/// A reflector's parallel light from a disc of 60 mm, 0.7 W within a cone of 2° (sin² uniform), and in its middle the filament itself, 0.3 W of Lambertian
/// light from a disc of 1 mm. Above the middle the beam gives 0.7 W/(π 30² mm²) as long as its cone does not reach the rim, the filament 0.3 W/(π d²).
#[test]
fn a_filament_in_a_beam_does_not_brighten_it() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let mut text = String::from("# x y z dx dy dz power_W\n");
    let widest = 2f64.to_radians().sin().powi(2);
    for _ in 0..RAYS {
        let [a, b, c, d, e] = [0; 5].map(|_| uniform(&mut random));
        let is_beam = a < 0.7;
        let radius_mm = if is_beam { 30.0 } else { 0.5 } * b.sqrt();
        let (sin, cos) = (TAU * c).sin_cos();
        let to = lambertian(if is_beam { widest * d } else { d }, e);
        text += &format!("{:.6} {:.6} 0 {:.9} {:.9} {:.9} 5e-6\n", radius_mm * cos, radius_mm * sin, to.x, to.y, to.z);
    }
    let outcome = of_text(text);
    let evaluator = Evaluator::new(&outcome.model, Quantity::Radiant).unwrap();
    // Above the middle, and round it, where the beam is all that differs; the mean of eight places.
    for (height_mm, aside_mm) in [(80.0, 0.7), (160.0, 0.7), (20.0, 4.0), (40.0, 4.0), (80.0, 4.0)] {
        let square_mm2: f64 = height_mm * height_mm + aside_mm * aside_mm;
        let exact = 0.7 / (PI * 900.0) + 0.3 / PI * (height_mm / square_mm2).powi(2);
        let at = |place: usize| {
            let (sin, cos) = (TAU * place as f64 / 8.0).sin_cos();
            evaluator.irradiance(DVec3::new(aside_mm * cos, aside_mm * sin, height_mm), DVec3::NEG_Z)
        };
        let off = (0..8).map(at).sum::<f64>() / 8.0 / exact - 1.0;
        println!("{height_mm} mm above, {aside_mm} mm aside: {off:+.3}");
        assert!(off.abs() < 0.1, "{height_mm} mm above, {aside_mm} mm aside: {off:+.3}");
    }
}

/// Two chips of different colours that shine alike: as bright on one side as on the other, but no image of each other. Their rays start on a
/// plane ahead of them.
#[test]
fn colours_side_by_side_are_not_mirrored() {
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let mut text = String::from("# x y z dx dy dz power_W wavelength_nm\n");
    for _ in 0..BEAM_RAYS {
        let [a, b, c, d, e] = [0; 5].map(|_| uniform(&mut random));
        let is_red = a < 0.5;
        let (to, middle_mm) = (lambertian(d, e), if is_red { -1.0 } else { 1.0 });
        let from_mm = DVec3::new(middle_mm + b - 0.5, c - 0.5, 0.0) + to / to.z;
        let nm = if is_red { 620 } else { 470 };
        text += &format!("{:.6} {:.6} 1 {:.9} {:.9} {:.9} 1 {nm}\n", from_mm.x, from_mm.y, to.x, to.y, to.z);
    }
    let model = of_text(text).model;
    let study = model.study.as_ref().unwrap();
    assert_eq!(study.surface().unwrap().surface(), "plane", "{:?}", study.candidates);
    assert!(study.figures.iter().filter(|figure| figure.view.is_spectral()).count() > 1);
    for figure in &study.figures {
        println!("{}: {figure}", figure.view);
        assert!(!figure.is_worse_than_rays(), "{}: {figure}", figure.view);
    }
    // A vertex of the left chip sends red light.
    let flux = model.surface.vertices.primary();
    let red = model.spectral.bands.band(620.0).unwrap();
    let sums =
        (0..flux.len()).filter(|vertex| model.hull.vertices_mm[*vertex].x < 0.0).fold((0.0, 0.0), |sums, vertex| {
            (sums.0 + model.surface.vertices.columns_of(vertex)[red], sums.1 + flux[vertex])
        });
    assert!(sums.0 > 0.98 * sums.1, "{} of {} W", sums.0, sums.1);
}

/// A round Gaussian beam: peak 1/(2π σ²) per sr, σ the standard deviation of the tangent; the peak is right within 2 % or three times its
/// stated noise, and a reader who takes the mean of neighbouring nodes for the zone between them finds the flux within 0.5 %.
#[test]
fn narrow_beams_keep_their_peak_and_their_flux() {
    let mut random = ChaCha8Rng::seed_from_u64(8);
    for (width_deg, tilt_deg) in [(0.0_f64, 0.0_f64), (1.0, 0.0), (3.0, 0.0), (10.0, 0.0), (30.0, 0.0), (3.0, 20.0)] {
        let sigma = (0.5 * width_deg).to_radians().tan() / (2.0 * 2f64.ln()).sqrt();
        let axis = DQuat::from_rotation_x(tilt_deg.to_radians());
        let mut text = String::from("# x y z dx dy dz power_W\n");
        for _ in 0..BEAM_RAYS {
            let [a, b, c, d] = [0; 4].map(|_| uniform(&mut random));
            let radius = sigma * (-2.0 * a.max(f64::MIN_POSITIVE).ln()).sqrt();
            let (sin, cos) = (TAU * b).sin_cos();
            let to = axis * DVec3::new(radius * cos, radius * sin, 1.0).normalize();
            text += &format!("{c:.5} {d:.5} 0 {:.9} {:.9} {:.9} 1\n", to.x, to.y, to.z);
        }
        let outcome = of_text(text);
        let (goniograms, total) = (&outcome.model.goniograms, &outcome.model.goniograms.total);
        let (nodes, flux) = (total.radiant_w_per_sr.as_ref().unwrap(), total.flux.radiant_w.unwrap());
        let peak = nodes.iter().copied().fold(0.0, f64::max) / flux;
        let exact = 1.0 / (TAU * sigma * sigma);
        let noise = total.quality.relative_noise_at_peak;
        let gamma: Vec<f64> = goniograms.grid.gamma_deg().into_iter().map(f64::to_radians).collect();
        let planes = goniograms.grid.c_planes();
        let read: f64 = nodes
            .chunks_exact(gamma.len())
            .map(|plane| {
                let zones = gamma.windows(2).zip(plane.windows(2));
                zones.map(|(g, i)| 0.5 * (i[0] + i[1]) * (g[0].cos() - g[1].cos())).sum::<f64>() * TAU / planes as f64
            })
            .sum();
        println!(
            "{width_deg} deg, tilted {tilt_deg}: peak {:+.4} noise {noise:.4}, read {:+.4}",
            peak / exact - 1.0,
            read / flux - 1.0
        );
        assert!(
            (read / flux - 1.0).abs() < 0.005,
            "{width_deg} deg, tilted {tilt_deg}: {:+.4} of the flux",
            read / flux - 1.0
        );
        if width_deg > 0.0 {
            assert!(
                (peak / exact - 1.0).abs() < 0.02_f64.max(3.0 * noise),
                "{width_deg} deg, tilted {tilt_deg}: {peak} of {exact}"
            );
        }
    }
}

/// A lens that sends its light to the sides, a Gaussian of γ all round: the frame looks along its axis, and over γ the intensity is right within
/// three standard errors of as many rays as stand in a cell of two degrees, or 1.5 % of the peak where those are smaller.
#[test]
fn a_belt_of_light_is_seen_from_its_axis() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let (middle, deviation) = (78f64.to_radians(), 6f64.to_radians());
    let density = |gamma: f64| (-0.5 * ((gamma - middle) / deviation).powi(2)).exp();
    let mut text = String::from("# x y z dx dy dz power_W\n");
    let mut rays = 0;
    while rays < BEAM_RAYS {
        let [a, b, c, d, e] = [0; 5].map(|_| uniform(&mut random));
        let gamma = middle + 4.0 * deviation * (2.0 * a - 1.0);
        if b > density(gamma) * gamma.sin() {
            continue;
        }
        rays += 1;
        let (sin, cos) = (TAU * c).sin_cos();
        let (side, along) = (TAU * c + 0.6 * (d - 0.5)).sin_cos();
        let (x, y, z) = (gamma.sin() * along, gamma.sin() * side, gamma.cos());
        text += &format!("{:.6} {:.6} {:.6} {x:.9} {y:.9} {z:.9} 1e-5\n", 3.0 * cos, 3.0 * sin, 2.0 * e);
    }
    let outcome = of_text(text);
    let goniograms = &outcome.model.goniograms;
    assert_eq!(goniograms.frame.nadir, Axis::PosZ);
    let steps = 4000;
    let sum: f64 = (0..steps).map(|k| (k as f64 + 0.5) * PI / steps as f64).map(|g| density(g) * g.sin()).sum();
    let whole_sr = TAU * sum * PI / steps as f64;
    let nodes = goniograms.total.radiant_w_per_sr.as_ref().unwrap();
    let gammas = goniograms.grid.gamma_deg();
    assert!(gammas.windows(2).filter(|pair| pair[1] - pair[0] < 2.0).count() > 10, "{gammas:?}");
    for (k, gamma_deg) in gammas.iter().enumerate() {
        let ring = nodes.chunks_exact(gammas.len()).map(|plane| plane[k]);
        let found = ring.sum::<f64>() / goniograms.grid.c_planes() as f64;
        let exact = density(gamma_deg.to_radians()) / whole_sr;
        let cell_sr = TAU * gamma_deg.to_radians().sin() * 2f64.to_radians();
        let error = (exact / (BEAM_RAYS as f64 * cell_sr.max(1e-3))).sqrt().max(0.005 / whole_sr);
        println!("{gamma_deg} deg: {found:.5} of {exact:.5} W/sr, {:+.1} standard errors", (found - exact) / error);
        assert!((found - exact).abs() < 3.0 * error, "{gamma_deg} deg: {found} of {exact} W/sr, {error}");
    }
}

/// Directions of drawn rays fall into cells as often as the evaluated intensity says, and rays start where the flux is.
#[test]
fn drawn_rays_are_those_of_the_model() {
    const DRAWN: usize = 400_000;
    for name in ["phosphor-ring", "cylinder"] {
        let outcome = by_default(name);
        let model = &outcome.model;
        let evaluator = Evaluator::new(model, Quantity::Radiant).unwrap();
        let sampler = Sampler::new(&evaluator).unwrap();
        let grid = SphereGrid::new(18, 24);
        let (mut counted, mut above) = (vec![0.0; grid.cell_count()], 0.0);
        let middle_mm = model.hull.bounds_mm().center();
        for ray in 0..DRAWN as u64 {
            let drawn = sampler.ray(3, ray).unwrap();
            let (c, gamma) = model.goniograms.frame.angles(drawn.direction);
            counted[grid.cell(c, gamma)] += 1.0;
            above += if drawn.point_mm.x > middle_mm.x { 1.0 } else { 0.0 };
        }
        let share = |c: f64, gamma: f64| evaluator.intensity(model.goniograms.frame.direction(c, gamma));
        let (c_step, gamma_step) = (TAU / 24.0, PI / 18.0);
        let cell = |((c, gamma), sr): ((f64, f64), f64)| {
            let pole = gamma == 0.0 || gamma == PI;
            sr * cell_mean(c, gamma, if pole { TAU } else { c_step }, gamma_step, share)
        };
        let flux: Vec<f64> = grid.cell_nodes().into_iter().zip(grid.cell_solid_angles_sr()).map(cell).collect();
        let total: f64 = flux.iter().sum();
        let expected: Vec<f64> = flux.iter().map(|flux| DRAWN as f64 * flux / total).collect();
        let (z, cells) = chi_square_z(&counted, &expected);
        println!("{name}: {cells} cells, z = {z:.2}");
        assert!(z < ALARM_Z, "{name}: {cells} cells, z = {z:.2}");
        // The half of the flux beyond the middle: triangles that lie across it share theirs, which is less than a hundredth.
        let beyond = |triangle: usize| {
            let [a, b, c] = model.hull.corners_mm(triangle);
            let exitance = evaluator.exitance(triangle, [1.0 / 3.0; 3]);
            model.hull.area_mm2(triangle) * exitance * if ((a + b + c) / 3.0).x > middle_mm.x { 1.0 } else { 0.0 }
        };
        let in_volume = model.volume.as_ref().map(|volume| {
            let (lattice, middle) = (&volume.lattice, [0.5; 3]);
            let density: Vec<f64> = (0..lattice.node_count).map(|node| evaluator.density(node)).collect();
            let beyond = lattice.lit_cells().filter(|cell| lattice.point_mm(*cell, middle).x > middle_mm.x);
            beyond.map(|cell| lattice.interpolate(cell, middle, &density)).sum::<f64>()
                * lattice.pitch_mm.element_product()
        });
        let on_surface = || (0..model.hull.triangles.len()).map(beyond).sum::<f64>();
        let share = in_volume.unwrap_or_else(on_surface) / model.flux.radiant_w.unwrap();
        assert!((above / DRAWN as f64 - share).abs() < 0.015, "{name}: {above} of {DRAWN}, {share}");
    }
}
