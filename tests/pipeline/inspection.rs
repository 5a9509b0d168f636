//! Inspections of files whose answers are known: closed forms, files made wrong on purpose, and a real one.

use glam::DVec3;
use pipeline::formats::bytes::digest;
use pipeline::known_sources::write_tm25;
use pipeline::{
    Declared, Input, Inspection, Limits, NoProgress, Options, Table, Verdict, drawings, inspect, known_sources, run,
};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::Value;
use std::sync::Arc;

const SCHEMA: &str = include_str!("../../openapi/inspection.schema.json");
const ZEMAX_HEADER: usize = 208;

fn seen(bytes: Vec<u8>) -> Inspection {
    let input = Input {
        name: "test".into(),
        sha256: String::new(),
        bytes: Arc::new(bytes),
        declared: Declared::default(),
        notices: Vec::new(),
    };
    inspect(&input, &Limits::default(), &NoProgress).unwrap()
}

fn verdict(found: &Inspection, check: &str) -> Verdict {
    found.checks.iter().find(|found| found.check == check).unwrap().verdict
}

fn known(name: &str, rays: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_tm25(&known_sources::by_name(name).unwrap(), rays, 5, &mut bytes).unwrap();
    bytes
}

/// A Zemax file (pipeline/formats/README.md 2) of these rays: x y z l m n flux; lengths in the unit of this code (4 = mm, 0 = m).
fn zemax(unit: i32, rays: &[[f64; 7]]) -> Vec<u8> {
    let mut file = vec![0; ZEMAX_HEADER];
    let mut word = |at: usize, value: [u8; 4]| file[at..at + 4].copy_from_slice(&value);
    word(0, 1010_i32.to_le_bytes());
    word(4, (rays.len() as u32).to_le_bytes());
    let total = rays.iter().map(|ray| ray[6]).sum::<f64>() as f32;
    word(108, total.to_le_bytes());
    word(112, total.to_le_bytes());
    word(116, 0.55_f32.to_le_bytes());
    word(136, unit.to_le_bytes());
    rays.iter().flatten().for_each(|value| file.extend((*value as f32).to_le_bytes()));
    file
}

/// Every inspection fits the published schema, and has a remedy where something is to be done.
fn conforms(found: &Inspection) {
    let schema: Value = serde_json::from_str(SCHEMA).unwrap();
    let json = serde_json::to_value(found).unwrap();
    let problems: Vec<String> =
        jsonschema::validator_for(&schema).unwrap().iter_errors(&json).map(|error| error.to_string()).collect();
    assert!(problems.is_empty(), "{problems:?}");
    for check in &found.checks {
        assert_eq!(check.remedy.is_some(), check.verdict > Verdict::Ok, "{check:?}");
    }
    assert_eq!(found.verdict, found.checks.iter().map(|check| check.verdict).max().unwrap());
}

/// Closed forms of the 1 x 1 mm Lambertian chip in z = 0: the focus is its middle, because places and directions are
/// independent, so A F = A E[o]; A/W = diag(3/4, 3/4, 1/2), condition 1.5; mean cosine 2/3; no flux backward. The mean square
/// distance of the lines is E[o . (1 - d d^T) o] = 3/4 E[x^2 + y^2] = 3/4 * 2/12 = 1/8.
#[test]
fn a_lambertian_chip_is_what_its_closed_form_says() {
    const RAYS: f64 = 100_000.0;
    let found = seen(known("flat-chip", RAYS as u64));
    conforms(&found);
    let focus = found.focus.unwrap();
    // Standard error along z: sqrt(1/8 / 2 / (n / 2)); across it is smaller.
    let error = (0.125 / RAYS).sqrt();
    assert!((focus.standard_error_mm / error - 1.0).abs() < 0.02, "{focus:?}");
    assert!(DVec3::from_array(focus.point_mm).length() < 6.0 * error, "{focus:?}");
    assert!((focus.condition - 1.5).abs() < 0.02 && (focus.rms_distance_mm - 0.125_f64.sqrt()).abs() < 0.003);
    let main = found.main_direction.unwrap();
    assert!((main.mean_cosine - 2.0 / 3.0).abs() < 6.0 * (1.0 / 18.0 / RAYS).sqrt() && main.backward_share == 0.0);
    let origins = found.origins.as_ref().unwrap();
    assert_eq!((origins.shape, origins.exact), ("plane", false));
    let flux = found.ray_flux.unwrap();
    assert!(flux.equal && (flux.effective_rays - RAYS).abs() < 1.0, "{flux:?}");
    assert!((found.noise.unwrap().of_2500_cells - (2500.0 / RAYS).sqrt()).abs() < 1e-9);
    assert_eq!(found.verdict, Verdict::Ok, "{:?}", found.checks);
}

