//! Rows of numbers at random access: an index of the byte where every [`CHUNK_RAYS`]-th row starts, made in one forward pass, so
//! that memory is 8 bytes for so many rows whatever the file.

use super::lines::{Line, Lines, Separator, leading_numbers};
use super::tail::{MOST_LINES, Tail, judge_padding};
use crate::error::Error;
use crate::formats::record::{Bytes, CHUNK_RAYS, RawRay, Records, SpectralData};
use crate::vocabulary::declaration::Column;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::wavelength::NM_PER_UM;
use std::sync::Arc;

/// What one column of a file holds and the factor to mm, nm, W or lm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slot {
    /// What it holds; [`Column::Flux`] is put where the W are.
    pub column: Column,
    /// Factor to mm, nm, W or lm.
    pub scale: f64,
}

impl Slot {
    /// A column with positions in units of `mm` millimetres.
    pub fn new(column: Column, mm: f64) -> Slot {
        let scale = match column {
            Column::X | Column::Y | Column::Z => mm,
            Column::WavelengthUm => NM_PER_UM,
            _ => 1.0,
        };
        Slot { column, scale }
    }

    /// Slots of these columns.
    pub fn of(columns: &[Column], mm: f64) -> Vec<Slot> {
        columns.iter().map(|column| Slot::new(*column, mm)).collect()
    }
}

/// Rows looked at to see how they are written.
pub const PROOF_ROWS: usize = 64;
/// Share of rows that a header may announce too many or too few.
const COUNT_TOLERANCE: f64 = 0.01;
/// Code of the notice for rows beyond the number that the header announces.
pub const MORE_ROWS: &str = "text.more_rows";
/// Position and direction.
pub const LINE_OF_LIGHT: [Column; 6] = [Column::X, Column::Y, Column::Z, Column::L, Column::M, Column::N];

/// [`LINE_OF_LIGHT`] and what follows it.
pub fn ray_columns(more: &[Column]) -> Vec<Column> {
    [&LINE_OF_LIGHT, more].concat()
}

/// What the rays carry of the spectrum when their columns are these.
pub fn spectral(columns: &[Column]) -> SpectralData {
    let has = |column| columns.contains(&column);
    if has(Column::WavelengthNm) || has(Column::WavelengthUm) {
        SpectralData::Wavelength
    } else if has(Column::TristimulusX) && has(Column::TristimulusZ) && has(Column::LuminousFlux) {
        SpectralData::Tristimulus
    } else {
        SpectralData::None
    }
}

/// How the rows of a file are written.
#[derive(Clone, Debug)]
pub struct Grammar {
    /// What stands between numbers.
    pub separator: Separator,
    /// What the columns hold.
    pub slots: Vec<Slot>,
    /// The line after the last row, in lower case, where the format has one.
    pub end: Option<&'static str>,
    /// The value of every ray, where no column holds flux.
    weight: f64,
    /// Bytes of the shortest row there can be.
    shortest: usize,
}

/// The rows of a file.
pub struct Rows {
    bytes: Arc<dyn Bytes>,
    grammar: Grammar,
    /// Offsets of rows 0, [`CHUNK_RAYS`], 2 × [`CHUNK_RAYS`] ..
    starts: Vec<u64>,
    count: u64,
    /// The line after the last row was there.
    has_end: bool,
    /// Lines behind the last row.
    tail: Tail,
}

impl Rows {
    /// Finds the rows from byte `from` on. A last row that the end of the file cuts short is left out, and so are lines of words
    /// behind the last row, each with a notice; words between rows are taken as rows, and reading them fails.
    ///
    /// # Errors
    /// `rays.too_many`, `text.line_too_long`, `text.control`, [`Error::Unreadable`].
    pub fn index(
        bytes: Arc<dyn Bytes>,
        from: u64,
        grammar: Grammar,
        limits: &Limits,
        notices: &mut Notices,
    ) -> Result<Rows, Error> {
        let (starts, tail) = (Vec::new(), Tail::default());
        let mut rows = Rows { bytes: Arc::clone(&bytes), grammar, starts, count: 0, has_end: false, tail };
        let mut lines = Lines::from(bytes.as_ref(), from);
        while let Some(line) = lines.read_next()? {
            match rows.grammar.kind(line) {
                Kind::Comment => continue,
                Kind::End => {
                    rows.has_end = true;
                    break;
                }
                Kind::Words if rows.tail.line_count() < MOST_LINES => rows.tail.add(line),
                Kind::Row | Kind::Words if line.ended || rows.keeps_last(line, notices) => {
                    for at in rows.tail.take() {
                        rows.add(at, limits)?;
                    }
                    rows.add(line.at, limits)?;
                }
                Kind::Row | Kind::Words => {}
            }
        }
        if let Some(at) = lines.stopped_at().filter(|_| !rows.has_end) {
            judge_padding(bytes.as_ref(), at, notices)?;
        }
        rows.tail.tell(notices);
        Ok(rows)
    }

