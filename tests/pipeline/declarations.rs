//! Every format with every fact that a user can declare: missing, wrong, and declared. What a user declares goes before the
//! file's word, and a word that cannot be meant is asked for and never fatal.

use crate::rays::{WATTS, file, good};
use pipeline::formats::record::RawRay;
use pipeline::formats::tm25::header::SpectralId;
use pipeline::options::RaysOptions;
use pipeline::source::Source;
use pipeline::vocabulary::declaration::FluxOverride;
use pipeline::vocabulary::spectrum::Table;
use pipeline::vocabulary::units::Flux;
use pipeline::vocabulary::watch::StageWatch;
use pipeline::{Column, Declared, Error, Input, LengthUnit, Limits, NoProgress, Quantity, Stage, inspect, peek};
use std::sync::Arc;

/// What a user can declare of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fact {
    LengthUnit,
    Quantity,
    Spectrum,
    Flux,
    Columns,
}

const FACTS: [Fact; 5] = [Fact::LengthUnit, Fact::Quantity, Fact::Spectrum, Fact::Flux, Fact::Columns];

/// What a file says of a fact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Word {
    Good,
    Missing,
    Wrong,
}

/// Rays of every file.
const RAYS: usize = 100;

/// Numbers of a ray: on a chip of 10 x 10, up, 2, at 555 nm.
fn ray(k: usize) -> [f64; 8] {
    [(k % 10) as f64, (k / 10) as f64, 0.0, 0.0, 0.0, 1.0, 2.0, 555.0]
}

fn floats(columns: usize) -> Vec<u8> {
    (0..RAYS)
        .flat_map(|k| {
            ray(k).into_iter().take(columns).flat_map(|value| (value as f32).to_le_bytes()).collect::<Vec<u8>>()
        })
        .collect()
}

fn rows(columns: usize) -> String {
    let row = |k| ray(k).iter().take(columns).map(ToString::to_string).collect::<Vec<_>>().join(" ") + "\n";
    (0..RAYS).map(row).collect()
}

/// The three words on a fact, as a format writes them.
fn word<T: Copy>(fact: Fact, said: (Fact, Word), good: T, missing: T, wrong: T) -> T {
    match said {
        (of, Word::Missing) if of == fact => missing,
        (of, Word::Wrong) if of == fact => wrong,
        _ => good,
    }
}

fn tm25(said: (Fact, Word)) -> Vec<u8> {
    let raw = |k: usize| RawRay { origin_mm: [ray(k)[0], ray(k)[1], 0.0], ..good() };
    let rays: Vec<RawRay> = (0..RAYS).map(raw).collect();
    let table = word(Fact::Spectrum, said, Some([(555.0, 1.0), (556.0, 1.0)]), None, Some([(555.0, -1.0), (0.5, 1.0)]));
    let id = if table.is_some() { SpectralId::OneTable } else { SpectralId::None };
    let mut bytes = file(WATTS, id, table.into_iter().map(|points| points.to_vec()).collect(), &rays);
    let total = word(Fact::Flux, said, 200.0_f32, 0.0, f32::NAN);
    bytes[16..20].copy_from_slice(&total.to_le_bytes());
    bytes
}

fn zemax(said: (Fact, Word)) -> Vec<u8> {
    let mut header = vec![0; 208];
    let mut put = |at: usize, word: [u8; 4]| header[at..at + 4].copy_from_slice(&word);
    put(0, 1010_i32.to_le_bytes());
    put(4, (RAYS as u32).to_le_bytes());
    put(108, word(Fact::Flux, said, 200.0_f32, 0.0, f32::NAN).to_le_bytes());
    put(116, word(Fact::Spectrum, said, 0.555_f32, 0.0, 77.0).to_le_bytes());
    put(136, word(Fact::LengthUnit, said, 4_i32, 4, 9).to_le_bytes());
    put(196, word(Fact::Quantity, said, 0_i32, 0, 7).to_le_bytes());
    [header, floats(7)].concat()
}

