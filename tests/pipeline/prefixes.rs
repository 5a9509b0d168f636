//! Files cut anywhere: every prefix of every fixture is refused, or read with a notice. Never a panic, never read in silence.

use lampwright::pipeline::rays::row_writer::Encode;
use lampwright::pipeline::rays::synthetic::{by_name, write_tm25};
use lampwright::pipeline::rays::tm25::additional::Additional;
use lampwright::pipeline::rays::tm25::header::{Flags, Header, SpectralId};
use lampwright::pipeline::rays::tm25::{self, Preamble, spectra::Spectra};
use lampwright::pipeline::rays::zemax_writer::{self, Rows};
use lampwright::pipeline::rays::{Bytes, RawRay};
use lampwright::pipeline::{Declared, Error, Input, Limits, Unwatched, inspect, peek};
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

/// One row per format and form; a new reader adds its own.
fn fixtures() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("TM-25 with a table", known("flat-chip")),
        ("TM-25 with wavelengths", known("four-chips")),
        ("TM-25 with everything", tm25_with_everything()),
        ("Zemax W", zemax(Rows::Radiant)),
        ("Zemax lm", zemax(Rows::Luminous)),
        ("Zemax spectral", zemax(Rows::Spectral)),
    ]
}

/// Codes of the notices of a file that was read.
fn inspected(whole: &Arc<Vec<u8>>, length: usize) -> Result<Vec<&'static str>, Error> {
    let bytes = Arc::new(Cut { whole: Arc::clone(whole), length });
    let input = Input { name: "cut".into(), sha256: String::new(), bytes, declared: Declared::default() };
    let inspection = inspect(&input, &Limits::default(), &Unwatched)?;
    Ok(inspection.notices.iter().map(|notice| notice.code).collect())
}

#[test]
fn every_prefix_is_refused_or_read_with_a_notice() {
    for (name, bytes) in fixtures() {
        let whole = Arc::new(bytes);
        let of_whole = inspected(&whole, whole.len()).unwrap_or_else(|error| panic!("{name} itself: {error}"));
        for length in 0..whole.len() {
            match inspected(&whole, length) {
                // Cut off is a finding of its own: what the whole file is told anyway does not count.
                Ok(codes) => {
                    assert!(codes.iter().any(|code| !of_whole.contains(code)), "{name}, {length} bytes: in silence")
                }
                Err(Error::Malformed(fault) | Error::Refused(fault)) => {
                    assert!(fault.at.is_some(), "{name}, {length} bytes: {fault:?} has no place");
                }
                Err(other) => panic!("{name}, {length} bytes: {other}"),
            }
        }
    }
}

/// An upload is judged by its first bytes: a good file's prefix is never refused while the rest may still come.
#[test]
fn no_prefix_of_an_upload_is_refused_while_the_rest_may_come() {
    for (name, bytes) in fixtures() {
        for length in 0..bytes.len() {
            let verdict = peek(&bytes[..length], Some(bytes.len() as u64), &Limits::default());
            assert!(verdict.is_ok(), "{name}, {length} bytes: {verdict:?}");
        }
    }
}