#[test]
fn no_known_source_is_called_wrong_and_threads_do_not_matter() {
    for source in known_sources::all() {
        let bytes = known(source.name, 60_000);
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| seen(bytes.clone()))
        };
        let found = on(1);
        conforms(&found);
        assert!(found == on(3), "{}", source.name);
        assert_eq!(verdict(&found, "rays.order"), Verdict::Ok, "{}", source.name);
        assert!(found.verdict < Verdict::Wrong, "{}: {:?}", source.name, found.checks);
        let drawn = drawings(&found, "<a> & \u{1}\"b\"]]>");
        assert_eq!(drawn.len(), 2);
        for drawing in drawn {
            let text = String::from_utf8(drawing.bytes).unwrap();
            assert!(text.len() < 60_000 && text.contains("&lt;a&gt; &amp;"), "{}: {}", drawing.name, text.len());
            assert!(!text.contains("<a>") && !text.contains("NaN") && !text.contains("inf "), "{}", drawing.name);
        }
    }
}

/// A sphere of radius 10 about a small bulb of radius 1: the focus is the bulb's middle, the origins are not the bulb.
#[test]
fn a_receiver_sphere_is_told_from_an_emitter() {
    let spiral = |k: usize| {
        let (z, c) = (1.0 - (2 * (k % 20_000) + 1) as f64 / 20_000.0, 2.399_963_229_728_653 * (k % 20_000) as f64);
        DVec3::new((1.0 - z * z).sqrt() * c.cos(), (1.0 - z * z).sqrt() * c.sin(), z)
    };
    let rays: Vec<[f64; 7]> = (0..20_000)
        .map(|k| {
            let (direction, from) = (spiral(k * 7919), spiral(k * 11_003 + 77));
            let along = from.dot(direction);
            let start = from + direction * ((along * along + 99.0).sqrt() - along);
            [start.x, start.y, start.z, direction.x, direction.y, direction.z, 1.0]
        })
        .collect();
    let found = seen(zemax(4, &rays));
    conforms(&found);
    let origins = found.origins.as_ref().unwrap();
    let sphere = origins.sphere.unwrap();
    assert_eq!((origins.shape, origins.exact), ("sphere", true));
    assert!((sphere.radius_mm - 10.0).abs() < 1e-3 && sphere.share > 0.999, "{sphere:?}");
    let focus = found.focus.unwrap();
    assert!(DVec3::from_array(focus.point_mm).length() < 0.02 && focus.distance_99_mm < 1.02, "{focus:?}");
    assert_eq!(verdict(&found, "rays.origins"), Verdict::Notice);
}

/// The rays of a known source as a Zemax file has them.
fn rays() -> Vec<[f64; 7]> {
    let found = seen(known("four-chips", 20_000));
    let row = |o: DVec3, d: DVec3| [o.x, o.y, o.z, d.x, d.y, d.z, 1e-3];
    found.evidence.sample.iter().map(|ray| row(ray.origin_mm, ray.direction)).collect()
}

/// Files a job would refuse are told of nevertheless.
#[test]
fn what_is_wrong_is_said() {
    let rays = rays();
    let plain = seen(zemax(4, &rays));
    conforms(&plain);
    assert!(plain.verdict < Verdict::Wrong, "{:?}", plain.checks);
    // Directions and positions swapped.
    let swapped: Vec<[f64; 7]> = rays.iter().map(|r| [r[3], r[4], r[5], r[0], r[1], r[2], r[6]]).collect();
    let found = seen(zemax(4, &swapped));
    conforms(&found);
    assert_eq!((verdict(&found, "rays.usable"), found.verdict), (Verdict::Wrong, Verdict::Wrong));
    assert!(found.directions.worst_length_error > 0.01);
    // No flux at all: nothing can be said of rays, and that is said.
    let dark: Vec<[f64; 7]> = rays.iter().map(|r| [r[0], r[1], r[2], r[3], r[4], r[5], 0.0]).collect();
    let found = seen(zemax(4, &dark));
    conforms(&found);
    assert_eq!((found.verdict, found.rays_used, found.focus), (Verdict::Wrong, 0, None));
    assert!(drawings(&found, "dark").is_empty());
}