fn zemax_text(said: (Fact, Word)) -> Vec<u8> {
    let unit = word(Fact::LengthUnit, said, 4, 4, 9);
    let kind = word(Fact::Quantity, said, " 0 0", "", " 0 7");
    let kind = word(Fact::Columns, said, kind, kind, " 1 0");
    format!("{RAYS} {unit}{kind}\n{}", rows(7)).into()
}

fn lighttools(said: (Fact, Word)) -> Vec<u8> {
    let quantity = word(Fact::Quantity, said, 0, 0, 7);
    let unit = word(Fact::LengthUnit, said, 1, 0, 99);
    let numbers = [2_u32, 0, quantity, 0, 0, unit, 0, 0, 0].into_iter().flat_map(u32::to_le_bytes);
    let total = word(Fact::Flux, said, 200.0_f32, 0.0, f32::NAN).to_le_bytes();
    b"LTRF".iter().copied().chain(numbers).chain(total).chain(floats(7)).chain(*b"LTRFEND").collect()
}

fn lighttools_text(said: (Fact, Word)) -> Vec<u8> {
    let quantity = word(Fact::Quantity, said, "lt_datatype: radiant_power\n", "", "lt_datatype: photons\n");
    let unit = word(Fact::LengthUnit, said, "lt_length_units: millimeters\n", "", "lt_length_units: parsec\n");
    let total = word(Fact::Flux, said, "lt_radiant_flux: 200\n", "", "lt_radiant_flux: 0,5\n");
    let color = word(Fact::Columns, said, "", "", "lt_color_info: rgb\n");
    format!("lt_rdf_version: 2.0\n{quantity}{unit}{total}{color}lt_startofdata\n{}lt_endofdata\n", rows(7)).into()
}

fn speos(said: (Fact, Word)) -> Vec<u8> {
    let total = word(Fact::Flux, said, 200.0_f32, 0.0, f32::NAN);
    let header = [total, 2.0, 2.0, 2.0, 2.0, 2.0, 0.0].into_iter().flat_map(f32::to_le_bytes);
    let nm = word(Fact::Spectrum, said, 555.0, 555.0, 0.0);
    let rays = (0..RAYS).flat_map(|k| [ray(k)[0], ray(k)[1], 0.0, 0.0, 0.0, 1.0, nm, 2.0]);
    header.chain(rays.flat_map(|value| (value as f32).to_le_bytes())).collect()
}

fn asap(_: (Fact, Word)) -> Vec<u8> {
    let mut bytes = 7415_i32.to_le_bytes().to_vec();
    bytes.resize(140, 0);
    bytes[108..112].copy_from_slice(&(-(RAYS as i32)).to_le_bytes());
    [bytes, floats(7)].concat()
}

fn prosource(said: (Fact, Word)) -> Vec<u8> {
    let unit =
        word(Fact::LengthUnit, said, "Conversion Factor From Meters 1000\n", "", "Conversion Factor From Meters 7\n");
    format!("# NbrRays Requested: {RAYS},  NbrRays Generated: {RAYS}\n{unit}{}", rows(7)).into()
}

fn columns(said: (Fact, Word)) -> Vec<u8> {
    let names = word(Fact::Quantity, said, "x y z l m n W\n", "x y z l m n flux\n", "x y z l m n power[MW]\n");
    let names = word(Fact::Columns, said, names, "", "x y z l m n nonsense\n");
    let unit = word(Fact::LengthUnit, said, "Units: mm\n", "", "Units: parsec\n");
    format!("{unit}{names}{}", rows(7)).into()
}

/// How a format writes what is said of a fact.
type Written = fn((Fact, Word)) -> Vec<u8>;

