//! Additional columns and additional text (4.7.5, 4.7.6), and the standard's UTF-32LE.

use crate::error::Error;
use crate::formats::bytes::Cursor;
use crate::vocabulary::notice::Notices;

/// Bytes of a column's name: 128 code points.
pub const COLUMN_NAME_BYTES: u64 = 512;

/// What a file has beyond the standard's columns and texts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Additional {
    /// Names of the additional columns.
    pub columns: Vec<String>,
    /// Additional text; NULs within it are line ends.
    pub text: String,
}

impl Additional {
    /// Reads both.
    ///
    /// # Errors
    /// `rays.truncated`.
    pub fn read(
        cursor: &mut Cursor<'_>,
        columns: u32,
        text_bytes: u32,
        notices: &mut Notices,
    ) -> Result<Additional, Error> {
        let mut names = Vec::new();
        for _ in 0..columns {
            names.push(utf32(&cursor.block("the name of an additional column", COLUMN_NAME_BYTES)?, notices));
        }
        let block = cursor.block("the additional text", text_bytes.into())?;
        let lines = block.chunks(4).map(|point| if point == [0; 4] { b"\n\0\0\0" } else { point });
        let text = utf32(&lines.flatten().copied().collect::<Vec<u8>>(), notices);
        Ok(Additional { columns: names, text })
    }

    /// Bytes the text takes: a multiple of 32, with a NUL at its end.
    pub fn text_bytes(&self) -> u32 {
        let points = self.text.chars().count() as u32;
        if points == 0 { 0 } else { (4 * (points + 1)).next_multiple_of(32) }
    }

    /// What a person wants to see of it.
    pub fn told(&self) -> Vec<(String, String)> {
        let columns = self.columns.iter().map(|name| ("additional_column", name.clone()));
        let text = (!self.text.is_empty()).then(|| ("additional_text", self.text.clone()));
        columns.chain(text).map(|(name, value)| (name.to_owned(), value)).collect()
    }
}

/// UTF-32LE up to the first NUL, without white space round it; what is no code point becomes U+FFFD.
pub fn utf32(block: &[u8], notices: &mut Notices) -> String {
    let (points, _) = block.as_chunks::<4>();
    let codes = points.iter().map(|point| u32::from_le_bytes(*point)).take_while(|code| *code != 0);
    let mut damaged = false;
    let text: String = codes
        .map(|code| {
            char::from_u32(code).unwrap_or_else(|| {
                damaged = true;
                char::REPLACEMENT_CHARACTER
            })
        })
        .collect();
    if damaged {
        notices.add("tm25.text", "A text holds what is no code point of UTF-32; it was replaced by U+FFFD.");
    }
    text.trim().to_owned()
}

/// `text` as UTF-32LE in exactly `bytes` bytes, zero padded; what does not fit before the last NUL is cut.
pub fn to_utf32(text: &str, bytes: usize) -> Vec<u8> {
    let points = (bytes / 4).saturating_sub(1);
    let mut block: Vec<u8> = text.chars().take(points).flat_map(|point| u32::from(point).to_le_bytes()).collect();
    block.resize(bytes, 0);
    block
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn utf32_goes_there_and_back_and_survives_damage() {
        let mut notices = Notices::default();
        assert_eq!(utf32(&to_utf32("Größe Ω 光", 64), &mut notices), "Größe Ω 光");
        assert_eq!(utf32(&to_utf32("too long", 16), &mut notices), "too");
        assert_eq!(notices.iter().count(), 0);
        assert_eq!(utf32(&[0x41, 0, 0, 0, 0, 0xd8, 0, 0, 0xff], &mut notices), "A\u{fffd}");
        assert_eq!(notices.count_of("tm25.text"), 1);
    }
}
