//! The spectrum of a channel from a file of its own: two columns of text, wavelength and spectral density, under whatever
//! header the program that wrote it puts above them.
//!
//! | read | how it is known | wavelengths |
//! |---|---|---|
//! | two columns (OSRAM .txt, CSV, Zemax .spcd) | nothing else fits | nm, or µm (.spcd) by magnitude |
//! | LightTools .sre | a line `dfat 1.0`; `continuous` or `discrete`, `radiometric` or `photometric` | nm |
//! | IES TM-27 (XML) | begins with `<`, and is called so | nm |
//! | Speos .spectrum 1.0 | first line `OPTIS - Spectrum file v1.0`, then a description and the number of rows | nm |
//!
//! Columns are separated by blanks, tabs, semicolons or commas; a comma inside a column is a decimal one. Lines that begin with
//! `#`, `!`, `%` or `//` are comments; words above the first row are a header, below it they are a fault.

use super::spectrum_xml;
use crate::error::Error;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::spectrum::Table;
use crate::vocabulary::wavelength::{WavelengthUnit, lowest_dark};
use serde::Serialize;

/// Largest file, bytes: 0.01 nm steps over the visible range stay below it.
pub const MAX_BYTES: usize = 1 << 20;
/// Above this, nm, is no light that anybody sees; wavelengths in Å that are taken for nm are above it.
const FAR_NM: f64 = 2000.0;
/// Half the width that a line of a discrete spectrum is given, nm.
const HALF_LINE_NM: f64 = 0.01;

/// What a spectrum file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum SpectrumFormat {
    /// Two columns under any header.
    #[serde(rename = "two columns")]
    Columns,
    /// LightTools .sre.
    #[serde(rename = "LightTools .sre")]
    LightTools,
    /// Speos .spectrum 1.0.
    #[serde(rename = "Speos .spectrum")]
    Speos,
    /// IES TM-27.
    #[serde(rename = "IES TM-27")]
    Tm27,
}

impl SpectrumFormat {
    /// The name people use.
    pub fn name(self) -> &'static str {
        match self {
            SpectrumFormat::Columns => "two columns",
            SpectrumFormat::LightTools => "LightTools .sre",
            SpectrumFormat::Speos => "Speos .spectrum",
            SpectrumFormat::Tm27 => "IES TM-27",
        }
    }
}

/// A spectrum file, read.
#[derive(Clone, Debug)]
pub struct SpectrumFile {
    /// What it is.
    pub format: SpectrumFormat,
    /// Its spectrum.
    pub table: Table,
    /// What was repaired or odd.
    pub notices: Notices,
}

/// A row and the byte it begins at.
#[derive(Clone, Copy, Debug)]
struct Row {
    nm: f64,
    value: f64,
    byte: u64,
}

/// Reads a spectrum file.
///
/// # Errors
/// [`Error::Malformed`] and [`Error::Refused`] with codes `spectrum.*`, at the byte of the line they concern.
pub fn parse(bytes: &[u8]) -> Result<SpectrumFile, Error> {
    if bytes.len() > MAX_BYTES {
        let found = format!("The file has {} bytes; a spectrum is read up to {MAX_BYTES}.", bytes.len());
        return Err(Error::refused("spectrum.too_large", found, "Send the spectrum itself, not the rays."));
    }
    refuse_binary(bytes)?;
    let mut reader = Reader::default();
    let text = String::from_utf8_lossy(bytes);
    if text.trim_start_matches('\u{feff}').trim_start().starts_with('<') {
        reader.format = Some(SpectrumFormat::Tm27);
        for (nm, value, byte) in spectrum_xml::rows(&text)? {
            reader.row(Row { nm, value, byte })?;
        }
        return reader.end();
    }
    for (byte, line) in lines(bytes) {
        reader.line(byte, line)?;
    }
    reader.end()
}

