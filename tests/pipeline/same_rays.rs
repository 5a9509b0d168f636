//! The same rays in several containers are the same rays and the same model, or what differs is explained.
#![expect(clippy::unwrap_used, reason = "clippy.toml allows it in #[test] functions only, and these are their tools")]

use crate::real_files::real;
use pipeline::formats::record::RawRay;
use pipeline::rays::declared::open;
use pipeline::{Declared, Input, Limits, NoProgress, Options, Outcome, run};
use std::sync::Arc;

fn rays(name: &str) -> Option<Vec<RawRay>> {
    let set = open(Arc::new(real(name)?), &Declared::default(), &Limits::default()).unwrap();
    let mut rays = Vec::new();
    set.records.read(0, set.facts.ray_count as usize, &mut rays).unwrap();
    Some(rays)
}

/// The model of a file under a name and digest that say nothing, so that two containers can give the same bytes.
fn model(name: &str) -> Option<Outcome> {
    let (name, sha256, bytes) = ("container".into(), "0".repeat(64), Arc::new(real(name)?));
    let input = Input { name, sha256, bytes, declared: Declared::default(), notices: Vec::new() };
    Some(run(&[input], &Options::default(), &Limits::default(), &NoProgress).unwrap())
}

/// The same rays in two containers are the same rays: places, directions, wavelengths.
#[test]
fn a_container_changes_no_ray() {
    let pairs = [
        ("mu_ThreeRays_Wavelength.1.ray", "mu_ThreeRays_Wavelength_ZMX.ray", true),
        ("mu_ThreeRays_PowerOnly.1.ray", "mu_ThreeRays_Wavelength.1.ray", false),
        ("ansys_test_08_ray.ray", "ansys_test_08_ray_reference.sdf", true),
        ("ansys_test_08_dat.DAT", "ansys_test_08_dat_reference.ray", false),
    ];
    for (one, other, spectral) in pairs {
        let (Some(a), Some(b)) = (rays(one), rays(other)) else { return };
        assert_eq!(a.len(), b.len());
        for (a, b) in a.iter().zip(&b) {
            assert_eq!((a.origin_mm, a.direction), (b.origin_mm, b.direction), "{one}");
            // nm and um in f32 differ in the seventh digit.
            assert!(!spectral || (a.wavelength_nm - b.wavelength_nm).abs() < 1e-4, "{one}: {a:?} {b:?}");
        }
    }
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
/// digits, as in the plots, is the same byte for byte; but for the proof, whose rays are drawn by their lines' last digits.
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
    let lines = |outcome: &Outcome| {
        let readme = outcome.artifacts.iter().find(|file| file.name == "README.txt").unwrap();
        let text = String::from_utf8(readme.bytes.clone()).unwrap();
        let of_proof =
            |line: &str| [" %", "A model like this one", " other rays."].iter().any(|part| line.contains(part));
        text.lines().filter(|line| !of_proof(line)).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(lines(&text), lines(&tm25));
    for name in ["plots/polar_total.svg", "plots/hull_stage.svg", "plots/hull_exitance.svg"] {
        assert!(same(name), "{name}");
    }
    assert!(!same("report.json"), "the report names the format");
}

/// The same three rays as LightTools text, LightTools binary and Zemax binary. LightTools' total is its header's, Zemax' the sum
/// of the rays, which is three times that (`pipeline/formats/README.md` 2, 3).
#[test]
fn three_rays_are_the_same_in_every_container() {
    let Some(rays) = rays("mu_ThreeRays_Wavelength.1.txt") else { return };
    let Some(binary) = real("mu_ThreeRays_Wavelength.1.ray") else { return };
    // The binary by the table of pipeline/formats/README.md 3: 44 bytes of header, then binary32.
    for (ray, record) in rays.iter().zip(binary[44..].chunks(32)) {
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
