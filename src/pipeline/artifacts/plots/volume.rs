//! The volume that light comes from, in the three-quarter view of the hull: how much of the light leaves along each line of sight, if it left
//! in all directions alike.

use super::hull::{STAGE, View};
use crate::artifacts::provenance::source_name;
use crate::model::Model;
use crate::volume::Volume;
use crate::writing::Artifact;
use crate::writing::number::text;
use crate::writing::scale::{color_bar, hex, viridis};
use crate::writing::svg::{Svg, one_line};
use std::f64::consts::PI;

/// Edge of a cell of the picture, px.
const CELL_PX: f64 = 5.0;
/// Shades that are told apart: cells of one shade side by side are one rectangle.
const SHADES: f64 = 64.0;

/// `plots/volume.svg`.
pub fn artifact(model: &Model, volume: &Volume) -> Artifact {
    let view = View::new(model);
    let [left, top, width, height] = STAGE;
    let [columns, rows] = [width, height].map(|px| (px / CELL_PX) as usize);
    let (flux, unit) = match &volume.nodes.luminous_lm {
        Some(luminous) => (luminous.as_slice(), "lm/(mm² sr)"),
        None => (volume.nodes.primary(), "W/(mm² sr)"),
    };
    // Emission into all directions alike: a 4π-th per steradian.
    let density: Vec<f64> = flux.iter().zip(&volume.volumes_mm3).map(|(flux, mm3)| flux / (mm3 * 4.0 * PI)).collect();
    let at = |cell: usize| {
        let px = |k: usize| (k as f64 + 0.5) * CELL_PX;
        let point_mm = view.point_mm([left + px(cell % columns), top + px(cell / columns)]);
        volume.lattice.integral(point_mm, view.to_eye, &density)
    };
    let values: Vec<f64> = (0..columns * rows).map(at).collect();
    let max = values.iter().copied().fold(0.0, f64::max);
    let subtitle =
        format!("light along each line of sight through {} nodes   ·   max {} {unit}", density.len(), text(max, 4));
    let mut svg = Svg::sheet(680.0, 600.0, &one_line(&source_name(model), 64), &subtitle);
    let shade = |value: f64| (value / max.max(f64::MIN_POSITIVE) * SHADES).round();
    for (row, cells) in values.chunks(columns.max(1)).enumerate() {
        let mut x = left;
        for run in cells.chunk_by(|a, b| shade(*a) == shade(*b)) {
            let run_px = run.len() as f64 * CELL_PX;
            if run[0] > 0.0 {
                let color = hex(viridis(shade(run[0]) / SHADES));
                svg.rect([x, top + row as f64 * CELL_PX], [run_px, CELL_PX], &color);
            }
            x += run_px;
        }
    }
    view.axes(&mut svg);
    view.ruler(&mut svg);
    color_bar(&mut svg, [604.0, 130.0], 330.0, max, unit);
    svg.artifact("plots/volume.svg")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::fixture;

    #[test]
    fn the_cells_of_a_volume_are_seen() {
        let model = fixture::with_volume();
        let drawing = artifact(&model, model.volume.as_ref().unwrap());
        let svg = String::from_utf8(drawing.bytes).unwrap();
        assert!(svg.matches("<rect").count() > 50, "{svg}");
        assert!(svg.contains("12 nodes"), "{svg}");
    }
}
