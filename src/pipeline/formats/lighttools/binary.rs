//! LightTools binary ray files, version 2 (`pipeline/formats/README.md` 3).
//!
//! The header's total is the total: the rays are relative by the number of rays traced. There is no ray count; the length of the
//! file gives it, and the trailer at its end proves it.

use crate::error::Error;
use crate::formats::binary::{Floats, Words, float, in_lumens, triple};
use crate::formats::bytes::{Cursor, f32_in, u32_in};
use crate::formats::proof;
use crate::formats::record::{Bytes, Facts, Format, RawRay, RaySet, SpectralData, TotalRule};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::{Flux, LengthUnit};
use std::sync::Arc;

/// Bytes of the header of version 2.
const HEADER: u64 = 44;
/// The last bytes of a whole file.
pub const TRAILER: &[u8] = b"LTRFEND";
/// What to do where the header cannot be meant.
const EXPORT_AGAIN: &str = "Export the file again.";

/// Opens a file of this format.
///
/// # Errors
/// As [`crate::formats::open`].
pub fn open(bytes: Arc<dyn Bytes>, limits: &Limits) -> Result<RaySet, Error> {
    let header = Header::read(&Cursor::new(bytes.as_ref(), 0).block("the header", HEADER)?)?;
    let mut notices = header.notices();
    let ray_count = header.ray_count(bytes.as_ref(), &mut notices)?;
    proof::count(ray_count, limits)?;
    let facts = header.facts(ray_count, notices);
    let (color, luminous) = (header.color, header.luminous == Some(true));
    let mm = header.unit.map_or(1.0, LengthUnit::mm);
    let ray = move |record: &Words| color.ray(record, luminous, mm);
    Ok(RaySet { facts, records: Box::new(Floats { bytes, start: HEADER, words: color.words(), ray }) })
}

/// Judges the header from the first bytes of a file that is `length` bytes long, if that is known. The length proves nothing
/// before the trailer is seen.
///
/// # Errors
/// As [`open`]; [`Error::Unreadable`] (end of file) when `bytes` holds too little to tell.
pub fn peek(bytes: &dyn Bytes, _length: Option<u64>) -> Result<(), Error> {
    let mut block = vec![0; HEADER as usize];
    bytes.read_at(0, &mut block)?;
    Header::read(&block).map(|_| ())
}

/// What a record holds after position and direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Color {
    /// Flux.
    None,
    /// Tristimulus X, Y, Z.
    Tristimulus,
    /// Flux and wavelength, nm.
    Wavelength,
}

impl Color {
    /// Numbers per record.
    fn words(self) -> usize {
        match self {
            Color::None => 7,
            Color::Wavelength => 8,
            Color::Tristimulus => 9,
        }
    }

    fn ray(self, record: &Words, luminous: bool, mm: f64) -> RawRay {
        let tristimulus = self == Color::Tristimulus;
        let flux = float(record, if tristimulus { 7 } else { 6 });
        RawRay {
            origin_mm: triple(record, 0, mm),
            direction: triple(record, 3, 1.0),
            radiant: if luminous { 0.0 } else { flux },
            luminous: if luminous { flux } else { 0.0 },
            wavelength_nm: if self == Color::Wavelength { float(record, 7) } else { 0.0 },
            xz: if tristimulus { [float(record, 6), float(record, 8)] } else { [0.0; 2] },
            ..RawRay::default()
        }
    }
}

/// The header, every field in its range.
struct Header {
    minor: u32,
    /// Flux is in lm; `None` where the data type does not exist.
    luminous: Option<bool>,
    color: Color,
    /// `None` for "system", the unit of a model we do not have, and for a code that does not exist.
    unit: Option<LengthUnit>,
    /// Codes that do not exist, and what has to be declared for them.
    told: Notices,
    origin: [f32; 3],
    total: f32,
}

/// A field of the header that holds what no version of the format has.
fn wrong(code: &'static str, name: &str, value: u32, known: &str, at: u64) -> Error {
    Error::malformed(code, format!("The {name} is {value}; only {known} exist."), EXPORT_AGAIN).at_byte(at)
}

