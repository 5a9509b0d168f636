//! Aligned text for people: a heading, then cells in columns.

use pipeline::vocabulary::units::Flux;
use service::calendar::rfc_3339;
use service::telemetry::visible;

/// Rows of a heading and cells; columns are as wide as their widest cell, the last cell of a row is free.
#[derive(Default)]
pub struct Table {
    rows: Vec<(String, Vec<String>)>,
}

impl Table {
    /// A row; a heading said by the row above is left blank. What a terminal would obey is written out.
    pub fn row<const N: usize>(&mut self, heading: &str, cells: [String; N]) {
        let shown = |text: &str| visible(text).into_owned();
        self.rows.push((shown(heading), cells.iter().map(|cell| shown(cell)).collect()));
    }
}

impl std::fmt::Display for Table {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let wide = |text: &String| text.chars().count();
        let first = self.rows.iter().map(|(heading, _)| wide(heading)).max().unwrap_or(0);
        // The last cell of a row is a sentence, and sentences do not set the width of columns.
        let mut widths = Vec::new();
        for (_, cells) in &self.rows {
            let aligned = cells.len().saturating_sub(1);
            widths.resize(widths.len().max(aligned), 0);
            for (width, cell) in widths.iter_mut().zip(&cells[..aligned]) {
                *width = wide(cell).max(*width);
            }
        }
        let mut above = None;
        for (heading, cells) in &self.rows {
            let shown = if above == Some(heading) { "" } else { heading };
            let mut line = format!("{shown:first$}");
            for (k, cell) in cells.iter().enumerate() {
                let width = if k + 1 < cells.len() { widths[k] } else { 0 };
                line += &format!("  {cell:width$}");
            }
            writeln!(f, "{}", line.trim_end())?;
            above = Some(heading);
        }
        Ok(())
    }
}

/// A count with its thousands apart: 20 000 000.
pub fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::new();
    for (k, digit) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

/// A moment given in epoch ms: 2026-11-22 04:05 UTC.
pub fn moment(epoch_ms: i64) -> String {
    let written = rfc_3339(epoch_ms);
    let (date, time) = written.split_once('T').unwrap_or((&written, ""));
    format!("{date} {} UTC", time.get(..5).unwrap_or_default())
}

/// A number to 5 significant digits.
pub fn number(value: f64) -> String {
    // The magnitude after rounding: 0.99999999 is written as 1.0000.
    let written = format!("{value:.4e}");
    let magnitude = written.split_once('e').and_then(|(_, exponent)| exponent.parse().ok()).unwrap_or(0.0_f64);
    if value == 0.0 {
        "0".to_owned()
    } else if (-4.0..6.0).contains(&magnitude) {
        format!("{value:.*}", (4.0 - magnitude).max(0.0) as usize)
    } else {
        written
    }
}

/// Three numbers, "1.0000, 2.0000, 0.5000".
pub fn triple(values: [f64; 3]) -> String {
    values.map(number).join(", ")
}

/// A flux in the units it is known in.
pub fn flux(flux: Flux) -> String {
    let in_unit = |value: Option<f64>, unit| value.map(|value| format!("{} {unit}", number(value)));
    let known: Vec<String> =
        [in_unit(flux.luminous_lm, "lm"), in_unit(flux.radiant_w, "W")].into_iter().flatten().collect();
    if known.is_empty() { "unknown".to_owned() } else { known.join(", ") }
}

/// A share in per cent.
pub fn percent(part: f64, whole: f64) -> String {
    if whole > 0.0 { format!("{:.3} %", 100.0 * part / whole) } else { "-".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up_and_headings_are_said_once() {
        let mut table = Table::default();
        table.row("flux", ["in".into(), "1 lm".into()]);
        table.row("flux", ["rejected".into(), "0 lm".into()]);
        table.row("notices", ["a sentence that is longer than any column".into()]);
        assert_eq!(
            table.to_string(),
            "flux     in        1 lm\n         rejected  0 lm\nnotices  a sentence that is longer than any column\n"
        );
    }

    #[test]
    fn a_name_cannot_act_on_the_terminal_and_columns_line_up_all_the_same() {
        let mut table = Table::default();
        table.row("la\u{202e}b", ["\x1b[31m".into(), "one".into()]);
        table.row("shop", ["b\nc".into(), "two".into()]);
        assert_eq!(table.to_string(), "la\\u{202e}b  \\u{1b}[31m  one\nshop         b\\u{a}c     two\n");
    }

    #[test]
    fn a_moment_is_a_date_and_a_time() {
        // date -u -d @951868799, and so on.
        let moments = [951_868_799_999, 0, -1, 4_102_444_800_000, 1_709_164_800_000].map(moment);
        let expected =
            ["2000-02-29 23:59", "1970-01-01 00:00", "1969-12-31 23:59", "2100-01-01 00:00", "2024-02-29 00:00"];
        assert_eq!(moments, expected.map(|text| format!("{text} UTC")));
    }

    #[test]
    fn numbers_are_short_and_keep_their_unit() {
        assert_eq!(
            [0.0, 0.999_999_99, -54.7712, 123_456.7, 2.5e7, 3.14159e-6].map(number),
            ["0", "1.0000", "-54.771", "123457", "2.5000e7", "3.1416e-6"]
        );
        assert_eq!([0, 999, 1000, 20_000_000].map(count), ["0", "999", "1 000", "20 000 000"]);
        let both = Flux { radiant_w: Some(1.0), luminous_lm: Some(683.0) };
        assert_eq!(
            [both, Flux { radiant_w: None, ..both }, Flux::default()].map(flux),
            ["683.00 lm, 1.0000 W", "683.00 lm", "unknown"]
        );
    }
}