    /// Lines behind the last row.
    pub fn tail(&self) -> &Tail {
        &self.tail
    }

    /// The flux of the rows is that of `column`.
    pub fn hold_flux(&mut self, column: Column) {
        self.grammar.slots.iter_mut().filter(|slot| slot.column == Column::Flux).for_each(|slot| slot.column = column);
    }

    fn add(&mut self, at: u64, limits: &Limits) -> Result<(), Error> {
        if self.count == limits.max_rays {
            let found = format!("The file holds more than the {} rays allowed.", limits.max_rays);
            return Err(Error::refused("rays.too_many", found, "Thin the file out, or raise the limit.").at_byte(at));
        }
        if self.count.is_multiple_of(CHUNK_RAYS as u64) {
            self.starts.push(at);
        }
        self.count += 1;
        Ok(())
    }

    /// Whether the last row, with no line end behind it, is whole as far as can be told.
    fn keeps_last(&self, line: Line<'_>, notices: &mut Notices) -> bool {
        if self.grammar.ray(self.count, line).is_err() {
            notices.add("text.last_row_cut", "The file ends inside its last row; the row was left out.");
            return false;
        }
        let told = "The last line has no line end: if the file was cut there, its last number is wrong.";
        notices.add("text.unterminated", told);
        true
    }

    /// How many there are.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The line after the last row was there.
    pub fn has_end(&self) -> bool {
        self.has_end
    }

    /// Holds the file to the number of rays its header announces. More rows than announced are not read: nor does the vendor's
    /// program. Fewer mean that the file was cut, and with it the total, which is the sum of the rays.
    ///
    /// # Errors
    /// `text.row_count`, where more than 1 % of the rows are missing.
    pub fn hold_to(&mut self, announced: u64, notices: &mut Notices) -> Result<(), Error> {
        let share = |part: u64, whole: u64| 100.0 * part as f64 / whole.max(1) as f64;
        if self.count < announced {
            let missing = share(announced - self.count, announced);
            let found = format!(
                "The header announces {announced} rays; the file has {} rows: {missing:.2} % are missing.",
                self.count
            );
            if missing > 100.0 * COUNT_TOLERANCE {
                let remedy =
                    "Fetch the file again, the copy is not complete; if it is, correct the number in its header.";
                return Err(Error::malformed("text.row_count", found, remedy).at_byte(self.bytes.len()));
            }
            notices.add("text.fewer_rows", found);
        } else if self.count > announced {
            let more = self.count - announced;
            let told = format!(
                "The header announces {announced} rays and {} rows follow; those beyond, {:.2} % of them, were not read.",
                self.count,
                share(more, self.count)
            );
            notices.count(MORE_ROWS, more, None, told);
        }
        self.count = self.count.min(announced);
        Ok(())
    }
}

/// Whether so many rows beyond those announced are more than a wrong number explains.
pub fn too_many_more(unread: u64, read: u64) -> bool {
    unread as f64 > COUNT_TOLERANCE * (unread + read) as f64
}

/// How the rows of a file from byte `from` on are written, by the first of them.
///
/// # Errors
/// As [`Lines::read_next`].
pub fn separator(bytes: &dyn Bytes, from: u64, fewest: usize) -> Result<Separator, Error> {
    let mut lines = Lines::from(bytes, from);
    let mut rows: Vec<Vec<u8>> = Vec::new();
    while rows.len() < PROOF_ROWS
        && let Some(line) = lines.read_next()?
    {
        if !line.is_comment() && leading_numbers(line.text) >= fewest {
            rows.push(line.text.to_vec());
        }
    }
    Ok(Separator::of_rows(rows.iter().map(Vec::as_slice)))
}

