//! Numbers as people write them.

/// Up to here every whole number is a 64-bit float.
const LARGEST: f64 = (1_u64 << 53) as f64;

/// A count of at least 1: `1000000`, `1e6`, `2.5e8`; `None` where it is none.
pub fn count(text: &str) -> Option<u64> {
    let text = text.trim();
    let as_float =
        || text.parse::<f64>().ok().filter(|number| number.fract() == 0.0 && (1.0..=LARGEST).contains(number));
    text.parse().ok().or_else(|| as_float().map(|number| number as u64)).filter(|number| *number > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_read_as_people_write_them() {
        for (text, expected) in [("1000000", 1_000_000), ("1e9", 1_000_000_000), ("2.5e8", 250_000_000), (" 1 ", 1)] {
            assert_eq!(count(text), Some(expected), "{text}");
        }
        for wrong in ["", "0", "-1", "1.5", "1e-3", "1e99", "inf", "NaN", "1 000", "many"] {
            assert_eq!(count(wrong), None, "{wrong}");
        }
    }
}
