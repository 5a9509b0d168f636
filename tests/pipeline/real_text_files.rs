//! Real text ray files from other programs (`../shared/rays`, never committed; left out aloud where the folder is missing).
#![expect(clippy::unwrap_used, reason = "clippy.toml allows it in #[test] functions only, and these are their tools")]

use lampwright::pipeline::rays::{RawRay, open};
use lampwright::pipeline::{
    Declared, Format, Input, Inspection, LengthUnit, Limits, Options, Outcome, Unwatched, inspect, run,
};
use std::path::PathBuf;
use std::sync::Arc;

/// A file under a name and digest that say nothing, so that two containers can give the same bytes.
fn real(name: &str) -> Option<Input> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/rays").join(name);
    let Ok(bytes) = std::fs::read(&path) else {
        println!("LEFT OUT: {} is not here", path.display());
        return None;
    };
    let (name, sha256) = ("container".into(), "0".repeat(64));
    Some(Input { name, sha256, bytes: Arc::new(bytes), declared: Declared::default() })
}

fn unit(input: &Input) -> Option<LengthUnit> {
    open(Arc::clone(&input.bytes), &Declared::default(), &Limits::default()).unwrap().facts.length_unit
}

fn codes(inspection: &Inspection) -> Vec<&str> {
    inspection.notices.iter().map(|notice| notice.code).collect()
}

/// Format, rays, unit: `INDEX.md`. Sums and boxes: awk over the same files.
#[test]
fn what_the_index_says_is_found() {
    use LengthUnit::{Centimetre, Millimetre};
    let three = ([-0.6668399, -0.6670539, 0.0001], [0.6666667, 0.8334215, 0.0001]);
    let cylinder = ([-9.998978, -9.999973, 0.03076709], [9.999976, 9.996271, 19.97654]);
    let nine = ([-15.03922, -15.77001, 0.0], [9.922475, 14.27664, 0.0]);
    let wide = (nine.0.map(|value: f64| 10.0 * value), nine.1.map(|value: f64| 10.0 * value));
    let (ratio, none): (&[&str], &[&str]) = (&["rays.total_ratio"], &[]);
    let cases = [
        ("mu_Cyl10k.1.ray", Format::LightToolsText, 10_000, Millimetre, [None, Some(1.0)], cylinder, ratio),
        (
            "mu_ThreeRays_Wavelength.1.txt",
            Format::LightToolsText,
            3,
            Millimetre,
            [Some(0.003106601), None],
            three,
            ratio,
        ),
        ("mu_ZemaxText.txt", Format::ZemaxText, 9, Millimetre, [Some(138.865937), None], nine, none),
        (
            "mu_ZemaxWavelengthText.txt",
            Format::ZemaxText,
            9,
            Centimetre,
            [Some(138.865937), None],
            wide,
            &["text.unterminated"][..],
        ),
    ];
    for (name, format, rays, length_unit, [watt, lumen], (min, max), notices) in cases {
        let Some(input) = real(name) else { return };
        let found = inspect(&input, &Limits::default(), &Unwatched).unwrap();
        assert_eq!((found.header.format, found.rays_used, unit(&input)), (format, rays, Some(length_unit)), "{name}");
        assert_eq!(codes(&found), notices, "{name}");
        let near = |found: Option<f64>, told: f64| found.is_some_and(|found| (found / told - 1.0).abs() < 1e-9);
        assert!(watt.is_none_or(|told| near(found.flux.radiant_w, told)), "{name}: {:?}", found.flux);
        assert!(lumen.is_none_or(|told| near(found.flux.luminous_lm, told)), "{name}: {:?}", found.flux);
        for (found, told) in [(found.origins_mm.unwrap().min, min), (found.origins_mm.unwrap().max, max)] {
            assert!(found.iter().zip(told).all(|(found, told)| (found - told).abs() < 1e-9), "{name}: {found:?}");
        }
    }
}

fn model(name: &str) -> Option<Outcome> {
    Some(run(&[real(name)?], &Options::default(), &Limits::default(), &Unwatched).unwrap())
}