impl Records for Rows {
    fn read(&self, first: u64, count: usize, rays: &mut Vec<RawRay>) -> Result<(), Error> {
        let chunk = CHUNK_RAYS as u64;
        let Some(start) = usize::try_from(first / chunk).ok().and_then(|k| self.starts.get(k)) else { return Ok(()) };
        let mut lines = Lines::from(self.bytes.as_ref(), *start);
        let mut row = first - first % chunk;
        let end = self.count.min(first + count as u64);
        while row < end
            && let Some(line) = lines.read_next()?
        {
            if matches!(self.grammar.kind(line), Kind::Row | Kind::Words) {
                if row >= first {
                    rays.push(self.grammar.ray(row, line)?);
                }
                row += 1;
            }
        }
        Ok(())
    }
}

/// What a line behind the header is.
enum Kind {
    Row,
    Comment,
    End,
    /// No row: a remark, a total.
    Words,
}

impl Grammar {
    /// Rows of these columns.
    pub fn new(separator: Separator, slots: Vec<Slot>, end: Option<&'static str>) -> Grammar {
        use Column::{Flux, LuminousFlux, RadiantFlux};
        let has_flux = slots.iter().any(|slot| matches!(slot.column, Flux | RadiantFlux | LuminousFlux));
        let shortest = (2 * slots.len()).saturating_sub(1);
        Grammar { separator, slots, end, weight: if has_flux { 0.0 } else { 1.0 }, shortest }
    }

    fn kind(&self, line: Line<'_>) -> Kind {
        match self.end {
            _ if line.is_comment() => Kind::Comment,
            Some(end) if line.text.eq_ignore_ascii_case(end.as_bytes()) => Kind::End,
            _ if self.is_row(line) => Kind::Row,
            _ => Kind::Words,
        }
    }

    /// It begins with a number, and is long enough for all of them unless it is cut.
    fn is_row(&self, line: Line<'_>) -> bool {
        if line.ended && line.text.len() < self.shortest {
            return false;
        }
        let numeric = match line.text {
            [b'0'..=b'9' | b'"', ..] | [b'+' | b'-' | b'.' | b'*', b'0'..=b'9' | b'.' | b'*', ..] => true,
            _ => leading_numbers(line.text) > 0,
        };
        let named = || self.slots.first().is_some_and(|slot| slot.column == Column::Ignored);
        numeric || (named() && self.separator.fields(line.text).count() == self.slots.len())
    }

    /// The ray of a line that is row `row`, from 0. A row in which a program could not write its numbers (`****`) is one of NaN,
    /// which the check of rays refuses and counts.
    ///
    /// # Errors
    /// `text.not_a_number` and `text.columns`, with their byte.
    pub fn ray(&self, row: u64, line: Line<'_>) -> Result<RawRay, Error> {
        let overflown = || line.text.windows(2).any(|pair| pair == b"**");
        match self.parse(row, line) {
            Err(_) if overflown() => Ok(RawRay { origin_mm: [f64::NAN; 3], ..RawRay::default() }),
            parsed => parsed,
        }
    }

    fn parse(&self, row: u64, line: Line<'_>) -> Result<RawRay, Error> {
        let mut fields = self.separator.fields(line.text);
        let mut ray = RawRay { radiant: self.weight, ..RawRay::default() };
        for (found, slot) in self.slots.iter().enumerate() {
            let Some((place, field)) = fields.next() else { return Err(self.wrong_count(row, line.at, found)) };
            if slot.column == Column::Ignored {
                continue;
            }
            let number = self.separator.number(field).or(field.is_empty().then_some(f64::NAN));
            let Some(number) = number else {
                return Err(not_a_number(row, line.at + place as u64, field));
            };
            put(&mut ray, slot.column, slot.scale * number);
        }
        match fields.count() {
            0 => Ok(ray),
            more => Err(self.wrong_count(row, line.at, self.slots.len() + more)),
        }
    }

    fn wrong_count(&self, row: u64, at: u64, found: usize) -> Error {
        let found = format!("Row {} has {found} columns, not {}.", row + 1, self.slots.len());
        let remedy =
            "Declare what each column holds, if all rows have as many; else export the file again, every ray alike.";
        Error::malformed("text.columns", found, remedy).at_byte(at)
    }
}

fn not_a_number(row: u64, at: u64, field: &[u8]) -> Error {
    let shown: String = String::from_utf8_lossy(field).chars().take(20).collect();
    let found = format!("Row {} has \"{}\" where a number belongs.", row + 1, shown.escape_debug());
    Error::malformed("text.not_a_number", found, "Export the file again; it is damaged here.").at_byte(at)
}

