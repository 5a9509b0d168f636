//! Drawings, written by hand: a drawing is a list of shapes, and a plotting library would decide its looks for us.

use super::Artifact;
use super::xml::escaped;
use std::fmt::Write as _;

/// Text colour.
pub const INK: &str = "#1d2733";
/// Secondary text, axes.
pub const MUTED: &str = "#64707d";
/// Grid lines.
pub const FAINT: &str = "#d6dce2";

/// A drawing in the making; coordinates in px, y down.
pub struct Svg {
    text: String,
}

/// Where text hangs on its point.
#[derive(Clone, Copy)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

impl Svg {
    /// A white sheet with a title and a line of small print under it.
    pub fn sheet(width: f64, height: f64, title: &str, subtitle: &str) -> Svg {
        let mut svg = Svg { text: String::new() };
        svg.put(format_args!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
             font-family=\"Helvetica, Arial, 'DejaVu Sans', sans-serif\">\n<title>{0}</title>\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n",
            escaped(title)
        ));
        svg.label(24.0, 34.0, 17.0, Anchor::Start, INK, title);
        svg.label(24.0, 54.0, 12.0, Anchor::Start, MUTED, subtitle);
        svg
    }

    pub fn put(&mut self, piece: std::fmt::Arguments<'_>) {
        // Writing to a String cannot fail.
        let _ = self.text.write_fmt(piece);
    }

    pub fn label(&mut self, x: f64, y: f64, size: f64, anchor: Anchor, fill: &str, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        self.put(format_args!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" text-anchor=\"{anchor}\" fill=\"{fill}\">{}</text>\n",
            escaped(text)
        ));
    }

    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], stroke: &str, width: f64) {
        self.put(format_args!(
            "<path d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"{stroke}\" stroke-width=\"{width}\"/>\n",
            from[0], from[1], to[0], to[1]
        ));
    }

    pub fn rect(&mut self, corner: [f64; 2], size: [f64; 2], fill: &str) {
        self.put(format_args!(
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{fill}\"/>\n",
            corner[0], corner[1], size[0], size[1]
        ));
    }

    pub fn circle(&mut self, center: [f64; 2], radius: f64, stroke: &str) {
        self.put(format_args!(
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius:.1}\" fill=\"none\" stroke=\"{stroke}\"/>\n",
            center[0], center[1]
        ));
    }

    pub fn artifact(mut self, name: &str) -> Artifact {
        self.text.push_str("</svg>\n");
        Artifact { name: name.to_owned(), media_type: "image/svg+xml", bytes: self.text.into_bytes() }
    }
}

/// Foreign text fit for a title: one line without control characters, at most `most` characters.
pub fn one_line(text: &str, most: usize) -> String {
    let clean: String = text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect();
    let words = clean.split_whitespace().collect::<Vec<_>>().join(" ");
    if words.chars().count() <= most {
        words
    } else {
        words.chars().take(most.saturating_sub(1)).chain(['…']).collect()
    }
}

/// The largest of 1, 2, 2.5, 5 times a power of ten that gives at least `least` steps up to `max`.
pub fn nice_step(max: f64, least: f64) -> f64 {
    if !(max > 0.0 && max.is_finite()) {
        return 1.0;
    }
    let rough = max / least;
    let power = 10_f64.powf(rough.log10().floor());
    let factor = [5.0, 2.5, 2.0, 1.0].into_iter().find(|factor| factor * power <= rough).unwrap_or(1.0);
    super::number::rounded(factor * power, 6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_text_cannot_leave_its_element() {
        assert_eq!(escaped("a<b>&\u{1}\u{ffff}c"), "a&lt;b&gt;&amp;  c");
        assert_eq!(one_line("a\nb\t c\u{7}", 80), "a b c");
        assert_eq!(one_line(&"x".repeat(10_000), 5), "xxxx…");
    }

    #[test]
    fn rings_are_round_numbers() {
        for (max, step) in [(318.3, 50.0), (1.0, 0.25), (0.0079, 0.001), (0.0, 1.0), (f64::NAN, 1.0)] {
            assert_eq!(nice_step(max, 4.0), step, "{max}");
        }
    }
}