/// Every format, how its files are written here, and the facts on which its files have a word.
const FORMATS: [(&str, Written, &[Fact]); 9] = [
    ("IES TM-25", tm25, &[Fact::Spectrum, Fact::Flux]),
    ("Zemax binary", zemax, &[Fact::LengthUnit, Fact::Quantity, Fact::Spectrum, Fact::Flux]),
    ("Zemax text", zemax_text, &[Fact::LengthUnit, Fact::Quantity, Fact::Columns]),
    ("LightTools binary", lighttools, &[Fact::LengthUnit, Fact::Quantity, Fact::Flux]),
    ("LightTools text", lighttools_text, &[Fact::LengthUnit, Fact::Quantity, Fact::Flux, Fact::Columns]),
    ("Speos", speos, &[Fact::Spectrum, Fact::Flux]),
    ("ASAP distribution", asap, &[]),
    ("TracePro text", prosource, &[Fact::LengthUnit]),
    ("text columns", columns, &[Fact::LengthUnit, Fact::Quantity, Fact::Columns]),
];

fn input(bytes: Vec<u8>, declared: Declared) -> Input {
    Input { name: "test".into(), sha256: "0".repeat(64), bytes: Arc::new(bytes), declared, notices: Vec::new() }
}

fn read(bytes: Vec<u8>, declared: Declared) -> Result<Source, Error> {
    let watch = StageWatch::enter(&NoProgress, Stage::Rays)?;
    Source::read(&[input(bytes, declared)], &RaysOptions::default(), &Limits::default(), watch)
}

fn is_text(format: &str) -> bool {
    format.contains("text")
}

/// All that a user can declare of a file of this format: then no word of its own is needed.
fn everything(format: &str) -> Declared {
    Declared {
        name: None,
        length_unit: Some(LengthUnit::Millimetre),
        quantity: Some(Quantity::Radiant),
        columns: is_text(format).then(|| {
            use Column::{Flux, L, M, N, X, Y, Z};
            vec![X, Y, Z, L, M, N, Flux]
        }),
        spectrum: Table::new(&[(555.0, 1.0)]),
        flux: Some(FluxOverride::RadiantW(3.0)),
    }
}

/// Everything but one fact.
fn without(format: &str, fact: Fact) -> Declared {
    let all = everything(format);
    match fact {
        Fact::LengthUnit => Declared { length_unit: None, ..all },
        // A declared flux answers what the values are, too.
        Fact::Quantity => Declared { quantity: None, flux: None, ..all },
        Fact::Spectrum => Declared { spectrum: None, ..all },
        Fact::Flux => Declared { flux: None, ..all },
        Fact::Columns => Declared { columns: None, ..all },
    }
}

/// What is answered where a fact is not declared and the file's word on it is missing or cannot be meant: the code that asks for
/// it, or "read" where a model needs no such word, or has another to go by.
fn asked(format: &str, fact: Fact, said: Word) -> &'static str {
    let has_word = FORMATS.iter().any(|(name, _, facts)| *name == format && facts.contains(&fact));
    match (fact, said) {
        (_, Word::Good) if has_word => "read",
        (Fact::LengthUnit, _) if matches!(format, "IES TM-25" | "Speos") => "read",
        // The header's unit has no way to be missing in Zemax' files.
        (Fact::LengthUnit, Word::Missing) if format.starts_with("Zemax") => "read",
        (Fact::LengthUnit, _) => "rays.unit_unknown",
        (Fact::Quantity, _) if matches!(format, "IES TM-25" | "Speos") => "read",
        (Fact::Quantity, Word::Missing) if matches!(format, "Zemax binary" | "LightTools binary") => "read",
        (Fact::Quantity, _) => "rays.quantity_unknown",
        (Fact::Spectrum, Word::Wrong) if format == "IES TM-25" => "rays.spectrum_unreadable",
        (Fact::Spectrum, Word::Wrong) if format == "Speos" => "rays.too_many_refused",
        (Fact::Flux, Word::Wrong) if format == "LightTools text" => "rays.total_unreadable",
        (Fact::Columns, Word::Wrong) if format == "Zemax text" => "zemax.ray_format",
        (Fact::Columns, Word::Wrong) if format == "LightTools text" => "lighttools.color_info",
        (Fact::Columns, Word::Wrong) if format == "text columns" => "columns.missing",
        _ => "read",
    }
}

