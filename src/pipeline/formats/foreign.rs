//! What is no ray file, and ray files whose layout is not public: refused by name, with what to take instead (`pipeline/formats/README.md` 0
//! and 6). Content decides here too: a download page saved as `.ray` is a page.

use super::bytes::{i32_in, word_in};
use super::proof;
use crate::error::Error;

/// What to take instead of most things.
pub const EXPORT: &str = "Use the same source's IES TM-25 or Zemax binary file; vendors offer both.";
/// What to do with a measurement model.
const FROM_MODEL: &str =
    "Export rays from it with ProSource, as IES TM-25 or Zemax binary, or take the vendor's ray file.";
/// What to do with a spectrum.
const NAME_SPECTRUM: &str = "Send the ray file, and name this as the spectrum of its channel in the job.";

/// The file of a GLDF file that says what it is; other zips may have a file of this name.
pub const GLDF_PRODUCT: &str = "product.xml";
/// The code of a GLDF file, and of the file that says what it is.
pub const GLDF: &str = "detect.gldf";

/// The refusal of a GLDF file.
pub fn gldf() -> Error {
    refused(GLDF, "a GLDF file (surfaces and photometry of a luminaire, without rays)", EXPORT)
}

/// Whether a document with this start is [`GLDF_PRODUCT`] of a GLDF file: its root names the schema.
pub fn is_gldf_product(start: &[u8]) -> bool {
    is_gldf(&String::from_utf8_lossy(start).to_lowercase())
}

fn is_gldf(lower: &str) -> bool {
    lower.find("<root").and_then(|from| lower.get(from..)?.split('>').next()).is_some_and(|root| root.contains("gldf"))
}

/// First bytes, code, and what such a file is.
const MAGIC: [(&[u8], &str, &str); 25] = [
    (b"Rar!\x1a\x07", "detect.archive", "a RAR archive"),
    (b"7z\xbc\xaf\x27\x1c", "detect.archive", "a 7z archive"),
    (b"\xfd7zXZ\0", "detect.archive", "an xz archive"),
    (b"BZh", "detect.archive", "a bzip2 archive"),
    (b"%PDF", "detect.document", "a PDF document"),
    (b"{\\rtf", "detect.document", "an RTF document"),
    (
        b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1",
        "detect.document",
        "a compound document, as old Office and CAD programs write",
    ),
    (b"\x89PNG\r\n", "detect.image", "a PNG image"),
    (b"\xff\xd8\xff", "detect.image", "a JPEG image"),
    (b"GIF8", "detect.image", "a GIF image"),
    (b"II*\0", "detect.image", "a TIFF image"),
    (b"MM\0*", "detect.image", "a TIFF image"),
    (b"ISO-10303-21", "detect.cad", "a STEP model"),
    (b"solid ", "detect.cad", "an STL model"),
    (b"glTF", "detect.cad", "a glTF model"),
    (b"ACIS BinaryFile", "detect.cad", "an ACIS model"),
    (b"ASM BinaryFile", "detect.cad", "an ACIS model"),
    (b"**ABCDEFGHIJKLMNOPQRSTUVWXYZ", "detect.cad", "a Parasolid model"),
    (b"3D Geometry File Format ", "detect.cad", "a Rhino model"),
    (b"AutoCAD Binary DXF", "detect.cad", "a DXF drawing"),
    (b"AC10", "detect.cad", "a DWG drawing"),
    (b"\x89HDF\r\n", "detect.data", "an HDF5 data file"),
    (b"\x93NUMPY", "detect.data", "a NumPy array"),
    (b"MATLAB 5.0 MAT-file", "detect.data", "a MATLAB data file"),
    (b"SQLite format 3\0", "detect.data", "an SQLite database"),
];

