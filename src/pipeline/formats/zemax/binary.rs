//! Zemax / OpticStudio binary source files, .dat and .sdf (`pipeline/formats/README.md` 2). Radiant ProSource and TracePro write the same.
//!
//! The reader follows the vendor's help page: of the header OpticStudio uses only the count, the unit, the format and the
//! flux type; what it calls the power of a file is the sum of its rays.

use crate::error::Error;
use crate::formats::binary::{Floats, Words, float, in_lumens, triple};
use crate::formats::bytes::{Cursor, ascii, f32_in, i32_in, u32_in};
use crate::formats::proof;
use crate::formats::record::{Bytes, Facts, Format, RawRay, RaySet, SpectralData, TotalRule};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::spectrum::Table;
use crate::vocabulary::units::{Flux, LengthUnit};
use crate::vocabulary::wavelength::{NM_PER_UM, WavelengthUnit};
use std::sync::Arc;

/// First word of a file: current, and the older one of Radiant ProSource.
pub const IDENTIFIERS: [i32; 2] = [1010, 8_675_309];
/// Bytes of the header.
pub const HEADER: u64 = 208;
/// Bytes of the header as 64-bit Linux programs write it that declare a field `long`: all after byte 140 is 4 bytes late.
const HEADER_LONG: u64 = 212;
/// Rays looked at to see whether their flux and wavelength are where they belong.
const SPECTRAL_RAYS: u64 = 64;
/// What is told of a file with wavelengths in nm.
const IN_NANOMETRES: &str = "Wavelengths stand in nm where the format has um; they were read as nm.";

/// Whether a file begins as one of these.
pub fn begins(start: &[u8]) -> bool {
    start.len() >= 4 && IDENTIFIERS.contains(&i32_in(start, 0))
}

/// Opens a file of this format.
///
/// # Errors
/// As [`crate::formats::open`].
pub fn open(bytes: Arc<dyn Bytes>, limits: &Limits) -> Result<RaySet, Error> {
    let header = Header::read(bytes.as_ref())?;
    let layout = header.layout(bytes.as_ref())?;
    proof::count(header.ray_count.into(), limits).map_err(|error| error.at_byte(4))?;
    let mut facts = header.facts(&layout);
    let spectral = Spectral::of(&layout, bytes.as_ref(), header.ray_count)?;
    spectral.notice(&mut facts.notices);
    let ray =
        move |record: &Words| layout.ray(record, if spectral == Spectral::InNanometres { 1.0 } else { NM_PER_UM });
    Ok(RaySet { facts, records: Box::new(Floats { bytes, start: layout.start, words: layout.words(), ray }) })
}

/// Judges the header from the first bytes of a file that is `length` bytes long, if that is known.
///
/// # Errors
/// As [`open`]; [`Error::Unreadable`] (end of file) when `bytes` holds too little to tell.
pub fn peek(bytes: &dyn Bytes, length: Option<u64>) -> Result<(), Error> {
    let mut block = vec![0; HEADER_LONG as usize];
    bytes.read_at(0, &mut block)?;
    let header = Header { ray_count: u32_in(&block, 4), block };
    match length {
        Some(_) => header.layout(bytes).map(|_| ()),
        None => Ok(()),
    }
}

/// The length unit of a code; text files have the same.
pub fn length_unit(code: i32) -> Option<LengthUnit> {
    match code {
        0 => Some(LengthUnit::Metre),
        1 => Some(LengthUnit::Inch),
        2 => Some(LengthUnit::Centimetre),
        3 => Some(LengthUnit::Foot),
        4 => Some(LengthUnit::Millimetre),
        _ => None,
    }
}

/// The same; a code that does not exist is told, and says nothing.
pub fn stored_unit(code: i32, notices: &mut Notices) -> Option<LengthUnit> {
    let unit = length_unit(code);
    if unit.is_none() {
        let told = format!("The length unit is {code}; only 0 to 4 (m, in, cm, ft, mm) exist, so it is not said.");
        notices.add("zemax.unit", told);
    }
    unit
}

/// Whether a flux type is lm; one that does not exist is told, and says nothing.
pub fn stored_flux_type(code: i32, notices: &mut Notices) -> Option<bool> {
    in_lumens(code, "zemax.flux_type", "flux type", notices)
}