#[test]
fn every_fact_of_every_format_can_be_declared() {
    let mut cells = 0;
    for (format, written, facts) in FORMATS {
        for fact in FACTS {
            let mut row = Vec::new();
            for said in [Word::Good, Word::Missing, Word::Wrong] {
                let bytes = written((fact, said));
                let what = format!("{format}, {fact:?} {said:?}");
                assert!(peek(&bytes, Some(bytes.len() as u64), &Limits::default()).unwrap().is_some(), "{what}");
                // Asked for, or not needed.
                let alone = read(bytes.clone(), without(format, fact)).map_or_else(|error| error.code(), |_| "read");
                assert_eq!(alone, asked(format, fact, said), "{what}");
                // Declared, whatever the file says.
                let source = read(bytes.clone(), everything(format)).unwrap_or_else(|error| panic!("{what}: {error}"));
                assert_eq!(source.flux.radiant_w.map(f64::round), Some(3.0), "{what}");
                let size = source.survey.bounds_mm.size();
                assert!((size.x - 9.0).abs() < 1e-6 && (size.y - 9.0).abs() < 1e-6, "{what}: {size}");
                assert_eq!(source.survey.rays_used, RAYS as u64, "{what}");
                let found = inspect(&input(bytes, everything(format)), &Limits::default(), &NoProgress);
                let wrong = found.unwrap().checks.into_iter().filter(|check| check.verdict.name() == "wrong");
                assert_eq!(wrong.map(|check| check.check).collect::<Vec<_>>(), Vec::<&str>::new(), "{what}");
                row.push(alone);
                cells += 1;
            }
            let word = if facts.contains(&fact) { "in the file" } else { "not in the file" };
            println!(
                "{format:18} {:12} {word:16} good: {:22} missing: {:22} wrong: {}",
                format!("{fact:?}"),
                row[0],
                row[1],
                row[2]
            );
        }
    }
    assert_eq!(cells, 9 * 5 * 3, "the table has no hole");
}

/// In whatever format: what a file knows in both quantities stays what it is, or is refused, when its user names the other quantity.
#[test]
fn a_declared_quantity_makes_no_light_of_a_word() {
    let flux = |bytes: Vec<u8>, declared: Declared| read(bytes, declared).map(|source| source.flux);
    for (format, written, _) in FORMATS {
        for spectrum in [None, Table::new(&[(555.0, 1.0)])] {
            let plain = Declared { spectrum, ..said() };
            let bytes = || written((Fact::Columns, Word::Good));
            let own = flux(bytes(), plain.clone()).unwrap();
            let other = flux(bytes(), Declared { quantity: Some(Quantity::Luminous), ..plain });
            let same = |other: Flux| {
                let pairs = [(own.radiant_w, other.radiant_w), (own.luminous_lm, other.luminous_lm)];
                pairs.iter().all(|(a, b)| a.zip(*b).is_some_and(|(a, b)| (a / b - 1.0).abs() < 1e-6))
            };
            // ASAP, TracePro and columns of numbers say no quantity: the user's word is the only one.
            let is_silent = matches!(format, "ASAP distribution" | "TracePro text");
            match other {
                Ok(other) if own.luminous_lm.is_some() && !is_silent => {
                    assert!(same(other), "{format}: {own:?} {other:?}")
                }
                Ok(_) => {}
                Err(error) => assert_eq!(error.code(), "rays.quantity_known", "{format}"),
            }
        }
    }
}

/// Verdict and sentence of a check.
fn check(bytes: Vec<u8>, declared: Declared, name: &str) -> (&'static str, String) {
    let found = inspect(&input(bytes, declared), &Limits::default(), &NoProgress).unwrap();
    let check = found.checks.into_iter().find(|check| check.check == name).unwrap();
    (check.verdict.name(), check.message)
}

fn said() -> Declared {
    Declared { length_unit: Some(LengthUnit::Millimetre), quantity: Some(Quantity::Radiant), ..Declared::default() }
}

