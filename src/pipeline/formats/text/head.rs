//! What stands before the rows of a file in free columns, and how its rows are written.

use super::column_names::{Named, named, names};
use super::lines::{Lines, Separator, leading_numbers};
use super::rows::{PROOF_ROWS, separator};
use super::units::{self, Told};
use crate::error::Error;
use crate::formats::record::Bytes;
use crate::vocabulary::notice::Notices;

/// Numbers a row starts with at least: position, direction, flux.
const WITH_FLUX: usize = 7;
/// The same without flux, which has to be declared.
pub const WITHOUT_FLUX: usize = 6;

/// What stands before the rows, and how they are written.
pub struct Head {
    /// Lines before the rows.
    pub texts: Vec<(String, String)>,
    /// Of those the last that names columns, with the units of a row below it.
    pub named: Option<Named>,
    /// Units that lines of words tell.
    pub told: Told,
    /// What stands between numbers.
    pub separator: Separator,
    /// Columns of the first row.
    pub width: usize,
    /// Offset of the first row.
    pub rows_at: u64,
}

impl Head {
    /// Reads up to the first row, which has at least as many numbers as a ray with flux; where no line has, as one without.
    ///
    /// # Errors
    /// `columns.no_rows`, `text.line_too_long`, [`Error::Unreadable`].
    pub fn read(bytes: &dyn Bytes, declared: Option<usize>, max_bytes: usize) -> Result<Head, Error> {
        let fewest = declared.map_or(WITH_FLUX, |width| width.clamp(WITHOUT_FLUX, WITH_FLUX));
        match Head::with(bytes, fewest, max_bytes) {
            Err(Error::Malformed(fault)) if fault.code == "columns.no_rows" => {
                Head::with(bytes, WITHOUT_FLUX, max_bytes)
            }
            head => head,
        }
    }

    fn with(bytes: &dyn Bytes, fewest: usize, max_bytes: usize) -> Result<Head, Error> {
        let mut lines = Lines::of(bytes);
        let mut texts: Vec<String> = Vec::new();
        while let Some(line) = lines.read_next()? {
            if leading_numbers(line.text) >= fewest {
                let (rows_at, first) = (line.at, line.text.to_vec());
                let separator = separator(bytes, rows_at, fewest)?;
                let width = separator.fields(&first).count();
                let told = texts.iter().fold(Told::default(), |told, text| told.or(Told::of(text)));
                let named = naming(&texts, width);
                let texts = texts.into_iter().map(|text| ("header".to_owned(), text)).collect();
                return Ok(Head { texts, named, told, separator, width, rows_at });
            }
            if line.at > max_bytes as u64 {
                break;
            }
            texts.push(line.to_text());
        }
        let found = format!("No line has the {WITH_FLUX} numbers of a ray: position, direction, flux.");
        Err(Error::malformed("columns.no_rows", found, "Send a file with one ray on a line.").at_byte(lines.at()))
    }

    /// Tells of lines of numbers before the rows, which nobody gives a meaning.
    pub fn tell_bare_lines(&self, rows: u64, notices: &mut Notices) {
        let bare = |text: &&str| {
            let separator = Separator::of(text.as_bytes());
            separator.fields(text.as_bytes()).all(|(_, field)| separator.number(field).is_some())
        };
        let lines: Vec<&str> = self.texts.iter().map(|(_, text)| text.as_str()).filter(bare).collect();
        let Some(first) = lines.first() else { return };
        let shown: String = first.chars().take(60).collect();
        let told = format!(
            "Before the rows stand numbers that nobody gives a meaning, \"{shown}\"; they were not used. The file has {rows} rows."
        );
        notices.count("columns.bare_line", lines.len() as u64, None, told);
    }

    /// The numbers of the first rows; NaN for what is none.
    ///
    /// # Errors
    /// As [`Lines::read_next`].
    pub fn proof(&self, bytes: &dyn Bytes) -> Result<Vec<Vec<f64>>, Error> {
        let mut lines = Lines::from(bytes, self.rows_at);
        let mut proof = Vec::new();
        while proof.len() < PROOF_ROWS
            && let Some(line) = lines.read_next()?
        {
            if !line.is_comment() && leading_numbers(line.text) > 0 {
                let fields = self.separator.fields(line.text);
                proof.push(fields.map(|(_, field)| self.separator.number(field).unwrap_or(f64::NAN)).collect());
            }
        }
        Ok(proof)
    }
}

/// What the last line that names columns says, and the row of units below it.
fn naming(texts: &[String], width: usize) -> Option<Named> {
    let plain = |text: &str| text.trim_start_matches(['#', '!', '%', '/', ' ']).to_owned();
    let found = texts.iter().enumerate().rev().find_map(|(k, text)| Some((k, named(&plain(text), width)?)));
    let (at, named) = found?;
    // Where the names stand between blanks, a unit in brackets is a field of its own here.
    let fields = |text: &str| match text.contains([',', ';', '\t']) {
        true => names(text),
        false => text.split_whitespace().map(str::to_owned).collect(),
    };
    let units = texts.get(at + 1).and_then(|text| units::row(&fields(&plain(text)), width));
    Some(match units {
        Some(units) => named.with_units(&units),
        None => named,
    })
}
