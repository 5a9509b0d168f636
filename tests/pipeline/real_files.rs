//! Every real ray file of other programs at hand (`../shared/rays`, with an index of its own) against what is written of it. They may
//! not be redistributed and are not in this repository: where the folder is missing, these tests say so and are left out.
//! `cargo test --test pipeline real_files -- --nocapture` prints the table.
#![expect(clippy::unwrap_used, reason = "clippy.toml allows it in #[test] functions only, and these are their tools")]

use crate::rays::{close, read_all, sums};
use pipeline::formats::bytes::digest;
use pipeline::source::Columns;
use pipeline::{Declared, Format, Input, Inspection, LengthUnit, Limits, NoProgress, Options, Outcome, inspect, run};
use std::collections::BTreeSet;
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

/// Smallest and largest coordinates of the origins, mm, and how far they may be off.
type Extent = ([f64; 3], [f64; 3], f64);

/// What is known of one file.
struct Row {
    name: &'static str,
    format: Format,
    rays: u64,
    watt: Total,
    lumen: Total,
    unit: LengthUnit,
    extent_mm: Option<Extent>,
    notices: &'static [&'static str],
}

const MM: LengthUnit = LengthUnit::Millimetre;
const GREEN: &str = "mu_rayfile_LERTDUW_S2WP_green_100k_20161013_IES_TM25.TM25RAY";
const FILAMENT: &str = "speos_pyspeos_Rays.ray";
const RATIO: &str = "rays.total_ratio";
const LINE: &str = "zemax.header_wavelength";
/// V(550 nm) = 0.99495 (CIE 1924) times 683 lm/W.
const LM_PER_W_550: f64 = 679.55;
/// Files beside the ray files, and the codes that refuse them.
const NO_RAYS: [(&str, &str); 6] = [
    (concat!("INDEX", ".md"), "detect.not_rays"),
    ("mu_LEDWhite.txt", "detect.spectrum"),
    ("mu_LERTDUW_S2WP_20161017_info.pdf", "detect.document"),
    ("mu_LERTDUW_S2WP_binBQ_white-blue_20110706_spectrum.txt", "detect.spectrum"),
    ("mu_LERTDUW_S2WP_binBQ_white-yellow_20110706_spectrum.txt", "detect.spectrum"),
    ("mu_VirtualFocus.pdf", "detect.document"),
];