impl Header {
    fn read(block: &[u8]) -> Result<Header, Error> {
        let field = |at| u32_in(block, at);
        version(field(4))?;
        let mut notices = Notices::default();
        let luminous = in_lumens(field(12).cast_signed(), "lighttools.data_type", "data type", &mut notices);
        near_field(field(16))?;
        let color = match field(20) {
            0 => Color::None,
            1 if luminous != Some(false) => Color::Tristimulus,
            1 => return Err(tristimulus_in_w(12)),
            2 => Color::Wavelength,
            other => {
                let known = "0 (none), 1 (tristimulus) and 2 (wavelength)";
                return Err(wrong("lighttools.color_info", "color information", other, known, 20));
            }
        };
        let unit = match field(24) {
            0 => None,
            1 => Some(LengthUnit::Millimetre),
            2 => Some(LengthUnit::Centimetre),
            3 => Some(LengthUnit::Metre),
            4 => Some(LengthUnit::Inch),
            5 => Some(LengthUnit::Foot),
            6 => Some(LengthUnit::Micrometre),
            7 => Some(LengthUnit::Nanometre),
            other => {
                let known = "0 to 7 (system, mm, cm, m, in, ft, um, nm)";
                let told = format!("The length unit is {other}; only {known} exist, so it is not said.");
                notices.add("lighttools.length_unit", told);
                None
            }
        };
        let origin = [28, 32, 36].map(|at| f32_in(block, at));
        let luminous = if color == Color::Tristimulus { Some(true) } else { luminous };
        Ok(Header { minor: field(8), luminous, color, unit, told: notices, origin, total: f32_in(block, 40) })
    }

    /// How many rays the length of the file proves. A whole file ends with its trailer; without it the records must prove
    /// themselves, and what is left over is no ray.
    fn ray_count(&self, bytes: &dyn Bytes, notices: &mut Notices) -> Result<u64, Error> {
        let (length, trailer) = (bytes.len(), TRAILER.len() as u64);
        let record_bytes = 4 * self.color.words() as u64;
        let body = length.saturating_sub(HEADER);
        let (count, rest) = (body / record_bytes, body % record_bytes);
        // At most a record: the end of a file without a trailer, or with the first bytes of one.
        let end = Cursor::new(bytes, length - rest).block("the end", rest)?;
        let last = Cursor::new(bytes, length - trailer.min(body)).block("the trailer", trailer.min(body))?;
        if last == TRAILER {
            let body = body - trailer;
            if body % record_bytes == 0 {
                return Ok(body / record_bytes);
            }
            let found = format!(
                "Between header and trailer are {body} bytes, which is no whole number of rays of {record_bytes} bytes."
            );
            return Err(Error::malformed("lighttools.size", found, "Fetch the file again.").at_byte(HEADER));
        }
        if count > 0 && !proof::directions_hold(bytes, HEADER, record_bytes, count)? {
            let found = format!("The file has no trailer, and rays of {record_bytes} bytes make no sense in it.");
            return Err(Error::malformed("lighttools.records", found, EXPORT_AGAIN).at_byte(HEADER));
        }
        if TRAILER.starts_with(&end) {
            let told = format!("The trailer is missing; the file may be cut. {count} rays were read.");
            notices.add("lighttools.no_trailer", told);
        } else {
            let told = format!(
                "The file is cut inside a ray: {count} rays were read, {rest} bytes after them were left out. The total of \
                 the header was kept and is spread over the rays at hand."
            );
            notices.add("lighttools.cut", told);
        }
        Ok(count)
    }

    /// The header's total, where it is one.
    fn total(&self) -> Option<f64> {
        Some(f64::from(self.total)).filter(|total| total.is_finite() && *total > 0.0)
    }

    fn notices(&self) -> Notices {
        let mut notices = self.told.clone();
        if self.total().is_none() {
            let told = "The header has no total; the sum of the rays was taken, which LightTools means to be relative.";
            notices.add("lighttools.no_total", told);
        }
        // Everything lives in the ray file's own axes (`pipeline/README.md`, frames): the data origin only says where these axes stood in
        // the model the rays were traced in, which is not the user's. All files at hand have 0 there.
        if self.origin.iter().any(|value| *value != 0.0) {
            let [x, y, z] = self.origin;
            let told =
                format!("The data origin is ({x}, {y}, {z}); positions were left as stored and not moved by it.");
            notices.add("lighttools.data_origin", told);
        }
        notices
    }

    fn facts(&self, ray_count: u64, notices: Notices) -> Facts {
        let luminous = self.luminous == Some(true);
        Facts {
            format: Format::LightToolsBinary,
            ray_count,
            header_flux: Flux {
                radiant_w: self.total().filter(|_| !luminous),
                luminous_lm: self.total().filter(|_| luminous),
            },
            total_rule: TotalRule::Header,
            has_radiant: !luminous,
            has_luminous: luminous,
            spectral: match self.color {
                Color::None => SpectralData::None,
                Color::Tristimulus => SpectralData::Tristimulus,
                Color::Wavelength => SpectralData::Wavelength,
            },
            length_unit: self.unit,
            quantity_unknown: self.luminous.is_none(),
            texts: self.texts(),
            notices,
        }
    }

