//! What stands behind the last row of a text: `END`, totals, remarks, padding.

use super::lines::{Line, Separator, is_padding};
use crate::error::Error;
use crate::formats::record::Bytes;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::units::Quantity;

/// Most lines of words that are kept until it is known whether rows follow.
pub const MOST_LINES: usize = 64;
/// Longest piece of such a line that is shown.
const SHOWN: usize = 60;
/// Words of a line that tells a total.
const TOTAL_WORDS: [&str; 4] = ["total", "sum", "flux", "power"];
/// Bytes looked at together behind the end of a text.
const BLOCK: u64 = 1 << 16;

/// Lines behind the last row.
#[derive(Clone, Debug, Default)]
pub struct Tail {
    /// Byte offsets and contents.
    lines: Vec<(u64, String)>,
}

impl Tail {
    /// Keeps a line that is no row.
    pub fn add(&mut self, line: Line<'_>) {
        self.lines.push((line.at, line.to_text()));
    }

    /// How many there are.
    pub fn line_count(&self) -> usize {
        self.lines.len()
    }

    /// Byte offsets of the lines; none is kept.
    pub fn take(&mut self) -> Vec<u64> {
        std::mem::take(&mut self.lines).into_iter().map(|(at, _)| at).collect()
    }

    /// The total that one of the lines tells, as written, with its unit where it has one, and that in W or lm.
    pub fn total(&self) -> Option<(f64, Option<(Quantity, f64)>)> {
        self.lines.iter().find_map(|(_, line)| total(line))
    }

    /// Tells them.
    pub fn tell(&self, notices: &mut Notices) {
        let Some((_, first)) = self.lines.first() else { return };
        let shown: String = first.chars().take(SHOWN).collect();
        let told = format!(
            "Behind the last row are lines that are no rays; they were not read: \"{}\".",
            shown.escape_debug()
        );
        notices.count("text.tail", self.lines.len() as u64, None, told);
    }
}

/// A number behind a word of totals, and the unit behind it.
fn total(line: &str) -> Option<(f64, Option<(Quantity, f64)>)> {
    let lower = line.to_lowercase();
    if !TOTAL_WORDS.iter().any(|word| lower.contains(word)) {
        return None;
    }
    let mut words = line.split([' ', '\t', ':', '=', ';', '(', ')', '[', ']']).filter(|word| !word.is_empty());
    let number = words.find_map(|word| Separator::Blank.number(word.as_bytes()).filter(|value| value.is_finite()))?;
    Some((number, words.next().and_then(Quantity::from_unit)))
}

/// Judges what follows a text that a NUL or a Ctrl-Z ends at byte `at`: padding is told, anything else is loss.
///
/// # Errors
/// `text.control`; [`Error::Unreadable`].
pub fn judge_padding(bytes: &dyn Bytes, at: u64, notices: &mut Notices) -> Result<(), Error> {
    let mut next = at;
    while next < bytes.len() {
        let mut block = vec![0; BLOCK.min(bytes.len() - next) as usize];
        bytes.read_at(next, &mut block)?;
        if let Some(k) = block.iter().position(|byte| !is_padding(*byte) && !byte.is_ascii_whitespace()) {
            let found = format!("The text ends with a NUL or Ctrl-Z, and goes on at byte {}.", next + k as u64);
            let remedy = "Fetch or export the file again; it is damaged here.";
            return Err(Error::malformed("text.control", found, remedy).at_byte(at));
        }
        next += block.len() as u64;
    }
    let told = format!("The file ends in {} bytes of padding (NUL or Ctrl-Z).", bytes.len() - at);
    notices.add("text.padding", told);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn totals_as_people_write_them() {
        let watt = Some((Quantity::Radiant, 1.0));
        for (line, expected) in [
            ("Total flux: 1.0 W", Some((1.0, watt))),
            ("Sum = 0.25", Some((0.25, None))),
            ("total power [mW]: 250", Some((250.0, None))),
            ("Flux 3.5 klm", Some((3.5, Some((Quantity::Luminous, 1000.0))))),
            ("END", None),
            ("end of 200 rays", None),
            ("Total", None),
        ] {
            assert_eq!(total(line), expected, "{line}");
        }
    }
}
