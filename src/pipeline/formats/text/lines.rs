//! Lines and numbers of text files, shared by every text format: bounded memory, any kind of line end, every failure with its
//! byte.

use crate::error::Error;
use crate::formats::record::Bytes;

/// Longest line, bytes: rows of a ray file have a few hundred; a longer line is no text.
pub const LONGEST_LINE: usize = 1 << 16;
/// Bytes read at once, at most; more than a line, so that a line is always whole in memory.
pub const BLOCK: usize = 1 << 18;
/// Bytes read at first: what [`crate::formats::detect`] looks at, so that a file can be judged by its start.
const FIRST_BLOCK: usize = crate::formats::bytes::LOOK;
/// Longest number that is looked at twice.
const LONGEST_NUMBER: usize = 64;
/// Bytes looked at together in search of a line's end; the compiler makes one vector instruction of them.
const LANES: usize = 32;

/// A line that is not blank, without blanks before and after it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line<'a> {
    /// Byte offset of its first character.
    pub at: u64,
    /// Its characters.
    pub text: &'a [u8],
    /// A line end follows; without one the file ends here, perhaps too early.
    pub ended: bool,
}

impl Line<'_> {
    /// Its characters; what is not UTF-8 becomes U+FFFD.
    pub fn to_text(self) -> String {
        String::from_utf8_lossy(self.text).into_owned()
    }

    /// Starts as comments do in ray files and in what scripts write.
    pub fn is_comment(self) -> bool {
        matches!(self.text.first(), Some(b'#' | b'!' | b'%')) || self.text.starts_with(b"//")
    }
}

/// Reads lines forward. `\n`, `\r\n`, `\n\r` and `\r` all end a line, because blank lines are skipped.
pub struct Lines<'a> {
    bytes: &'a dyn Bytes,
    /// Bytes at hand; those before `from` are done with.
    block: Vec<u8>,
    from: usize,
    /// Offset of the first byte after `block`.
    next: u64,
    /// Size of the next block.
    reach: usize,
}

impl<'a> Lines<'a> {
    /// Lines from the start of a file, after its byte order mark; in small blocks first.
    pub fn of(bytes: &'a dyn Bytes) -> Lines<'a> {
        Lines { bytes, block: Vec::new(), from: 0, next: 0, reach: FIRST_BLOCK }
    }

    /// Lines from `offset`, which starts a line; in big blocks.
    pub fn from(bytes: &'a dyn Bytes, offset: u64) -> Lines<'a> {
        Lines { bytes, block: Vec::new(), from: 0, next: offset, reach: BLOCK }
    }

    /// The next line that is not blank; `None` at the end.
    ///
    /// # Errors
    /// `text.line_too_long`; [`Error::Unreadable`].
    pub fn read_next(&mut self) -> Result<Option<Line<'_>>, Error> {
        let (length, ended) = loop {
            self.skip_blank();
            let rest = self.block.get(self.from..).unwrap_or_default();
            let end = line_end(rest);
            let length = end.unwrap_or(rest.len());
            if length > LONGEST_LINE {
                return Err(too_long(self.at()));
            }
            if end.is_some() || !self.refill()? {
                break (length, end.is_some());
            }
        };
        let (at, from) = (self.at(), self.from);
        self.from += length;
        let text = self.block.get(from..from + length).unwrap_or_default().trim_ascii_end();
        Ok((length > 0).then_some(Line { at, text, ended }))
    }

    /// Offset of the next byte.
    pub fn at(&self) -> u64 {
        self.next - (self.block.len() - self.from) as u64
    }

    fn skip_blank(&mut self) {
        let rest = self.block.get(self.from..).unwrap_or_default();
        self.from += rest.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(rest.len());
    }

    /// Reads on behind what is left; false at the end of the file.
    fn refill(&mut self) -> Result<bool, Error> {
        let left = self.bytes.len().saturating_sub(self.next);
        if left == 0 {
            return Ok(false);
        }
        self.block.drain(..self.from);
        self.from = 0;
        let kept = self.block.len();
        let count = usize::try_from(left).unwrap_or(usize::MAX).min(self.reach);
        self.block.resize(kept + count, 0);
        self.bytes.read_at(self.next, self.block.get_mut(kept..).unwrap_or_default())?;
        if self.next == 0 && self.block.starts_with(b"\xef\xbb\xbf") {
            self.from = 3;
        }
        self.next += count as u64;
        self.reach = BLOCK.min(2 * self.reach);
        Ok(true)
    }
}

fn too_long(at: u64) -> Error {
    let found = format!("A line is longer than {LONGEST_LINE} bytes.");
    Error::malformed("text.line_too_long", found, "Export the file again, one ray on a line.").at_byte(at)
}

/// Index of the first `\n` or `\r`.
fn line_end(bytes: &[u8]) -> Option<usize> {
    let ends = |byte: &u8| *byte == b'\n' || *byte == b'\r';
    let (lanes, _) = bytes.as_chunks::<LANES>();
    let dull = |lane: &&[u8; LANES]| !lane.iter().fold(false, |any, byte| any | ends(byte));
    let from = LANES * lanes.iter().take_while(dull).count();
    bytes.get(from..)?.iter().position(ends).map(|k| from + k)
}

/// What stands between the numbers of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Separator {
    /// Spaces and tabs, any number of them.
    Blank,
    /// One tab; a comma is then a decimal point.
    Tab,
    /// One comma.
    Comma,
    /// One semicolon; a comma is then a decimal point.
    Semicolon,
}