/// Beams through a file and all of the inspection: I = exp(-4 ln 2 (theta/w)^2) is half of its maximum at w/2, cos theta at 60 degrees.
#[test]
fn beams_have_the_width_they_were_made_with() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let mut even = || f64::from(random.next_u32()) / 4_294_967_296.0;
    for width_deg in [1.0_f64, 3.0, 10.0, 30.0] {
        let sigma = width_deg.to_radians() / (8.0 * 2.0_f64.ln()).sqrt();
        let mut rays: Vec<[f64; 7]> = Vec::new();
        while rays.len() < 60_000 {
            // A flat Gaussian, thinned out by sin theta / theta; its axis is (0, 0.6, 0.8).
            let theta = sigma * (-2.0 * (1.0 - even()).ln()).sqrt();
            let (sin, cos) = theta.sin_cos();
            if theta < 3.0 && even() * theta <= sin {
                let (side, up) = (std::f64::consts::TAU * even()).sin_cos();
                let [across, along] = [sin * up, sin * side];
                let direction = [across, 0.6 * cos + 0.8 * along, 0.8 * cos - 0.6 * along];
                rays.push([even(), even(), 0.0, direction[0], direction[1], direction[2], 1.0]);
            }
        }
        let found = seen(zemax(4, &rays));
        conforms(&found);
        let beam = found.beam.unwrap();
        for width in [beam.least_deg, beam.greatest_deg] {
            assert!((width / width_deg - 1.0).abs() < 0.05, "{width} instead of {width_deg}");
        }
        assert!((16.0 * beam.goniogram_step_deg / width_deg - 1.0).abs() < 0.06, "{beam:?}");
        assert!(DVec3::from_array(beam.axis).dot(DVec3::new(0.0, 0.6, 0.8)) > 0.9999);
        let told = found.checks.iter().find(|check| check.check == "rays.beam").unwrap();
        assert!(told.verdict == Verdict::Ok && told.message.contains(&format!("{:.3}", beam.least_deg)), "{told:?}");
    }
    let chip = seen(known("flat-chip", 50_000)).beam.unwrap();
    assert!((chip.least_deg / 120.0 - 1.0).abs() < 0.05 && chip.goniogram_step_deg == 2.5, "{chip:?}");
}

/// Origins slid 2 mm up their rays: the plane they lie on is no longer the chips'.
fn lifted(rays: &[[f64; 7]]) -> Vec<[f64; 7]> {
    let lift = |r: &[f64; 7]| {
        let t = 2.0 / r[5].max(0.05);
        [r[0] + t * r[3], r[1] + t * r[4], r[2] + t * r[5], r[3], r[4], r[5], r[6]]
    };
    rays.iter().filter(|r| r[5] > 0.3).map(lift).collect()
}

