//! New rays of models that were read back from their own files: against the model, and against the sources' closed forms.

use super::models::{Way, made};
use super::read_back::read_back;
use glam::DVec3;
use pipeline::artifacts::read::StoredModel;
use pipeline::convert::Target;
use pipeline::formats::record::RawRay;
use pipeline::goniogram::SphereGrid;
use pipeline::known_sources::by_name;
use pipeline::model::evaluation::Evaluator;
use pipeline::model::light::Light;
use pipeline::model::sampling::Sampler;
use pipeline::new_rays::{NewRays, Request};
use pipeline::options::Zones;
use pipeline::vocabulary::watch::StageWatch;
use pipeline::{Declared, Input, Limits, NoProgress, Options, Stage, Verdict, inspect};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use support::statistics::{ALARM_Z, cell_mean, chi_square_z};

/// The model of 200 000 rays of a known source, back from its files.
fn stored(name: &str) -> StoredModel {
    read_back(&made(name, 200_000, Way::Default))
}

fn asked(count: u64, seed: u64, target: Target) -> Request {
    Request { count, seed, low_discrepancy: false, target }
}

/// The same, spread more evenly than chance has it.
fn spread(count: u64, seed: u64, target: Target) -> Request {
    Request { low_discrepancy: true, ..asked(count, seed, target) }
}

fn bytes(rays: &NewRays<'_>, from: u64, to: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    rays.write(from..to, &mut bytes, StageWatch::enter(&NoProgress, Stage::Rays).unwrap()).unwrap();
    bytes
}

fn whole(model: &StoredModel, request: Request) -> Vec<u8> {
    let rays = NewRays::new(model, &model.name, request).unwrap();
    bytes(&rays, 0, rays.byte_count())
}

/// The file as the pipeline reads ray files.
fn input(bytes: Vec<u8>) -> Input {
    Input {
        name: "new".into(),
        sha256: "0".repeat(64),
        bytes: Arc::new(bytes),
        declared: Declared::default(),
        notices: Vec::new(),
    }
}

/// All rays of a file.
fn rays_of(bytes: Vec<u8>) -> Vec<RawRay> {
    let set = pipeline::formats::open(Arc::new(bytes), None, &Limits::default()).unwrap();
    let mut rays = Vec::new();
    set.records.read(0, set.facts.ray_count as usize, &mut rays).unwrap();
    rays
}

/// A lattice of more zones than there is light for leaves some without a ray: their files are read back, and rays are drawn all the same. A
/// LightTools file, which ends with a mark, is read back by our reader.
#[test]
fn zones_without_rays_do_no_harm() {
    for smoothing in [None, Some(false)] {
        let mut options = Options::default();
        options.goniogram.zones = Some(Zones { columns: 32, rows: 32 });
        options.hull.resolution = Some(40);
        (options.goniogram.smoothing, options.flux.smoothing) = (smoothing, smoothing);
        let outcome = super::known_sources::built(&by_name("flat-chip").unwrap(), 3_000, &options).unwrap();
        let zones = &outcome.model.goniograms.zones;
        assert!(
            zones.iter().any(|zone| zone.goniogram.flux.primary() == 0.0),
            "every zone of {} has light",
            zones.len()
        );
        let rays = rays_of(whole(&read_back(&outcome), asked(20_000, 7, Target::LightToolsBinary)));
        assert_eq!(rays.len(), 20_000);
    }
}

/// New rays fall on vertices or nodes, into the cells of directions of each zone, and into bands as often as the files say. False alarms:
/// 1e-9 for each of the tests.
#[test]
fn new_rays_fall_where_the_model_has_its_light() {
    const DRAWN: u64 = 1_000_000;
    for name in ["four-chips", "phosphor-ring", "dome", "cylinder"] {
        let model = stored(name);
        let (light, evaluator) = (Light::from(&model), Evaluator::of_primary(&model).unwrap());
        let sampler = Sampler::new(&evaluator).unwrap();
        let grid = SphereGrid::new(18, 24);
        let zones = if light.volume.is_some() { 1 } else { light.zones.len() };
        let mut on_sites = vec![0.0; light.sites().len()];
        let mut in_cells = vec![0.0; zones * grid.cell_count()];
        for ray in 0..DRAWN {
            let drawn = sampler.ray(11, ray).unwrap();
            let (c, gamma) = light.frame.angles(drawn.direction);
            on_sites[drawn.site] += 1.0;
            in_cells[drawn.zone * grid.cell_count() + grid.cell(c, gamma)] += 1.0;
        }
        let flux = evaluator.flux();
        let expected: Vec<f64> = light.sites().primary().iter().map(|own| DRAWN as f64 * own / flux).collect();
        let (z, sites) = chi_square_z(&on_sites, &expected);
        println!("{name}: {sites} places, z = {z:.2}");
        assert!(z.abs() < ALARM_Z, "{name}: {sites} places, z = {z:.2}");
        let mut expected = Vec::new();
        for zone in 0..zones {
            for ((c, gamma), sr) in grid.cell_nodes().into_iter().zip(grid.cell_solid_angles_sr()) {
                let turn = if gamma == 0.0 || gamma == PI { TAU } else { TAU / 24.0 };
                let mean = cell_mean(c, gamma, turn, PI / 18.0, |c, gamma| evaluator.distribution_of(zone, c, gamma));
                expected.push(DRAWN as f64 * evaluator.zone_flux(zone) / flux * sr * mean);
            }
        }
        let (z, cells) = chi_square_z(&in_cells, &expected);
        println!("{name}: {cells} cells of {zones} zones, z = {z:.2}");
        assert!(z < ALARM_Z, "{name}: {cells} cells of {zones} zones, z = {z:.2}");
    }
}

