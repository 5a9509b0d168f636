//! One line a cell: column, row, place, then each channel and its bound. Numbers have nine digits; the first line has names and units.

use super::places::Places;
use crate::error::Error;
use crate::evaluation::answer::Answer;
use crate::writing::number::{SUM_DIGITS, rounded};

/// The table.
///
/// # Errors
/// As [`Places::of`].
pub fn bytes(answer: &Answer) -> Result<Vec<u8>, Error> {
    let places = Places::of(answer)?;
    let mut text = "column,row".to_owned();
    places.names.iter().for_each(|name| text.push_str(&format!(",{name}")));
    for channel in &answer.channels {
        text.push_str(&format!(",{} [{}],bound [{}]", channel.name, channel.unit, channel.unit));
    }
    text.push_str("\r\n"); // RFC 4180
    for (cell, place) in places.places.iter().enumerate() {
        text.push_str(&format!("{},{}", cell % answer.columns, cell / answer.columns));
        place.iter().for_each(|at| text.push_str(&format!(",{}", rounded(*at, SUM_DIGITS))));
        for channel in &answer.channels {
            let [value, bound] = [&channel.values, &channel.bounds].map(|numbers| rounded(numbers[cell], SUM_DIGITS));
            text.push_str(&format!(",{value:e},{bound:e}"));
        }
        text.push_str("\r\n");
    }
    Ok(text.into_bytes())
}