/// Formats, counts, totals, units: the folder's index and `pipeline/formats/README.md`. Boxes and sums of text: awk over the same files; of ansys_test_08_*:
/// their bytes; of the filament: its cylinder, which random rays fill but for 2 um.
#[rustfmt::skip]
fn rows() -> Vec<Row> {
    use Format::{LightToolsBinary, LightToolsText, Speos, Tm25, ZemaxBinary, ZemaxText};
    let row = |name, format, rays, watt, lumen, unit, extent_mm, notices| {
        Row { name, format, rays, watt, lumen, unit, extent_mm, notices }
    };
    let filament = Some(([-0.4, -3.0, 31.35], [0.4, 3.0, 32.15], 2e-3));
    let cylinder = |within_mm| Some(([-9.998978, -9.999973, 0.03076709], [9.999976, 9.996271, 19.97654], within_mm));
    let three = |within_mm| Some(([-0.6668399, -0.6670539, 0.0001], [0.6666667, 0.8334215, 0.0001], within_mm));
    let eleven_in_a_row = Some(([0.0, -5.0, 0.0], [0.0, 5.0, 0.0], 0.0));
    let point = |at: f64| Some(([at; 3], [at; 3], 0.0));
    let nine = ([-15.03922, -15.77001, 0.0], [9.922475, 14.27664, 0.0]);
    let wide = Some((nine.0.map(|value: f64| 10.0 * value), nine.1.map(|value: f64| 10.0 * value), 1e-9));
    let nine = Some((nine.0, nine.1, 1e-9));
    let (eleven, one) = (LM_PER_W_550 * 11.0, LM_PER_W_550);
    let (three_w, nine_w) = (0.003_106_601, 138.865_937);
    vec![
        row(GREEN, Tm25, 100_000, Is(0.6938, 1e-4), Is(337.0, 1e-6), MM, None, &[]),
        row("mu_Cyl10k.1.tm25ray", Tm25, 10_000, Unknown, Is(1.0, 1e-6), MM, cylinder(1e-5), &[RATIO]),
        row("mu_Cyl10k.1.ray", LightToolsText, 10_000, Unknown, Is(1.0, 1e-9), MM, cylinder(1e-9), &[RATIO]),
        row(FILAMENT, Speos, 45_462, Is(4.018, 1e-3), Is(450.08, 1e-3), MM, filament, &[RATIO]),
        row("speos_pyspeos_RaysWithoutSpectralData.RAY", LightToolsBinary, 113, Unknown, Is(55.0, 1e-6), MM, None, &["lighttools.cut", RATIO]),
        row("mu_ThreeRays_PowerOnly.1.ray", LightToolsBinary, 3, Is(three_w, 1e-6), Unknown, MM, three(1e-6), &[RATIO]),
        row("mu_ThreeRays_Wavelength.1.ray", LightToolsBinary, 3, Is(three_w, 1e-6), Known, MM, three(1e-6), &[RATIO]),
        row("mu_ThreeRays_Wavelength.1.txt", LightToolsText, 3, Is(three_w, 1e-9), Known, MM, three(1e-9), &[RATIO]),
        // Zemax sums its rays, LightTools takes the header's total: three times as much.
        row("mu_ThreeRays_Wavelength_ZMX.ray", ZemaxBinary, 3, Is(3.0 * three_w, 1e-6), Known, MM, three(1e-6), &[RATIO]),
        row("mu_ZemaxText.txt", ZemaxText, 9, Is(nine_w, 1e-9), Unknown, MM, nine, &[]),
        row("mu_ZemaxWavelengthText.txt", ZemaxText, 9, Is(nine_w, 1e-9), Known, LengthUnit::Centimetre, wide, &["text.unterminated"]),
        row("ansys_test_08_ray.ray", Speos, 11, Is(1.0, 1e-6), Is(one, 1e-4), MM, eleven_in_a_row, &[RATIO]),
        row("ansys_test_08_dat_reference.ray", Speos, 11, Is(1.0, 1e-6), Is(one, 1e-4), MM, eleven_in_a_row, &[RATIO]),
        row("ansys_test_08_ray_reference.sdf", ZemaxBinary, 11, Is(11.0, 1e-6), Is(eleven, 1e-4), MM, eleven_in_a_row, &[RATIO]),
        row("ansys_test_08_dat.DAT", ZemaxBinary, 11, Is(11.0, 1e-6), Is(eleven, 1e-4), MM, eleven_in_a_row, &[RATIO, LINE]),
        row("ansys_test_08_sdf.sdf", ZemaxBinary, 11, Known, Known, MM, eleven_in_a_row, &[RATIO, "zemax.swapped_columns"]),
        row("ansys_test_08_dat_flux_type_1.dat", ZemaxBinary, 1, Is(0.0015 / one, 1e-4), Is(0.0015, 1e-6), MM, point(1.0), &[LINE]),
        row("zemax_omnistic_binary_source.dat", ZemaxBinary, 1, Is(1.0, 1e-6), Known, LengthUnit::Metre, point(0.0), &[LINE]),
    ]
}

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/rays")
}

/// A real file, or `None`, said aloud, where the folder is missing. A folder without the file is a failure.
pub fn real(name: &str) -> Option<Vec<u8>> {
    if !folder().is_dir() {
        println!("LEFT OUT: {name}, because {} is not here", folder().display());
        return None;
    }
    Some(std::fs::read(folder().join(name)).unwrap())
}

fn input(name: &str, bytes: Vec<u8>) -> Input {
    Input {
        name: name.into(),
        sha256: digest(&bytes).unwrap(),
        bytes: Arc::new(bytes),
        declared: Declared::default(),
        notices: Vec::new(),
    }
}

fn inspected(name: &str, bytes: Vec<u8>) -> Inspection {
    inspect(&input(name, bytes), &Limits::default(), &NoProgress).unwrap()
}

fn assert_total(name: &str, found: Option<f64>, expected: Total) {
    let holds = match expected {
        Unknown => found.is_none(),
        Known => found.is_some(),
        Is(value, error) => found.is_some_and(|found| (found - value).abs() <= error * value),
    };
    assert!(holds, "{name}: {found:?}");
}

/// The line of the printed table.
fn line(name: &str, seen: &Inspection) -> String {
    let total = |value: Option<f64>| value.map_or("unknown".to_owned(), |value| format!("{value:.6}"));
    let [min, max] = seen.origins_mm.map(|extent| [extent.min, extent.max]).unwrap().map(|corner| {
        let short = corner.map(|value| format!("{}", (value * 1e4).round() / 1e4 + 0.0));
        format!("({})", short.join(", "))
    });
    let notices: Vec<&str> = seen.notices.iter().map(|notice| notice.code.as_ref()).collect();
    let (watt, lumen) = (total(seen.flux.radiant_w), total(seen.flux.luminous_lm));
    let unit = seen.header.length_unit.unwrap_or("unknown");
    let format = seen.header.format.name();
    format!(
        "| {name} | {format} | {} | {watt} | {lumen} | {unit} | {min} .. {max} | {} |",
        seen.rays_used,
        notices.join(", ")
    )
}