/// Wavelengths fall into bands as often as the model has flux there: exactly where no zone sends one band otherwise than another.
#[test]
fn wavelengths_are_those_of_the_model() {
    const DRAWN: u64 = 1_000_000;
    for name in ["flat-chip", "four-chips"] {
        let model = stored(name);
        let light = Light::from(&model);
        assert!(light.zones.iter().all(|zone| zone.spectral_w_per_sr_nm.is_empty()), "{name}");
        let bands = &light.spectral.bands;
        let mut counted = vec![0.0; bands.len()];
        for ray in rays_of(whole(&model, asked(DRAWN, 5, Target::Tm25))) {
            counted[bands.band(ray.wavelength_nm).unwrap()] += 1.0;
        }
        let totals = &light.vertices.column_totals()[..bands.len()];
        let sum: f64 = totals.iter().sum();
        let expected: Vec<f64> = totals.iter().map(|watt| DRAWN as f64 * watt / sum).collect();
        let (z, cells) = chi_square_z(&counted, &expected);
        println!("{name}: {cells} bands, z = {z:.2}");
        assert!(z < ALARM_Z, "{name}: {cells} bands, z = {z:.2}");
    }
}

/// Any part of a file is the bytes of that part, on any number of threads; another seed gives other rays.
#[test]
fn ten_parts_are_one_file() {
    let model = stored("four-chips");
    let requests =
        [asked(100_003, 7, Target::Tm25), asked(100_003, 7, Target::ZemaxBinary), spread(100_003, 7, Target::Tm25)];
    for request in requests {
        let rays = NewRays::new(&model, "lamp", request).unwrap();
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| bytes(&rays, 0, rays.byte_count()))
        };
        let whole = on(1);
        assert_eq!(whole.len() as u64, rays.byte_count());
        assert!(whole == on(3), "threads change the bytes");
        let parts = |edge: &dyn Fn(u64) -> u64| -> Vec<u8> {
            (0..10).flat_map(|part| bytes(&rays, if part == 0 { 0 } else { edge(part) }, edge(part + 1))).collect()
        };
        let by_rays = |part: u64| rays.byte_of_ray(100_003 * part / 10);
        let by_bytes = |part: u64| rays.byte_count() * part / 10;
        assert!(whole == parts(&by_rays) && whole == parts(&by_bytes), "parts are others than the whole");
        assert!(bytes(&rays, rays.byte_count(), u64::MAX).is_empty());
        assert_eq!(bytes(&rays, 3, 5), whole[3..5]);
        let other = NewRays::new(&model, "lamp", Request { seed: 8, ..request }).unwrap();
        assert!(bytes(&other, 0, 1 << 20) != whole[..1 << 20]);
    }
}

/// W, and the lm of the header, are the model's, to the rounding of the 32-bit numbers in the file; the inspection finds rays in a random order, all of the same
/// flux, and nothing to complain of.
#[test]
fn an_inspection_calls_new_rays_random_and_sound() {
    for name in ["flat-chip", "four-chips", "cylinder"] {
        let model = stored(name);
        let flux = NewRays::new(&model, name, asked(200_000, 3, Target::Tm25)).unwrap().flux();
        let requests =
            [asked(200_000, 3, Target::Tm25), asked(200_000, 3, Target::ZemaxBinary), spread(200_000, 3, Target::Tm25)];
        for request in requests {
            let file = whole(&model, request);
            let input = input(file);
            let found = inspect(&input, &Limits::default(), &NoProgress).unwrap();
            for check in &found.checks {
                println!("{name}: {} {:?} {}", check.check, check.verdict, check.message);
                let may_tell = ["rays.noise", "rays.efficacy"].contains(&check.check);
                assert!(
                    check.verdict == Verdict::Ok || may_tell && check.verdict == Verdict::Notice,
                    "{name}: {check:?}"
                );
            }
            // The noise of counts is not theirs, as their header says.
            let noise = &found.checks.iter().find(|check| check.check == "rays.noise").unwrap().message;
            assert_eq!(noise.contains("of low discrepancy"), request.low_discrepancy, "{noise}");
            let radiant = found.flux.radiant_w.unwrap() / flux.radiant_w.unwrap();
            assert!((radiant - 1.0).abs() < 1e-6, "{name}: {radiant}");
            if request.target == Target::Tm25 {
                let header = pipeline::header(&input, &Limits::default()).unwrap();
                let header = header.flux.luminous_lm.unwrap() / flux.luminous_lm.unwrap();
                assert!((header - 1.0).abs() < 1e-6, "{name}: {header}");
            }
            // Lumens that are recomputed from wavelengths in bands of 10 nm differ, for blue light by up to 3 % (openapi/README.md 5).
            let luminous = found.flux.luminous_lm.unwrap() / flux.luminous_lm.unwrap();
            assert!((luminous - 1.0).abs() < 0.03, "{name}: {luminous}");
        }
    }
}

