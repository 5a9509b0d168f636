//! Text from others (names of files, of keys, what a file says of itself) as it is printed for a person. A terminal obeys control
//! characters, and bidirectional controls show a text in another order than it has: a name could repaint the screen, forge a
//! line or hide its true ending. Such characters are written out; JSON, which programs read, stays as it is.

use std::borrow::Cow;

/// `text` with every character that a terminal would obey, or that cannot be seen, written out, as `\u{1b}`: controls (C0, DEL,
/// C1) with line ends and tabs among them, bidirectional controls, characters of no width, separators of lines.
pub fn visible(text: &str) -> Cow<'_, str> {
    if !text.chars().any(is_hidden) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 8);
    for character in text.chars() {
        match is_hidden(character) {
            true => shown.extend(character.escape_unicode()),
            false => shown.push(character),
        }
    }
    Cow::Owned(shown)
}

/// The general categories Cc, Zl and Zp of Unicode 16, and of Cf what orders text (Bidi_Control) or has no width.
fn is_hidden(character: char) -> bool {
    character.is_control()
        || matches!(character,
            '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}'
            | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

#[cfg(test)]
mod tests {
    use super::visible;

    #[test]
    fn what_a_terminal_would_obey_is_written_out() {
        for (text, shown) in [
            ("\x1b[2J\x1b]0;title\x07", r"\u{1b}[2J\u{1b}]0;title\u{7}"),
            ("\u{9b}31m", r"\u{9b}31m"),
            ("a\r\nb\tc\x7f", r"a\u{d}\u{a}b\u{9}c\u{7f}"),
            ("lamp\u{202e}yar.exe", r"lamp\u{202e}yar.exe"),
            ("\u{2066}x\u{2069}\u{200f}\u{61c}", r"\u{2066}x\u{2069}\u{200f}\u{61c}"),
            ("a\u{200b}b\u{200d}\u{feff}\u{2060}", r"a\u{200b}b\u{200d}\u{feff}\u{2060}"),
            ("x\u{2028}y", r"x\u{2028}y"),
        ] {
            assert_eq!(visible(text), shown);
        }
    }

    #[test]
    fn other_text_stays_as_it_is() {
        // A combining accent, as macOS writes names, and what is not Latin.
        for text in ["", "lamp (1).ray", "e\u{301}clairage", "光源", "مصباح", "→ 5° mm²", r"C:\rays\a"] {
            assert!(matches!(visible(text), std::borrow::Cow::Borrowed(same) if same == text), "{text}");
        }
    }
}
