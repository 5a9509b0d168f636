//! What strangers send, through the whole pipeline: an error that says what and where, or a model with notices. Never a panic.

use pipeline::known_sources::{by_name, write_tm25};
use pipeline::source::Source;
use pipeline::vocabulary::watch::StageWatch;
use pipeline::{Declared, Error, Input, Limits, NoProgress, Options, Outcome, Stage, run};
use std::collections::BTreeSet;
use std::sync::Arc;

/// First ray of a file without tables (pipeline/formats/README.md 1).
const RAY_START: usize = 36_288;

fn input(bytes: Vec<u8>) -> Input {
    Input {
        name: "bad".into(),
        sha256: "0".repeat(64),
        bytes: Arc::new(bytes),
        declared: Declared::default(),
        notices: Vec::new(),
    }
}

fn build(bytes: Vec<u8>) -> Result<Outcome, Error> {
    run(&[input(bytes)], &Options::default(), &Limits::default(), &NoProgress)
}

fn read(bytes: Vec<u8>) -> Result<Source, Error> {
    let watch = StageWatch::enter(&NoProgress, Stage::Rays)?;
    Source::read(&[input(bytes)], &Options::default().rays, &Limits::default(), watch)
}

fn sample(name: &str, rays: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_tm25(&by_name(name).unwrap(), rays, 3, &mut bytes).unwrap();
    bytes
}

/// A TM-25 file of four-chips: no tables, 32-byte records x y z kx ky kz W nm.
fn with_rays(rays: &[[f32; 8]]) -> Vec<u8> {
    let mut bytes = sample("four-chips", 1);
    bytes.truncate(RAY_START);
    bytes[20..28].copy_from_slice(&(rays.len() as u64).to_le_bytes());
    rays.iter().flatten().for_each(|value| bytes.extend(value.to_le_bytes()));
    bytes
}

fn up(x: f32, y: f32, z: f32) -> [f32; 8] {
    [x, y, z, 0.0, 0.0, 1.0, 1.0, 500.0]
}

fn code(bytes: Vec<u8>) -> &'static str {
    let error = build(bytes).unwrap_err();
    assert!(!matches!(error, Error::Unreadable(_)), "{error}");
    assert!(error.to_string().len() > 30, "says what was found and what to do: {error}");
    error.code()
}

#[test]
fn the_fixture_is_what_the_tests_think() {
    let outcome = build(with_rays(&[up(0.0, 0.0, 0.0), up(1.0, 1.0, 0.0), up(0.0, 1.0, 0.0)])).unwrap();
    assert_eq!(outcome.model.origins[0].rays_used, 3);
}

#[test]
fn headers_that_lie_are_refused_without_large_allocations() {
    let honest = sample("four-chips", 10);
    for claim in [0u64, 1, 9, 11, 1 << 33, 10_000_000_000, u64::MAX / 32, u64::MAX] {
        let mut bytes = honest.clone();
        bytes[20..28].copy_from_slice(&claim.to_le_bytes());
        assert!(build(bytes).is_err(), "a claim of {claim} rays passed");
    }
    // Every i32 field of the header, with hostile numbers: refused or read, never a panic or a hang. Of those that are read as the same source
    // one is built.
    let mut seen = BTreeSet::new();
    for field in (4..88).step_by(4).chain((256..288).step_by(4)) {
        for value in [-1i32, 0, 1, 2, 7, i32::MAX, i32::MIN] {
            let mut bytes = honest.clone();
            bytes[field..field + 4].copy_from_slice(&value.to_le_bytes());
            let read = read(bytes.clone()).map(|source| {
                let told: Vec<_> = source.notices.to_vec().into_iter().map(|notice| notice.code).collect();
                format!("{:?} {:?} {:?} {told:?}", source.flux, source.survey.bounds_mm, source.spectral)
            });
            if read.is_ok_and(|source| seen.insert(source)) {
                let _ = build(bytes);
            }
        }
    }
}