/// The header, not yet believed.
struct Header {
    block: Vec<u8>,
    ray_count: u32,
}

/// Where records are and what is in them.
#[derive(Clone, Copy, Debug)]
struct Layout {
    /// Offset of the first record: [`HEADER`], [`HEADER_LONG`], or more where zeros were added.
    start: u64,
    /// Records hold a wavelength.
    spectral: bool,
    /// Flux type as stored.
    flux_type: i32,
    /// Length unit of positions, where there is one of its code.
    unit: Option<LengthUnit>,
}

impl Layout {
    /// Numbers per record.
    fn words(&self) -> usize {
        if self.spectral { 8 } else { 7 }
    }

    /// Flux is in lm.
    fn luminous(&self) -> bool {
        !self.spectral && self.flux_type == 1
    }

    /// The ray of a record whose wavelength, times `nm`, is in nm.
    fn ray(&self, record: &Words, nm: f64) -> RawRay {
        let flux = float(record, 6);
        RawRay {
            origin_mm: triple(record, 0, self.unit.map_or(1.0, LengthUnit::mm)),
            direction: triple(record, 3, 1.0),
            radiant: if self.luminous() { 0.0 } else { flux },
            luminous: if self.luminous() { flux } else { 0.0 },
            wavelength_nm: float(record, 7) * nm,
            ..RawRay::default()
        }
    }
}

impl Header {
    fn read(bytes: &dyn Bytes) -> Result<Header, Error> {
        let mut cursor = Cursor::new(bytes, 0);
        let mut block = cursor.block("the header", HEADER)?;
        // One more word, for the long header; the first record of a good file has it too.
        block.extend(cursor.block("the first record", 4.min(bytes.len() - HEADER))?);
        Ok(Header { ray_count: u32_in(&block, 4), block })
    }

    /// The layout that the length of the file and, under the long header, its directions prove.
    fn layout(&self, bytes: &dyn Bytes) -> Result<Layout, Error> {
        let length = bytes.len();
        let formats = [(HEADER, 192), (HEADER_LONG, 196)].map(|(start, at)| (start, i32_in(&self.block, at), at));
        let count = u64::from(self.ray_count);
        for (start, format, at) in formats {
            let record_bytes = if format == 2 { 32 } else { 28 };
            if matches!(format, 0 | 2)
                && length == start + count * record_bytes
                && (start == HEADER || proof::directions_hold(bytes, start, record_bytes, count)?)
            {
                return Ok(self.layout_at(start, format == 2, at));
            }
        }
        let (_, format, at) = formats[0];
        let record_bytes = if format == 2 { 32 } else { 28 };
        if matches!(format, 0 | 2)
            && let Some(start) = proof::counted_back(bytes, HEADER, HEADER, record_bytes, count)?
        {
            return Ok(self.layout_at(start, format == 2, at));
        }
        if !matches!(format, 0 | 2) {
            let found = format!("The ray format is {format}; only 0 (flux) and 2 (spectral) exist.");
            return Err(Error::malformed("zemax.ray_format", found, "Export the file again.").at_byte(192));
        }
        let found = format!(
            "The header announces {count} rays of {record_bytes} bytes, which makes {} bytes; the file has {length}.",
            HEADER + count * record_bytes
        );
        let remedy = "Fetch the file again if it is shorter than announced; export it again if it is longer.";
        Err(Error::malformed("zemax.size", found, remedy).at_byte(length.min(HEADER)))
    }

    fn layout_at(&self, start: u64, spectral: bool, format_at: usize) -> Layout {
        let (unit, flux_type) = (i32_in(&self.block, 136), i32_in(&self.block, format_at + 4));
        Layout { start, spectral, flux_type, unit: length_unit(unit) }
    }

