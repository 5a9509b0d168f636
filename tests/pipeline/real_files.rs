//! Real ray files of other programs against what is written of them (`INDEX.md` beside them). They may not be redistributed
//! and are not in this repository: where `../shared/rays` is missing, these tests say so and are left out.
#![expect(clippy::unwrap_used, reason = "clippy.toml allows it in #[test] functions only, and these are their tools")]

use lampwright::pipeline::rays::{RawRay, digest, open};
use lampwright::pipeline::{Declared, Format, Input, Inspection, LengthUnit, Limits, Unwatched, inspect};
use std::path::PathBuf;
use std::sync::Arc;

/// A total of the used rays.
#[derive(Clone, Copy)]
enum Total {
    /// Neither the file nor a spectrum gives it.
    Unknown,
    /// Known by a conversion nobody has published a figure of.
    Known,
    /// As published, with the relative error of the figure.
    Is(f64, f64),
}

use Total::{Is, Known, Unknown};

/// What is known of one file.
struct Row {
    name: &'static str,
    format: Format,
    rays: u64,
    watt: Total,
    lumen: Total,
    unit: Option<LengthUnit>,
    /// Smallest and largest coordinates of the origins, mm.
    extent_mm: Option<([f64; 3], [f64; 3])>,
    notices: &'static [&'static str],
}

const MM: Option<LengthUnit> = Some(LengthUnit::Millimetre);
const RATIO: &str = "rays.total_ratio";
const LINE: &str = "zemax.header_wavelength";
/// V(550 nm) = 0.99495 (CIE 1924) times 683 lm/W.
const LM_PER_W_550: f64 = 679.55;
/// Rays along y from -5 to 5 (the bytes of ansys_test_08_*).
const ROW_OF_11: Option<([f64; 3], [f64; 3])> = Some(([0.0, -5.0, 0.0], [0.0, 5.0, 0.0]));

#[rustfmt::skip]
fn rows() -> Vec<Row> {
    use Format::{LightToolsBinary, Speos, Tm25, ZemaxBinary};
    let row = |name, format, rays, watt, lumen, unit, extent_mm, notices| {
        Row { name, format, rays, watt, lumen, unit, extent_mm, notices }
    };
    let filament = Some(([-0.4, -3.0, 31.35], [0.4, 3.0, 32.15]));
    let (eleven, one) = (LM_PER_W_550 * 11.0, LM_PER_W_550);
    vec![
        row("mu_rayfile_LERTDUW_S2WP_green_100k_20161013_IES_TM25.TM25RAY", Tm25, 100_000, Is(0.6938, 1e-4), Is(337.0, 1e-6), MM, None, &[]),
        row("mu_Cyl10k.1.tm25ray", Tm25, 10_000, Unknown, Is(1.0, 1e-6), MM, None, &[RATIO]),
        row("speos_pyspeos_Rays.ray", Speos, 45_462, Is(4.018, 1e-3), Is(450.08, 1e-3), MM, filament, &[RATIO]),
        row("speos_pyspeos_RaysWithoutSpectralData.RAY", LightToolsBinary, 113, Unknown, Is(55.0, 1e-6), MM, None, &["lighttools.cut", RATIO]),
        row("mu_ThreeRays_PowerOnly.1.ray", LightToolsBinary, 3, Is(0.003_106_6, 1e-5), Unknown, MM, None, &[RATIO]),
        row("mu_ThreeRays_Wavelength.1.ray", LightToolsBinary, 3, Is(0.003_106_6, 1e-5), Known, MM, None, &[RATIO]),
        // Zemax sums its rays, LightTools takes the header's total: three times as much.
        row("mu_ThreeRays_Wavelength_ZMX.ray", ZemaxBinary, 3, Is(3.0 * 0.003_106_6, 1e-5), Known, MM, None, &[RATIO]),
        row("ansys_test_08_ray.ray", Speos, 11, Is(1.0, 1e-6), Is(one, 1e-4), MM, ROW_OF_11, &[RATIO]),
        row("ansys_test_08_dat_reference.ray", Speos, 11, Is(1.0, 1e-6), Is(one, 1e-4), MM, ROW_OF_11, &[RATIO]),
        row("ansys_test_08_ray_reference.sdf", ZemaxBinary, 11, Is(11.0, 1e-6), Is(eleven, 1e-4), MM, ROW_OF_11, &[RATIO]),
        row("ansys_test_08_dat.DAT", ZemaxBinary, 11, Is(11.0, 1e-6), Is(eleven, 1e-4), MM, ROW_OF_11, &[RATIO, LINE]),
        row("ansys_test_08_sdf.sdf", ZemaxBinary, 11, Known, Known, MM, ROW_OF_11, &[RATIO, "zemax.swapped_columns"]),
        row("ansys_test_08_dat_flux_type_1.dat", ZemaxBinary, 1, Is(0.0015 / one, 1e-4), Is(0.0015, 1e-6), MM, Some(([1.0; 3], [1.0; 3])), &[LINE]),
        row("zemax_omnistic_binary_source.dat", ZemaxBinary, 1, Is(1.0, 1e-6), Known, Some(LengthUnit::Metre), Some(([0.0; 3], [0.0; 3])), &[LINE]),
    ]
}

