//! Which format a file is, from content alone: `.ray` alone is the extension of seven formats (`pipeline/formats/README.md` 0).

use super::bytes::LOOK;
use super::bytes::i32_in;
use super::foreign::EXPORT;
use super::record::{Bytes, Format};
use super::text::columns;
use super::text::lines::leading_numbers;
use super::zemax::{binary, text};
use super::{asap, foreign, speos};
use crate::error::Error;

/// The format of a file.
///
/// # Errors
/// Refused with the format's name when it is one we know and do not read; malformed when it is none we know.
pub fn detect(bytes: &dyn Bytes) -> Result<Format, Error> {
    let mut start = vec![0; usize::try_from(bytes.len()).unwrap_or(LOOK).min(LOOK)];
    bytes.read_at(0, &mut start)?;
    detect_start(&start, Some(bytes.len()))?.ok_or_else(unknown)
}

/// The format of a file that starts with `start` and is `length` bytes long, if that is known; `None` when more bytes are
/// needed to tell.
///
/// # Errors
/// As [`detect`], as soon as the bytes at hand prove it.
pub fn detect_start(start: &[u8], length: Option<u64>) -> Result<Option<Format>, Error> {
    if length == Some(0) {
        return Err(Error::malformed("detect.empty", "The file is empty.", "Send the file's content.").at_byte(0));
    }
    if start.starts_with(b"TM25") {
        return Ok(Some(Format::Tm25));
    }
    if start.starts_with(b"LTRF") {
        return Ok(Some(Format::LightToolsBinary));
    }
    if start.len() >= 4 && binary::IDENTIFIERS.contains(&i32_in(start, 0)) {
        return Ok(Some(Format::ZemaxBinary));
    }
    if let Some(error) = refused_by_magic(start).or_else(|| foreign::by_magic(start)) {
        return Err(error);
    }
    if start.len() >= 4 && asap::words(i32_in(start, 0)).is_some() {
        return Ok(Some(Format::Asap));
    }
    let complete = start.len() >= LOOK || length.is_some_and(|length| start.len() as u64 >= length);
    if !complete {
        return Ok(None);
    }
    if let Some(error) = foreign::by_text(start, start.len() < LOOK) {
        return Err(error);
    }
    if !start.contains(&0) {
        return text(start).map(Some).map_err(|error| error.at_byte(0));
    }
    if speos::is_speos(start, length) {
        return Ok(Some(Format::Speos));
    }
    Err(foreign::closed(start).unwrap_or_else(unknown))
}

/// How archives begin. Those that are unpacked here come to this only where they are not, inside another one.
const ARCHIVES: [(&[u8], &str); 8] = [
    (b"PK\x03\x04", "a zip archive"),
    (b"PK\x05\x06", "an empty zip archive"),
    (b"\x1f\x8b", "a gzip file"),
    (b"\x28\xb5\x2f\xfd", "a zstd file"),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive"),
    (b"Rar!\x1a\x07", "a RAR archive"),
    (b"\xfd7zXZ\0", "an xz file"),
    (b"BZh", "a bzip2 file"),
];

fn refused_by_magic(start: &[u8]) -> Option<Error> {
    let error = if start.starts_with(b"version https://git-lfs") {
        let found = "This is a git-lfs pointer, not the ray file it stands for.";
        Error::refused("detect.git_lfs", found, "Fetch the file itself (`git lfs pull`) and send that.")
    } else if let Some((_, archive)) = ARCHIVES.iter().find(|(magic, _)| start.starts_with(magic)) {
        let found = format!("This is {archive}, not a ray file.");
        Error::refused("detect.archive", found, "Unpack it; gzip, zstd and zip are unpacked here.")
    } else {
        return None;
    };
    Some(error.at_byte(0))
}

/// What text it is, in the order of `pipeline/formats/README.md` 0. The last line may be cut and is judged only where it is the first.
fn text(start: &[u8]) -> Result<Format, Error> {
    let text = String::from_utf8_lossy(start).to_lowercase();
    if text.contains("lt_rdf_version") || text.contains("lt_startofdata") {
        return Ok(Format::LightToolsText);
    }
    if text.contains("nbrrays requested") {
        return Ok(Format::ProSourceText);
    }
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    let lines =
        || start.split(|byte| matches!(byte, b'\n' | b'\r')).map(<[u8]>::trim_ascii).filter(|line| !line.is_empty());
    if !start.iter().all(|byte| !byte.is_ascii_control() || byte.is_ascii_whitespace()) {
        return Err(unknown());
    }
    if lines().next().is_some_and(|first| text::starts(first, lines().nth(1))) {
        return Ok(Format::ZemaxText);
    }
    if lines().any(|line| leading_numbers(line) >= columns::FEWEST) {
        return Ok(Format::Columns);
    }
    Err(Error::malformed("detect.not_rays", "This is text, not a ray file.", EXPORT))
}

fn unknown() -> Error {
    Error::malformed(
        "detect.unknown",
        "The content is no ray file format we know: IES TM-25, Zemax binary, LightTools, ASAP, Speos and text were tried.",
        "Send an IES TM-25 (.tm25ray) or a Zemax binary (.dat, .sdf) ray file.",
    )
    .at_byte(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn code(bytes: &[u8]) -> &'static str {
        detect(&bytes.to_vec()).map_or_else(|error| error.code(), Format::name)
    }

    #[test]
    fn content_decides() {
        let speos: Vec<u8> =
            [4.0_f32, 2.0, 2.0, 2.0, 2.0, 2.0, 450.0].iter().flat_map(|f| f.to_le_bytes()).chain([0; 64]).collect();
        let cases: [(&[u8], &str); 14] = [
            (b"TM25\xdd\x07\0\0", "IES TM-25"),
            (&1010_i32.to_le_bytes(), "Zemax binary"),
            (&8_675_309_i32.to_le_bytes(), "Zemax binary"),
            (b"", "detect.empty"),
            (b"TM2", "detect.not_rays"),
            (b"version https://git-lfs.github.com/spec/v1\n", "detect.git_lfs"),
            (b"PK\x03\x04....", "detect.archive"),
            (b"\x1f\x8b\x08", "detect.archive"),
            (b"LTRF\x02\0\0\0", "LightTools binary"),
            (&7415_i32.to_le_bytes(), "ASAP distribution"),
            (b"# made\nlt_rdf_version: 2.0\n", "LightTools text"),
            (b"9 4 0 0\n0 0 0 0 0 1 1\n", "Zemax text"),
            (b"<html><body>Sign in</body></html>", "detect.html"),
            (&speos, "Speos"),
        ];
        for (bytes, expected) in cases {
            assert_eq!(code(bytes), expected, "{bytes:?}");
        }
        assert_eq!(code(&[0; 5000]), "detect.unknown");
    }

    #[test]
    fn too_few_bytes_are_no_verdict() {
        assert_eq!(detect_start(b"TM", None).unwrap(), None);
        assert_eq!(detect_start(b"0 0 1", Some(100)).unwrap(), None);
        assert_eq!(detect_start(b"TM25", None).unwrap(), Some(Format::Tm25));
        assert_eq!(detect_start(b"", Some(0)).unwrap_err().code(), "detect.empty");
        assert_eq!(detect_start(&[0; 5000], None).unwrap_err().code(), "detect.unknown");
    }
}
