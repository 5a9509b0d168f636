//! The zone map: the lattice in the plane of C0 and C90, seen against the light (from the side of γ = 0), coloured by flux; zones that
//! follow the surface are drawn on it.

use super::hull::zone_map;
use crate::artifacts::provenance::source_name;
use crate::goniogram::Lattice;
use crate::model::Model;
use crate::vocabulary::space::Axis;
use crate::writing::Artifact;
use crate::writing::number::text;
use crate::writing::scale::{color_bar, hex, is_dark, viridis};
use crate::writing::svg::{Anchor, INK, MUTED, Svg, one_line};

/// Path in the zip.
pub const NAME: &str = "plots/zones.svg";

const CORNER: [f64; 2] = [70.0, 90.0];
const LARGEST: f64 = 460.0;
/// Height of the colour bar.
const BAR: f64 = 240.0;
/// Shortest drawn side: a lattice along a line stays visible.
const SMALLEST: f64 = 60.0;

/// The map.
pub fn artifact(model: &Model) -> Artifact {
    match &model.goniograms.lattice {
        Some(lattice) => lattice_map(model, lattice),
        None => zone_map(model, NAME),
    }
}

fn lattice_map(model: &Model, lattice: &Lattice) -> Artifact {
    let goniograms = &model.goniograms;
    let unit = goniograms.total.flux.luminous_lm.map_or("W", |_| "lm");
    let flux: Vec<f64> = goniograms
        .zones
        .iter()
        .map(|zone| zone.goniogram.flux.luminous_lm.or(zone.goniogram.flux.radiant_w).unwrap_or(0.0))
        .collect();
    let (max, total) = (flux.iter().copied().fold(0.0, f64::max), flux.iter().sum::<f64>());
    let subtitle = format!(
        "{} zones of a {} × {} lattice   ·   flux {} {unit}   ·   seen against the light",
        flux.len(),
        lattice.columns,
        lattice.rows,
        text(total, 4)
    );
    let size = map_size([0, 1].map(|k| lattice.max_mm[k] - lattice.min_mm[k]));
    let height = CORNER[1] + size[1].max(BAR) + 90.0;
    let mut svg = Svg::sheet(680.0, height, &one_line(&source_name(model), 64), &subtitle);
    let cell = [size[0] / lattice.columns as f64, size[1] / lattice.rows as f64];
    svg.rect(CORNER, size, "#eef1f4");
    for (place, flux) in goniograms.zones.iter().zip(&flux).filter_map(|(zone, flux)| Some((zone.place?, flux))) {
        let corner = [CORNER[0] + place.column as f64 * cell[0], CORNER[1] + place.row as f64 * cell[1]];
        let color = viridis(flux / max.max(f64::MIN_POSITIVE));
        svg.rect([corner[0] + 0.5, corner[1] + 0.5], [cell[0] - 1.0, cell[1] - 1.0], &hex(color));
        let ink = if is_dark(color) { "#ffffff" } else { INK };
        let share = 100.0 * flux / total.max(f64::MIN_POSITIVE);
        let words = [format!("{}.{}", place.row, place.column), text(*flux, 3), format!("{share:.1} %")];
        cell_words(&mut svg, corner, cell, ink, &words);
    }
    axes(&mut svg, model, lattice, size);
    color_bar(&mut svg, [580.0, CORNER[1] + 20.0], BAR, max, &format!("{unit} per zone"));
    svg.artifact(NAME)
}

/// Drawn size of a map of `span` mm: the longer side fills the sheet.
fn map_size(span: [f64; 2]) -> [f64; 2] {
    let longest = span[0].max(span[1]);
    if longest > 0.0 { span.map(|side| (LARGEST * side / longest).max(SMALLEST)) } else { [LARGEST / 2.0; 2] }
}

/// As many of `words` as fit: all three, or the first.
fn cell_words(svg: &mut Svg, corner: [f64; 2], cell: [f64; 2], ink: &str, words: &[String; 3]) {
    let x = corner[0] + cell[0] / 2.0;
    let y = corner[1] + cell[1] / 2.0;
    if cell[0] >= 52.0 && cell[1] >= 50.0 {
        for (word, (dy, size)) in words.iter().zip([(-12.0, 11.0), (4.0, 13.0), (20.0, 11.0)]) {
            svg.label(x, y + dy, size, Anchor::Middle, ink, word);
        }
    } else if cell[0] >= 22.0 && cell[1] >= 12.0 {
        svg.label(x, y + 3.0, 8.0, Anchor::Middle, ink, &words[0]);
    }
}

fn axes(svg: &mut Svg, model: &Model, lattice: &Lattice, size: [f64; 2]) {
    let frame = &model.goniograms.frame;
    let [left, top] = CORNER;
    let bottom = top + size[1];
    let mm = |value: f64| text(value, 4);
    svg.label(left, bottom + 18.0, 11.0, Anchor::Start, MUTED, &mm(lattice.min_mm[0]));
    svg.label(left + size[0], bottom + 18.0, 11.0, Anchor::End, MUTED, &mm(lattice.max_mm[0]));
    let along = format!("along C0 = source {} → mm", frame.c0.name());
    svg.label(left + size[0] / 2.0, bottom + 36.0, 12.0, Anchor::Middle, INK, &along);
    svg.label(left - 8.0, top + 10.0, 11.0, Anchor::End, MUTED, &mm(lattice.min_mm[1]));
    svg.label(left - 8.0, bottom, 11.0, Anchor::End, MUTED, &mm(lattice.max_mm[1]));
    let down = format!(
        "down: along C90 = source {}, mm; in each zone: row.column, flux, share",
        Axis::nearest(frame.y()).name()
    );
    svg.label(left, bottom + 56.0, 11.0, Anchor::Start, MUTED, &down);
}