#[test]
fn things_that_are_no_ray_files_are_named() {
    assert_eq!(code(Vec::new()), "detect.empty");
    for bytes in
        [&b"TM26"[..], b"PK\x03\x04zip", b"\x1f\x8bgzip", b"version https://git-lfs.github.com/spec/v1\n", &[0; 100]]
    {
        assert!(code(bytes.to_vec()).starts_with("detect."), "{bytes:?}");
    }
}

#[test]
fn rays_that_are_no_rays_are_refused_one_by_one_or_with_the_file() {
    let good: Vec<[f32; 8]> = (0..1000).map(|k| up((k % 32) as f32, (k / 32) as f32, 0.0)).collect();
    let broken = |ray: [f32; 8]| {
        let mut rays = good.clone();
        rays[500] = ray;
        rays
    };
    for bad in [
        [f32::NAN, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 500.0],
        [0.0, 0.0, f32::INFINITY, 0.0, 0.0, 1.0, 1.0, 500.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 500.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, -1.0, 500.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, f32::NAN, 500.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 500.0],
    ] {
        let model = build(with_rays(&broken(bad))).unwrap().model;
        assert_eq!(model.origins[0].rays_used, 999, "{bad:?}");
        let told = model.notices.iter().find(|notice| notice.first_ray == Some(500));
        assert!(told.is_some_and(|notice| notice.count == 1), "{bad:?}: {:?}", model.notices);
        // All of them so: the file is refused.
        assert!(code(with_rays(&vec![bad; 1000])).starts_with("rays."), "{bad:?}");
    }
    assert!(code(with_rays(&[])).starts_with("rays."));
}

#[test]
fn few_rays_and_points_and_lines_still_make_a_model() {
    let point = vec![up(3.0, 4.0, 5.0); 1000];
    let one = vec![up(0.1, 0.2, 0.3)];
    let two = vec![up(0.0, 0.0, 0.0), up(1.0, 2.0, 3.0)];
    let line: Vec<[f32; 8]> = (0..1000).map(|k| up(k as f32 * 0.01, 0.0, 0.0)).collect();
    let far = vec![up(1e9, -1e9, 1e9), up(1.1e9, -1e9, 1e9), up(1e9, -1.1e9, 1e9)];
    let tiny: Vec<[f32; 8]> = (0..100).map(|k| up(1e-12 * (k % 10) as f32, 1e-12 * (k / 10) as f32, 0.0)).collect();
    for (name, rays) in [("point", point), ("one", one), ("two", two), ("line", line), ("far", far), ("tiny", tiny)] {
        let model = build(with_rays(&rays)).unwrap_or_else(|error| panic!("{name}: {error}")).model;
        let balance = &model.surface.balance;
        assert!(balance.every_ray_once() && balance.error() < 1e-6, "{name}: {balance:?}");
        assert_eq!(balance.rejected.rays, 0, "{name}");
        assert_eq!(model.hull.check(), [], "{name}");
    }
}

/// Infrared has watts and a spectrum, and is known to have no lumens: a model without IES files, not an error.
#[test]
fn invisible_light_makes_a_model_too() {
    let infrared = |k: usize| [(k % 40) as f32, (k / 40) as f32, 0.0, 0.0, 0.0, 1.0, 1.0, 935.0 + (k % 10) as f32];
    let outcome = build(with_rays(&(0..1600).map(infrared).collect::<Vec<_>>())).unwrap();
    assert_eq!(outcome.model.flux.luminous_lm, Some(0.0));
    // The header's 1 W in 935..945 nm.
    let spectrum = &outcome.model.goniograms.total.spectral_flux_w_per_nm;
    let widths = outcome.model.spectral.bands.widths_nm();
    let total = outcome.model.flux.radiant_w.unwrap();
    let watt: f64 = spectrum.iter().zip(widths).map(|(w_per_nm, nm)| w_per_nm * nm).sum();
    assert!((watt / total - 1.0).abs() < 1e-9, "{watt} of {total} W in the bands");
    assert!(outcome.notices.iter().any(|notice| notice.code == "artifacts.no_ies"));
    assert!(outcome.artifacts.iter().all(|artifact| !artifact.name.ends_with(".ies")));
    assert!(outcome.artifacts.iter().any(|artifact| artifact.name == "emitter.glb"));
}
