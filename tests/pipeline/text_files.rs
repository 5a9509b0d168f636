//! Ray files in text, laid out by hand from `pipeline/formats/README.md`: every cut, every range, any number of threads.
#![expect(clippy::unwrap_used, reason = "clippy.toml allows it in #[test] functions only, and these are their tools")]

use pipeline::formats::record::{Facts, RawRay};
use pipeline::rays::declared::open;
use pipeline::{Declared, Error, Input, LengthUnit, Limits, NoProgress, Options, Quantity, run};
use std::fmt::Write;
use std::sync::Arc;

const LIGHTTOOLS: &str = "# LightTools 8.7.0 \r\nlt_rdf_version: 2.0\r\nlt_datatype: radiant_power\r\nlt_far_field_data: no\r\n\
    lt_color_info: none\r\nlt_length_units: millimeters\r\nlt_data_origin: 0 0 0\r\nlt_radiant_flux: 3\r\nlt_startofdata\r\n\
    \u{20} 1 2 3 0 0 1 1.5\r\n 4 5 6 1.0e-016 0 -1 0.5\r\n 7 8 9 0 1 0 2.25\r\nlt_endofdata";
const ZEMAX: &str = "3 4 0 1\n1 2 3 0 0 1 1.5\n4 5 6 0 0 -1 0.5\n7 8 9 0 1 0 2.25\n";
const TRACEPRO: &str = "!! Source file: led.dat\n# NbrRays Requested: 3,  NbrRays Generated: 3\nAngular Range PolarBeg: 0.0, PolarEnd: 90.0\n\
    Conversion Factor From Meters 1.000000E+003\nX Pos Y Pos Z Pos X Vec Y Vec Z Vec Inc Flux\n\
    1.0E+000 2 3 0 0 1 1.5\n4 5 6 0 0 -1 0.5\n7 8 9 0 1 0 2.25\n";
const NAMED: &str = "x [mm],y [mm],z [mm],kx,ky,kz,power_W,wavelength (nm)\n1,2,3,0,0,1,1.5,450\n4,5,6,0,0,-1,0.5,550\n7,8,9,0,1,0,2.25,650\n";

fn read(bytes: &[u8]) -> Result<(Facts, Vec<RawRay>), Error> {
    let set = open(Arc::new(bytes.to_vec()), &Declared::default(), &Limits::default())?;
    let mut rays = Vec::new();
    set.records.read(0, set.facts.ray_count as usize, &mut rays)?;
    Ok((set.facts, rays))
}

/// A cut file is refused or read with a notice. Where the format has neither count nor end, a file cut between two lines is a
/// shorter file.
#[test]
fn every_cut_is_refused_or_told() {
    for (text, has_count_or_end) in [(LIGHTTOOLS, true), (ZEMAX, true), (TRACEPRO, true), (NAMED, false)] {
        let whole = read(text.as_bytes()).unwrap();
        assert_eq!((whole.1.len(), whole.0.notices.iter().count()), (3, 0), "{text}");
        let (mut refused, mut told) = (0, 0);
        for length in 0..text.len() {
            let start = &text.as_bytes()[..length];
            match read(start) {
                Err(Error::Unreadable(error)) => panic!("{length} bytes of {text}: {error}"),
                Err(_) => refused += 1,
                Ok((facts, rays)) => {
                    assert_eq!(rays.len() as u64, facts.ray_count);
                    assert!(whole.1.starts_with(&rays[..rays.len().saturating_sub(1)]), "{length} bytes of {text}");
                    let between_lines = !has_count_or_end && start.ends_with(b"\n") || start.ends_with(b"\r");
                    assert!(facts.notices.iter().count() > 0 || between_lines, "{length} bytes of {text}");
                    told += 1;
                }
            }
        }
        assert!(refused > 40 && told > 0, "{refused} {told}");
    }
}

/// Rows with their own number in every place where a wrong row would show.
fn many_rows(rows: u64) -> String {
    let mut text = "# x y z l m n flux\n".to_owned();
    for row in 0..rows {
        // Comments, blank lines and lines of unlike length between rows: offsets cannot be computed, only found.
        match row % 5 {
            0 => writeln!(text, "# row {row}").unwrap(),
            1 => text.push_str("\r\n\n"),
            _ => {}
        }
        let (x, y) = (row as f64 / 8.0, row % 97);
        let padding = " ".repeat((row % 13) as usize);
        writeln!(text, "{x}{padding} {y} -1.5 0 0 1 {}", row + 1).unwrap();
    }
    text
}

fn row(index: u64) -> RawRay {
    RawRay {
        origin_mm: [index as f64 / 8.0, (index % 97) as f64, -1.5],
        direction: [0.0, 0.0, 1.0],
        radiant: (index + 1) as f64,
        ..RawRay::default()
    }
}

#[test]
fn any_range_of_many_rows_is_the_same_as_the_whole() {
    const ROWS: u64 = 40_000;
    let set = open(Arc::new(many_rows(ROWS).into_bytes()), &Declared::default(), &Limits::default()).unwrap();
    assert_eq!(set.facts.ray_count, ROWS);
    let whole: Vec<RawRay> = (0..ROWS).map(row).collect();
    for (first, count) in
        [(0, 40_000), (0, 1), (16_383, 2), (16_384, 16_384), (32_767, 7_233), (39_999, 1), (7, 20_011), (16_385, 0)]
    {
        let mut rays = Vec::new();
        set.records.read(first, count, &mut rays).unwrap();
        assert!(rays == whole[first as usize..first as usize + count], "{first} {count}");
    }
    let limits = Limits { max_rays: ROWS - 1, ..Limits::default() };
    let refusal = open(Arc::new(many_rows(ROWS).into_bytes()), &Declared::default(), &limits).err().unwrap();
    assert_eq!(refusal.code(), "rays.too_many");
}

#[test]
fn a_model_is_the_same_on_any_number_of_threads() {
    let text = many_rows(40_000);
    let declared = Declared {
        length_unit: Some(LengthUnit::Micrometre),
        quantity: Some(Quantity::Luminous),
        ..Declared::default()
    };
    let input = Input {
        name: "columns".into(),
        sha256: String::new(),
        bytes: Arc::new(text.into_bytes()),
        declared,
        notices: Vec::new(),
    };
    let built = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            run(std::slice::from_ref(&input), &Options::default(), &Limits::default(), &NoProgress).unwrap()
        })
    };
    let (one, three) = (built(1), built(3));
    // 1 + 2 + .. + 40 000 lm.
    assert!((one.model.flux.luminous_lm.unwrap() / 800_020_000.0 - 1.0).abs() < 1e-12);
    assert_eq!(one.artifacts.len(), three.artifacts.len());
    for (a, b) in one.artifacts.iter().zip(&three.artifacts) {
        assert!(a.bytes == b.bytes, "{}", a.name);
    }
}
