//! Numbers as text: the one place where digits are counted. Six significant digits for arrays (a goniogram of a million rays is
//! known to three), nine for sums, so that fluxes can still be compared after reading.

use serde::ser::{Error as _, SerializeSeq};
use serde::{Serialize, Serializer};

/// Significant digits of array elements.
pub const ARRAY_DIGITS: usize = 6;
/// Significant digits of sums and single facts.
pub const SUM_DIGITS: usize = 9;

/// `value` rounded to `digits` significant digits; its shortest decimal text is then that short.
pub fn rounded(value: f64, digits: usize) -> f64 {
    format!("{value:.*e}", digits.saturating_sub(1)).parse().unwrap_or(value)
}

/// A sum or single fact, rounded for JSON.
pub fn sum(value: f64) -> f64 {
    rounded(value, SUM_DIGITS)
}

/// `value` for people: `digits` significant digits, plain where that is short, else with an exponent.
pub fn text(value: f64, digits: usize) -> String {
    let value = rounded(value, digits);
    if value == 0.0 || (1e-4..1e7).contains(&value.abs()) { format!("{value}") } else { format!("{value:e}") }
}

/// `value` as a plain decimal of at most `decimals` places, without trailing zeros and without a point where none is needed.
pub fn plain(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// A JSON array of numbers, rounded while it is written: no second copy of large arrays.
pub struct Numbers<'a>(pub &'a [f64], pub usize);

impl Serialize for Numbers<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut array = serializer.serialize_seq(Some(self.0.len()))?;
        for value in self.0 {
            if !value.is_finite() {
                return Err(S::Error::custom("an array of the model holds a number that is not finite"));
            }
            array.serialize_element(&rounded(*value, self.1))?;
        }
        array.end()
    }
}

/// A JSON array of rows of `columns` numbers each, to a millionth of the power of ten below the largest of them: what is smaller is 0.
pub struct Matrix<'a>(pub &'a [f64], pub usize);

impl Serialize for Matrix<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let largest = self.0.iter().copied().fold(0.0, f64::max);
        let exponent = if largest > 0.0 { largest.log10().floor() as i32 } else { 0 };
        let digits = move |value: f64| {
            let own = if value > 0.0 { value.log10().floor() as i32 } else { exponent };
            (ARRAY_DIGITS as i32 + 1 + own - exponent).min(ARRAY_DIGITS as i32)
        };
        let counted =
            move |value: &f64| if digits(*value) > 0 { rounded(*value, digits(*value) as usize) } else { 0.0 };
        if self.0.iter().any(|value| !value.is_finite()) {
            return Err(S::Error::custom("an array of the model holds a number that is not finite"));
        }
        let rows = self.0.chunks(self.1.max(1)).map(|row| row.iter().map(counted).map(Short).collect::<Vec<Short>>());
        serializer.collect_seq(rows)
    }
}

/// A number whose zero is "0": most directions of a beam are dark.
struct Short(f64);

impl Serialize for Short {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.0 == 0.0 { serializer.serialize_u64(0) } else { serializer.serialize_f64(self.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_significant_and_text_is_short() {
        assert_eq!(rounded(123_456_789.0, 6), 123_457_000.0);
        assert_eq!(rounded(-1.234_567_89e-12, 6).to_string(), "-0.00000000000123457");
        assert_eq!(rounded(0.0, 6), 0.0);
        assert_eq!(text(2.0 / 3.0, 3), "0.667");
        assert_eq!(text(1.5e-9, 4), "1.5e-9");
        assert_eq!(text(1200.4, 2), "1200");
        assert_eq!(plain(2.5, 6), "2.5");
        assert_eq!(plain(180.0, 6), "180");
        assert_eq!(plain(1.0 / 3.0, 6), "0.333333");
        assert_eq!(plain(-1e-12, 6), "0");
        assert_eq!(plain(100.0, 0), "100");
    }

    #[test]
    fn arrays_hold_short_numbers_and_never_nan() {
        let json = serde_json::to_string(&Matrix(&[0.1 + 0.2, 1.0, 2.0, 1e-30], 2)).unwrap();
        assert_eq!(json, "[[0.3,1.0],[2.0,0]]");
        assert!(serde_json::to_string(&Numbers(&[f64::NAN], 6)).is_err());
        assert!(serde_json::to_string(&Numbers(&[f64::INFINITY], 6)).is_err());
    }
}
