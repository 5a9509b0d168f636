//! Files cut anywhere: every prefix of every fixture is refused, or read with a notice. Never a panic, never read in silence.

use lampwright::pipeline::rays::row_writer::Encode;
use lampwright::pipeline::rays::synthetic::{by_name, write_tm25};
use lampwright::pipeline::rays::tm25::additional::Additional;
use lampwright::pipeline::rays::tm25::header::{Flags, Header, SpectralId};
use lampwright::pipeline::rays::tm25::{self, Preamble, spectra::Spectra};
use lampwright::pipeline::rays::zemax_writer::{self, Rows};
use lampwright::pipeline::rays::{Bytes, RawRay};
use lampwright::pipeline::{Declared, Error, Input, LengthUnit, Limits, Quantity, Unwatched, Verdict, inspect, peek};
use std::io;
use std::sync::Arc;

/// The first bytes of a file.
struct Cut {
    whole: Arc<Vec<u8>>,
    length: usize,
}

impl Bytes for Cut {
    fn len(&self) -> u64 {
        self.length as u64
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        if offset.saturating_add(into.len() as u64) > self.len() {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        self.whole.read_at(offset, into)
    }
}

/// A few rays that every fixture may hold.
fn rays() -> Vec<RawRay> {
    let ray = |k: u32| RawRay {
        origin_mm: [0.25 * f64::from(k), -0.5, 0.125],
        direction: [0.0, 0.0, 1.0],
        radiant: 1.0,
        luminous: 100.0,
        wavelength_nm: 450.0 + f64::from(k),
        table: k % 2,
        xz: [1.0, 2.0],
    };
    (0..5).map(ray).collect()
}

fn known(name: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_tm25(&by_name(name).unwrap(), 5, 3, &mut bytes).unwrap();
    bytes
}

/// A TM-25 file with all that may stand before the rays: two tables, additional columns, additional text.
fn tm25_with_everything() -> Vec<u8> {
    let flags =
        Flags { radiant: true, wavelength: false, luminous: false, stokes: true, tristimulus: false, index: true };
    let header = Header { ray_count: 5, spectral_id: SpectralId::IndexPerRay, flags, ..Header::default() };
    let spectra = Spectra::new(vec![vec![(440.0, 0.5), (450.0, 1.0)], vec![(620.0, 1.0)]]);
    let additional = Additional { columns: vec!["phase".into(), "path".into()], text: "two\nlines".into() };
    let mut bytes = Vec::new();
    let mut writer = tm25::writer::Writer::start(&mut bytes, &Preamble::new(header, spectra, additional)).unwrap();
    let mut rows = Vec::new();
    rays().iter().for_each(|ray| writer.rows().encode_ray(ray, &mut rows));
    writer.write(&rows).unwrap();
    writer.finish().unwrap();
    bytes
}

fn zemax(rows: Rows) -> Vec<u8> {
    let header =
        zemax_writer::Header { ray_count: 5, description: "cut".into(), flux: 5.0, rows, ..Default::default() };
    let mut bytes = Vec::new();
    let mut writer = zemax_writer::Writer::start(&mut bytes, &header).unwrap();
    let mut encoded = Vec::new();
    rays().iter().for_each(|ray| rows.encode_ray(ray, &mut encoded));
    writer.write(&encoded).unwrap();
    writer.finish().unwrap();
    bytes
}

fn floats<const N: usize>(values: [f64; N]) -> Vec<u8> {
    values.iter().flat_map(|value| (*value as f32).to_le_bytes()).collect()
}

/// Rows of 28 bytes, as many formats have them.
fn words() -> Vec<u8> {
    let row = |RawRay { origin_mm: [x, y, z], direction: [l, m, n], radiant, .. }: RawRay| {
        floats([x, y, z, l, m, n, radiant])
    };
    rays().into_iter().flat_map(row).collect()
}

/// FORMATS.md 3: 44 bytes of header, rows, seven bytes at the end.
fn lighttools() -> Vec<u8> {
    let numbers = [2_u32, 0, 0, 0, 0, 1].into_iter().flat_map(u32::to_le_bytes);
    let header = b"LTRF".iter().copied().chain(numbers).chain(floats([0.0, 0.0, 0.0, 5.0]));
    header.chain(words()).chain(*b"LTRFEND").collect()
}

/// FORMATS.md 5: five records of 28 bytes, then as many rays as the fourth says.
fn asap() -> Vec<u8> {
    let mut bytes = 7415_i32.to_le_bytes().to_vec();
    bytes.resize(28, 0);
    bytes.extend(b"cut                     \x01\0\0\0");
    bytes.extend(b"Z       \0\0\0\0FLUX            ");
    bytes.extend(b"Y               \0\0\0\0\0\0\0\0");
    bytes.extend((-5_i32).to_le_bytes());
    bytes.extend(b"X               \0\0\0\0\0\0\0\0\x01\0\0\0");
    bytes.extend(words());
    bytes
}

/// A line per ray, ending in a line break.
fn lines() -> String {
    let line = |RawRay { origin_mm: [x, y, z], direction: [l, m, n], radiant, .. }: RawRay| {
        format!("{x:.4} {y:.4} {z:.4} {l:.4} {m:.4} {n:.4} {radiant:.4}\n")
    };
    rays().into_iter().map(line).collect()
}

fn lighttools_text() -> Vec<u8> {
    let head = "# cut\nlt_rdf_version: 2.0\ndataname: cut\nlt_datatype: radiant_power\nlt_radiant_flux: 5\n\
                lt_far_field_data: NO\nlt_color_info: none\nlt_length_units: millimeters\nlt_data_origin: 0 0 0\nlt_startofdata\n";
    format!("{head}{}lt_endofdata\n", lines()).into()
}

fn prosource() -> Vec<u8> {
    let head = "!! Source file: cut\n# NbrRays Requested: 5,  NbrRays Generated: 5\nConversion Factor From Meters 1000\n\
                X Pos Y Pos Z Pos X Vec Y Vec Z Vec Inc Flux\n";
    format!("{head}{}", lines()).into()
}

/// One row per format and form, and the most bytes that may be missing without anybody being able to tell: a line break at
/// the end is not part of what the file says. Speos files and plain columns are not here: they have neither count nor end,
/// and their first rays are a file of their own (`rows_without_count_or_end`).
fn fixtures() -> Vec<(&'static str, Vec<u8>, usize)> {
    vec![
        ("TM-25 with a table", known("flat-chip"), 0),
        ("TM-25 with wavelengths", known("four-chips"), 0),
        ("TM-25 with everything", tm25_with_everything(), 0),
        ("Zemax W", zemax(Rows::Radiant), 0),
        ("Zemax lm", zemax(Rows::Luminous), 0),
        ("Zemax spectral", zemax(Rows::Spectral), 0),
        ("Zemax text", format!("5 4\n{}", lines()).into(), 1),
        ("LightTools", lighttools(), 0),
        ("LightTools text", lighttools_text(), 1),
        ("ASAP", asap(), 0),
        ("ProSource text", prosource(), 1),
    ]
}

/// Files whose rows follow each other until the end, and where each row ends.
fn rows_without_count_or_end() -> Vec<(&'static str, Vec<u8>, Vec<usize>)> {
    let mut speos = floats([5.0, 2.0, 2.0, 2.0, 2.0, 2.0, 1000.0]);
    for ray in rays() {
        let ([x, y, z], [l, m, n]) = (ray.origin_mm, ray.direction);
        speos.extend(floats([x, y, z, l, m, n, ray.wavelength_nm, 1.0]));
    }
    let text = lines();
    let ends = text.match_indices('\n').map(|(at, _)| at + 1).collect();
    vec![("Speos", speos.clone(), (0..=5).map(|k| 28 + 32 * k).collect()), ("columns", text.into_bytes(), ends)]
}

/// Codes of the notices of a file that was read, and what is wrong with it.
fn inspected(whole: &Arc<Vec<u8>>, length: usize) -> Result<Vec<String>, Error> {
    let bytes = Arc::new(Cut { whole: Arc::clone(whole), length });
    let declared = Declared {
        length_unit: Some(LengthUnit::Millimetre),
        quantity: Some(Quantity::Radiant),
        ..Declared::default()
    };
    let input = Input { name: "cut".into(), sha256: String::new(), bytes, declared, notices: Vec::new() };
    let inspection = inspect(&input, &Limits::default(), &Unwatched)?;
    let wrong =
        inspection.checks.iter().filter(|check| check.verdict == Verdict::Wrong).map(|check| check.check.to_owned());
    Ok(inspection.notices.iter().map(|notice| notice.code.clone().into_owned()).chain(wrong).collect())
}

/// What a cut file is told; `None` where it is read as if nothing were missing.
fn told(name: &str, whole: &Arc<Vec<u8>>, of_whole: &[String], length: usize) -> Option<()> {
    match inspected(whole, length) {
        // Cut off is a finding of its own: what the whole file is told anyway does not count.
        Ok(codes) => codes.iter().any(|code| !of_whole.contains(code)).then_some(()),
        Err(Error::Malformed(fault) | Error::Refused(fault) | Error::Unusable(fault)) => {
            assert!(fault.at.is_some(), "{name}, {length} bytes: {fault:?} has no place");
            Some(())
        }
        Err(other) => panic!("{name}, {length} bytes: {other}"),
    }
}

#[test]
fn every_prefix_is_refused_or_read_with_a_notice() {
    for (name, bytes, spare) in fixtures() {
        let whole = Arc::new(bytes);
        let of_whole = inspected(&whole, whole.len()).unwrap_or_else(|error| panic!("{name} itself: {error}"));
        for length in 0..whole.len() - spare {
            assert!(told(name, &whole, &of_whole, length).is_some(), "{name}, {length} bytes: in silence");
        }
    }
}

#[test]
fn rows_without_a_count_are_read_in_silence_up_to_whole_rows_only() {
    for (name, bytes, ends) in rows_without_count_or_end() {
        let whole = Arc::new(bytes);
        let of_whole = inspected(&whole, whole.len()).unwrap_or_else(|error| panic!("{name} itself: {error}"));
        let silent: Vec<usize> =
            (0..whole.len()).filter(|length| told(name, &whole, &of_whole, *length).is_none()).collect();
        assert!(silent.iter().all(|length| ends.contains(length)), "{name}: read in silence up to {silent:?}");
    }
}

/// An upload is judged by its first bytes: a good file's prefix is never refused while the rest may still come.
#[test]
fn no_prefix_of_an_upload_is_refused_while_the_rest_may_come() {
    for (name, bytes, _) in fixtures() {
        for length in 0..bytes.len() {
            let verdict = peek(&bytes[..length], Some(bytes.len() as u64), &Limits::default());
            assert!(verdict.is_ok(), "{name}, {length} bytes: {verdict:?}");
        }
    }
}
