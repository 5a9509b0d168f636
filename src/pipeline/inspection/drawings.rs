//! What an inspection found, at a glance: where rays start, in three projections, and where they go, in two planes.

use super::findings::Inspection;
use crate::vocabulary::space::{Axis, Frame};
use crate::writing::number::text;
use crate::writing::polar_chart::{C0_COLOR, C90_COLOR, RADIUS};
use crate::writing::scale::{hex, viridis};
use crate::writing::svg::{Anchor, FAINT, INK, MUTED, Svg, nice_step, one_line};
use crate::writing::{Artifact, polar_chart};
use glam::DVec3;
use std::f64::consts::PI;

/// Cells along an edge of a projection, and px of one. 44² cells in three projections of 8 bytes each stay below 60 kB.
const CELLS: usize = 44;
const CELL_PX: f64 = 6.0;
/// Edge of a projection, px.
const EDGE: f64 = CELLS as f64 * CELL_PX;
/// Corners of the projections, px.
const TOP: f64 = 92.0;
const LEFT: [f64; 3] = [60.0, 372.0, 684.0];
/// What is seen in each: the component to the right and the one up.
const SEEN: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];
/// Shades of density.
const SHADES: usize = 8;
/// Share of the rays on either side that may lie outside the drawing.
const STRAY: f64 = 1e-3;
const FOCUS_COLOR: &str = "#d55e00";

/// Names of the drawings.
pub const NAMES: [&str; 2] = ["origins.svg", "far-field.svg"];

/// The drawings; none where no ray can be used.
pub fn artifacts(inspection: &Inspection, name: &str) -> Vec<Artifact> {
    if inspection.evidence.sample.is_empty() {
        return Vec::new();
    }
    vec![origins(inspection, name), far_field(inspection, name)]
}

/// Density of origins on one scale, mm.
fn origins(inspection: &Inspection, name: &str) -> Artifact {
    let window = Window::of(inspection);
    let sample = &inspection.evidence.sample;
    let outside = sample.iter().filter(|ray| !window.holds(ray.origin_mm)).count();
    let all = sample.len() as u64 == inspection.rays_used;
    let rays = if all { format!("all {} rays", sample.len()) } else { format!("{} sampled rays", sample.len()) };
    let subtitle = format!(
        "origins of {rays}, brighter where more flux starts   ·   {outside} outside the drawing{}",
        if inspection.focus.is_some() { "   ·   cross: virtual focus" } else { "" }
    );
    let mut svg = Svg::sheet(980.0, 420.0, &one_line(name, 84), &subtitle);
    for (left, seen) in LEFT.into_iter().zip(SEEN) {
        window.projection(&mut svg, inspection, left, seen);
    }
    svg.artifact(NAMES[0])
}

/// The cube of space that is drawn.
struct Window {
    low: DVec3,
    edge_mm: f64,
}

impl Window {
    fn of(inspection: &Inspection) -> Window {
        let mut low = DVec3::ZERO;
        let mut high = DVec3::ZERO;
        for k in 0..3 {
            let mut column: Vec<f64> = inspection.evidence.sample.iter().map(|ray| ray.origin_mm[k]).collect();
            column.sort_by(f64::total_cmp);
            let place = (STRAY * (column.len() - 1) as f64).round() as usize;
            low[k] = column.get(place).copied().unwrap_or(0.0);
            high[k] = column.get(column.len() - 1 - place).copied().unwrap_or(0.0);
        }
        let widest = (high - low).max_element();
        // Rays from one point still need a scale.
        let edge_mm = if widest > 0.0 { 1.08 * widest } else { 1.0 };
        Window { low: 0.5 * (low + high) - 0.5 * edge_mm, edge_mm }
    }

    fn holds(&self, point: DVec3) -> bool {
        let share = (point - self.low) / self.edge_mm;
        share.cmpge(DVec3::ZERO).all() && share.cmple(DVec3::ONE).all()
    }

    /// px right of and above the lower left corner.
    fn px(&self, value: f64, component: usize) -> f64 {
        EDGE * (value - self.low[component]) / self.edge_mm
    }

    fn projection(&self, svg: &mut Svg, inspection: &Inspection, left: f64, (right, up): (usize, usize)) {
        svg.rect([left, TOP], [EDGE; 2], "#f4f6f8");
        let mut density = vec![0.0; CELLS * CELLS];
        for ray in inspection.evidence.sample.iter().filter(|ray| self.holds(ray.origin_mm)) {
            let [column, row] = [right, up].map(|k| ((self.px(ray.origin_mm[k], k) / CELL_PX) as usize).min(CELLS - 1));
            density[(CELLS - 1 - row) * CELLS + column] += ray.weight;
        }
        shades(svg, left, &density);
        self.ticks(svg, left, (right, up));
        if let Some(focus) = inspection.focus {
            let (x, y) = (self.px(focus.point_mm[right], right), self.px(focus.point_mm[up], up));
            if (0.0..=EDGE).contains(&x) && (0.0..=EDGE).contains(&y) {
                let (x, y) = (left + x, TOP + EDGE - y);
                svg.line([x - 7.0, y], [x + 7.0, y], FOCUS_COLOR, 2.0);
                svg.line([x, y - 7.0], [x, y + 7.0], FOCUS_COLOR, 2.0);
            }
        }
    }