#[test]
fn rays_without_flux_have_equal_shares_of_a_declared_flux_on_request() {
    use Column::{Ignored, L, M, N, X, Y, Z};
    let bytes = || rows(7).into_bytes();
    let columns = Some(vec![X, Y, Z, L, M, N, Ignored]);
    let without = Declared { quantity: None, columns: columns.clone(), ..said() };
    assert_eq!(read(bytes(), without.clone()).err().unwrap().code(), "rays.flux_missing");
    assert_eq!(check(bytes(), without.clone(), "rays.total").0, "wrong");
    for (flux, watt, lumen) in
        [(FluxOverride::RadiantW(3.0), Some(3.0), None), (FluxOverride::LuminousLm(50.0), None, Some(50.0))]
    {
        let source = read(bytes(), Declared { flux: Some(flux), ..without.clone() }).unwrap();
        let close = |a: Option<f64>, b: Option<f64>| a.zip(b).map_or(a == b, |(a, b)| (a / b - 1.0).abs() < 1e-9);
        assert!(close(source.flux.radiant_w, watt) && close(source.flux.luminous_lm, lumen), "{:?}", source.flux);
        assert_eq!(source.notices.count_of("rays.equal_shares"), 1);
    }
}

/// Every format whose flux fields are all 0: the same where a flux is declared, and asked for where none is.
#[test]
fn files_without_flux_in_any_ray_have_equal_shares_of_a_declared_flux() {
    for (format, written, _) in FORMATS {
        let good = written((Fact::Columns, Word::Good));
        let dark = if is_text(format) {
            String::from_utf8(good).unwrap().replace(" 0 0 1 2\n", " 0 0 1 0\n").into_bytes()
        } else {
            let (start, record, at) = match format {
                "IES TM-25" => (good.len() - 28 * RAYS, 28, 24),
                "Zemax binary" => (208, 28, 24),
                "LightTools binary" => (44, 28, 24),
                "Speos" => (28, 32, 28),
                _ => (140, 28, 24),
            };
            let mut bytes = good;
            for ray in bytes[start..].chunks_exact_mut(record) {
                ray[at..at + 4].fill(0);
            }
            bytes
        };
        let without = Declared { flux: None, quantity: None, columns: None, spectrum: None, ..everything(format) };
        let asked = read(dark.clone(), Declared { quantity: everything(format).quantity, ..without.clone() });
        let error = asked.err().unwrap_or_else(|| panic!("{format}"));
        assert!(
            error.code() == "rays.none_usable" && error.to_string().contains("Declare its flux"),
            "{format}: {error}"
        );
        for (flux, own) in [(FluxOverride::RadiantW(3.0), 3.0), (FluxOverride::LuminousLm(50.0), 50.0)] {
            let source = read(dark.clone(), Declared { flux: Some(flux), ..without.clone() });
            let source = source.unwrap_or_else(|error| panic!("{format}: {error}"));
            let found = if own == 3.0 { source.flux.radiant_w } else { source.flux.luminous_lm };
            assert!((found.unwrap() / own - 1.0).abs() < 1e-9, "{format}: {:?}", source.flux);
            assert_eq!(source.survey.rays_used, RAYS as u64, "{format}");
            assert_eq!(source.notices.count_of("rays.equal_shares"), 1, "{format}");
            assert_eq!(source.notices.count_of("rays.total_ratio"), 0, "{format}");
            let declared = Declared { flux: Some(flux), ..everything(format) };
            let found = inspect(&input(dark.clone(), declared), &Limits::default(), &NoProgress).unwrap();
            let total = if own == 3.0 { found.flux.radiant_w } else { found.flux.luminous_lm };
            assert!((total.unwrap() / own - 1.0).abs() < 1e-9, "{format}: {:?}", found.flux);
        }
        // One ray with flux, and the others are dropped as ever.
        if format == "Zemax binary" {
            let mut one = dark;
            one[208 + 28 * 70 + 24..][..4].copy_from_slice(&1.0_f32.to_le_bytes());
            let source = read(one, Declared { flux: Some(FluxOverride::RadiantW(3.0)), ..without }).unwrap();
            assert_eq!((source.survey.rays_used, source.notices.count_of("rays.equal_shares")), (1, 0));
        }
    }
}