    fn texts(&self) -> Vec<(String, String)> {
        let [x, y, z] = self.origin;
        let data_type = match self.luminous {
            Some(true) => "luminous flux",
            Some(false) => "radiant power",
            None => "",
        };
        [
            ("version", format!("2.{}", self.minor)),
            ("data_type", data_type.to_owned()),
            ("length_unit", self.unit.map_or("system", LengthUnit::symbol).to_owned()),
            ("data_origin", format!("{x} {y} {z}")),
            ("total_flux", self.total.to_string()),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .to_vec()
    }
}

/// Tristimulus values are lm.
pub fn tristimulus_in_w(at: u64) -> Error {
    let found = "The rays are tristimulus values, of which Y is luminous flux, but the data type is W.";
    Error::malformed("lighttools.data_type", found, EXPORT_AGAIN).at_byte(at)
}

/// Version 3 carries polarisation; its layout is not public in full.
fn version(major: u32) -> Result<(), Error> {
    let remedy = "Export it again without polarisation, or use the source's IES TM-25 or Zemax binary file.";
    match major {
        2 => Ok(()),
        3 => {
            let found = "This is a LightTools ray file of version 3, with polarised rays, which is not read.";
            Err(Error::refused("lighttools.polarised", found, remedy).at_byte(4))
        }
        other => {
            let found = format!("This is a LightTools ray file of version {other}; version 2 is read.");
            Err(Error::refused("lighttools.version", found, remedy).at_byte(4))
        }
    }
}

/// What rays without start points are refused with: they have no surface to be laid on.
pub fn far_field(at: u64) -> Error {
    let found = "This is far-field data: its rays have directions and no start points.";
    let remedy = "Export near-field rays; a source model needs to know where light starts.";
    Error::refused("lighttools.far_field", found, remedy).at_byte(at)
}

fn near_field(flag: u32) -> Result<(), Error> {
    match flag {
        0 => Ok(()),
        1 => Err(far_field(16)),
        other => Err(wrong("lighttools.far_field", "far-field flag", other, "0 and 1", 16)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file by the table of `pipeline/formats/README.md` 3: header fields by offset, rays, trailer.
    fn file(fields: &[(usize, u32)], rays: &[&[f32]]) -> Vec<u8> {
        let mut bytes = vec![0; HEADER as usize];
        let mut put = |at: usize, word: [u8; 4]| bytes[at..at + 4].copy_from_slice(&word);
        put(0, *b"LTRF");
        for (at, value) in [(4, 2), (24, 1)].iter().chain(fields) {
            put(*at, value.to_le_bytes());
        }
        put(40, 5.0_f32.to_le_bytes());
        bytes.extend(rays.iter().flat_map(|ray| ray.iter().flat_map(|value| value.to_le_bytes())));
        bytes.extend(TRAILER);
        bytes
    }

    const RAY: &[f32] = &[1.0, 2.0, 0.5, 0.6, 0.0, -0.8, 0.25];
    const COLORED: &[f32] = &[1.0, 2.0, 0.5, 0.6, 0.0, -0.8, 0.25, 450.0];
    const TRISTIMULUS: &[f32] = &[1.0, 2.0, 0.5, 0.6, 0.0, -0.8, 0.75, 0.25, 1.5];
    const LUMENS: (usize, u32) = (12, 1);

    fn opened(bytes: Vec<u8>) -> Result<(Facts, Vec<RawRay>), Error> {
        open(Arc::new(bytes), &Limits::default())?.read_all()
    }

    #[test]
    fn data_types_and_colors() {
        let base =
            RawRay { origin_mm: [1.0, 2.0, 0.5], direction: [0.6_f32, 0.0, -0.8].map(f64::from), ..RawRay::default() };
        let cases = [
            (file(&[], &[RAY; 4]), RawRay { radiant: 0.25, ..base }, SpectralData::None),
            (file(&[LUMENS], &[RAY; 4]), RawRay { luminous: 0.25, ..base }, SpectralData::None),
            (
                file(&[(20, 2)], &[COLORED; 4]),
                RawRay { radiant: 0.25, wavelength_nm: 450.0, ..base },
                SpectralData::Wavelength,
            ),
            (
                file(&[LUMENS, (20, 1)], &[TRISTIMULUS; 4]),
                RawRay { luminous: 0.25, xz: [0.75, 1.5], ..base },
                SpectralData::Tristimulus,
            ),
        ];
        for (bytes, ray, spectral) in cases {
            let (facts, rays) = opened(bytes).unwrap();
            assert_eq!((rays, &facts.spectral), (vec![ray; 4], &spectral));
            let luminous = ray.luminous > 0.0;
            assert_eq!((facts.has_radiant, facts.has_luminous), (!luminous, luminous));
            let total = |known: bool| known.then_some(5.0);
            assert_eq!(facts.header_flux, Flux { radiant_w: total(!luminous), luminous_lm: total(luminous) });
            assert_eq!((facts.total_rule, facts.notices), (TotalRule::Header, Notices::default()));
        }
    }

    #[test]
    fn units_and_the_data_origin() {
        let units = [None, Some(1.0), Some(10.0), Some(1000.0), Some(25.4), Some(304.8), Some(1e-3), Some(1e-6)];
        for (unit, mm) in (0..).zip(units) {
            let (facts, rays) = opened(file(&[(24, unit)], &[RAY])).unwrap();
            assert_eq!(facts.length_unit.map(LengthUnit::mm), mm);
            assert_eq!(rays[0].origin_mm, [1.0, 2.0, 0.5].map(|value| value * mm.unwrap_or(1.0)));
        }
        let (facts, rays) = opened(file(&[(32, 7.5_f32.to_bits())], &[RAY])).unwrap();
        assert_eq!((facts.notices.count_of("lighttools.data_origin"), rays[0].origin_mm), (1, [1.0, 2.0, 0.5]));
    }

    #[test]
    fn a_header_without_total_is_told() {
        for total in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            let mut bytes = file(&[], &[RAY]);
            bytes[40..44].copy_from_slice(&total.to_le_bytes());
            let (facts, _) = opened(bytes).unwrap();
            assert_eq!((facts.header_flux, facts.notices.count_of("lighttools.no_total")), (Flux::default(), 1));
        }
    }

    /// Header 44, rays 28 each; 7 bytes of trailer, whole, in part or missing.
    #[test]
    fn every_prefix_is_refused_or_read_with_a_notice() {
        let whole = file(&[], &[RAY; 3]);
        for length in 0..whole.len() {
            let set = crate::formats::open(Arc::new(whole[..length].to_vec()), None, &Limits::default());
            let Ok(set) = set else {
                assert!(length < 44, "{length}");
                continue;
            };
            let (count, rest) = ((length as u64 - 44) / 28, (length - 44) % 28);
            let expected = if rest == 0 || count == 3 { "lighttools.no_trailer" } else { "lighttools.cut" };
            assert_eq!((set.facts.ray_count, set.facts.notices.count_of(expected)), (count, 1), "{length}");
        }
        assert_eq!(opened(whole).unwrap().0.notices, Notices::default());
    }

    #[test]
    fn wrong_headers_have_names() {
        let cases: [(&[(usize, u32)], &str); 7] = [
            (&[(4, 3)], "lighttools.polarised"),
            (&[(4, 1)], "lighttools.version"),
            (&[(20, 1)], "lighttools.data_type"),
            (&[(16, 1)], "lighttools.far_field"),
            (&[(16, 2)], "lighttools.far_field"),
            (&[(20, 3)], "lighttools.color_info"),
            (&[(20, 2)], "lighttools.size"),
        ];
        for (fields, expected) in cases {
            let bytes = file(fields, &[RAY, RAY, RAY]);
            assert_eq!(opened(bytes.clone()).unwrap_err().code(), expected, "{fields:?}");
            let told = peek(&bytes[..44].to_vec(), None);
            assert_eq!(told.err().map(|error| error.code()), Some(expected).filter(|code| *code != "lighttools.size"));
        }
        // What does not exist is not said, and has to be declared.
        for (at, code) in [(12, "lighttools.data_type"), (24, "lighttools.length_unit")] {
            for value in [8, u32::MAX] {
                let (facts, _) = opened(file(&[(at, value)], &[RAY])).unwrap();
                assert_eq!((facts.notices.count_of(code), facts.quantity_unknown), (1, at == 12), "{value} at {at}");
                assert_eq!(facts.length_unit.is_none(), at == 24);
            }
        }
        // Seven rays of 32 bytes are eight of 28: without a trailer only the directions tell.
        let mut colored = file(&[], &[COLORED; 7]);
        colored.truncate(44 + 7 * 32);
        assert_eq!(opened(colored).unwrap_err().code(), "lighttools.records");
        let limits = Limits { max_rays: 1, ..Limits::default() };
        assert_eq!(open(Arc::new(file(&[], &[RAY; 2])), &limits).err().unwrap().code(), "rays.too_many");
    }
}