/// What users trip over, each made on purpose: the check that is meant raises a notice, which it does not for the rays as they are.
#[test]
fn what_users_trip_over_is_noticed() {
    let rays = rays();
    let mut sorted = rays.clone();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut spot = rays.clone();
    spot[77][6] = 1e-3 * rays.len() as f64;
    let beam = rays.iter().map(|r| [r[0], r[1], r[2], 0.0, 0.6, 0.8, r[6]]).collect();
    let turn =
        |(k, r): (usize, &[f64; 7])| [r[0], r[1], r[2], r[3], r[4], if k % 10 == 0 { -r[5] } else { r[5] }, r[6]];
    let back: Vec<[f64; 7]> = rays.iter().enumerate().map(turn).collect();
    let long = rays.iter().map(|r| [r[0], r[1], r[2], r[3] * 1.0005, r[4] * 1.0005, r[5] * 1.0005, r[6]]).collect();
    let few = rays[..2000].to_vec();
    let lifted = lifted(&rays);
    let backward = seen(zemax(4, &back)).main_direction.unwrap().backward_share;
    assert!((backward - 0.1).abs() < 1e-3, "{backward}");
    let plain = seen(zemax(4, &rays));
    // On a car, a lamp is metres from the origin of the file; in a building it is not a kilometre from it for each millimetre of its own.
    let away = |far: f64| {
        rays.iter().map(|ray| [ray[0] + far, ray[1], ray[2], ray[3], ray[4], ray[5], ray[6]]).collect::<Vec<_>>()
    };
    assert_eq!(verdict(&seen(zemax(4, &away(5e3))), "rays.size"), Verdict::Ok);
    let cases: [(&str, i32, Vec<[f64; 7]>); 9] = [
        ("rays.size", 4, away(1e6)),
        ("rays.order", 4, sorted),
        ("rays.ray_flux", 4, spot),
        ("rays.focus", 4, beam),
        ("rays.backward", 4, back),
        ("rays.directions", 4, long),
        ("rays.origins", 4, lifted),
        ("rays.size", 0, rays.clone()), // mm labelled as metres
        ("rays.noise", 4, few),
    ];
    for (check, unit, rays) in cases {
        let found = seen(zemax(unit, &rays));
        conforms(&found);
        assert_eq!(verdict(&found, check), Verdict::Notice, "{check}: {:?}", found.checks);
        if check != "rays.noise" {
            assert_eq!(verdict(&plain, check), Verdict::Ok, "{check}: {:?}", plain.checks);
        }
    }
}

/// OSRAM prints the virtual focus of this file; the file may be used but not redistributed.
#[test]
fn the_published_virtual_focus_is_found() {
    const FILE: &str = "../shared/rays/mu_rayfile_LERTDUW_S2WP_green_100k_20161013_IES_TM25.TM25RAY";
    let Ok(bytes) = std::fs::read(FILE) else {
        println!("left out: {FILE} is not here");
        return;
    };
    let found = seen(bytes);
    conforms(&found);
    let published = DVec3::new(-0.684, 0.836, -0.449);
    let off = (DVec3::from_array(found.focus.unwrap().point_mm) - published).abs().max_element();
    assert!(off < 0.002, "{:?}", found.focus);
    // 98 % on the plane z = 0.02 mm, the rest on the sides of a box.
    let origins = found.origins.as_ref().unwrap();
    let plane = origins.plane.unwrap();
    assert!((plane.share - 0.98).abs() < 0.01 && (plane.offset_mm.abs() - 0.02).abs() < 1e-6, "{plane:?}");
    assert_eq!((origins.shape, verdict(&found, "rays.order")), ("box", Verdict::Ok));
    assert_eq!(verdict(&found, "rays.origins"), Verdict::Notice);
}

/// What an inspection warns of, and by which code a run tells it; codes of its own where reading tells it.
fn told_as(check: &str) -> &[&str] {
    match check {
        "rays.size" => &["rays.unlikely_size"],
        "rays.total" => &["rays.total_ratio"],
        "rays.efficacy" => &["rays.efficacy_differs"],
        "rays.directions" => &["rays.direction_normalized"],
        "rays.usable" => &["rays.flux_zero"],
        _ => &[],
    }
}

fn as_input(name: &str, bytes: Vec<u8>, declared: Declared) -> Input {
    Input { name: name.into(), sha256: digest(&bytes).unwrap(), bytes: Arc::new(bytes), declared, notices: Vec::new() }
}

/// `(code, channel)` of every notice of a run, which report.json and README.txt tell too.
fn told(inputs: &[Input]) -> Vec<(String, Option<String>)> {
    let outcome = run(inputs, &Options::default(), &Limits::default(), &NoProgress).unwrap();
    let file = |name: &str| {
        let artifact = outcome.artifacts.iter().find(|artifact| artifact.name == name).unwrap();
        String::from_utf8(artifact.bytes.clone()).unwrap()
    };
    let report: Value = serde_json::from_str(&file("report.json")).unwrap();
    assert_eq!(report["notices"], serde_json::to_value(&outcome.notices).unwrap());
    let page = file("README.txt");
    let words: Vec<&str> = page.split_whitespace().collect();
    for notice in &outcome.notices {
        let sentence: Vec<&str> = notice.message.split_whitespace().collect();
        assert!(words.windows(sentence.len()).any(|window| window == sentence), "{}: {page}", notice.code);
    }
    outcome.notices.iter().map(|notice| (notice.code.to_string(), notice.channel.clone())).collect()
}