/// Encrypted Speos 2.0 files, UTF-16 and everything else that is no text has a zero byte early on.
fn refuse_binary(bytes: &[u8]) -> Result<(), Error> {
    let Some(at) = bytes.iter().position(|byte| *byte == 0) else { return Ok(()) };
    let found = "The file is not plain text (8 bits a character).";
    let remedy = "Save it as text in UTF-8; a Speos spectrum as version 1.0, because 2.0 is encrypted.";
    Err(Error::malformed("spectrum.binary", found, remedy).at_byte(at as u64))
}

/// Lines without their ends, which may be any of the three, and the byte each begins at. A byte order mark is no text.
fn lines(bytes: &[u8]) -> impl Iterator<Item = (u64, String)> + '_ {
    let mark = if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
    let mut byte = 0;
    bytes.split(|byte| matches!(byte, b'\n' | b'\r')).map(move |line| {
        let skipped = if byte == 0 { mark } else { 0 };
        let begin = byte + skipped;
        byte += line.len() + 1;
        (begin as u64, String::from_utf8_lossy(line.get(skipped..).unwrap_or_default()).trim().to_owned())
    })
}

/// Reads line by line.
#[derive(Default)]
struct Reader {
    format: Option<SpectrumFormat>,
    /// Lines seen that are not blank; comments count, because only the first line makes a Speos file.
    seen: u64,
    /// The number of rows that a Speos header announces, and the byte it stands at.
    announced: Option<(usize, u64)>,
    discrete: bool,
    /// Rows have decimal points; decimal commas.
    signs: [bool; 2],
    /// A header says that wavelengths are in Å.
    angstrom: bool,
    rows: Vec<Row>,
    notices: Notices,
}

impl Reader {
    fn line(&mut self, byte: u64, line: String) -> Result<(), Error> {
        if self.format == Some(SpectrumFormat::Speos) && self.seen == 1 {
            // The description, which may be empty, or look like anything.
            self.seen = 2;
            return Ok(());
        }
        if line.is_empty() {
            return Ok(());
        }
        self.seen += 1;
        if line.starts_with(['#', '!', '%']) || line.starts_with("//") {
            return Ok(());
        }
        let fields = fields(&line);
        let numbers: Vec<Option<f64>> = fields.iter().map(|field| number(field)).collect();
        let numeric = !numbers.is_empty() && numbers.iter().all(Option::is_some);
        if numeric {
            self.signs[0] |= line.contains('.');
            self.signs[1] |= fields.iter().any(|field| field.contains(','));
        }
        match numbers.as_slice() {
            [Some(nm), Some(value)] => self.row(Row { nm: *nm, value: *value, byte }),
            [Some(count)] if self.rows.is_empty() => {
                if self.format == Some(SpectrumFormat::Speos) && self.announced.is_none() {
                    self.announced = Some((*count as usize, byte));
                }
                Ok(())
            }
            _ if self.rows.is_empty() && !numeric => self.header(byte, &line),
            _ => Err(wrong_row(&line, byte, fields.len())),
        }
    }

    fn row(&mut self, row: Row) -> Result<(), Error> {
        if !(row.nm.is_finite() && row.value.is_finite()) {
            let found = "A wavelength or a value is not a finite number.";
            return Err(Error::malformed("spectrum.not_finite", found, "Correct the row.").at_byte(row.byte));
        }
        self.rows.push(row);
        Ok(())
    }