/// New rays of the flat chip against its closed forms: a Lambertian square of 1 mm and 1 W. The model's own error was at most 0.4 % with so
/// many rays; six standard deviations of the counts come on top.
#[test]
fn new_rays_of_a_chip_light_what_the_chip_lights() {
    const DRAWN: u64 = 4_000_000;
    let source = by_name("flat-chip").unwrap();
    let rays = rays_of(whole(&stored("flat-chip"), asked(DRAWN, 1, Target::Tm25)));
    let watts = source.radiant_w() / DRAWN as f64;
    let judge = |what: &str, counted: f64, exact: f64| {
        let noise = 6.0 / counted.sqrt();
        let error = counted * watts / exact - 1.0;
        println!("{what}: {:.5} of {exact:.5}, {error:+.4} (noise {noise:.4})", counted * watts);
        assert!(error.abs() < 0.004 + noise, "{what}: {error:+.4}, noise {noise:.4}");
    };
    // Within 10 degrees of the axis: sin² of that.
    let near = rays.iter().filter(|ray| ray.direction[2] > 10_f64.to_radians().cos()).count();
    judge("flux within 10 degrees", near as f64, source.radiant_w() * 10_f64.to_radians().sin().powi(2));
    // On a square of 0.2 mm, 1 mm above the middle: the irradiance there is even within 0.4 % of it.
    let above = |ray: &&RawRay| {
        let [origin_mm, direction] = [ray.origin_mm, ray.direction].map(DVec3::from_array);
        let at_mm = origin_mm + direction * ((1.0 - origin_mm.z) / direction.z);
        direction.z > 0.0 && at_mm.x.abs() < 0.1 && at_mm.y.abs() < 0.1
    };
    let half = 64;
    let mean: f64 = (0..half * half)
        .map(|k| {
            let [x, y] = [k % half, k / half].map(|at| (f64::from(at) + 0.5) / f64::from(half) * 0.2 - 0.1);
            irradiance_w_per_mm2(&source, DVec3::new(x, y, 1.0))
        })
        .sum::<f64>()
        / f64::from(half * half);
    judge("flux on a square 1 mm above", rays.iter().filter(above).count() as f64, mean * 0.04);
}

/// Irradiance above a Lambertian square of 1 mm, by the configuration factor of its four rectangles at the foot of the point (Howell, A
/// Catalog of Radiation Heat Transfer Configuration Factors, B-3).
fn irradiance_w_per_mm2(source: &pipeline::known_sources::KnownSource, point_mm: DVec3) -> f64 {
    let corner = |a_mm: f64, b_mm: f64| {
        let (x, y) = (a_mm / point_mm.z, b_mm / point_mm.z);
        let (u, v) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
        (x / u * (y / u).atan() + y / v * (x / v).atan()) / TAU
    };
    let [left, right] = [0.5 + point_mm.x, 0.5 - point_mm.x];
    let [below, above] = [0.5 + point_mm.y, 0.5 - point_mm.y];
    let factor = corner(left, below) + corner(left, above) + corner(right, below) + corner(right, above);
    source.radiant_w() / source.area_mm2() * factor
}