impl Separator {
    /// What stands between the fields of this line: the rarest sign it has.
    pub fn of(line: &[u8]) -> Separator {
        let count = |sign: u8| line.iter().filter(|byte| **byte == sign).count();
        match () {
            () if count(b';') > 0 => Separator::Semicolon,
            () if count(b'\t') > 0 && count(b',') > 0 => Separator::Tab,
            () if count(b',') > 0 => Separator::Comma,
            () => Separator::Blank,
        }
    }

    /// The fields of a line, from its byte 0: each with its place in the line. One sign at the end of a line ends its last field.
    pub fn fields(self, line: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
        let sign = match self {
            Separator::Blank => None,
            Separator::Tab => Some(b'\t'),
            Separator::Comma => Some(b','),
            Separator::Semicolon => Some(b';'),
        };
        let mut from = 0;
        std::iter::from_fn(move || {
            let rest = line.get(from..)?;
            let start = from + rest.iter().position(|byte| !is_blank(*byte) || Some(*byte) == sign)?;
            let rest = line.get(start..)?;
            let length = match sign {
                None => rest.iter().position(|byte| is_blank(*byte)),
                Some(sign) => rest.iter().position(|byte| *byte == sign),
            }
            .unwrap_or(rest.len());
            from = start + length + 1;
            Some((start, rest.get(..length)?.trim_ascii_end()))
        })
    }

    /// A number of this line. Beyond Rust's own grammar: decimal commas, Fortran's `1.5D-03` and `1.5-103`, quotes, and what C
    /// writes for NaN and infinity, which becomes NaN.
    pub fn number(self, field: &[u8]) -> Option<f64> {
        let text = str::from_utf8(field).ok()?;
        text.parse().ok().or_else(|| self.odd_number(text))
    }

    fn odd_number(self, text: &str) -> Option<f64> {
        let text = text.trim_matches('"').trim();
        if text.len() > LONGEST_NUMBER {
            return None;
        }
        let unsigned = text.trim_start_matches(['-', '+']).to_ascii_lowercase();
        if unsigned.starts_with("1.#") || unsigned.starts_with("nan(") {
            return Some(f64::NAN);
        }
        let mut plain = String::with_capacity(text.len() + 1);
        for sign in text.chars() {
            match sign {
                ',' if matches!(self, Separator::Tab | Separator::Semicolon) => plain.push('.'),
                'd' | 'D' => plain.push('e'),
                '+' | '-' if plain.ends_with(|last: char| last.is_ascii_digit() || last == '.') => {
                    plain.extend(['e', sign]);
                }
                _ => plain.push(sign),
            }
        }
        plain.parse().ok()
    }
}

fn is_blank(byte: u8) -> bool {
    byte == b' ' || byte == b'\t'
}

