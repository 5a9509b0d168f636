//! Real files from other programs (`../shared/rays`, never committed) and sources made of several of our own.

use lampwright::pipeline::rays::source::Columns;
use lampwright::pipeline::rays::{Options, Ray, Source, digest, read};
use lampwright::pipeline::vocabulary::watch::StageWatch;
use lampwright::pipeline::{Error, Input, Limits, Stage, Unwatched};
use std::path::PathBuf;
use std::sync::Arc;

/// A real file, or `None` (said aloud) where the folder is missing.
fn real(name: &str) -> Option<Vec<u8>> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/rays").join(name);
    let bytes = std::fs::read(&path).ok();
    if bytes.is_none() {
        println!("LEFT OUT: {} is not here", path.display());
    }
    bytes
}

fn input(bytes: Vec<u8>) -> Input {
    Input { name: "test".into(), sha256: digest(&bytes).unwrap(), bytes: Arc::new(bytes) }
}

fn read_with(inputs: &[Input], options: &Options) -> Result<Source, Error> {
    read(inputs, options, &Limits::default(), StageWatch::enter(&Unwatched, Stage::Rays)?)
}

fn read_all(files: Vec<Vec<u8>>) -> Result<Source, Error> {
    read_with(&files.into_iter().map(input).collect::<Vec<_>>(), &Options::default())
}

/// Rays seen and sums of W and lm of one pass.
fn sums(source: &Source) -> (u64, f64, f64) {
    let watch = StageWatch::enter(&Unwatched, Stage::Flux).unwrap();
    source
        .fold(
            watch,
            (0, 0.0, 0.0),
            |rays| {
                let sum = |of: fn(&Ray) -> f64| rays.iter().map(of).sum::<f64>();
                Ok((rays.len() as u64, sum(|ray| ray.radiant_w), sum(|ray| ray.luminous_lm)))
            },
            |total, part| *total = (total.0 + part.0, total.1 + part.1, total.2 + part.2),
        )
        .unwrap()
}

fn close(a: f64, b: f64, relative: f64) -> bool {
    (a - b).abs() <= relative * b.abs()
}

/// Totals of the vendor's data sheet and header: 337 lm, 0.6938 W.
#[test]
fn osram_green_has_both_totals_of_its_header() {
    let Some(bytes) = real("mu_rayfile_LERTDUW_S2WP_green_100k_20161013_IES_TM25.TM25RAY") else { return };
    let source = read_all(vec![bytes]).unwrap();
    let (count, watt, lumen) = sums(&source);
    assert_eq!(count, 100_000);
    assert!(close(lumen, 337.0, 1e-9) && close(watt, 0.6938, 1e-4), "{lumen} lm {watt} W");
    assert!(close(source.flux.luminous_lm.unwrap(), 337.0, 1e-9));
    assert_eq!(source.channels[0].facts().texts[0].1, "2013");
    assert!(matches!(&source.spectral.columns, Columns::Tables { shares } if shares.len() == 1));
    // `INDEX.md`: 98 % of the origins lie on z = 0.02 mm; nothing shines below the package.
    assert!(source.survey.bounds_mm.max.z > 0.0199 && source.survey.directions.hemispheres()[0] > 0.9);
}

#[test]
fn lighttools_export_is_scaled_to_its_header() {
    let Some(bytes) = real("mu_Cyl10k.1.tm25ray") else { return };
    let source = read_all(vec![bytes]).unwrap();
    let (count, _, lumen) = sums(&source);
    assert_eq!((count, source.flux.radiant_w), (10_000, None));
    assert!(close(lumen, 1.0, 1e-12), "{lumen}");
    assert!(close(source.survey.luminous_sum, 10_000.0, 1e-6));
    assert_eq!(source.notices.count_of("rays.total_ratio"), 1);
    // `INDEX.md`: all origins on a sphere of radius 10 about (0, 0, 10).
    assert!(source.survey.bounds_mm.size().max_element() < 20.001);
}

#[test]
fn zemax_files_sum_their_rays() {
    let cases = [
        ("zemax_omnistic_binary_source.dat", 1, Some(1.0), 1),
        ("ansys_test_08_dat.DAT", 11, Some(11.0), 1),
        ("ansys_test_08_ray_reference.sdf", 11, Some(11.0), 0),
        ("mu_ThreeRays_Wavelength_ZMX.ray", 3, Some(0.009_319_803), 0),
    ];
    for (name, count, watt, header_wavelength) in cases {
        let Some(bytes) = real(name) else { return };
        let source = read_all(vec![bytes]).unwrap();
        let (used, radiant, _) = sums(&source);
        assert_eq!(used, count, "{name}");
        assert!(close(radiant, watt.unwrap(), 1e-6), "{name}: {radiant}");
        assert_eq!(source.notices.count_of("zemax.header_wavelength"), header_wavelength, "{name}");
    }
    let Some(lumens) = real("ansys_test_08_dat_flux_type_1.dat") else { return };
    let source = read_all(vec![lumens]).unwrap();
    assert!(close(source.flux.luminous_lm.unwrap(), 0.0015, 1e-6));
    let Some(swapped) = real("ansys_test_08_sdf.sdf") else { return };
    assert_eq!(read_all(vec![swapped]).unwrap().notices.count_of("zemax.swapped_columns"), 1);
}

#[test]
fn formats_not_read_are_named() {
    let cases = [
        ("mu_Cyl10k.1.ray", "detect.lighttools_text"),
        ("mu_ThreeRays_Wavelength.1.ray", "detect.lighttools"),
        ("speos_pyspeos_Rays.ray", "detect.speos"),
        ("mu_ZemaxText.txt", "detect.text"),
        ("mu_VirtualFocus.pdf", "detect.unknown"),
    ];
    for (name, code) in cases {
        let Some(bytes) = real(name) else { return };
        assert_eq!(read_all(vec![bytes]).err().unwrap().code(), code, "{name}");
    }
}