#[test]
fn sums_beyond_what_a_model_holds_are_refused_and_can_be_declared() {
    let mut bytes = zemax((Fact::Columns, Word::Good));
    for ray in bytes[208..].chunks_exact_mut(28) {
        ray[24..28].copy_from_slice(&1e38_f32.to_le_bytes());
    }
    assert_eq!(read(bytes.clone(), Declared::default()).err().unwrap().code(), "rays.flux_too_large");
    assert_eq!(check(bytes.clone(), Declared::default(), "rays.usable").0, "wrong");
    let declared = Declared { flux: Some(FluxOverride::RadiantW(3.0)), ..Declared::default() };
    assert!((read(bytes.clone(), declared).unwrap().flux.radiant_w.unwrap() - 3.0).abs() < 1e-9);
    for flux_w in [1e39, 1e-39] {
        let declared = Declared { flux: Some(FluxOverride::RadiantW(flux_w)), ..Declared::default() };
        assert_eq!(read(bytes.clone(), declared).err().unwrap().code(), "rays.flux_impossible");
    }
    for ray in bytes[208..].chunks_exact_mut(28) {
        ray[24..28].copy_from_slice(&1e-40_f32.to_le_bytes());
    }
    assert_eq!(read(bytes, Declared::default()).err().unwrap().code(), "rays.flux_too_small");
}

/// A count that disagrees is told with its share, and above 1 % it is wrong.
#[test]
fn counts_that_disagree_are_told_with_their_share() {
    let text = |announced: usize| format!("{announced} 4 0 0\n{}", rows(7)).into_bytes();
    assert_eq!(check(text(100), said(), "rays.usable").0, "ok");
    for (announced, verdict, code) in
        [(99, "ok", "text.more_rows"), (98, "wrong", "text.more_rows"), (101, "ok", "text.fewer_rows")]
    {
        assert_eq!(check(text(announced), said(), "rays.usable").0, verdict, "{announced}");
        let source = read(text(announced), said()).unwrap();
        let told = source.notices.iter().find(|notice| notice.code == code).unwrap();
        assert!(told.message.contains('%'), "{}", told.message);
    }
    let error = read(text(102), said()).err().unwrap();
    assert!(error.code() == "text.row_count" && error.to_string().contains("1.96 %"), "{error}");
}