/// How many numbers a line starts with.
pub fn leading_numbers(line: &[u8]) -> usize {
    let separator = Separator::of(line);
    separator.fields(line).take_while(|(_, field)| separator.number(field).is_some()).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &[u8]) -> Result<Vec<(u64, String, bool)>, Error> {
        let bytes = text.to_vec();
        let mut lines = Lines::of(&bytes);
        let mut found = Vec::new();
        while let Some(line) = lines.read_next()? {
            found.push((line.at, line.to_text(), line.ended));
        }
        Ok(found)
    }

    #[test]
    fn every_kind_of_line_end_and_a_byte_order_mark() {
        for end in ["\n", "\r\n", "\n\r", "\r"] {
            let text = ["a b ", "", "\t c", "d"].join(end);
            let wide = end.len() as u64;
            let expected = [(0, "a b", true), (4 + 2 * wide + 2, "c", true), (7 + 3 * wide, "d", false)];
            assert_eq!(lines(text.as_bytes()).unwrap(), expected.map(|(at, text, ended)| (at, text.to_owned(), ended)));
        }
        assert_eq!(lines(b"\xef\xbb\xbf1\n").unwrap(), [(3, "1".to_owned(), true)]);
        assert_eq!(lines(b"  \n \r\n\t").unwrap(), []);
    }

    #[test]
    fn lines_cross_the_borders_of_blocks() {
        for length in [1, 31, 32, 33, 63, 4095, 4096, 4097, 30_000, LONGEST_LINE] {
            let text = format!("{}\nb\n", "a".repeat(length)).repeat(9);
            let found = lines(text.as_bytes()).unwrap();
            assert_eq!(found.len(), 18);
            for (k, (at, text, ended)) in found.iter().enumerate() {
                let expected = (k / 2 * (length + 3) + k % 2 * (length + 1)) as u64;
                assert_eq!((*at, text.len(), *ended), (expected, if k % 2 == 0 { length } else { 1 }, true));
            }
        }
    }

    #[test]
    fn a_line_too_long_is_refused_where_it_starts() {
        for end in ["", "\n"] {
            let text = format!("x\n{}{end}", "a".repeat(LONGEST_LINE + 1));
            let Err(Error::Malformed(fault)) = lines(text.as_bytes()) else { panic!("read") };
            assert_eq!((fault.code, fault.at), ("text.line_too_long", Some(crate::error::Place::Byte(2))));
        }
    }

    #[test]
    fn numbers_as_programs_write_them() {
        let cases = [
            ("7.2e-016", 7.2e-16),
            ("-1.5D-03", -1.5e-3),
            ("1.5d2", 150.0),
            ("0.123-103", 0.123e-103),
            ("+1.", 1.0),
            (".5", 0.5),
            ("\"2.5\"", 2.5),
            ("1E+002", 100.0),
        ];
        for (text, value) in cases {
            assert_eq!(Separator::Blank.number(text.as_bytes()), Some(value), "{text}");
        }
        for text in ["1.#QNAN", "-1.#IND00", "-nan(ind)", "nan"] {
            assert!(Separator::Blank.number(text.as_bytes()).unwrap().is_nan(), "{text}");
        }
        for text in ["", "-", "1,5", "1.2.3", "abc", "0x10", "1 2", "1e", "\u{b2}", &"1d".repeat(99)] {
            assert_eq!(Separator::Blank.number(text.as_bytes()), None, "{text}");
        }
        assert_eq!(Separator::Semicolon.number(b"-0,25"), Some(-0.25));
        assert_eq!(Separator::Tab.number(b"2,5E-3"), Some(0.0025));
        assert_eq!(Separator::Comma.number(b"2,5"), None);
    }

    #[test]
    fn fields_and_their_places() {
        type Fields = [(usize, &'static str)];
        let cases: [(&str, Separator, &Fields); 6] = [
            ("1 \t 2  3", Separator::Blank, &[(0, "1"), (4, "2"), (7, "3")]),
            ("1\t2", Separator::Blank, &[(0, "1"), (2, "2")]),
            ("1, 2 ,3,", Separator::Comma, &[(0, "1"), (3, "2"), (6, "3")]),
            ("1,,3", Separator::Comma, &[(0, "1"), (2, ""), (3, "3")]),
            ("1,5;2;", Separator::Semicolon, &[(0, "1,5"), (4, "2")]),
            ("1,5\t\t2", Separator::Tab, &[(0, "1,5"), (4, ""), (5, "2")]),
        ];
        for (line, separator, expected) in cases {
            assert_eq!(Separator::of(line.as_bytes()), separator, "{line}");
            let found: Vec<_> = separator.fields(line.as_bytes()).collect();
            let expected: Vec<_> = expected.iter().map(|(at, text)| (*at, text.as_bytes())).collect();
            assert_eq!(found, expected, "{line}");
        }
        assert_eq!(leading_numbers(b"1;2,5;3;x;5"), 3);
    }
}