/// Names in a binary header, lower case, with code, what such a file is, and what to do. A hint, not a proof, and only asked
/// where nothing else fits.
const MAKERS: [(&str, &str, &str, &str); 12] = [
    ("radiant source", "detect.radiant_model", "a Radiant source model (.rsm, .rsmx, .rs8)", FROM_MODEL),
    ("radiant imaging", "detect.radiant_model", "a Radiant source model (.rsm, .rsmx, .rs8)", FROM_MODEL),
    ("radiant zemax", "detect.radiant_model", "a Radiant source model (.rsm, .rsmx, .rs8)", FROM_MODEL),
    ("radiant vision", "detect.radiant_model", "a Radiant source model (.rsm, .rsmx, .rs8)", FROM_MODEL),
    ("tracepro", "detect.tracepro", "a TracePro binary file", EXPORT),
    ("lambda research", "detect.tracepro", "a TracePro binary file", EXPORT),
    ("lucidshape", "detect.lucidshape", "a LucidShape file", EXPORT),
    ("opticad", "detect.opticad", "an OPTICAD file", EXPORT),
    ("photon engineering", "detect.fred", "a FRED file (.fcr, .frbs)", EXPORT),
    ("fredray", "detect.fred", "a FRED file (.fcr, .frbs)", EXPORT),
    ("photopia", "detect.photopia", "a Photopia file", EXPORT),
    ("simulux", "detect.simulux", "a SimuLux file", EXPORT),
];

/// Words that start a line of an OpticStudio coating file.
const COATING_WORDS: [&str; 6] = ["MATE ", "COAT ", "TAPR ", "TABLE ", "IDEAL ", "IDEAL2 "];
/// Lines before the numbers of a spectrum.
const SPECTRUM_HEAD: usize = 16;
/// Headers, bytes, under which rays of an unknown format are looked for.
const CLOSED_HEADER: std::ops::RangeInclusive<usize> = 4..=1024;
/// Sizes of such rays, bytes: position, direction, flux, and at most two numbers more.
const CLOSED_RAYS: [usize; 3] = [28, 32, 36];

fn refused(code: &'static str, what: &str, remedy: &str) -> Error {
    Error::refused(code, format!("This is {what}, not a ray file."), remedy).at_byte(0)
}

/// The refusal of a file that starts with `start`, where its first bytes name it.
pub fn by_magic(start: &[u8]) -> Option<Error> {
    if is_ray_database(start) {
        return Some(refused("detect.ray_database", RAY_DATABASE, SAVE_SOURCE));
    }
    let (_, code, what) = MAGIC.into_iter().find(|(magic, ..)| start.starts_with(magic))?;
    let remedy = if code == "detect.archive" { "Unpack it and send the ray file inside." } else { EXPORT };
    Some(refused(code, what, remedy))
}

/// What an OpticStudio ray database is, and what to save in its place.
const RAY_DATABASE: &str = "an OpticStudio ray database (.zrd): the ways of rays through a model, segment by segment";
const SAVE_SOURCE: &str = "Trace again in OpticStudio with Save Rays to a .sdf or .dat file in place of the .zrd, with the number of the object \
    that the rays hit before its name (3-led.sdf); or use the source's IES TM-25 or Zemax binary file.";

/// A ray database: a version, 2002 and later, with 10000 or 20000 more where it is compressed; the most segments of a ray; the
/// segments of the first ray.
fn is_ray_database(start: &[u8]) -> bool {
    let (version, most, first) = (i32_in(start, 0), i32_in(start, 4), i32_in(start, 8));
    let known = matches!(version / 10_000, 0..=2) && (2000..=2030).contains(&(version % 10_000));
    start.len() >= 12 && known && (1..=100_000).contains(&most) && (1..=most).contains(&first)
}

/// Whether a file begins as one of some kind.
type Begins = fn(&[u8]) -> bool;

