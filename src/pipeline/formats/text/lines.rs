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
        is_comment(self.text)
    }
}

/// Starts as comments do in ray files and in what scripts write.
pub fn is_comment(line: &[u8]) -> bool {
    matches!(line.first(), Some(b'#' | b'!' | b'%')) || line.starts_with(b"//")
}

/// Reads lines forward. `\n`, `\r\n`, `\n\r` and `\r` all end a line, because blank lines are skipped. NUL and Ctrl-Z end the
/// text, as they did for the programs that pad files with them: see [`Lines::stopped_at`].
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

    /// Where the text ends before the file does: at a NUL or a Ctrl-Z.
    pub fn stopped_at(&self) -> Option<u64> {
        self.block.get(self.from).filter(|byte| is_padding(**byte)).map(|_| self.at())
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

/// NUL and Ctrl-Z: old programs fill the end of a text with them.
pub fn is_padding(byte: u8) -> bool {
    byte == 0 || byte == 0x1a
}

/// Index of the first `\n` or `\r`, or of what ends the text.
fn line_end(bytes: &[u8]) -> Option<usize> {
    let ends = |byte: &u8| *byte == b'\n' || *byte == b'\r' || is_padding(*byte);
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
    /// The same, with decimal commas.
    BlankComma,
    /// One tab, with decimal commas.
    Tab,
    /// One tab, with decimal points.
    TabPoint,
    /// One comma.
    Comma,
    /// One semicolon, with decimal commas.
    Semicolon,
    /// One semicolon, with decimal points.
    SemicolonPoint,
}

impl Separator {
    /// What stands between the fields of this line: the rarest sign it has. Where a point is a decimal one, a comma is none.
    pub fn of(line: &[u8]) -> Separator {
        let has = |sign: u8| line.contains(&sign);
        match (has(b';'), has(b'\t') && has(b','), has(b',')) {
            (true, ..) if has(b'.') => Separator::SemicolonPoint,
            (true, ..) => Separator::Semicolon,
            (_, true, _) if has(b'.') => Separator::TabPoint,
            (_, true, _) => Separator::Tab,
            (.., true) if has_decimal_commas(line) => Separator::BlankComma,
            (.., true) => Separator::Comma,
            _ => Separator::Blank,
        }
    }

    /// What all of `rows` are written with, if they are written alike: that of the first which shows it.
    pub fn of_rows<'r>(rows: impl IntoIterator<Item = &'r [u8]>) -> Separator {
        let shows = |separator: &Separator| *separator != Separator::Blank && *separator != Separator::Semicolon;
        let mut first = None;
        for row in rows {
            let separator = Separator::of(row);
            if shows(&separator) || row.contains(&b',') {
                return separator;
            }
            first = first.or(Some(separator));
        }
        first.unwrap_or(Separator::Blank)
    }

    /// The decimal sign is a comma.
    fn has_decimal_comma(self) -> bool {
        matches!(self, Separator::BlankComma | Separator::Tab | Separator::Semicolon)
    }

    /// The fields of a line, from its byte 0: each with its place in the line. One sign at the end of a line ends its last field.
    pub fn fields(self, line: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
        let sign = match self {
            Separator::Blank | Separator::BlankComma => None,
            Separator::Tab | Separator::TabPoint => Some(b'\t'),
            Separator::Comma => Some(b','),
            Separator::Semicolon | Separator::SemicolonPoint => Some(b';'),
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

    /// A number of this line, whole or not at all: with decimal commas a point is a grouping sign, and the other way round. Beyond
    /// Rust's own grammar: Fortran's `1.5D-03` and `1.5-103`, quotes, and what stands where no number could be written, which
    /// becomes NaN: C's NaN and infinity, Fortran's `****`, `#NUM!` and `N/A` of tables.
    pub fn number(self, field: &[u8]) -> Option<f64> {
        let text = str::from_utf8(field).ok()?;
        if self.has_decimal_comma() && text.contains('.') && !text.contains('#') {
            return None;
        }
        text.parse().ok().or_else(|| self.odd_number(text))
    }

    fn odd_number(self, text: &str) -> Option<f64> {
        let text = text.trim_matches('"').trim();
        if text.len() > LONGEST_NUMBER {
            return None;
        }
        let unsigned = text.trim_start_matches(['-', '+']).to_ascii_lowercase();
        let overflown = unsigned.len() > 1 && unsigned.bytes().all(|sign| sign == b'*');
        let in_table = matches!(unsigned.as_str(), "#num!" | "#value!" | "#div/0!" | "#n/a" | "n/a" | "na" | "null");
        if overflown || in_table || unsigned.starts_with("1.#") || unsigned.starts_with("nan(") {
            return Some(f64::NAN);
        }
        let mut plain = String::with_capacity(text.len() + 1);
        for sign in text.chars() {
            match sign {
                ',' if self.has_decimal_comma() => plain.push('.'),
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

/// Numbers between blanks, and every comma inside one of them: `0,5 1 -2,25`.
fn has_decimal_commas(line: &[u8]) -> bool {
    let decimal = |field: &[u8]| {
        let digit = |at: usize| field.get(at).is_some_and(u8::is_ascii_digit);
        let comma = field.iter().position(|byte| *byte == b',');
        comma.is_none_or(|at| digit(at + 1) && (digit(at.wrapping_sub(1)) || at == 0) && digit(field.len() - 1))
            && Separator::BlankComma.number(field).is_some()
    };
    let mut fields = Separator::BlankComma.fields(line).map(|(_, field)| field).peekable();
    let one = fields.next();
    fields.peek().is_some() && one.is_some_and(decimal) && fields.all(decimal)
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
        for text in ["****", "-***", "#NUM!", "N/A", "na"] {
            assert!(Separator::Blank.number(text.as_bytes()).unwrap().is_nan(), "{text}");
        }
    }

    /// Grouped digits are no number: read whole or not at all.
    #[test]
    fn one_decimal_sign_for_all() {
        for (separator, text) in [
            (Separator::SemicolonPoint, "1,234"),
            (Separator::Semicolon, "1.234"),
            (Separator::Semicolon, "1.234,5"),
            (Separator::TabPoint, "1,234"),
            (Separator::BlankComma, "1.5"),
            (Separator::Blank, "1,234"),
            (Separator::Blank, "1.5mm"),
        ] {
            assert_eq!(separator.number(text.as_bytes()), None, "{separator:?} {text}");
        }
        assert_eq!(Separator::of(b"0,5 1 -2,25e-3 0"), Separator::BlankComma);
        assert_eq!(Separator::of(b"0, 5, 1"), Separator::Comma);
        assert_eq!(Separator::of(b"1.5;2;3"), Separator::SemicolonPoint);
        assert_eq!(Separator::of(b"1.5\t2,5\t3"), Separator::TabPoint);
        let rows = |rows: [&'static str; 2]| Separator::of_rows(rows.map(str::as_bytes));
        assert_eq!(rows(["0;0;1", "0.5;0;1"]), Separator::SemicolonPoint);
        assert_eq!(rows(["0;0;1", "0,5;0;1"]), Separator::Semicolon);
        assert_eq!(rows(["0 0 1", "0,5 0 1"]), Separator::BlankComma);
        assert_eq!(rows(["0 0 1", "0.5 0 1"]), Separator::Blank);
    }

    #[test]
    fn nul_and_control_z_end_the_text() {
        for tail in [&b"\0\0\0"[..], b"\x1a", b"\r\n\x1a\0\0"] {
            let bytes = [b"a b\nc", tail].concat();
            let mut lines = Lines::of(&bytes);
            assert_eq!(lines.read_next().unwrap().unwrap().to_text(), "a b");
            let last = lines.read_next().unwrap().unwrap();
            assert!(last.text == b"c" && last.ended);
            assert_eq!(lines.read_next().unwrap(), None);
            assert!(lines.stopped_at().is_some_and(|at| at >= 5 && at < bytes.len() as u64));
        }
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
