//! Files to begin with, made here: known sources by our writers, other formats laid out by hand (`pipeline/formats/README.md`).

use crate::Kind;
use crate::pipeline::formats::record::RawRay;
use crate::pipeline::formats::tm25::additional::Additional;
use crate::pipeline::formats::tm25::header::{Flags, Header, SpectralId};
use crate::pipeline::formats::tm25::{self, Preamble, spectra::Spectra};
use crate::pipeline::formats::writer::Encode;
use crate::pipeline::formats::zemax::writer::{self, Rows};
use crate::pipeline::known_sources::{all, by_name, write_tm25};
use std::io::Write;

/// Rays per seed: enough for a surface, few enough for thousands of runs a second.
const RAYS: u64 = 40;

/// The seeds of one target.
pub fn of(kind: Kind) -> Vec<Vec<u8>> {
    let rays = rays();
    match kind {
        Kind::Tm25 => tm25_files(&rays),
        Kind::ZemaxBinary => [Rows::Radiant, Rows::Luminous, Rows::Spectral].map(|rows| zemax(rows, &rays)).into(),
        Kind::ZemaxText => vec![
            format!("{} 4\n{}", rays.len(), text(&rays, " ", false)).into(),
            format!("{} 0 2 0\r\n{}", rays.len(), text(&rays, "\t", true)).into(),
            format!("{}.000000 4.000000 0 0 0 0 0\n{}", rays.len(), text(&rays, " ", false)).into(),
        ],
        Kind::LightToolsBinary => (0..3).map(|color| lighttools(color, &rays)).collect(),
        Kind::LightToolsText => vec![lighttools_text("none", &rays), lighttools_text("wavelength", &rays)],
        Kind::Speos => vec![speos(&rays)],
        Kind::Asap => vec![asap(&rays)],
        Kind::ProSourceText => vec![prosource(&rays)],
        Kind::Columns => vec![
            text(&rays, " ", false).into(),
            text(&rays, ",", true).into(),
            format!("x;y;z;l;m;n;flux;wavelength\n{}", text(&rays, ";", true).replace('.', ",")).into(),
            format!("# x [mm]\ty\tz\tkx\tky\tkz\tpower [W]\n{}", text(&rays, "\t", false)).into(),
        ],
        Kind::Container => packed(&zemax(Rows::Radiant, &rays)),
        Kind::SpectrumFile => spectra(),
        Kind::Upload => {
            Kind::ALL.into_iter().filter(|(kind, _)| *kind != Kind::Upload).flat_map(|(kind, _)| of(kind)).collect()
        }
    }
}

/// A few rays of a known source.
fn rays() -> Vec<RawRay> {
    let mut rays = Vec::new();
    if let Some(source) = by_name("four-chips") {
        source.rays(7, RAYS, 0, RAYS as usize, &mut rays);
    }
    rays.iter_mut().for_each(|ray| {
        ray.luminous = 300.0 * ray.radiant;
        ray.xz = [ray.luminous, 0.5 * ray.luminous];
    });
    rays
}

/// Every known source, and every spectral identifier with all that can stand before the rays.
fn tm25_files(rays: &[RawRay]) -> Vec<Vec<u8>> {
    let mut files: Vec<Vec<u8>> = Vec::new();
    for source in all() {
        let mut bytes = Vec::new();
        write_tm25(&source, RAYS, 1, &mut bytes).expect("memory");
        files.push(bytes);
    }
    for spectral_id in SpectralId::ALL {
        let flags = Flags {
            radiant: spectral_id != SpectralId::None,
            wavelength: spectral_id == SpectralId::PerRay,
            luminous: matches!(spectral_id, SpectralId::None | SpectralId::OneTable),
            stokes: spectral_id == SpectralId::PerRay,
            tristimulus: spectral_id == SpectralId::None,
            index: spectral_id == SpectralId::IndexPerRay,
        };
        let header = Header {
            ray_count: rays.len() as u64,
            radiant_w: Some(2.0),
            luminous_lm: Some(400.0),
            spectral_id,
            wavelength_nm: Some(555.0),
            flags,
            ..Header::default()
        };
        let tables = match spectral_id {
            SpectralId::OneTable => 1,
            SpectralId::IndexPerRay => 4,
            _ => 0,
        };
        let spectra = (0..tables).map(|k| vec![(440.0 + k as f32, 0.5), (450.0 + k as f32, 1.0)]).collect();
        let additional = Additional { columns: vec!["phase".into()], text: "text".into() };
        let mut bytes = Vec::new();
        let preamble = Preamble::new(header, Spectra::new(spectra), additional);
        let mut writer = tm25::writer::Writer::start(&mut bytes, &preamble).expect("memory");
        writer.write(&rows(&writer.rows(), rays)).expect("memory");
        files.push(bytes);
    }
    files
}

fn rows(encoder: &impl Encode, rays: &[RawRay]) -> Vec<u8> {
    let mut rows = Vec::new();
    rays.iter().for_each(|ray| encoder.encode_ray(ray, &mut rows));
    rows
}

fn zemax(form: Rows, rays: &[RawRay]) -> Vec<u8> {
    let header = writer::Header {
        ray_count: rays.len() as u32,
        description: "seed".into(),
        flux: 2.4,
        wavelength_nm: None,
        rows: form,
    };
    let mut bytes = Vec::new();
    let mut writer = writer::Writer::start(&mut bytes, &header).expect("memory");
    writer.write(&rows(&form, rays)).expect("memory");
    bytes
}