/// One rule for wavelengths in every format: written in another unit they are converted and told, mixed they are wrong.
#[test]
fn wavelengths_are_judged_alike_in_every_format() {
    let binary = |head: Vec<u8>, order: fn(f64) -> [f64; 2], nm: &dyn Fn(usize) -> f64| {
        let ray = |k: usize| {
            let [seventh, eighth] = order(nm(k));
            [ray(k)[0], ray(k)[1], 0.0, 0.0, 0.0, 1.0, seventh, eighth]
                .map(|value| (value as f32).to_le_bytes())
                .concat()
        };
        [head, (0..RAYS).flat_map(ray).collect()].concat()
    };
    let text = |head: &str, nm: &dyn Fn(usize) -> f64| {
        let row = |k: usize| format!("{} {} 0 0 0 1 2 {}\n", k % 10, k / 10, nm(k));
        format!("{head}{}", (0..RAYS).map(row).collect::<String>()).into_bytes()
    };
    let speos_head =
        || [1.0_f32, 2.0, 2.0, 2.0, 2.0, 2.0, 0.0].into_iter().flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    let zemax_head = || {
        let mut head = zemax((Fact::Columns, Word::Good));
        head.truncate(208);
        head[116..120].fill(0);
        head[192..196].copy_from_slice(&2_i32.to_le_bytes());
        head
    };
    let lighttools = "lt_rdf_version: 2.0\nlt_datatype: radiant_power\nlt_color_info: wavelength\nlt_length_units: millimeters\nlt_startofdata\n";
    type Made<'a> = Box<dyn Fn(&dyn Fn(usize) -> f64) -> Vec<u8> + 'a>;
    let formats: [(&str, Made<'_>); 5] = [
        ("Speos", Box::new(|nm| binary(speos_head(), |nm| [nm, 2.0], nm))),
        ("Zemax binary", Box::new(|nm| binary(zemax_head(), |nm| [2.0, nm], nm))),
        ("Zemax text", Box::new(|nm| text("100 4\n", nm))),
        ("LightTools text", Box::new(|nm| text(lighttools, nm))),
        ("text columns", Box::new(|nm| text("x y z l m n W wavelength\n", nm))),
    ];
    for (format, made) in &formats {
        for nm in [&(|_| 555.0) as &dyn Fn(usize) -> f64, &|_| 0.555] {
            let source = read(made(nm), said()).unwrap_or_else(|error| panic!("{format}: {error}"));
            let (radiant, luminous) = (source.flux.radiant_w.unwrap(), source.flux.luminous_lm.unwrap());
            assert!((luminous / radiant - 683.0).abs() < 0.1, "{format}: {luminous} lm of {radiant} W");
            assert_eq!(check(made(nm), said(), "rays.spectrum").0, "ok", "{format}");
        }
        // The first rows do not speak for all.
        let late = |k: usize| if k < 99 { 555.0 } else { 0.555 };
        let early = |k: usize| if k < 99 { 0.555 } else { 555.0 };
        for mixed in [&late as &dyn Fn(usize) -> f64, &early] {
            assert_eq!(check(made(mixed), said(), "rays.spectrum").0, "wrong", "{format}");
        }
        let half = |k: usize| if k < 70 { 555.0 } else { 0.555 };
        assert_eq!(read(made(&half), said()).err().unwrap().code(), "rays.too_many_refused", "{format}");
    }
}

#[test]
fn a_unit_that_programs_leave_as_it_is_is_told_with_both_readings() {
    let text = String::from_utf8(prosource((Fact::Columns, Word::Good))).unwrap().replace("Meters 1000", "Meters 1.0");
    for name in ["rays.length_unit", "rays.size"] {
        assert_eq!(
            check(text.clone().into_bytes(), Declared { length_unit: None, ..said() }, name).0,
            "notice",
            "{name}"
        );
    }
    assert!(
        check(text.clone().into_bytes(), Declared { length_unit: None, ..said() }, "rays.size")
            .1
            .contains("9.0000 x 9.0000")
    );
    for (unit, size) in [(LengthUnit::Metre, 9000.0), (LengthUnit::Millimetre, 9.0)] {
        let source = read(text.clone().into_bytes(), Declared { length_unit: Some(unit), ..said() }).unwrap();
        assert!((source.survey.bounds_mm.size().x - size).abs() < 1e-6);
        assert_eq!(source.notices.count_of("rays.default_unit"), 0);
    }
}

#[test]
fn channels_that_can_hardly_belong_together_are_told() {
    let told = |scale: f64, shift: f64| {
        let moved: String =
            (0..RAYS).map(|k| format!("{} {} 0 0 0 1 2\n", scale * ray(k)[0] + shift, scale * ray(k)[1])).collect();
        let [one, two] = [rows(7), moved].map(|text| input(text.into_bytes(), said()));
        let two = Input { sha256: "1".repeat(64), ..two };
        let watch = StageWatch::enter(&NoProgress, Stage::Rays).unwrap();
        let source = Source::read(&[one, two], &RaysOptions::default(), &Limits::default(), watch).unwrap();
        ["rays.channel_sizes", "rays.channel_places"].map(|code| source.notices.count_of(code))
    };
    for (scale, shift, expected) in [
        (1.0, 0.5, [0, 0]),
        (2.0, 0.0, [0, 0]),
        (10.0, 0.0, [1, 0]),
        (25.4, 0.0, [1, 0]),
        (0.001, 0.0, [1, 0]),
        (1.0, 100.0, [0, 1]),
    ] {
        assert_eq!(told(scale, shift), expected, "{scale} {shift}");
    }
}
