//! Values to colours: viridis (matplotlib, CC0), perceptually uniform and readable without colour vision.

use super::number::text;
use super::svg::{Anchor, INK, MUTED, Svg, nice_step};

#[rustfmt::skip]
const VIRIDIS: [[u8; 3]; 17] = [
    [68, 1, 84], [72, 24, 106], [71, 45, 123], [66, 64, 134], [59, 82, 139], [51, 99, 141], [44, 114, 142], [38, 130, 142],
    [33, 145, 140], [31, 160, 136], [40, 174, 128], [63, 188, 115], [94, 201, 98], [132, 212, 75], [173, 220, 48],
    [216, 226, 25], [253, 231, 37],
];

/// The colour of `share` in 0..=1.
pub fn viridis(share: f64) -> [u8; 3] {
    let at = share.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f64;
    let low = (at as usize).min(VIRIDIS.len() - 2);
    let part = at - low as f64;
    std::array::from_fn(|k| {
        let (from, to) = (f64::from(VIRIDIS[low][k]), f64::from(VIRIDIS[low + 1][k]));
        (from + part * (to - from)).round() as u8
    })
}

/// "#rrggbb".
pub fn hex([red, green, blue]: [u8; 3]) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// True where white text reads better than dark text.
pub fn is_dark([red, green, blue]: [u8; 3]) -> bool {
    0.2126 * f64::from(red) + 0.7152 * f64::from(green) + 0.0722 * f64::from(blue) < 140.0
}

/// A vertical colour bar from 0 to `max` at `corner`, with round ticks; `unit` above it.
pub fn color_bar(svg: &mut Svg, corner: [f64; 2], height: f64, max: f64, unit: &str) {
    const STEPS: usize = 64;
    let width = 16.0;
    let step_px = height / STEPS as f64;
    svg.put(format_args!("<g shape-rendering=\"crispEdges\">\n"));
    for step in 0..STEPS {
        let share = (step as f64 + 0.5) / STEPS as f64;
        let top = corner[1] + height - (step + 1) as f64 * step_px;
        svg.rect([corner[0], top], [width, step_px + 0.3], &hex(viridis(share)));
    }
    svg.put(format_args!("</g>\n"));
    svg.label(corner[0], corner[1] - 12.0, 12.0, Anchor::Start, INK, unit);
    let tick = nice_step(max, 4.0);
    for k in 0..=(max / tick * (1.0 + 1e-9)).floor() as usize {
        let y = corner[1] + height * (1.0 - k as f64 * tick / max.max(f64::MIN_POSITIVE));
        svg.line([corner[0] + width, y], [corner[0] + width + 4.0, y], MUTED, 1.0);
        svg.label(corner[0] + width + 8.0, y + 4.0, 11.0, Anchor::Start, INK, &text(k as f64 * tick, 4));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_map_has_its_published_ends_and_middle() {
        assert_eq!(hex(viridis(0.0)), "#440154");
        assert_eq!(hex(viridis(0.5)), "#21918c");
        assert_eq!(hex(viridis(1.0)), "#fde725");
        assert_eq!(viridis(f64::INFINITY), viridis(1.0));
        assert!(is_dark(viridis(0.0)) && !is_dark(viridis(1.0)));
    }
}