    fn facts(&self, layout: &Layout) -> Facts {
        let float = |at| f32_in(&self.block, at);
        let mut notices = Notices::default();
        if layout.start == HEADER_LONG {
            let told = "The header is 212 bytes long, as written by programs with 64-bit `long`; it was read as such.";
            notices.add("zemax.long_header", told);
        } else if layout.start > HEADER_LONG {
            let told = format!(
                "Zeros stand between header and rays; counted back from the end of the file, the rays begin at byte {}.",
                layout.start
            );
            notices.add("zemax.over_padded", told);
        }
        stored_unit(i32_in(&self.block, 136), &mut notices);
        let mut quantity_unknown = false;
        if layout.spectral && layout.flux_type != 0 {
            notices.add(
                "zemax.flux_type",
                "Spectral rays are in W by definition; the flux type of the header was ignored.",
            );
        } else if !layout.spectral {
            quantity_unknown = stored_flux_type(layout.flux_type, &mut notices).is_none();
        }
        let total =
            [108, 112].map(|at| f64::from(float(at))).into_iter().find(|total| total.is_finite() && *total > 0.0);
        Facts {
            format: Format::ZemaxBinary,
            ray_count: u64::from(self.ray_count),
            header_flux: Flux {
                radiant_w: total.filter(|_| !layout.luminous()),
                luminous_lm: total.filter(|_| layout.luminous()),
            },
            total_rule: TotalRule::RaySum,
            has_radiant: !layout.luminous(),
            has_luminous: layout.luminous(),
            spectral: self.spectral(layout, &mut notices),
            length_unit: layout.unit,
            quantity_unknown,
            texts: self.texts(layout, quantity_unknown),
            notices,
        }
    }

    /// A wavelength in the header of a flux-only file is that of all its rays; 0 stands for a composite, NaN for nothing.
    fn spectral(&self, layout: &Layout, notices: &mut Notices) -> SpectralData {
        let stored = f64::from(f32_in(&self.block, 116));
        if layout.spectral {
            return SpectralData::Wavelength;
        }
        let nm = if WavelengthUnit::Micrometre.is_light(stored) {
            stored * NM_PER_UM
        } else if WavelengthUnit::Nanometre.is_light(stored) {
            notices.add("zemax.wavelength_nm", IN_NANOMETRES);
            stored
        } else {
            return SpectralData::None;
        };
        let told =
            format!("The header gives one wavelength for all rays, {nm:.1} nm; W and lm were converted with it.");
        notices.add("zemax.header_wavelength", told);
        Table::new(&[(nm, 1.0)]).map_or(SpectralData::None, SpectralData::Table)
    }

    fn texts(&self, layout: &Layout, quantity_unknown: bool) -> Vec<(String, String)> {
        let float = |at| f32_in(&self.block, at).to_string();
        let flux_unit = match (quantity_unknown, layout.luminous()) {
            (true, _) => "",
            (_, true) => "lm",
            _ => "W",
        };
        [
            ("identifier", i32_in(&self.block, 0).to_string()),
            ("description", ascii(self.block.get(8..108).unwrap_or_default())),
            ("source_flux", float(108)),
            ("ray_set_flux", float(112)),
            ("wavelength_um", float(116)),
            ("length_unit", layout.unit.map_or("", LengthUnit::symbol).to_owned()),
            ("flux_unit", flux_unit.to_owned()),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .to_vec()
    }
}

/// What the spectral column shows of a file when its first rays are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Spectral {
    /// Flux, then wavelength in µm.
    AsDocumented,
    /// Column 7 reads like wavelengths in µm and column 8 does not.
    LooksSwapped,
    /// Wavelengths are in nm: as µm they would be no light.
    InNanometres,
}

impl Spectral {
    fn of(layout: &Layout, bytes: &dyn Bytes, ray_count: u32) -> Result<Spectral, Error> {
        let looked = if layout.spectral { u64::from(ray_count).min(SPECTRAL_RAYS) } else { 0 };
        let block = Cursor::new(bytes, layout.start).block("the first rays", looked * 32)?;
        let all = |test: fn(f32, f32) -> bool| block.chunks_exact(32).all(|r| test(f32_in(r, 24), f32_in(r, 28)));
        Ok(match looked {
            0 => Spectral::AsDocumented,
            _ if all(|_, wavelength| WavelengthUnit::Nanometre.is_light(f64::from(wavelength))) => {
                Spectral::InNanometres
            }
            _ if all(|flux, wavelength| (0.2..=2.5).contains(&flux) && !(0.2..1.0).contains(&wavelength)) => {
                Spectral::LooksSwapped
            }
            _ => Spectral::AsDocumented,
        })
    }