fn floats(values: impl IntoIterator<Item = f64>) -> Vec<u8> {
    values.into_iter().flat_map(|value| (value as f32).to_le_bytes()).collect()
}

fn place(ray: &RawRay) -> impl Iterator<Item = f64> + use<> {
    ray.origin_mm.into_iter().chain(ray.direction)
}

/// `pipeline/formats/README.md` 3.
fn lighttools(color: u32, rays: &[RawRay]) -> Vec<u8> {
    let mut bytes = b"LTRF".to_vec();
    [2, 0, 0, 0, color, 1].into_iter().for_each(|word: u32| bytes.extend(word.to_le_bytes()));
    bytes.extend(floats([0.0, 0.0, 0.0, 2.4]));
    for ray in rays {
        bytes.extend(floats(place(ray)));
        bytes.extend(match color {
            0 => floats([ray.radiant]),
            1 => floats([ray.xz[0], ray.luminous, ray.xz[1]]),
            _ => floats([ray.radiant, ray.wavelength_nm]),
        });
    }
    bytes.extend(b"LTRFEND");
    bytes
}

fn lighttools_text(color: &str, rays: &[RawRay]) -> Vec<u8> {
    format!(
        "# made by hand\nlt_rdf_version: 2.0\ndataname: seed\nlt_datatype: radiant_power\nlt_radiant_flux: 2.4\n\
         lt_far_field_data: NO\nlt_color_info: {color}\nlt_length_units: millimeters\nlt_data_origin: 0 0 0\n\
         lt_startofdata\n{}lt_endofdata\n",
        text(rays, " ", color == "wavelength")
    )
    .into()
}

/// `pipeline/formats/README.md` 4.
fn speos(rays: &[RawRay]) -> Vec<u8> {
    let mut bytes = floats([2.4, 2.0, 2.0, 2.0, 2.0, 2.0, 700.0]);
    rays.iter().for_each(|ray| bytes.extend(floats(place(ray).chain([ray.wavelength_nm, 1.0]))));
    bytes
}

/// `pipeline/formats/README.md` 5.
fn asap(rays: &[RawRay]) -> Vec<u8> {
    let mut bytes = 7415_i32.to_le_bytes().to_vec();
    bytes.resize(28, 0);
    bytes.extend(b"seed                    \x01\0\0\0");
    bytes.extend(b"Z       \0\0\0\0FLUX            ");
    bytes.extend(b"Y               \0\0\0\0\0\0\0\0");
    bytes.extend((-(rays.len() as i32)).to_le_bytes());
    bytes.extend(b"X               \0\0\0\0\0\0\0\0\x01\0\0\0");
    rays.iter().for_each(|ray| bytes.extend(floats(place(ray).chain([ray.radiant]))));
    bytes
}

/// `pipeline/formats/README.md` 6.
fn prosource(rays: &[RawRay]) -> Vec<u8> {
    format!(
        "!! Source file: seed\n# NbrRays Requested: {count},  NbrRays Generated: {count}\n\
         Angular Range PolarBeg: 0, PolarEnd: 90, AzimuthBeg: 0, AzimuthEnd: 360\nRotation AboutX 0 AboutY 0 AboutZ 0\n\
         Translation X 0 Y 0 Z 0\nScale X 1 Y 1 Z 1\nConversion Factor From Meters 1000\n\
         X Pos Y Pos Z Pos X Vec Y Vec Z Vec Inc Flux\n{}",
        text(rays, " ", false),
        count = rays.len()
    )
    .into()
}

/// A line per ray: place, direction, flux, and a wavelength in nm.
fn text(rays: &[RawRay], separator: &str, wavelength: bool) -> String {
    let line = |ray: &RawRay| {
        let nm = wavelength.then_some(ray.wavelength_nm);
        let numbers: Vec<String> =
            place(ray).chain([ray.radiant]).chain(nm).map(|value| format!("{value:.7}")).collect();
        numbers.join(separator) + "\n"
    };
    rays.iter().map(line).collect()
}

/// One file in every packing, and two in a zip.
fn packed(file: &[u8]) -> Vec<Vec<u8>> {
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    gzip.write_all(file).expect("memory");
    let zstd = ruzstd::encoding::compress_to_vec(file, ruzstd::encoding::CompressionLevel::Fastest);
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, method) in [("a.dat", zip::CompressionMethod::Stored), ("b/c.dat", zip::CompressionMethod::Deflated)] {
        let options = zip::write::SimpleFileOptions::default().compression_method(method);
        zip.start_file(name, options).expect("memory");
        zip.write_all(file).expect("memory");
    }
    vec![gzip.finish().expect("memory"), zstd, zip.finish().expect("memory").into_inner()]
}

/// Spectra as people keep them.
fn spectra() -> Vec<Vec<u8>> {
    [
        "400 0\n450 1\n500 0\n",
        "wavelength;intensity\n400,0;0,1\n450,5;1\n",
        "# LightTools spectral region\nSpectralRegion\n0.40 0.1\n0.45 1.0\n",
        "OSRAM\r\nlambda [nm]\tE [%]\r\n380\t0.0\r\n381\t0.5\r\n",
        "OPTIS - Spectrum file v1.0\nseed\n3\n400 0\n450 100\n500 0\n",
    ]
    .map(|text| text.as_bytes().to_vec())
    .into()
}
