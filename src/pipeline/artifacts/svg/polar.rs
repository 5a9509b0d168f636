//! Polar curves: intensity in the planes C0-180 and C90-270, γ = 0 at the bottom as on every photometric sheet.

use super::super::super::goniogram::{Goniogram, SphereGrid, Zone};
use super::super::super::model::Model;
use super::super::super::vocabulary::space::{Axis, Frame};
use super::super::Artifact;
use super::super::number::text;
use super::super::provenance::source_name;
use super::{Anchor, FAINT, INK, MUTED, Svg, nice_step, one_line};

/// Path of the whole source's curves.
pub const TOTAL: &str = "plots/polar_total.svg";

/// Path of a zone's curves.
pub fn zone_name(zone: &Zone) -> String {
    format!("plots/polar_zone_{:02}_{:02}.svg", zone.row, zone.column)
}

const CENTER: [f64; 2] = [320.0, 350.0];
/// Radius of the outer ring, px.
pub const RADIUS: f64 = 240.0;
/// Colours that stay apart without colour vision (Okabe and Ito).
pub const C0_COLOR: &str = "#0072b2";
/// The other one.
pub const C90_COLOR: &str = "#d55e00";

/// The curves of the whole source and of each zone.
pub fn artifacts(model: &Model) -> Vec<Artifact> {
    let total = plot(model, &model.goniograms.total, "whole source").artifact(TOTAL);
    let zones = model.goniograms.zones.iter().map(|zone| {
        plot(model, &zone.goniogram, &format!("zone row {} column {}", zone.row, zone.column))
            .artifact(&zone_name(zone))
    });
    std::iter::once(total).chain(zones).collect()
}

fn plot(model: &Model, goniogram: &Goniogram, part: &str) -> Svg {
    let grid = &model.goniograms.grid;
    let luminous = goniogram
        .luminous_cd
        .as_deref()
        .filter(|_| goniogram.flux.luminous_lm > Some(0.0))
        .map(|values| (values, "cd", goniogram.flux.luminous_lm, "lm"));
    let radiant = goniogram.radiant_w_per_sr.as_deref().map(|values| (values, "W/sr", goniogram.flux.radiant_w, "W"));
    let (values, unit, flux, flux_unit) = luminous.or(radiant).unwrap_or((&[], "W/sr", None, "W"));
    let peak = values.iter().copied().fold(0.0, f64::max);
    let subtitle = format!(
        "{part}   ·   flux {} {flux_unit}   ·   peak {} {unit}   ·   {} rays",
        text(flux.unwrap_or(0.0), 4),
        text(peak, 4),
        text(goniogram.rays, 7)
    );
    let mut svg = Svg::sheet(640.0, 690.0, &one_line(&source_name(model), 64), &subtitle);
    let step = nice_step(peak, 4.0);
    let rings = (peak / step).ceil().max(1.0);
    axes(&mut svg, step, rings, unit);
    if values.is_empty() {
        return svg;
    }
    let radius = |value: f64| RADIUS * value / (step * rings);
    curve(&mut svg, grid, values, [90.0, 270.0], C90_COLOR, "7 4", radius);
    curve(&mut svg, grid, values, [0.0, 180.0], C0_COLOR, "", radius);
    legend(&mut svg, &model.goniograms.frame);
    svg
}

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

/// Both half planes as one curve from 180° over 0° to 180°.
fn curve(
    svg: &mut Svg,
    grid: &SphereGrid,
    values: &[f64],
    [right, left]: [f64; 2],
    color: &str,
    dashes: &str,
    radius: impl Fn(f64) -> f64,
) {
    let nodes: Vec<f64> = grid.gamma_deg().into_iter().map(f64::to_radians).collect();
    let (right, left) = (half_plane(grid, values, right), half_plane(grid, values, left));
    let on_left = nodes.iter().zip(&left).rev().map(|(gamma, value)| place(*gamma, -1.0, radius(*value)));
    let on_right = nodes.iter().zip(&right).map(|(gamma, value)| place(*gamma, 1.0, radius(*value)));
    polyline(svg, on_left.chain(on_right), color, dashes);
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

/// Intensity over γ at `c_deg`, linear between planes.
fn half_plane(grid: &SphereGrid, values: &[f64], c_deg: f64) -> Vec<f64> {
    let (planes, nodes) = (grid.c_planes(), grid.gamma_nodes());
    let at = c_deg * planes as f64 / 360.0;
    let (low, part) = (at.floor() as usize % planes, at.fract());
    let value = |plane: usize, node: usize| values.get(plane * nodes + node).copied().unwrap_or(0.0);
    (0..nodes).map(|node| (1.0 - part) * value(low, node) + part * value((low + 1) % planes, node)).collect()
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
    fn half_planes_lie_between_the_grid_planes() {
        // 2 γ steps, 3 planes at 0, 120, 240 degrees whose values are 1, 2, 3.
        let grid = SphereGrid::new(2, 3);
        let values = [1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0];
        assert_eq!(half_plane(&grid, &values, 0.0), vec![1.0; 3]);
        assert_eq!(half_plane(&grid, &values, 180.0), vec![2.5; 3]);
        assert_eq!(half_plane(&grid, &values, 270.0), vec![2.5; 3]); // 3/4 of 3 and 1/4 of 1
    }

    #[test]
    fn nadir_is_at_the_bottom_and_c0_on_the_right() {
        let [x, y] = place(0.0, 1.0, 10.0);
        assert!((x - CENTER[0]).abs() < 1e-9 && (y - CENTER[1] - 10.0).abs() < 1e-9);
        let [x, _] = place(std::f64::consts::FRAC_PI_2, 1.0, 10.0);
        assert!((x - CENTER[0] - 10.0).abs() < 1e-9);
    }
}
