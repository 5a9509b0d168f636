//! Polar curves: intensity in the planes C0-180 and C90-270, γ = 0 at the bottom as on every photometric sheet.

use crate::artifacts::provenance::source_name;
use crate::goniogram::{Goniogram, SphereGrid, Zone};
use crate::model::Model;
use crate::writing::Artifact;
use crate::writing::number::text;
use crate::writing::polar_chart::{C0_COLOR, C90_COLOR, RADIUS, axes, legend, place, polyline};
use crate::writing::svg::{Svg, nice_step, one_line};

/// Path of the whole source's curves.
pub const TOTAL: &str = "plots/polar_total.svg";

/// Path of a zone's curves.
pub fn zone_name(zone: &Zone) -> String {
    format!("plots/polar_{}.svg", zone.name())
}

/// The curves of the whole source and of each zone.
pub fn artifacts(model: &Model) -> Vec<Artifact> {
    let total = plot(model, &model.goniograms.total, "whole source").artifact(TOTAL);
    let with_files = model.goniograms.zones_with_files();
    let zones = model.goniograms.zones.iter().filter(|zone| with_files.contains(&zone.id)).map(|zone| {
        plot(model, &zone.goniogram, &format!("zone {}{}", zone.id, zone.position())).artifact(&zone_name(zone))
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

/// Intensity over γ at `c_deg`, linear between planes.
fn half_plane(grid: &SphereGrid, values: &[f64], c_deg: f64) -> Vec<f64> {
    let (planes, nodes) = (grid.c_planes(), grid.gamma_nodes());
    let at = c_deg * planes as f64 / 360.0;
    let (low, part) = (at.floor() as usize % planes, at.fract());
    let value = |plane: usize, node: usize| values.get(plane * nodes + node).copied().unwrap_or(0.0);
    (0..nodes).map(|node| (1.0 - part) * value(low, node) + part * value((low + 1) % planes, node)).collect()
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
}
