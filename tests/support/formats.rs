//! A ray file in every format and form that is read, of as many rays as a test asks for.

use pipeline::formats::record::RawRay;
use pipeline::formats::tm25;
use pipeline::formats::tm25::Preamble;
use pipeline::formats::tm25::additional::Additional;
use pipeline::formats::tm25::header::{Flags, Header, SpectralId};
use pipeline::formats::tm25::spectra::Spectra;
use pipeline::formats::writer::Encode;
use pipeline::formats::zemax::writer;
use pipeline::formats::zemax::writer::Rows;
use pipeline::known_sources::{by_name, write_tm25};

/// A few rays that every fixture may hold.
fn rays(count: u32) -> Vec<RawRay> {
    let ray = |k: u32| RawRay {
        origin_mm: [0.25 * f64::from(k % 40), -0.5, 0.125],
        direction: [0.0, 0.0, 1.0],
        radiant: 1.0,
        luminous: 100.0,
        wavelength_nm: 450.0 + f64::from(k % 300),
        table: k % 2,
        xz: [1.0, 2.0],
    };
    (0..count).map(ray).collect()
}

fn known(name: &str, count: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_tm25(&by_name(name).unwrap(), count.into(), 3, &mut bytes).unwrap();
    bytes
}

/// A TM-25 file with all that may stand before the rays: two tables, additional columns, additional text.
fn tm25_with_everything(count: u32) -> Vec<u8> {
    let flags =
        Flags { radiant: true, wavelength: false, luminous: false, stokes: true, tristimulus: false, index: true };
    let header = Header { ray_count: count.into(), spectral_id: SpectralId::IndexPerRay, flags, ..Header::default() };
    let spectra = Spectra::new(vec![vec![(440.0, 0.5), (450.0, 1.0)], vec![(620.0, 1.0)]]);
    let additional = Additional { columns: vec!["phase".into(), "path".into()], text: "two\nlines".into() };
    let mut bytes = Vec::new();
    let mut writer = tm25::writer::Writer::start(&mut bytes, &Preamble::new(header, spectra, additional)).unwrap();
    let mut rows = Vec::new();
    rays(count).iter().for_each(|ray| writer.rows().encode_ray(ray, &mut rows));
    writer.write(&rows).unwrap();
    writer.finish().unwrap();
    bytes
}

fn zemax(rows: Rows, count: u32) -> Vec<u8> {
    let header = writer::Header {
        ray_count: count,
        description: "cut".into(),
        flux: f64::from(count),
        rows,
        ..Default::default()
    };
    let mut bytes = Vec::new();
    let mut writer = writer::Writer::start(&mut bytes, &header).unwrap();
    let mut encoded = Vec::new();
    rays(count).iter().for_each(|ray| rows.encode_ray(ray, &mut encoded));
    writer.write(&encoded).unwrap();
    writer.finish().unwrap();
    bytes
}

fn floats<const N: usize>(values: [f64; N]) -> Vec<u8> {
    values.iter().flat_map(|value| (*value as f32).to_le_bytes()).collect()
}

/// Rows of 28 bytes, as many formats have them.
fn words(count: u32) -> Vec<u8> {
    let row = |RawRay { origin_mm: [x, y, z], direction: [l, m, n], radiant, .. }: RawRay| {
        floats([x, y, z, l, m, n, radiant])
    };
    rays(count).into_iter().flat_map(row).collect()
}

/// pipeline/formats/README.md 3: 44 bytes of header, rows, seven bytes at the end.
fn lighttools(count: u32) -> Vec<u8> {
    let numbers = [2_u32, 0, 0, 0, 0, 1].into_iter().flat_map(u32::to_le_bytes);
    let header = b"LTRF".iter().copied().chain(numbers).chain(floats([0.0, 0.0, 0.0, f64::from(count)]));
    header.chain(words(count)).chain(*b"LTRFEND").collect()
}

/// pipeline/formats/README.md 5: five records of 28 bytes, then as many rays as the fourth says.
fn asap(count: u32) -> Vec<u8> {
    let mut bytes = 7415_i32.to_le_bytes().to_vec();
    bytes.resize(28, 0);
    bytes.extend(b"cut                     \x01\0\0\0");
    bytes.extend(b"Z       \0\0\0\0FLUX            ");
    bytes.extend(b"Y               \0\0\0\0\0\0\0\0");
    bytes.extend((-count.cast_signed()).to_le_bytes());
    bytes.extend(b"X               \0\0\0\0\0\0\0\0\x01\0\0\0");
    bytes.extend(words(count));
    bytes
}

/// A line per ray, ending in a line break.
fn lines(count: u32) -> String {
    let line = |RawRay { origin_mm: [x, y, z], direction: [l, m, n], radiant, .. }: RawRay| {
        format!("{x:.4} {y:.4} {z:.4} {l:.4} {m:.4} {n:.4} {radiant:.4}\n")
    };
    rays(count).into_iter().map(line).collect()
}

fn lighttools_text(count: u32) -> Vec<u8> {
    let head = format!(
        "# cut\nlt_rdf_version: 2.0\ndataname: cut\nlt_datatype: radiant_power\nlt_radiant_flux: {count}\n\
                lt_far_field_data: NO\nlt_color_info: none\nlt_length_units: millimeters\nlt_data_origin: 0 0 0\nlt_startofdata\n"
    );
    format!("{head}{}lt_endofdata\n", lines(count)).into()
}

fn prosource(count: u32) -> Vec<u8> {
    let head = format!(
        "!! Source file: cut\n# NbrRays Requested: {count},  NbrRays Generated: {count}\nConversion Factor From Meters 1000\n\
                X Pos Y Pos Z Pos X Vec Y Vec Z Vec Inc Flux\n"
    );
    format!("{head}{}", lines(count)).into()
}

/// One row per format and form that has a count or an end, and the most bytes that may be missing without anybody being able to
/// tell: a line break at the end is not part of what the file says.
pub fn with_count_or_end(count: u32) -> Vec<(&'static str, Vec<u8>, usize)> {
    vec![
        ("TM-25 with a table", known("flat-chip", count), 0),
        ("TM-25 with wavelengths", known("four-chips", count), 0),
        ("TM-25 with everything", tm25_with_everything(count), 0),
        ("Zemax W", zemax(Rows::Radiant, count), 0),
        ("Zemax lm", zemax(Rows::Luminous, count), 0),
        ("Zemax spectral", zemax(Rows::Spectral, count), 0),
        ("Zemax text", format!("{count} 4\n{}", lines(count)).into(), 1),
        ("LightTools", lighttools(count), 0),
        ("LightTools text", lighttools_text(count), 1),
        ("ASAP", asap(count), 0),
        ("ProSource text", prosource(count), 1),
    ]
}

/// Files whose rows follow each other until the end, and where each row ends.
pub fn without_count_or_end(count: u32) -> Vec<(&'static str, Vec<u8>, Vec<usize>)> {
    let mut speos = floats([f64::from(count), 2.0, 2.0, 2.0, 2.0, 2.0, 1000.0]);
    for ray in rays(count) {
        let ([x, y, z], [l, m, n]) = (ray.origin_mm, ray.direction);
        speos.extend(floats([x, y, z, l, m, n, ray.wavelength_nm, 1.0]));
    }
    let text = lines(count);
    let ends = text.match_indices('\n').map(|(at, _)| at + 1).collect();
    vec![("Speos", speos, (0..=count as usize).map(|k| 28 + 32 * k).collect()), ("columns", text.into_bytes(), ends)]
}