/// A user who never looks at the inspection is warned by the model all the same: of each channel, once, by its name.
#[test]
fn a_run_tells_what_an_inspection_warns_of() {
    let rays = rays();
    let mut sorted = rays.clone();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut spot = rays.clone();
    spot[77][6] = 1e-3 * rays.len() as f64;
    let long: Vec<[f64; 7]> =
        rays.iter().map(|r| [r[0], r[1], r[2], r[3] * 1.0005, r[4] * 1.0005, r[5] * 1.0005, r[6]]).collect();
    let mut dark = rays.clone();
    dark[5][6] = 0.0;
    let lifted = lifted(&rays);
    let cases: [(i32, &[[f64; 7]]); 7] =
        [(4, &rays), (4, &sorted), (4, &spot), (4, &long), (4, &dark), (4, &lifted), (0, &rays)];
    for (unit, rays) in cases {
        let bytes = zemax(unit, rays);
        let found = seen(bytes.clone());
        let notices = told(&[as_input("led", bytes, Declared::default())]);
        for check in found.checks.iter().filter(|check| check.verdict > Verdict::Ok) {
            let is = |code: &str| code == check.check || told_as(check.check).contains(&code);
            let times = notices.iter().filter(|(code, of)| is(code) && of.as_deref() == Some("led")).count();
            assert_eq!(times, 1, "{}: {notices:?}", check.check);
        }
        for check in found.checks.iter().filter(|check| check.verdict == Verdict::Ok) {
            assert!(!notices.iter().any(|(code, _)| code == check.check), "{}: {notices:?}", check.check);
        }
    }
    // Two channels, also of the same name: each is warned of. What a declaration has answered is not.
    let named =
        |name: &str, spectrum: Option<Table>| Declared { name: Some(name.into()), spectrum, ..Declared::default() };
    let line = || Table::new(&[(550.0, 1.0)]);
    let (first, second) = (zemax(4, &sorted), zemax(4, &lifted));
    let channels = [as_input("a", first, named("blue", line())), as_input("b", second, named("blue", line()))];
    let notices = told(&channels);
    let of = |wanted: &str| notices.iter().filter(|(code, of)| code == wanted && of.as_deref() == Some("blue")).count();
    assert_eq!((of("rays.order"), of("rays.origins"), of("rays.spectrum")), (1, 1, 0), "{notices:?}");
    let both = told(&[
        as_input("a", zemax(4, &sorted), named("blue", line())),
        as_input(
            "b",
            zemax(4, &sorted.iter().map(|r| [r[0] + 9.0, r[1], r[2], r[3], r[4], r[5], r[6]]).collect::<Vec<_>>()),
            named("blue", line()),
        ),
    ]);
    assert_eq!(both.iter().filter(|(code, _)| code == "rays.order").count(), 2, "{both:?}");
}

/// The LED whose origins were moved: its model says so.
#[test]
fn a_model_of_a_real_led_says_that_the_origins_are_not_the_emitter() {
    let name = "mu_rayfile_LERTDUW_S2WP_green_100k_20161013_IES_TM25.TM25RAY";
    let Some(bytes) = crate::real_files::real(name) else { return };
    let outcome =
        run(&[as_input(name, bytes, Declared::default())], &Options::default(), &Limits::default(), &NoProgress)
            .unwrap();
    let notice = outcome.notices.iter().find(|notice| notice.code == "rays.origins").unwrap();
    for part in ["are on one plane", "the origins are not the emitter", "virtual focus", "blurred near the source"] {
        assert!(notice.message.contains(part), "{part}: {}", notice.message);
    }
    assert_eq!(notice.channel.as_deref(), Some(name));
}