fn put(ray: &mut RawRay, column: Column, value: f64) {
    match column {
        Column::X => ray.origin_mm[0] = value,
        Column::Y => ray.origin_mm[1] = value,
        Column::Z => ray.origin_mm[2] = value,
        Column::L => ray.direction[0] = value,
        Column::M => ray.direction[1] = value,
        Column::N => ray.direction[2] = value,
        Column::Flux | Column::RadiantFlux => ray.radiant = value,
        Column::LuminousFlux => ray.luminous = value,
        Column::WavelengthNm | Column::WavelengthUm => ray.wavelength_nm = value,
        Column::TristimulusX => ray.xz[0] = value,
        Column::TristimulusZ => ray.xz[1] = value,
        Column::Ignored => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Place;

    fn rows(text: &str, notices: &mut Notices) -> Result<Rows, Error> {
        let slots = Slot::of(&ray_columns(&[Column::LuminousFlux, Column::WavelengthUm]), 10.0);
        let grammar = Grammar::new(Separator::Blank, slots, Some("stop"));
        Rows::index(Arc::new(text.as_bytes().to_vec()), 0, grammar, &Limits::default(), notices)
    }

    const GOOD: &str = "1 2 3 0 0 1 5 0.5\n";

    #[test]
    fn columns_go_where_they_belong() {
        let mut rays = Vec::new();
        let found = rows(&format!("{GOOD}# 7\nSTOP\n9 9"), &mut Notices::default()).unwrap();
        found.read(0, 1, &mut rays).unwrap();
        assert!(found.has_end() && found.count() == 1);
        let expected = RawRay {
            origin_mm: [10.0, 20.0, 30.0],
            direction: [0.0, 0.0, 1.0],
            luminous: 5.0,
            wavelength_nm: 500.0,
            ..RawRay::default()
        };
        assert_eq!(rays, [expected]);
    }

    #[test]
    fn a_bad_row_names_its_byte_and_its_number() {
        let cases = [
            ("1 2 3 0 0 1 5\n", "text.columns", 18, "Row 2 has 7 columns, not 8."),
            ("1 2 3 0 0 1 5 0.5 7 7\n", "text.columns", 18, "Row 2 has 10 columns, not 8."),
            ("1 2 3 0 zero 1 5 0.5\n", "text.not_a_number", 26, "Row 2 has \"zero\" where a number belongs."),
            ("total: 1\n", "text.not_a_number", 18, "Row 2 has \"total:\" where a number belongs."),
        ];
        for (bad, code, byte, found) in cases {
            let rows = rows(&[GOOD, bad, GOOD].concat(), &mut Notices::default()).unwrap();
            let mut rays = Vec::new();
            let Err(Error::Malformed(fault)) = rows.read(0, 3, &mut rays) else { panic!("read {bad}") };
            assert_eq!((fault.code, fault.at, fault.found.as_str()), (code, Some(Place::Byte(byte)), found));
            // Rows beyond the bad one can be had.
            rows.read(2, 1, &mut Vec::new()).unwrap();
        }
    }

    #[test]
    fn the_tail_of_a_cut_file_is_told() {
        for (tail, code, count) in [
            ("1 2 3 0 0", "text.last_row_cut", 1),
            ("1 2 3 0 0 1 5 0.5e", "text.last_row_cut", 1),
            ("1 2 3 0 0 1 5 0.5", "text.unterminated", 2),
        ] {
            let mut notices = Notices::default();
            let rows = rows(&[GOOD, tail].concat(), &mut notices).unwrap();
            assert_eq!((rows.count(), notices.count_of(code), notices.iter().count()), (count, 1, 1), "{tail}");
        }
    }

    #[test]
    fn an_announced_count_is_a_promise() {
        let mut notices = Notices::default();
        let mut found = rows(&GOOD.repeat(3), &mut notices).unwrap();
        assert_eq!(found.hold_to(4, &mut notices).unwrap_err().code(), "text.row_count");
        found.hold_to(3, &mut notices).unwrap();
        assert_eq!(notices, Notices::default());
        found.hold_to(2, &mut notices).unwrap();
        assert_eq!((found.count(), notices.count_of("text.more_rows")), (2, 1));
        let mut rays = Vec::new();
        found.read(0, 2, &mut rays).unwrap();
        assert_eq!(rays.len(), 2);
    }
}
