//! New rays of models that were read back from their own files: against the model, and against the sources' closed forms.

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
    read_back(&super::known_sources::built(&by_name(name).unwrap(), 200_000, &Options::default()).unwrap())
}

fn asked(count: u64, seed: u64, target: Target) -> Request {
    Request { count, seed, target }
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
    for target in [Target::Tm25, Target::ZemaxBinary] {
        let rays = NewRays::new(&model, "lamp", asked(100_003, 7, target)).unwrap();
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
        let other = NewRays::new(&model, "lamp", asked(100_003, 8, target)).unwrap();
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
        for target in [Target::Tm25, Target::ZemaxBinary] {
            let file = whole(&model, asked(200_000, 3, target));
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
            let radiant = found.flux.radiant_w.unwrap() / flux.radiant_w.unwrap();
            assert!((radiant - 1.0).abs() < 1e-6, "{name}: {radiant}");
            if target == Target::Tm25 {
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