    fn ticks(&self, svg: &mut Svg, left: f64, (right, up): (usize, usize)) {
        const NAMES: [&str; 3] = ["x", "y", "z"];
        let bottom = TOP + EDGE;
        let step = nice_step(self.edge_mm, 3.0);
        for (k, across) in [(right, true), (up, false)] {
            let first = (self.low[k] / step).ceil();
            let last = ((self.low[k] + self.edge_mm) / step).floor();
            // At most twice as many as asked for; a window far from 0 has no better numbers than these.
            for n in 0..=((last - first).clamp(0.0, 10.0) as u32) {
                let value = (first + f64::from(n)) * step;
                let px = self.px(value, k);
                let label = text(value, 4);
                if across {
                    svg.line([left + px, bottom], [left + px, bottom + 5.0], MUTED, 1.0);
                    svg.label(left + px, bottom + 18.0, 11.0, Anchor::Middle, MUTED, &label);
                } else {
                    svg.line([left - 5.0, bottom - px], [left, bottom - px], MUTED, 1.0);
                    svg.label(left - 8.0, bottom - px + 4.0, 11.0, Anchor::End, MUTED, &label);
                }
            }
        }
        let words = format!("{} → and {} ↑, mm", NAMES[right], NAMES[up]);
        svg.label(left + EDGE / 2.0, bottom + 38.0, 12.0, Anchor::Middle, INK, &words);
        svg.put(format_args!(
            "<rect x=\"{left}\" y=\"{TOP}\" width=\"{EDGE}\" height=\"{EDGE}\" fill=\"none\" stroke=\"{FAINT}\"/>\n"
        ));
    }
}

/// One path per shade; rows of equal shade are one stroke, one unit thick.
fn shades(svg: &mut Svg, left: f64, density: &[f64]) {
    let most = density.iter().copied().fold(0.0, f64::max);
    // Square root: the sparse sides of a box stay visible beside its bright face.
    let shade = |value: f64| {
        let share = (value / most.max(f64::MIN_POSITIVE)).sqrt();
        (value > 0.0).then(|| ((share * SHADES as f64) as usize).min(SHADES - 1))
    };
    let mut paths = vec![String::new(); SHADES];
    for (row, cells) in density.chunks(CELLS).enumerate() {
        let mut start = 0;
        for run in cells.chunk_by(|a, b| shade(*a) == shade(*b)) {
            if let Some(path) = run.first().and_then(|value| shade(*value)).and_then(|shade| paths.get_mut(shade)) {
                path.push_str(&format!("M{start} {row}h{}", run.len()));
            }
            start += run.len();
        }
    }
    let top = TOP + 0.5 * CELL_PX;
    svg.put(format_args!(
        "<g transform=\"translate({left} {top}) scale({CELL_PX})\" shape-rendering=\"crispEdges\">\n"
    ));
    for (shade, path) in paths.iter().enumerate().filter(|(_, path)| !path.is_empty()) {
        let color = hex(viridis((shade as f64 + 0.5) / SHADES as f64));
        svg.put(format_args!("<path d=\"{path}\" stroke=\"{color}\" fill=\"none\"/>\n"));
    }
    svg.put(format_args!("</g>\n"));
}

/// Intensity in the planes C0-180 and C90-270, looking along the axis nearest to the main direction.
fn far_field(inspection: &Inspection, name: &str) -> Artifact {
    const STEPS: u32 = 36;
    let frame = Frame::looking(inspection.main_direction.map_or(Axis::PosZ, |main| main.axis));
    let evidence = &inspection.evidence;
    let scale = inspection.flux.primary() / evidence.focus.weight().max(f64::MIN_POSITIVE);
    let [across_c0, across_c90] = [frame.y(), frame.x()].map(Axis::nearest);
    // From γ = 180° on the left over 0 to 180° on the right, 5° apart.
    let curve = |normal: Axis, toward: DVec3| -> Vec<(f64, f64)> {
        (0..=2 * STEPS)
            .map(|step| {
                let angle = (f64::from(step) / f64::from(STEPS) - 1.0) * PI;
                let direction = angle.cos() * frame.nadir.vector() + angle.sin() * toward;
                (angle, scale * evidence.meridians.intensity(normal, direction))
            })
            .collect()
    };
    let (c0, c90) = (curve(across_c0, frame.x()), curve(across_c90, frame.y()));
    let peak = c0.iter().chain(&c90).map(|(_, value)| *value).fold(0.0, f64::max);
    let unit = if inspection.flux.primary_unit() == "W" { "W/sr" } else { "cd" };
    let subtitle = format!(
        "intensity in bins of 5° x 10°   ·   flux {} {}   ·   peak {} {unit}   ·   {} rays",
        text(inspection.flux.primary(), 4),
        inspection.flux.primary_unit(),
        text(peak, 3),
        inspection.rays_used
    );
    let mut svg = Svg::sheet(640.0, 690.0, &one_line(name, 54), &subtitle);
    let step = nice_step(peak, 4.0);
    let rings = (peak / step).ceil().max(1.0);
    polar_chart::axes(&mut svg, step, rings, unit);
    let place = |(angle, value): &(f64, f64)| {
        polar_chart::place(angle.abs(), if *angle < 0.0 { -1.0 } else { 1.0 }, RADIUS * value / (step * rings))
    };
    polar_chart::polyline(&mut svg, c90.iter().map(place), C90_COLOR, "7 4");
    polar_chart::polyline(&mut svg, c0.iter().map(place), C0_COLOR, "");
    polar_chart::legend(&mut svg, &frame);
    svg.artifact(NAMES[1])
}
