//! Which format a file is, from content alone: `.ray` alone is the extension of seven formats (`pipeline/formats/README.md` 0).

use super::bytes::LOOK;
use super::foreign;
use super::foreign::EXPORT;
use super::own;
use super::record::{Bytes, Reader, Sign};
use super::text::lines::is_padding;
use crate::error::Error;

/// Most bytes looked at: comments may stand before everything else of a text.
pub const MOST: usize = 1 << 20;

/// The reader of a file, among `readers`.
///
/// # Errors
/// Refused with the format's name when it is one we know and do not read; malformed when it is none we know.
pub fn detect<'r>(readers: &'r [Reader], bytes: &dyn Bytes) -> Result<&'r Reader, Error> {
    let length = bytes.len();
    for most in [LOOK, MOST] {
        let mut start = vec![0; usize::try_from(length).unwrap_or(most).min(most)];
        bytes.read_at(0, &mut start)?;
        if let Some(reader) = detect_start(readers, &start, Some(length))? {
            return Ok(reader);
        }
    }
    Err(unknown())
}

/// The reader of a file that starts with `start` and is `length` bytes long, if that is known; `None` when more bytes are
/// needed to tell. More than the first bytes are looked at only where these are words that could stand before rays.
///
/// # Errors
/// As [`detect`], as soon as the bytes at hand prove it.
pub fn detect_start<'r>(readers: &'r [Reader], start: &[u8], length: Option<u64>) -> Result<Option<&'r Reader>, Error> {
    if length == Some(0) {
        return Err(Error::malformed("detect.empty", "The file is empty.", "Send the file's content.").at_byte(0));
    }
    let all = start;
    let start = start.get(..start.len().min(LOOK)).unwrap_or_default();
    if let Some(error) = foreign::swapped(start) {
        return Err(error);
    }
    let by = |test: &dyn Fn(&Sign) -> bool| readers.iter().find(|reader| test(&reader.sign));
    if let Some(reader) = by(&|sign| matches!(sign, Sign::Magic(is) if is(start))) {
        return Ok(Some(reader));
    }
    let complete = start.len() >= LOOK || length.is_some_and(|length| start.len() as u64 >= length);
    if own::may_be(start) && !complete {
        return Ok(None);
    }
    if let Some(error) = own::refused(start).or_else(|| refused_by_magic(start)).or_else(|| foreign::by_magic(start)) {
        return Err(error);
    }
    if let Some(reader) = by(&|sign| matches!(sign, Sign::Marker(is) if is(start))) {
        return Ok(Some(reader));
    }
    if !complete {
        return Ok(None);
    }
    let words = without_padding(start);
    if let Some(error) = foreign::by_text(words, start.len() < LOOK) {
        return Err(error);
    }
    if !words.contains(&0) {
        return longer_text(readers, words, all, length).map_err(|error| error.at_byte(0));
    }
    let reader = by(&|sign| matches!(sign, Sign::Layout(is) if is(start, length)));
    reader.map(Some).ok_or_else(|| foreign::closed(start).unwrap_or_else(unknown))
}

/// What reads a text whose first bytes are `words` and of which `all` is at hand; `None` where more of it may tell.
fn longer_text<'r>(
    readers: &'r [Reader],
    words: &[u8],
    all: &[u8],
    length: Option<u64>,
) -> Result<Option<&'r Reader>, Error> {
    let lines = || without_padding(all).split(|byte| matches!(byte, b'\n' | b'\r'));
    let may_come = all.len() >= LOOK && lines().all(|line| line.len() <= LONGEST_HEAD_LINE);
    let more = length.is_none_or(|length| all.len() as u64 != length) && all.len() < MOST;
    match text(readers, words) {
        Err(error) if error.code() == NOT_RAYS && may_come => match text(readers, without_padding(all)) {
            Err(error) if error.code() == NOT_RAYS && more => Ok(None),
            found => found.map(Some),
        },
        found => found.map(Some),
    }
}