#[test]
fn every_file_is_what_is_written_of_it() {
    let mut table = vec![
        "| file | detected as | rays | W | lm | unit | box, mm | notices |".to_owned(),
        "|---|---|---:|---:|---:|---|---|---|".to_owned(),
    ];
    for row in rows() {
        let name = row.name;
        let Some(bytes) = real(name) else { return };
        let seen = inspected(name, bytes);
        table.push(line(name, &seen));
        assert_eq!((seen.header.format, seen.header.ray_count), (row.format, row.rays), "{name}");
        assert_eq!((seen.rays_used, seen.rays_refused, seen.rays_dropped), (row.rays, 0, 0), "{name}");
        assert_total(name, seen.flux.radiant_w, row.watt);
        assert_total(name, seen.flux.luminous_lm, row.lumen);
        assert_eq!(seen.header.length_unit, Some(row.unit.symbol()), "{name}");
        if let Some((min, max, within_mm)) = row.extent_mm {
            let off = |found: [f64; 3], expected: [f64; 3]| (0..3).any(|k| (found[k] - expected[k]).abs() > within_mm);
            let origins = seen.origins_mm.unwrap();
            assert!(!off(origins.min, min) && !off(origins.max, max), "{name}: {:?}", seen.origins_mm);
        }
        let codes: Vec<&str> = seen.notices.iter().map(|notice| notice.code.as_ref()).collect();
        assert_eq!(codes, row.notices, "{name}");
    }
    for (name, code) in NO_RAYS {
        let refused = inspect(&input(name, real(name).unwrap()), &Limits::default(), &NoProgress).unwrap_err();
        assert_eq!(refused.code(), code, "{name}: {refused}");
        table.push(format!("| {name} | refused: {refused} | | | | | | {code} |"));
    }
    println!("{}", table.join("\n"));
}

/// The table leaves no file out.
#[test]
fn no_file_is_forgotten() {
    let Ok(files) = std::fs::read_dir(folder()) else { return };
    let found: BTreeSet<String> = files.map(|file| file.unwrap().file_name().into_string().unwrap()).collect();
    let told = rows().into_iter().map(|row| row.name).chain(NO_RAYS.map(|(name, _)| name));
    assert_eq!(found, told.map(str::to_owned).collect());
}

#[test]
fn the_filament_shines_into_all_directions_at_all_visible_wavelengths() {
    let Some(bytes) = real(FILAMENT) else { return };
    let seen = inspected(FILAMENT, bytes);
    // Half the flux to each side; the file's 45 462 rays leave 0.5 / sqrt(45 462) = 0.23 %, and the filament's own shape more.
    seen.hemispheres.iter().for_each(|half| assert!((half.share - 0.5).abs() < 0.02, "{half:?}"));
    let (low, high) = seen.wavelength_nm.unwrap();
    assert!((350.0..351.0).contains(&low) && (849.0..=850.0).contains(&high), "{low} to {high} nm");
}

/// The surface is the filament's own: a cylinder of radius 0.4 and length 6 whose ends are dark (the folder's index; no ray starts on them).
#[test]
fn the_filament_s_surface_is_its_cylinder() {
    let Some(bytes) = real(FILAMENT) else { return };
    let Outcome { model, .. } =
        run(&[input(FILAMENT, bytes)], &Options::default(), &Limits::default(), &NoProgress).unwrap();
    let (area, side) = (model.hull.total_area_mm2(), std::f64::consts::TAU * 0.4 * 6.0);
    let flux = model.flux;
    println!("filament: {flux:?}; hull {area:.3} mm2, side of the cylinder {side:.3} mm2, cell {}", model.hull.cell_mm);
    assert!(
        (flux.radiant_w.unwrap() / 4.018 - 1.0).abs() < 1e-3 && (flux.luminous_lm.unwrap() / 450.08 - 1.0).abs() < 1e-3
    );
    assert!((area / side - 1.0).abs() < 0.05, "{area} {side}");
    // Every vertex lies on the cylinder within half a cell.
    let half_mm = model.hull.cell_mm.max_element() / 2.0;
    for vertex in &model.hull.vertices_mm {
        let radius = vertex.x.hypot(vertex.z - 31.75);
        assert!((radius - 0.4).abs() < half_mm && vertex.y.abs() < 3.0 + half_mm, "{vertex}");
    }
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
    // The folder's index: 98 % of the origins lie on z = 0.02 mm; nothing shines below the package.
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
    // The folder's index: all origins on a sphere of radius 10 about (0, 0, 10).
    assert!(source.survey.bounds_mm.size().max_element() < 20.001);
}