/// Names of the binary formats, and whether bytes that are in the other order begin as one of their files.
const SWAPPED: [(&str, Begins); 5] = [
    ("an IES TM-25 file", |start| start.starts_with(b"TM25") && (2000..=2100).contains(&turned(start, 4))),
    ("a LightTools file", |start| start.starts_with(b"LTRF") && matches!(turned(start, 4), 1..=9)),
    ("a Zemax binary file", |start| matches!(turned(start, 0), 1010 | 8_675_309)),
    ("an ASAP file", |start| (7..=16).any(|words| turned(start, 0) == 247 + 1024 * words)),
    ("a Speos file", |start| start.len() >= 28 && (1..6).all(|k| turned(start, 4 * k) == 0x4000_0000)),
];

/// The integer at `at` with its bytes in the other order.
fn turned(start: &[u8], at: usize) -> i32 {
    i32::from_be_bytes(word_in(start, at))
}

/// The refusal of a ray file whose numbers have their bytes in the other order.
pub fn swapped(start: &[u8]) -> Option<Error> {
    let (what, _) = SWAPPED.into_iter().find(|(_, is)| start.len() >= 8 && is(start))?;
    let found = format!("This is {what} whose numbers have their bytes in the wrong order (big-endian).");
    Some(Error::refused("detect.byte_order", found, "Write the file again with little-endian numbers.").at_byte(0))
}

/// The refusal of a text that is no ray file; `None` for binary content and for text that may be one. `whole`: `start` is all of
/// it.
pub fn by_text(start: &[u8], whole: bool) -> Option<Error> {
    let (text, wide) = decoded(start)?;
    let (code, what, remedy) = match named(&text, whole) {
        Some(named) => named,
        None if wide && maker(start).is_some() => return maker(start),
        None if wide => ("detect.utf16", "text in UTF-16", "Save it as UTF-8 and send it again."),
        None => return None,
    };
    Some(refused(code, what, remedy))
}

/// The text, and whether it is in UTF-16, as OpticStudio and PowerShell write.
fn decoded(start: &[u8]) -> Option<(String, bool)> {
    let wide = |word: fn([u8; 2]) -> u16| {
        let (pairs, _) = start.as_chunks::<2>();
        let units: Vec<u16> = pairs.iter().skip(1).map(|pair| word(*pair)).collect();
        Some((String::from_utf16_lossy(&units), true))
    };
    match start {
        [0xff, 0xfe, ..] => wide(u16::from_le_bytes),
        [0xfe, 0xff, ..] => wide(u16::from_be_bytes),
        _ if is_wide(start, 1) => unmarked(start, u16::from_le_bytes),
        _ if is_wide(start, 0) => unmarked(start, u16::from_be_bytes),
        _ if start.contains(&0) => None,
        _ => Some((String::from_utf8_lossy(start).trim_start_matches('\u{feff}').to_owned(), false)),
    }
}

/// UTF-16 without a mark: of nine in ten pairs of bytes, one, always the first or always the second, is NUL, and the other plain.
fn is_wide(start: &[u8], nul: usize) -> bool {
    let (pairs, _) = start.as_chunks::<2>();
    let narrow = |pair: &&[u8; 2]| pair.get(nul) == Some(&0) && pair.get(1 - nul).is_some_and(|byte| is_plain(*byte));
    pairs.len() >= 4 && 10 * pairs.iter().filter(narrow).count() >= 9 * pairs.len()
}

fn is_plain(byte: u8) -> bool {
    byte.is_ascii_graphic() || byte.is_ascii_whitespace()
}

/// The text of UTF-16 without a mark.
fn unmarked(start: &[u8], word: fn([u8; 2]) -> u16) -> Option<(String, bool)> {
    let (pairs, _) = start.as_chunks::<2>();
    let units: Vec<u16> = pairs.iter().map(|pair| word(*pair)).collect();
    Some((String::from_utf16_lossy(&units), true))
}