    fn header(&mut self, byte: u64, line: &str) -> Result<(), Error> {
        let words = line.to_lowercase();
        self.angstrom |= words.contains("angstrom") || words.contains(['\u{e5}', '\u{212b}']);
        if self.seen == 1 && words.starts_with("optis - spectrum") {
            if words.contains("v2") {
                let found = "This is a Speos spectrum of version 2, which is encrypted.";
                let remedy = "Save it as version 1.0, or export its wavelengths and values as two columns.";
                return Err(Error::refused("spectrum.speos_version", found, remedy).at_byte(byte));
            }
            self.format = Some(SpectrumFormat::Speos);
        } else if words.starts_with("dfat ") {
            self.format = Some(SpectrumFormat::LightTools);
        } else if self.format == Some(SpectrumFormat::LightTools) {
            match words.as_str() {
                "discrete" => self.discrete = true,
                "photometric" => {
                    let found = "The values are photometric: lm per nm. Where nobody sees anything they say nothing.";
                    let remedy = "Export the spectrum as radiometric.";
                    return Err(Error::refused("spectrum.photometric", found, remedy).at_byte(byte));
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn end(mut self) -> Result<SpectrumFile, Error> {
        if self.rows.is_empty() {
            let found = "There is no row of a wavelength and a value.";
            let remedy = "Send a text of two columns: wavelength in nm (or µm) and spectral density.";
            return Err(Error::malformed("spectrum.no_rows", found, remedy).at_byte(0));
        }
        if let Some((announced, byte)) = self.announced.filter(|(announced, _)| *announced != self.rows.len()) {
            let found = format!("The header announces {announced} rows, the file has {}.", self.rows.len());
            let remedy = "Fetch the file again if rows are missing, or correct the number.";
            return Err(Error::malformed("spectrum.count", found, remedy).at_byte(byte));
        }
        if self.signs == [true; 2] {
            let found =
                "Some numbers have a decimal point and others a comma: one of the two groups digits, or is damage.";
            let error = Error::malformed("spectrum.decimal_sign", found, "Write all numbers alike.");
            return Err(error.at_byte(self.rows.first().map_or(0, |row| row.byte)));
        }
        self.settle_unit()?;
        self.repair_dark_noise()?;
        self.order()?;
        if self.discrete && self.rows.len() > 1 {
            self.widen_lines()?;
        }
        let points: Vec<(f64, f64)> = self.rows.iter().map(|row| (row.nm, row.value)).collect();
        let table = Table::new(&points).ok_or_else(|| {
            let found = "No value is above 0: the spectrum holds no light.";
            Error::refused("spectrum.dark", found, "Export it again.")
                .at_byte(self.rows.first().map_or(0, |row| row.byte))
        })?;
        Ok(SpectrumFile { format: self.format.unwrap_or(SpectrumFormat::Columns), table, notices: self.notices })
    }

    /// One unit for all wavelengths: as the header says, else by their size.
    fn settle_unit(&mut self) -> Result<(), Error> {
        if self.angstrom {
            self.rows.iter_mut().for_each(|row| row.nm *= 0.1);
            self.notices
                .add("spectrum.angstrom", "The wavelengths are in Å, as the header says; they were read as such.");
        }
        let unit = WavelengthUnit::of(self.rows.iter().map(|row| row.nm)).map_err(|stray| {
            let found =
                format!("The wavelengths are neither all nm (100 to 20000) nor all µm (0.1 to 20); see {stray}.");
            let byte = self.rows.iter().find(|row| row.nm == stray).map_or(0, |row| row.byte);
            Error::malformed("spectrum.wavelength", found, "Write all wavelengths in nm.").at_byte(byte)
        })?;
        if unit == WavelengthUnit::Micrometre {
            self.rows.iter_mut().for_each(|row| row.nm *= unit.nm());
            self.notices
                .add("spectrum.micrometres", "The wavelengths are in µm by their size; they were read as such.");
        } else if self.rows.iter().all(|row| row.nm > FAR_NM) {
            let told = "All wavelengths are above 2000 nm, which nobody sees. If they are in Å, divide them by 10.";
            self.notices.add("spectrum.far_infrared", told);
        }
        Ok(())
    }

    fn repair_dark_noise(&mut self) -> Result<(), Error> {
        let most = self.rows.iter().fold(0.0, |most: f64, row| most.max(row.value));
        if let Some(row) = self.rows.iter().find(|row| row.value < lowest_dark(most)) {
            let found = format!("The value {} is negative, and by more than 1 % of the highest, {most}.", row.value);
            let remedy = "Subtract the right dark spectrum, or correct the row.";
            return Err(Error::refused("spectrum.negative", found, remedy).at_byte(row.byte));
        }
        let told = "Small negative values, a spectrometer's dark noise, were set to 0.";
        for row in self.rows.iter_mut().filter(|row| row.value < 0.0) {
            row.value = 0.0;
            self.notices.add("spectrum.negative", told);
        }
        Ok(())
    }

    /// The order of rows carries no meaning, and saying the same twice is no contradiction.
    fn order(&mut self) -> Result<(), Error> {
        if !self.rows.is_sorted_by(|a, b| a.nm <= b.nm) {
            self.rows.sort_by(|a, b| a.nm.total_cmp(&b.nm));
            self.notices.add("spectrum.sorted", "The wavelengths did not increase; the rows were put in order.");
        }
        let contradiction = |pair: &&[Row]| matches!(pair, [a, b] if a.nm == b.nm && a.value != b.value);
        if let Some([a, b]) = self.rows.windows(2).find(contradiction) {
            let found = format!("{} nm has two values, {} and {}.", a.nm, a.value, b.value);
            return Err(
                Error::malformed("spectrum.contradiction", found, "Leave one of them.").at_byte(a.byte.max(b.byte))
            );
        }
        let rows = self.rows.len();
        self.rows.dedup_by(|a, b| a.nm == b.nm);
        if self.rows.len() < rows {
            let told = "Rows that repeat a wavelength and its value were left out.";
            self.notices.count("spectrum.duplicate", (rows - self.rows.len()) as u64, None, told);
        }
        Ok(())
    }

    /// Lines as narrow triangles of the same area: a table is a density.
    fn widen_lines(&mut self) -> Result<(), Error> {
        let close = |pair: &&[Row]| matches!(pair, [a, b] if b.nm - a.nm <= 2.0 * HALF_LINE_NM);
        if let Some([_, line]) = self.rows.windows(2).find(close) {
            let found = format!("Two lines of a discrete spectrum are closer than {} nm.", 2.0 * HALF_LINE_NM);
            return Err(Error::refused("spectrum.lines", found, "Add them up.").at_byte(line.byte));
        }
        let triangle = |row: &Row| {
            let at = |nm: f64, value: f64| Row { nm, value, ..*row };
            [at(row.nm - HALF_LINE_NM, 0.0), *row, at(row.nm + HALF_LINE_NM, 0.0)]
        };
        self.rows = self.rows.iter().flat_map(triangle).collect();
        self.notices.add("spectrum.lines", "The spectrum is one of lines; each was made 0.02 nm wide.");
        Ok(())
    }
}

fn wrong_row(line: &str, byte: u64, columns: usize) -> Error {
    let start: String = line.chars().take(40).collect();
    let found = match columns {
        3.. => format!("The row {start:?} has {columns} columns; it is not known which of them is meant."),
        _ => format!("The row {start:?} is not a wavelength and a value."),
    };
    Error::malformed("spectrum.row", found, "Write two numbers a row: wavelength in nm and value.").at_byte(byte)
}

/// The columns of a line. Without a blank, tab or semicolon the commas separate; otherwise they are decimal, or trail.
fn fields(line: &str) -> Vec<String> {
    let blank = |c: char| c == ';' || c.is_whitespace();
    let pieces: Vec<&str> = match line.contains(blank) {
        true => line.split(blank).map(|piece| piece.trim_matches('"').trim_end_matches(',')).collect(),
        false => line.split(',').map(|piece| piece.trim_matches('"')).collect(),
    };
    pieces.into_iter().filter(|piece| !piece.is_empty()).map(str::to_owned).collect()
}

/// A number with a decimal point or comma, not both; as Rust reads it, which is bounded by its length.
fn number(field: &str) -> Option<f64> {
    match (field.matches(',').count(), field.contains('.')) {
        (0, _) => field.parse().ok(),
        (1, false) => field.replace(',', ".").parse().ok(),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Place;

    fn points(text: &str) -> Vec<(f64, f64)> {
        parse(text.as_bytes()).unwrap().table.points().collect()
    }

    /// Code and byte of a fault.
    fn fault(bytes: &[u8]) -> (&'static str, Option<u64>) {
        match parse(bytes) {
            Err(Error::Malformed(fault) | Error::Refused(fault)) => match fault.at {
                Some(Place::Byte(byte)) => (fault.code, Some(byte)),
                _ => (fault.code, None),
            },
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn columns_are_told_apart_however_they_are_written() {
        let expected = [(400.0, 0.5), (410.5, 1.0), (420.0, 0.25)];
        for text in [
            "400 0.5\n410.5 1\n420 .25\n",
            "400\t0.5\r\n410.5\t1.0\r\n420\t0.25",
            "400;0,5\n410,5;1\n420;0,25\n",
            "400,0.5\n410.5,1\n420,0.25\n",
            "400, 0.5\n410.5, 1\n420, 0.25\n",
            "400,0 0,5\n410,5 1,0\n420,0 0,25\n",
            "  400  \t 5e-1 \r410.5 1\r\r420 2.5E-1;\r",
            "\u{feff}Wavelength [nm];Value\n\n# a comment\n400;0.5\n! another\n410.5;1\n// third\n% 4\n420;0.25\n",
            "\"wavelength\",\"value\"\n\"400\",\"0.5\"\n410.5,1\n420,0.25\n",
            "5 mm LED, 20 mA\n3\n400 0.5\n410.5 1\n420 0.25\n",
        ] {
            assert_eq!(points(text), expected, "{text:?}");
            assert_eq!(parse(text.as_bytes()).unwrap().format, SpectrumFormat::Columns);
        }
        assert_eq!(points("555 1"), [(555.0, 1.0)]);
    }

    #[test]
    fn micrometres_are_known_by_their_size() {
        let read = parse(b"0.40 0.5\n0.41 1\n").unwrap();
        assert_eq!(read.notices.count_of("spectrum.micrometres"), 1);
        let nm: Vec<f64> = read.table.points().map(|(nm, _)| nm).collect();
        assert!((nm[0] - 400.0).abs() < 1e-9 && (nm[1] - 410.0).abs() < 1e-9);
        assert_eq!(fault(b"0.40 1\n410 1\n"), ("spectrum.wavelength", Some(7)));
        assert_eq!(fault(b"400 1\n0.41 1\n"), ("spectrum.wavelength", Some(6)));
        assert_eq!(fault(b"50 1\n60 1\n"), ("spectrum.wavelength", Some(0)));
        assert_eq!(fault(b"-400 1\n"), ("spectrum.wavelength", Some(0)));
    }

    #[test]
    fn angstroms_and_tm27_are_read_and_decimal_signs_not_mixed() {
        assert_eq!(points("Wavelength (Angstrom) value\n4000 0.5\n4100 1\n"), [(400.0, 0.5), (410.0, 1.0)]);
        assert_eq!(parse(b"4000 0.5\n4100 1\n").unwrap().notices.count_of("spectrum.far_infrared"), 1);
        assert_eq!(fault(b"400;0.5\n410;1,234\n"), ("spectrum.decimal_sign", Some(0)));
        assert_eq!(
            points("<IESTM2714><SpectralData wavelength=\"400\">0.5</SpectralData></IESTM2714>"),
            [(400.0, 0.5)]
        );
        assert_eq!(fault(b"<IESTM2714></IESTM2714>").0, "spectrum.no_rows");
    }

    #[test]
    fn lighttools_says_what_its_values_are() {
        let file = |kind: &str, unit: &str| {
            format!("#\tSome LED\ndfat 1.0\t\ndataname:\t LED 5\n{kind}\n{unit}\t\n400\t0.5\n450\t1\n")
        };
        let continuous = parse(file("continuous", "radiometric").as_bytes()).unwrap();
        assert_eq!(continuous.format, SpectrumFormat::LightTools);
        assert_eq!(continuous.table.points().collect::<Vec<_>>(), [(400.0, 0.5), (450.0, 1.0)]);
        assert_eq!(fault(file("continuous", "photometric").as_bytes()), ("spectrum.photometric", Some(49)));
        // Two lines, a third and two thirds of the flux.
        let lines = parse(file("discrete", "radiometric").as_bytes()).unwrap();
        assert_eq!(lines.notices.count_of("spectrum.lines"), 1);
        let bands = crate::vocabulary::spectrum::Bands::new(vec![390.0, 410.0, 440.0, 460.0]).unwrap();
        for (share, exact) in lines.table.shares(&bands).iter().zip([1.0 / 3.0, 0.0, 2.0 / 3.0]) {
            assert!((share - exact).abs() < 1e-9, "{share} {exact}");
        }
        assert_eq!(fault(b"dfat 1.0\ndiscrete\n400 1\n400.01 1\n"), ("spectrum.lines", Some(24)));
    }

    #[test]
    fn speos_counts_its_rows() {
        let read = parse(b"OPTIS - Spectrum file v1.0\nWhite 5 %\n2\n360\t4\n830\t4\n").unwrap();
        assert_eq!((read.format, read.table.points().count()), (SpectrumFormat::Speos, 2));
        // The description may be empty, or look like a row; some programs leave the count out.
        for text in
            ["OPTIS - Spectrum file v1\n\n2\n360 4\n830 4\n", "OPTIS - Spectrum fie v1.0\n400 7\n360 4\n830 4\n"]
        {
            assert_eq!(points(text), [(360.0, 4.0), (830.0, 4.0)], "{text:?}");
        }
        assert_eq!(fault(b"OPTIS - Spectrum file v1.0\nx\n3\n360 4\n830 4\n"), ("spectrum.count", Some(29)));
        assert_eq!(fault(b"OPTIS - Spectrum file v2.0\nx\n"), ("spectrum.speos_version", Some(0)));
    }

    #[test]
    fn order_repetition_and_dark_noise_are_repaired_and_told() {
        let read = parse(b"420 1\n410 0.5\n400 0.25\n410 0.5\n430 -0.005\n").unwrap();
        assert_eq!(read.table.points().collect::<Vec<_>>(), [(400.0, 0.25), (410.0, 0.5), (420.0, 1.0), (430.0, 0.0)]);
        for code in ["spectrum.sorted", "spectrum.duplicate", "spectrum.negative"] {
            assert_eq!(read.notices.count_of(code), 1, "{code}");
        }
        assert_eq!(parse(b"400 1\n410 2\n").unwrap().notices, Notices::default());
    }

    #[test]
    fn what_cannot_be_meant_names_its_byte() {
        let cases: [(&[u8], &str, u64); 14] = [
            (b"", "spectrum.no_rows", 0),
            (b"wavelength value\n", "spectrum.no_rows", 0),
            (b"400\n410\n", "spectrum.no_rows", 0),
            (b"400 1\nend of data\n", "spectrum.row", 6),
            (b"400 1\n410\n", "spectrum.row", 6),
            (b"400 1 2\n", "spectrum.row", 0),
            (b"400,5,0,5\n", "spectrum.row", 0),
            (b"x\n400 1\n410 1,000.5\n", "spectrum.row", 8),
            (b"400 1\n410 nan\n", "spectrum.not_finite", 6),
            (b"400 1\ninf 1\n", "spectrum.not_finite", 6),
            (b"400 1\n410 -0.011\n", "spectrum.negative", 6),
            (b"400 1\n410 1\n400 2\n", "spectrum.contradiction", 12),
            (b"400 0\n410 0\n", "spectrum.dark", 0),
            (b"4\x000\x000\x00", "spectrum.binary", 1),
        ];
        for (bytes, code, byte) in cases {
            assert_eq!(fault(bytes), (code, Some(byte)), "{}", String::from_utf8_lossy(bytes));
        }
        assert_eq!(fault(&vec![b' '; MAX_BYTES + 1]), ("spectrum.too_large", None));
    }

    #[test]
    fn every_prefix_and_every_damage_is_an_answer() {
        let whole = b"OPTIS - Spectrum file v1.0\nWhite\n3\n360,5\t4\n4,1e2;-0.01 \n830\t4\n";
        for length in 0..=whole.len() {
            let _ = parse(&whole[..length]);
            for byte in [0, b',', b'-', b'e', b'9', b'\n', 0xff] {
                let mut damaged = whole.to_vec();
                if let Some(at) = damaged.get_mut(length) {
                    *at = byte;
                }
                if let Ok(read) = parse(&damaged) {
                    assert!(read.table.lm_per_w().is_finite());
                }
            }
        }
    }
}
