//! Axes, curves and legend of a polar chart.

use super::number::text;
use super::svg::{Anchor, FAINT, INK, MUTED, Svg};
use crate::vocabulary::space::{Axis, Frame};

/// Radius of the outer ring, px.
pub const RADIUS: f64 = 240.0;
/// Colours that stay apart without colour vision (Okabe and Ito).
pub const C0_COLOR: &str = "#0072b2";
/// The other one.
pub const C90_COLOR: &str = "#d55e00";
/// Middle of the rings, px.
const CENTER: [f64; 2] = [320.0, 350.0];

/// Where `(gamma, radius)` lies; `side` is +1 to the right, -1 to the left.
pub fn place(gamma: f64, side: f64, radius: f64) -> [f64; 2] {
    [CENTER[0] + side * radius * gamma.sin(), CENTER[1] + radius * gamma.cos()]
}

/// Rings of `step` each and lines of γ.
pub fn axes(svg: &mut Svg, step: f64, rings: f64, unit: &str) {
    for angle in (0..180).step_by(15) {
        let gamma = f64::from(angle).to_radians();
        svg.line(place(gamma, 1.0, RADIUS), place(std::f64::consts::PI - gamma, -1.0, RADIUS), FAINT, 1.0);
    }
    for ring in 1..=rings as usize {
        let radius = RADIUS * ring as f64 / rings;
        svg.circle(CENTER, radius, if ring as f64 == rings { MUTED } else { FAINT });
        let value = text(step * ring as f64, 4);
        let words = if ring as f64 == rings { format!("{value} {unit}") } else { value };
        let [x, y] = place(std::f64::consts::PI, 1.0, radius);
        svg.rect([x + 2.0, y - 6.0], [6.4 * words.chars().count() as f64 + 4.0, 13.0], "#ffffff");
        svg.label(x + 4.0, y + 4.0, 11.0, Anchor::Start, MUTED, &words);
    }
    for angle in (0..=180).step_by(30) {
        for side in [1.0, -1.0] {
            let [x, y] = place(f64::from(angle).to_radians(), side, RADIUS + 20.0);
            if side > 0.0 || !matches!(angle, 0 | 180) {
                svg.label(x, y + 4.0, 12.0, Anchor::Middle, MUTED, &format!("{angle}°"));
            }
        }
    }
}

/// One curve through `points`, px.
pub fn polyline(svg: &mut Svg, points: impl Iterator<Item = [f64; 2]>, color: &str, dashes: &str) {
    let points: Vec<String> = points.map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
    svg.put(format_args!(
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\" stroke-linejoin=\"round\" \
         stroke-dasharray=\"{}\"/>\n",
        points.join(" "),
        if dashes.is_empty() { "none" } else { dashes }
    ));
}

/// Which curve is which, and where γ = 0 points.
pub fn legend(svg: &mut Svg, frame: &Frame) {
    let c90 = Axis::nearest(frame.y()).name();
    let y = 656.0;
    svg.line([24.0, y], [54.0, y], C0_COLOR, 2.5);
    svg.label(62.0, y + 4.0, 12.0, Anchor::Start, INK, &format!("C0 (right, source {}) – C180", frame.c0.name()));
    svg.line([268.0, y], [280.0, y], C90_COLOR, 2.5);
    svg.line([286.0, y], [298.0, y], C90_COLOR, 2.5);
    svg.label(306.0, y + 4.0, 12.0, Anchor::Start, INK, &format!("C90 (right, source {c90}) – C270"));
    let nadir = format!("γ = 0: source {}", frame.nadir.name());
    svg.label(616.0, y + 4.0, 12.0, Anchor::End, INK, &nadir);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nadir_is_at_the_bottom_and_c0_on_the_right() {
        let [x, y] = place(0.0, 1.0, 10.0);
        assert!((x - CENTER[0]).abs() < 1e-9 && (y - CENTER[1] - 10.0).abs() < 1e-9);
        let [x, _] = place(std::f64::consts::FRAC_PI_2, 1.0, 10.0);
        assert!((x - CENTER[0] - 10.0).abs() < 1e-9);
    }
}