/// A text without the NULs and Ctrl-Zs that programs fill its end with.
fn without_padding(text: &[u8]) -> &[u8] {
    let end =
        text.iter().rposition(|byte| !is_padding(*byte) && !byte.is_ascii_whitespace()).map_or(0, |last| last + 1);
    text.get(..end).filter(|kept| !kept.is_empty()).unwrap_or(text)
}

/// Longest line before rays, bytes: a text with a longer one is not looked at any further.
const LONGEST_HEAD_LINE: usize = 1024;
/// Code of the refusal of a text without rays.
pub const NOT_RAYS: &str = "detect.not_rays";

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

/// What reads a text: by its words, else by its lines. The last line may be cut and is judged only where it is the first.
fn text<'r>(readers: &'r [Reader], start: &[u8]) -> Result<&'r Reader, Error> {
    let by = |test: &dyn Fn(&Sign) -> bool| readers.iter().find(|reader| test(&reader.sign));
    let words = String::from_utf8_lossy(start).to_lowercase();
    if let Some(reader) = by(&|sign| matches!(sign, Sign::Words(are) if are(&words))) {
        return Ok(reader);
    }
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    if !start.iter().all(|byte| !byte.is_ascii_control() || byte.is_ascii_whitespace()) {
        return Err(unknown());
    }
    let lines = start.split(|byte| matches!(byte, b'\n' | b'\r')).map(<[u8]>::trim_ascii);
    let lines: Vec<&[u8]> = lines.filter(|line| !line.is_empty()).collect();
    by(&|sign| matches!(sign, Sign::Lines(are) if are(&lines)))
        .ok_or_else(|| Error::malformed(NOT_RAYS, "This is text, not a ray file.", EXPORT))
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
    use crate::formats::FORMATS;
    use crate::formats::record::Format;

    fn code(bytes: &[u8]) -> &'static str {
        detect(&FORMATS, &bytes.to_vec()).map_or_else(|error| error.code(), |reader| reader.format.name())
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

    /// The format of a file that starts so; the code of its refusal.
    fn started(start: &[u8], length: Option<u64>) -> Result<Option<Format>, &'static str> {
        let found = detect_start(&FORMATS, start, length);
        found.map(|reader| reader.map(|reader| reader.format)).map_err(|error| error.code())
    }

    /// Comments of any length below [`MOST`] may stand before the rays, and padding behind them.
    #[test]
    fn the_verdict_does_not_depend_on_where_a_block_ends() {
        let rows = "0 0 0 0 0 1 1\n0 0 0 0 0 1 1\n";
        for count in [0, 50, 51, 52, 100, 5000] {
            let comments = format!("# {}\n", "c".repeat(77)).repeat(count);
            let [bare, zemax] = ["", "2 4 0 0\n"].map(|head| [&comments, head, rows].concat().into_bytes());
            assert_eq!((code(&bare), code(&zemax)), ("text columns", "Zemax text"), "{count}");
            for tail in [&b"\x1a"[..], &[0; 9000]] {
                assert_eq!(code(&[&bare, tail].concat()), "text columns", "{count}");
            }
            let start = &bare[..bare.len().min(LOOK)];
            let judged = started(start, Some(bare.len() as u64));
            assert!(matches!(judged, Ok(None | Some(Format::Columns))), "{count}: {judged:?}");
        }
        assert_eq!(code("# words\n".repeat(200_000).as_bytes()), "detect.not_rays");
    }

    #[test]
    fn too_few_bytes_are_no_verdict() {
        assert_eq!(started(b"TM", None), Ok(None));
        assert_eq!(started(b"0 0 1", Some(100)), Ok(None));
        assert_eq!(started(b"TM25", None), Ok(Some(Format::Tm25)));
        assert_eq!(started(b"", Some(0)), Err("detect.empty"));
        assert_eq!(started(&[0; 5000], None), Err("detect.unknown"));
    }
}