/// What N = 2^16 rays say of the model, against the model's own integrals: root mean square over 8 seeds and over cells, of the flux in cells of
/// directions and on cells of a plane before the lamp. Chance alone has σ = √(p (1 − p) / N) for a share p of the rays, which is also judged: the mean square of 8 seeds
/// and 12 cells lies within a half of it. Rays of low discrepancy are at least twice as good, of a dome a tenth.
#[test]
fn rays_of_low_discrepancy_have_less_noise() {
    const DRAWN: u64 = 1 << 16;
    const SEEDS: u64 = 8;
    for name in ["flat-chip", "four-chips", "dome"] {
        let model = stored(name);
        let evaluator = Evaluator::of_primary(&model).unwrap();
        let views = [directions(&model, &evaluator), on_plane(&evaluator)];
        let mut squares = [[0.0; 2]; 2];
        for seed in 1..=SEEDS {
            for (kind, request) in
                [asked(DRAWN, seed, Target::Tm25), spread(DRAWN, seed, Target::Tm25)].into_iter().enumerate()
            {
                let rays = rays_of(whole(&model, request));
                for (view, cells) in views.iter().enumerate() {
                    for cell in cells {
                        let share = rays.iter().filter(|ray| (cell.holds)(ray)).count() as f64 / DRAWN as f64;
                        let sigma = (cell.share * (1.0 - cell.share) / DRAWN as f64).sqrt();
                        squares[view][kind] +=
                            ((share - cell.share) / sigma).powi(2) / (SEEDS as usize * cells.len()) as f64;
                    }
                }
            }
        }
        for (what, [random, spread]) in ["directions", "plane"].into_iter().zip(squares) {
            let factor = (random / spread).sqrt();
            println!(
                "{name}, {what}: errors in σ of chance: random {:.3}, spread {:.3}, {factor:.1} times",
                random.sqrt(),
                spread.sqrt()
            );
            assert!((random - 1.0).abs() < 0.5, "{name}, {what}: {random}");
            // Where every place has zones of its own, as on a dome, which zone a ray goes by is one more thing that is left to chance in part.
            let least = if name == "dome" { 1.1 } else { 2.0 };
            assert!(factor > least, "{name}, {what}: {factor}");
        }
    }
}

/// Where rays are counted, and the share of the light that the model has there.
struct Counted {
    share: f64,
    holds: Box<dyn Fn(&RawRay) -> bool>,
}

/// Twelve cells of 30 degrees of C, 15 to 45 degrees from the axis.
fn directions(model: &StoredModel, evaluator: &Evaluator<'_>) -> Vec<Counted> {
    let frame = Light::from(model).frame;
    let cell = |number: i32| {
        let (c_step, gamma_step) = (TAU / 12.0, PI / 6.0);
        let (c, gamma) = ((f64::from(number) + 0.5) * c_step, PI / 6.0);
        let intensity = |c: f64, gamma: f64| evaluator.intensity(frame.direction(c, gamma));
        let sr = c_step * ((gamma - 0.5 * gamma_step).cos() - (gamma + 0.5 * gamma_step).cos());
        let holds = move |ray: &RawRay| {
            let (at_c, at_gamma) = frame.angles(DVec3::from_array(ray.direction));
            (at_c - c).abs() < 0.5 * c_step && (at_gamma - gamma).abs() < 0.5 * gamma_step
        };
        let share =
            fine_mean(8, |u, v| (intensity(c + u * c_step, gamma + v * gamma_step), (gamma + v * gamma_step).sin()));
        Counted { share: share * sr / evaluator.flux(), holds: Box::new(holds) }
    };
    (0..12).map(cell).collect()
}

/// Twelve squares of 1 mm on a plane 3 mm above the origin.
fn on_plane(evaluator: &Evaluator<'_>) -> Vec<Counted> {
    const ABOVE_MM: f64 = 3.0;
    let cell = |number: i32| {
        let [x_mm, y_mm] = [number % 4, number / 4].map(|at| f64::from(at) - 1.5);
        let holds = move |ray: &RawRay| {
            let [origin_mm, direction] = [ray.origin_mm, ray.direction].map(DVec3::from_array);
            let at_mm = origin_mm + direction * ((ABOVE_MM - origin_mm.z) / direction.z);
            direction.z > 0.0 && (at_mm.x - x_mm).abs() < 0.5 && (at_mm.y - y_mm).abs() < 0.5
        };
        let share =
            fine_mean(5, |u, v| (evaluator.irradiance(DVec3::new(x_mm + u, y_mm + v, ABOVE_MM), -DVec3::Z), 1.0));
        Counted { share: share / evaluator.flux(), holds: Box::new(holds) }
    };
    (0..12).map(cell).collect()
}

/// Mean over -0.5..0.5 of both coordinates of what `value` gives with its weight, at the middles of `side` x `side` parts.
fn fine_mean(side: i32, value: impl Fn(f64, f64) -> (f64, f64)) -> f64 {
    let middle = |k: i32| (f64::from(k) + 0.5) / f64::from(side) - 0.5;
    let found: Vec<(f64, f64)> = (0..side * side).map(|k| value(middle(k % side), middle(k / side))).collect();
    found.iter().map(|(value, weight)| value * weight).sum::<f64>()
        / found.iter().map(|(_, weight)| weight).sum::<f64>()
}