/// Largest distance of two hulls' vertices, mm, and largest difference of their total intensities over the peak, the second
/// model's taken times `factor`. Surfaces must be the same triangles of the same vertices.
fn difference(a: &Outcome, b: &Outcome, factor: f64) -> (f64, f64) {
    assert_eq!(a.model.hull.triangles, b.model.hull.triangles);
    let vertices = a.model.hull.vertices_mm.iter().zip(&b.model.hull.vertices_mm);
    let distance = vertices.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    let intensity = |outcome: &Outcome| outcome.model.goniograms.total.luminous_cd.clone().unwrap();
    let (a, b) = (intensity(a), intensity(b));
    let peak = a.iter().copied().fold(0.0, f64::max);
    let apart = a.iter().zip(&b).map(|(a, b)| (a - factor * b).abs()).fold(0.0, f64::max);
    (distance, apart / peak)
}

/// The same 10 000 rays as text and as TM-25. The bytes differ because the text has 7 digits and TM-25 has binary32: positions
/// up to 20 mm are rounded by 5e-6 mm in one and 1e-6 mm in the other, fluxes by 5e-7 of themselves. What is printed with fewer
/// digits, as in the plots, is the same byte for byte.
#[test]
fn cylinder_as_text_and_as_tm25_is_one_model() {
    let (Some(text), Some(tm25)) = (model("mu_Cyl10k.1.ray"), model("mu_Cyl10k.1.tm25ray")) else { return };
    let (distance_mm, intensity) = difference(&text, &tm25, 1.0);
    println!("Cyl10k: vertices within {distance_mm:.2e} mm, intensities within {intensity:.2e} of the peak");
    assert!(distance_mm <= 2e-5 && intensity <= 1e-6, "{distance_mm} {intensity}");
    assert!((text.model.flux.luminous_lm.unwrap() - 1.0).abs() < 1e-12);
    assert!((tm25.model.flux.luminous_lm.unwrap() - 1.0).abs() < 1e-12);
    let same = |name: &str| {
        let bytes = |outcome: &Outcome| outcome.artifacts.iter().find(|file| file.name == name).unwrap().bytes.clone();
        bytes(&text) == bytes(&tm25)
    };
    for name in ["README.txt", "plots/polar_total.svg", "plots/hull_stage.svg", "plots/hull_exitance.svg"] {
        assert!(same(name), "{name}");
    }
    assert!(!same("report.json"), "the report names the format");
}

/// The same three rays as LightTools text, LightTools binary and Zemax binary. LightTools' total is its header's, Zemax' the sum
/// of the rays, which is three times that (`FORMATS.md` 2, 3).
#[test]
fn three_rays_are_the_same_in_every_container() {
    let Some(input) = real("mu_ThreeRays_Wavelength.1.txt") else { return };
    let Some(binary) = real("mu_ThreeRays_Wavelength.1.ray") else { return };
    let set = open(Arc::clone(&input.bytes), &Declared::default(), &Limits::default()).unwrap();
    let mut rays: Vec<RawRay> = Vec::new();
    set.records.read(0, 3, &mut rays).unwrap();
    // The binary by the table of FORMATS.md 3: 44 bytes of header, then binary32.
    let mut block = vec![0; 3 * 32];
    binary.bytes.read_at(44, &mut block).unwrap();
    for (ray, record) in rays.iter().zip(block.chunks(32)) {
        let stored: Vec<f64> =
            record.chunks(4).map(|word| f64::from(f32::from_le_bytes(word.try_into().unwrap()))).collect();
        let read = [ray.origin_mm, ray.direction].concat().into_iter().chain([ray.radiant, ray.wavelength_nm]);
        for (read, stored) in read.zip(stored) {
            assert!((read - stored).abs() <= 5e-7 * stored.abs(), "{read} {stored}");
        }
    }
    let (Some(text), Some(zemax)) = (model("mu_ThreeRays_Wavelength.1.txt"), model("mu_ThreeRays_Wavelength_ZMX.ray"))
    else {
        return;
    };
    let (distance_mm, intensity) = difference(&text, &zemax, 1.0 / 3.0);
    println!("ThreeRays: vertices within {distance_mm:.2e} mm, intensities within {intensity:.2e} of the peak");
    assert!(distance_mm <= 1e-6 && intensity <= 1e-6, "{distance_mm} {intensity}");
}