type Named = (&'static str, &'static str, &'static str);

/// What a text is, where it is something we know to be no rays.
fn named(text: &str, whole: bool) -> Option<Named> {
    let all: Vec<&str> = text.lines().map(str::trim).collect();
    let text = text.trim_start();
    let mut lines: Vec<&str> = text.lines().map(str::trim).collect();
    if !whole {
        // It may end inside a line.
        lines.pop();
    }
    if text.starts_with('<') {
        return Some(markup(&text.to_lowercase()));
    }
    if is_json(text) {
        return Some(("detect.json", "JSON", EXPORT));
    }
    if text.starts_with("IESNA") || text.starts_with("IES:LM-63") || lines.iter().any(|line| line.starts_with("TILT="))
    {
        return Some(("detect.photometry", "an IES photometric file: directions without places", EXPORT));
    }
    // The first line of EULUMDAT, the company, may be empty.
    if is_eulumdat(&lines) || is_eulumdat(&all) {
        return Some(("detect.photometry", "an EULUMDAT photometric file: directions without places", EXPORT));
    }
    let content = lines.iter().find(|line| !(line.is_empty() || line.starts_with('!')));
    if content.is_some_and(|line| COATING_WORDS.iter().any(|word| line.starts_with(word))) {
        return Some(("detect.coating", "an OpticStudio coating file", EXPORT));
    }
    if text.starts_with("VERS ") && lines.iter().any(|line| line.starts_with("MODE ")) {
        return Some(("detect.lens", "an OpticStudio lens file (.zmx): it names ray files and holds none", EXPORT));
    }
    if text.starts_with("OPTIS - ") && !text.to_lowercase().contains("spectrum") {
        return Some(("detect.speos_text", "a Speos text file", EXPORT));
    }
    if text.starts_with("OPTIS - ") || is_spectrum(&lines) {
        return Some(("detect.spectrum", "a spectrum", NAME_SPECTRUM));
    }
    if is_dxf(&lines) || is_iges(text) {
        return Some(("detect.cad", "a CAD drawing (DXF or IGES)", EXPORT));
    }
    None
}

/// `lower`: starts with `<`.
fn markup(lower: &str) -> Named {
    let has = |word: &str| lower.contains(word);
    if has("<html") || has("<!doctype html") {
        let remedy = "Sign in, download the file again, and look at it before sending it.";
        ("detect.html", "a web page, perhaps the vendor's sign-in page saved under the file's name", remedy)
    } else if has("iestm27") {
        ("detect.spectrum", "an IES TM-27 spectrum", NAME_SPECTRUM)
    } else if has("<iestm33") || has("<luminaireopticaldata") {
        ("detect.photometry", "an IES TM-33 photometric file: directions without places", EXPORT)
    } else if is_gldf(lower) {
        (GLDF, "the product.xml of a GLDF file", EXPORT)
    } else {
        ("detect.xml", "XML", EXPORT)
    }
}

fn is_json(text: &str) -> bool {
    let after = |open: char| text.strip_prefix(open).map(|rest| rest.trim_start().chars().next());
    let object = after('{').is_some_and(|next| next.is_none_or(|next| "\"}".contains(next)));
    object || after('[').is_some_and(|next| next.is_some_and(|next| "[{\"-]0123456789".contains(next)))
}

/// EULUMDAT: a company, then one number a line: type 1 to 3, symmetry 0 to 4, planes, their distance, angles, their distance.
fn is_eulumdat(lines: &[&str]) -> bool {
    let number = |at: usize| lines.get(at).and_then(|line| line.replace(',', ".").parse::<f64>().ok());
    let within = |at: usize, low: f64, high: f64| number(at).is_some_and(|value| value >= low && value <= high);
    number(0).is_none()
        && within(1, 0.0, 3.0)
        && within(2, 0.0, 4.0)
        && within(3, 1.0, 721.0)
        && within(4, 0.0, 360.0)
        && within(5, 1.0, 721.0)
        && within(6, 0.0, 180.0)
}

/// After a head, nothing but two numbers a line, the first rising and a wavelength of light in nm or um.
fn is_spectrum(lines: &[&str]) -> bool {
    let pairs = |line: &&&str| pair(line).is_some();
    let head = lines.iter().take_while(|line| !pairs(line)).count();
    let body: Vec<&&str> = lines.iter().skip(head).filter(|line| !line.is_empty()).collect();
    let read: Vec<(f64, f64)> = body.iter().filter_map(|line| pair(line)).collect();
    let light = |nm: f64| (0.1..=20.0).contains(&nm) || (100.0..=20_000.0).contains(&nm);
    head <= SPECTRUM_HEAD
        && read.len() >= 3
        && read.len() == body.len()
        && read.is_sorted_by(|a, b| a.0 < b.0)
        && read.iter().all(|(wavelength, _)| light(*wavelength))
}

/// Exactly two numbers, between spaces, tabs or semicolons, or between commas.
fn pair(line: &str) -> Option<(f64, f64)> {
    let wide: Vec<&str> = line.split([' ', '\t', ';']).filter(|word| !word.is_empty()).collect();
    let words = if wide.len() == 1 { line.split(',').map(str::trim).collect() } else { wide };
    let number = |word: &str| word.replace(',', ".").parse::<f64>().ok();
    match words.as_slice() {
        [first, second] => number(first).zip(number(second)),
        _ => None,
    }
}

fn is_dxf(lines: &[&str]) -> bool {
    lines.first() == Some(&"0") && lines.get(1) == Some(&"SECTION")
}

/// IGES has 80 columns; column 73 names the section, the rest counts its lines.
fn is_iges(text: &str) -> bool {
    let line = text.lines().next().unwrap_or_default();
    line.get(72..80).is_some_and(|end| end.starts_with('S') && end.get(1..).is_some_and(|count| count.trim() == "1"))
}

/// The refusal of binary content that fits no format we read, as near to a name as it allows.
pub fn closed(start: &[u8]) -> Option<Error> {
    if let Some(error) = maker(start) {
        return Some(error);
    }
    let (at, size) = rays_somewhere(start)?;
    let found = format!(
        "Rays of {size} bytes start at byte {at}, under a header whose layout is not public: TracePro, OPTICAD, FRED (.fcr), \
         LucidShape, SimuLux and Photopia have such files."
    );
    Some(Error::refused("detect.closed_rays", found, EXPORT).at_byte(at as u64))
}

/// The refusal of a file whose first bytes have the name of a maker of closed formats.
fn maker(start: &[u8]) -> Option<Error> {
    // Without NUL bytes, text in UTF-16 reads like text in ASCII.
    let narrow: Vec<u8> = start.iter().copied().filter(|byte| *byte != 0).collect();
    let lower = String::from_utf8_lossy(&narrow).to_lowercase();
    let (_, code, what, remedy) = MAKERS.into_iter().find(|(name, ..)| lower.contains(name))?;
    let found = format!("This looks like {what}, whose layout is not public.");
    Some(Error::refused(code, found, remedy).at_byte(0))
}

/// Where records with unit directions start, and their size: what these formats share is position, direction and flux in f32.
fn rays_somewhere(start: &[u8]) -> Option<(usize, usize)> {
    let holds = |at: usize, size: usize| {
        let records = start.get(at..).unwrap_or_default().chunks_exact(size);
        let ray = |record: &[u8]| {
            (0..7).all(|k| f32::from_le_bytes(word_in(record, 4 * k)).is_finite()) && proof::is_unit_at(record, 12)
        };
        records.len() >= 3 && records.clone().all(ray)
    };
    CLOSED_HEADER.step_by(4).flat_map(|at| CLOSED_RAYS.map(|size| (at, size))).find(|(at, size)| holds(*at, *size))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::FORMATS;
    use crate::formats::bytes::LOOK;
    use crate::formats::detect::detect;

    fn code(bytes: &[u8]) -> &'static str {
        detect(&FORMATS, &bytes.to_vec()).map_or_else(|error| error.code(), |reader| reader.format.name())
    }

    #[test]
    fn first_bytes_that_are_no_rays() {
        for (magic, expected, _) in MAGIC {
            let mut bytes = magic.to_vec();
            bytes.extend([b' '; 60]);
            assert_eq!(code(&bytes), expected, "{magic:?}");
        }
    }

    /// OpticStudio's help, "The ZRD Uncompressed Full Data Format": a version, the most segments, then the segments of each ray.
    #[test]
    fn ray_databases_have_a_name() {
        for version in [2002, 2003, 12_002, 22_002] {
            let bytes: Vec<u8> = [version, 5, 2, 0, 0].into_iter().flat_map(i32::to_le_bytes).chain([0; 208]).collect();
            assert_eq!(code(&bytes), "detect.ray_database", "{version}");
        }
    }

    #[test]
    fn ray_files_with_their_bytes_in_the_other_order_have_names() {
        let big = |numbers: &[i32]| numbers.iter().flat_map(|number| number.to_be_bytes()).collect::<Vec<u8>>();
        let speos: Vec<u8> = [9.0_f32, 2.0, 2.0, 2.0, 2.0, 2.0, 1.0].into_iter().flat_map(f32::to_be_bytes).collect();
        for bytes in [
            [b"TM25".to_vec(), big(&[2013, 0])].concat(),
            [b"LTRF".to_vec(), big(&[2, 0])].concat(),
            big(&[1010, 9]),
            big(&[8_675_309, 9]),
            big(&[7415, 0]),
            speos,
        ] {
            assert_eq!(code(&bytes), "detect.byte_order", "{bytes:?}");
        }
    }

    #[test]
    fn text_in_utf_16_without_its_mark_has_a_name() {
        let rows = "0 0 0 0 0 1 1\n".repeat(4);
        for wide in [u16::to_le_bytes, u16::to_be_bytes] {
            let bytes: Vec<u8> = rows.encode_utf16().flat_map(wide).collect();
            assert_eq!(code(&bytes), "detect.utf16");
        }
    }

    /// Each as its own format's documentation starts it.
    #[test]
    fn texts_that_are_no_rays_have_names() {
        let ldt = "Company\n1\n1\n1\n0\n37\n5.0\nreport\nlamp\n";
        let iges = format!("{:72}S      1\n", "a part");
        // The schema of GLDF 1.0: the root of product.xml names the schema.
        let gldf = "<?xml version=\"1.0\"?>\n<Root xsi:noNamespaceSchemaLocation=\"https://gldf.io/xsd/gldf/1.0.0-rc.3/gldf.xsd\">";
        let cases: [(&str, &str); 28] = [
            (gldf, "detect.gldf"),
            ("<?xml version=\"1.0\"?><Root><Item>gldf</Item></Root>", "detect.xml"),
            ("<!DOCTYPE html><html><body>Sign in</body></html>", "detect.html"),
            ("\u{feff}\n <HTML><head>", "detect.html"),
            ("<?xml version=\"1.0\"?>\n<IESTM2714 version=\"1.0\">", "detect.spectrum"),
            ("<?xml version=\"1.0\"?>\n<IESTM33-22>", "detect.photometry"),
            ("<?xml version=\"1.0\"?><rays/>", "detect.xml"),
            ("{\"rays\": []}", "detect.json"),
            ("[[0, 0, 0, 0, 0, 1, 1]]", "detect.json"),
            ("IESNA:LM-63-2002\n[TEST] 1\nTILT=NONE\n", "detect.photometry"),
            ("old header\nTILT=NONE\n1 -1 1 3 1\n", "detect.photometry"),
            (ldt, "detect.photometry"),
            // Without a company.
            ("\n1\n1\n1\n0\n37\n5.0\nreport\nlamp\n", "detect.photometry"),
            ("IES:LM-63-2019\n[TEST] 1\n", "detect.photometry"),
            ("! Sample\nMATE CU\n0.4861 1.1512 -2.3025\nCOAT COPPER\nCU 0.0001 1\n", "detect.coating"),
            ("IDEAL I.50 0.5 0.5\n", "detect.coating"),
            ("VERS 140124 258 36214\nMODE NSC\nNAME LED\n", "detect.lens"),
            ("OPTIS - Spectrum file v1.0\nwhite\n2\n400 1\n700 1\n", "detect.spectrum"),
            ("OPTIS - Intensity file v1.0\n", "detect.speos_text"),
            ("4\n393.0000\t0.0062\r\n394.3\t0.0072\r\n395.6\t0.0084\r\n", "detect.spectrum"),
            ("# LED\ndataname: LED\ncontinuous\n400,5;0,1\n401,5;0,2\n402,5;0,3\n", "detect.spectrum"),
            ("nm,value\n400,0.1\n500,1\n600,0.1\n", "detect.spectrum"),
            ("ISO-10303-21;\nHEADER;\n", "detect.cad"),
            ("0\nSECTION\n2\nHEADER\n", "detect.cad"),
            (&iges, "detect.cad"),
            // These are rays, or may be.
            ("9 4\n0 0 0 0 0 1 1\n0 0 0 0 0 1 1\n", "Zemax text"),
            ("# made\nlt_rdf_version: 2.0\n", "LightTools text"),
            ("Some words.\n", "detect.not_rays"),
        ];
        for (text, expected) in cases {
            assert_eq!(code(text.as_bytes()), expected, "{text}");
        }
    }

    #[test]
    fn a_long_spectrum_is_one_wherever_its_4096th_byte_falls() {
        let rows: String = (0..1000).map(|k| format!("{}\t0.5\n", 380 + k)).collect();
        assert!(rows.len() > LOOK);
        (0..10).for_each(|k| assert_eq!(code(format!("{}{rows}", "#\n".repeat(k)).as_bytes()), "detect.spectrum"));
        let falling: String = (0..10).map(|k| format!("{} 0.5\n", 500 - k)).collect();
        assert_ne!(code(falling.as_bytes()), "detect.spectrum");
    }

    #[test]
    fn utf_16_is_read_as_far_as_its_name() {
        let wide =
            |text: &str| [0xff, 0xfe].into_iter().chain(text.encode_utf16().flat_map(u16::to_le_bytes)).collect();
        let lens: Vec<u8> = wide("VERS 220000\r\nMODE SEQ\r\n");
        assert_eq!(code(&lens), "detect.lens");
        let rays: Vec<u8> = wide("0 0 0 0 0 1 1\r\n");
        assert_eq!(code(&rays), "detect.utf16");
        let big: Vec<u8> = [0xfe, 0xff, 0, b'h', 0, b'i'].to_vec();
        assert_eq!(code(&big), "detect.utf16");
    }

    #[test]
    fn binary_files_without_a_public_layout_are_told_by_name_or_by_their_rays() {
        for (name, expected, ..) in MAKERS {
            let upper: Vec<u8> = [&[1, 2, 3, 0], name.to_uppercase().as_bytes(), &[0; 50]].concat();
            let wide: Vec<u8> = [0, 9].into_iter().chain(name.encode_utf16().flat_map(u16::to_le_bytes)).collect();
            assert_eq!((code(&upper), code(&wide)), (expected, expected));
        }
        let ray = [1.0_f32, 2.0, 3.0, 0.6, 0.0, 0.8, 0.5].map(f32::to_le_bytes).concat();
        let file = |header: usize, rays: usize| [vec![0; header], ray.repeat(rays)].concat();
        assert_eq!(code(&file(212, 200)), "detect.closed_rays");
        assert_eq!(code(&file(16, 3)), "detect.closed_rays");
        assert_eq!(code(&file(16, 2)), "detect.unknown");
        let Err(Error::Refused(fault)) = detect(&FORMATS, &file(212, 200)) else { panic!("read") };
        assert_eq!(fault.at, Some(crate::error::Place::Byte(212)));
    }
}