/// A real file, or `None`, said aloud, where the folder is missing. A folder without the file is a failure.
fn real(name: &str) -> Option<Arc<Vec<u8>>> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/rays");
    if !folder.is_dir() {
        println!("LEFT OUT: {name}, because {} is not here", folder.display());
        return None;
    }
    Some(Arc::new(std::fs::read(folder.join(name)).unwrap()))
}

fn inspected(name: &str, bytes: &Arc<Vec<u8>>) -> Inspection {
    let sha256 = digest(bytes.as_ref()).unwrap();
    let input = Input { name: name.into(), sha256, bytes: Arc::<Vec<u8>>::clone(bytes), declared: Declared::default() };
    inspect(&input, &Limits::default(), &Unwatched).unwrap()
}

fn rays(bytes: &Arc<Vec<u8>>) -> Vec<RawRay> {
    let set = open(Arc::<Vec<u8>>::clone(bytes), &Declared::default(), &Limits::default()).unwrap();
    let mut rays = Vec::new();
    set.records.read(0, set.facts.ray_count as usize, &mut rays).unwrap();
    rays
}

fn assert_total(name: &str, found: Option<f64>, expected: Total) {
    let holds = match expected {
        Unknown => found.is_none(),
        Known => found.is_some(),
        Is(value, error) => found.is_some_and(|found| (found - value).abs() <= error * value),
    };
    assert!(holds, "{name}: {found:?}");
}

#[test]
fn every_file_is_what_is_written_of_it() {
    for row in rows() {
        let Some(bytes) = real(row.name) else { continue };
        let seen = inspected(row.name, &bytes);
        let name = row.name;
        println!("{name}: {:?} {} {:?} {:?}", seen.header.format, seen.rays_used, seen.flux, seen.origins_mm);
        assert_eq!((seen.header.format, seen.header.ray_count), (row.format, row.rays), "{name}");
        assert_eq!((seen.rays_used, seen.rays_refused, seen.rays_dropped), (row.rays, 0, 0), "{name}");
        assert_total(name, seen.flux.radiant_w, row.watt);
        assert_total(name, seen.flux.luminous_lm, row.lumen);
        let set = open(Arc::<Vec<u8>>::clone(&bytes), &Declared::default(), &Limits::default()).unwrap();
        assert_eq!(set.facts.length_unit, row.unit, "{name}");
        if let Some((min, max)) = row.extent_mm {
            let off = |found: [f64; 3], expected: [f64; 3]| (0..3).any(|k| (found[k] - expected[k]).abs() > 2e-3);
            let origins = seen.origins_mm.unwrap();
            assert!(!off(origins.min, min) && !off(origins.max, max), "{name}: {:?}", seen.origins_mm);
        }
        let codes: Vec<&str> = seen.notices.iter().map(|notice| notice.code).collect();
        assert_eq!(codes, row.notices, "{name}");
    }
}

#[test]
fn the_filament_shines_into_all_directions_at_all_visible_wavelengths() {
    let name = "speos_pyspeos_Rays.ray";
    let Some(bytes) = real(name) else { return };
    let seen = inspected(name, &bytes);
    // Half the flux to each side; the file's 45 462 rays leave 0.5 / sqrt(45 462) = 0.23 %, and the filament's own shape more.
    seen.hemispheres.iter().for_each(|half| assert!((half.share - 0.5).abs() < 0.02, "{half:?}"));
    let (low, high) = seen.wavelength_nm.unwrap();
    assert!((350.0..351.0).contains(&low) && (849.0..=850.0).contains(&high), "{low} to {high} nm");
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
        let (Some(a), Some(b)) = (real(one), real(other)) else { return };
        let (a, b) = (rays(&a), rays(&b));
        assert_eq!(a.len(), b.len());
        for (a, b) in a.iter().zip(&b) {
            assert_eq!((a.origin_mm, a.direction), (b.origin_mm, b.direction), "{one}");
            // nm and um in f32 differ in the seventh digit.
            assert!(!spectral || (a.wavelength_nm - b.wavelength_nm).abs() < 1e-4, "{one}: {a:?} {b:?}");
        }
    }
}