    fn notice(self, notices: &mut Notices) {
        match self {
            Spectral::AsDocumented => {}
            Spectral::LooksSwapped => {
                let told =
                    "Flux and wavelength look as if they had changed places; they were read in the documented order.";
                notices.add("zemax.swapped_columns", told);
            }
            Spectral::InNanometres => notices.add("zemax.wavelength_nm", IN_NANOMETRES),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file by the table of `pipeline/formats/README.md` 2: header fields by offset, then rays.
    fn file(unit: i32, format: i32, flux_type: i32, rays: &[&[f32]]) -> Vec<u8> {
        let mut bytes = vec![0; HEADER as usize];
        let mut put = |at: usize, word: [u8; 4]| bytes[at..at + 4].copy_from_slice(&word);
        put(0, 1010_i32.to_le_bytes());
        put(4, (rays.len() as u32).to_le_bytes());
        put(8, *b"hand");
        put(108, 5.0_f32.to_le_bytes());
        put(136, unit.to_le_bytes());
        put(192, format.to_le_bytes());
        put(196, flux_type.to_le_bytes());
        bytes.extend(rays.iter().flat_map(|ray| ray.iter().flat_map(|value| value.to_le_bytes())));
        bytes
    }

    const RAY: &[f32] = &[1.0, 2.0, 0.5, 0.0, 0.0, 1.0, 0.25];
    const COLORED: &[f32] = &[1.0, 2.0, 0.5, 0.0, 0.0, 1.0, 0.125, 0.45];

    fn opened(bytes: Vec<u8>) -> Result<(Facts, Vec<RawRay>), Error> {
        open(Arc::new(bytes), &Limits::default())?.read_all()
    }

    #[test]
    fn units_and_fluxes() {
        for (unit, mm) in [(0, 1000.0), (1, 25.4), (2, 10.0), (3, 304.8), (4, 1.0)] {
            let (facts, rays) = opened(file(unit, 0, 1, &[RAY])).unwrap();
            assert_eq!(rays[0].origin_mm, [mm, 2.0 * mm, 0.5 * mm]);
            assert_eq!((rays[0].luminous, rays[0].radiant), (0.25, 0.0));
            assert_eq!(facts.header_flux, Flux { radiant_w: None, luminous_lm: Some(5.0) });
            assert_eq!(facts.spectral, SpectralData::None);
            assert_eq!(facts.total_rule, TotalRule::RaySum);
        }
        let (facts, rays) = opened(file(4, 2, 0, &[COLORED, COLORED])).unwrap();
        assert!((rays[1].wavelength_nm - 450.0).abs() < 1e-4 && rays[1].radiant == 0.125);
        assert_eq!(facts.notices, Notices::default());
        assert_eq!(facts.spectral, SpectralData::Wavelength);
    }

    #[test]
    fn a_header_with_64_bit_long_is_read_with_a_notice() {
        for (format, ray) in [(0, RAY), (2, COLORED)] {
            let mut bytes = file(4, format, 0, &[ray]);
            bytes.splice(140..140, [0; 4]);
            let (facts, rays) = opened(bytes).unwrap();
            assert_eq!(facts.notices.count_of("zemax.long_header"), 1);
            assert_eq!(rays[0].origin_mm, [1.0, 2.0, 0.5]);
        }
    }

    /// A header padded to a round number of bytes: the rays end with the file. What stands behind the rays is no padding.
    #[test]
    fn rays_are_counted_back_from_the_end_of_a_file_with_a_padded_header() {
        for (format, ray, padding) in [(0, RAY, 48), (2, COLORED, 304)] {
            let mut bytes = file(4, format, 0, &[ray, ray]);
            bytes.splice(208..208, vec![0; padding]);
            let (facts, rays) = opened(bytes.clone()).unwrap();
            assert_eq!(facts.notices.count_of("zemax.over_padded"), 1);
            assert_eq!((rays.len(), rays[1].origin_mm), (2, [1.0, 2.0, 0.5]));
            bytes[210] = 1;
            assert_eq!(opened(bytes).unwrap_err().code(), "zemax.size");
        }
        let mut behind = file(4, 0, 0, &[RAY, RAY]);
        behind.extend([0; 48]);
        assert_eq!(opened(behind).unwrap_err().code(), "zemax.size");
    }

    #[test]
    fn swapped_columns_are_told_and_not_touched() {
        let swapped: &[f32] = &[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.486, 1.0];
        let (facts, rays) = opened(file(4, 2, 0, &[swapped; 3])).unwrap();
        assert_eq!(facts.notices.count_of("zemax.swapped_columns"), 1);
        assert_eq!(rays[0].wavelength_nm, 1000.0);
    }

    /// Wavelengths of 100 and more in a column of µm are nm, in the records as in the header.
    #[test]
    fn wavelengths_in_nm_are_read_as_nm() {
        let nm: &[f32] = &[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.5, 450.0];
        let (facts, rays) = opened(file(4, 2, 0, &[nm; 3])).unwrap();
        assert_eq!((facts.notices.count_of("zemax.wavelength_nm"), rays[2].wavelength_nm), (1, 450.0));
        let (facts, rays) = opened(file(4, 2, 0, &[nm, COLORED])).unwrap();
        assert_eq!((facts.notices, rays[0].wavelength_nm), (Notices::default(), 450_000.0));
        let mut bytes = file(4, 0, 0, &[RAY]);
        bytes[116..120].copy_from_slice(&450.0_f32.to_le_bytes());
        let (facts, _) = opened(bytes).unwrap();
        assert_eq!(facts.notices.count_of("zemax.wavelength_nm"), 1);
        assert_eq!(facts.spectral.tables()[0].range_nm(), (450.0, 450.0));
    }

    /// The total of the header is the source's, or else that of the set.
    #[test]
    fn either_total_of_the_header_is_compared_with_the_rays() {
        for (source, set, expected) in [(5.0, 1.0, Some(5.0)), (0.0, 1.0, Some(1.0)), (0.0, f32::NAN, None)] {
            let mut bytes = file(4, 0, 0, &[RAY]);
            bytes[108..112].copy_from_slice(&f32::to_le_bytes(source));
            bytes[112..116].copy_from_slice(&f32::to_le_bytes(set));
            assert_eq!(opened(bytes).unwrap().0.header_flux.radiant_w, expected);
        }
    }

    #[test]
    fn a_header_wavelength_is_that_of_all_rays_and_nan_is_none() {
        for (um, expected) in [(0.55_f32, 1), (f32::NAN, 0), (0.0, 0), (-1.0, 0), (50.0, 0), (3e4, 0)] {
            let mut bytes = file(4, 0, 0, &[RAY]);
            bytes[116..120].copy_from_slice(&um.to_le_bytes());
            let (facts, _) = opened(bytes).unwrap();
            assert_eq!(facts.notices.count_of("zemax.header_wavelength"), expected);
            assert_eq!(facts.spectral.tables().len() as u64, expected);
        }
    }

    /// What does not exist is not said, and has to be declared.
    #[test]
    fn units_and_flux_types_that_do_not_exist() {
        let (facts, rays) = opened(file(9, 0, 0, &[RAY])).unwrap();
        assert_eq!((facts.length_unit, facts.notices.count_of("zemax.unit")), (None, 1));
        assert_eq!(rays[0].origin_mm, [1.0, 2.0, 0.5]);
        let (facts, rays) = opened(file(4, 0, 2, &[RAY])).unwrap();
        assert!(facts.quantity_unknown && facts.notices.count_of("zemax.flux_type") == 1);
        assert_eq!((facts.has_radiant, rays[0].radiant), (true, 0.25));
    }

    #[test]
    fn wrong_headers_name_their_byte() {
        let cases = [
            (file(4, 1, 0, &[RAY]), "zemax.ray_format"),
            (file(4, 2, 0, &[RAY]), "zemax.size"),
            (file(4, 0, 0, &[COLORED]), "zemax.size"),
        ];
        for (bytes, code) in cases {
            assert_eq!(opened(bytes).unwrap_err().code(), code);
        }
        let whole = file(4, 0, 0, &[RAY, RAY]);
        for length in 4..whole.len() {
            let Err(Error::Malformed(fault)) = opened(whole[..length].to_vec()) else { panic!("{length}") };
            assert!(fault.at.is_some());
        }
        let limits = Limits { max_rays: 1, ..Limits::default() };
        assert_eq!(open(Arc::new(whole), &limits).err().unwrap().code(), "rays.too_many");
    }
}
