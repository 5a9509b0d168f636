//! The surface in a three-quarter orthographic view: how its triangles came to be, and how bright they are.
//!
//! Up to 20 000 triangles are polygons, painted from back to front. Finer hulls are rastered first (`raster.rs`), so that a
//! drawing stays below 3 MB and shows the same.

use crate::artifacts::exitance::exitance;
use crate::artifacts::provenance::source_name;
use crate::hull::Label;
use crate::model::Model;
use crate::vocabulary::space::Axis;
use crate::writing::Artifact;
use crate::writing::number::text;
use crate::writing::raster::Raster;
use crate::writing::scale::{color_bar, hex, viridis};
use crate::writing::svg::{Anchor, INK, MUTED, Svg, nice_step, one_line};
use glam::DVec3;

/// Most triangles that are drawn one by one.
const MOST_POLYGONS: usize = 20_000;
/// Where the surface is drawn, px: left, top, width, height.
pub(super) const STAGE: [f64; 4] = [30.0, 80.0, 560.0, 460.0];
/// Most triangles whose edges are drawn: finer edges would hide the faces.
const MOST_EDGES: usize = 4_000;
/// Size of a raster cell, px.
const CELL_PX: f64 = 1.0;
/// Style of faces without edges: no seams.
const CRISP: &str = "shape-rendering=\"crispEdges\"";
/// Style of faces with edges.
const EDGES: &str = "stroke=\"#ffffff\" stroke-opacity=\"0.5\" stroke-width=\"0.6\" stroke-linejoin=\"round\"";
/// Directions to the eye: above the horizon, and from C0 towards the viewer.
const ELEVATION_DEG: f64 = 32.0;
const AZIMUTH_DEG: f64 = -58.0;

/// The paper's figure 2: red, green, blue.
fn label_color(label: Label) -> [u8; 3] {
    match label {
        Label::Projected => [214, 69, 65],
        Label::Stitched => [64, 160, 90],
        Label::Filled => [58, 110, 200],
    }
}

/// `plots/hull_stage.svg`.
pub fn stage(model: &Model) -> Artifact {
    let hull = &model.hull;
    let view = View::new(model);
    let counts = [Label::Projected, Label::Stitched, Label::Filled].map(|label| (label, hull.count(label)));
    let subtitle = format!("surface of {} triangles by how they came to be", hull.triangles.len());
    let mut svg = Svg::sheet(680.0, 600.0, &one_line(&source_name(model), 64), &subtitle);
    let colors: Vec<[u8; 3]> = hull
        .labels
        .iter()
        .enumerate()
        .map(|(triangle, label)| shaded(label_color(*label), hull.normal(triangle).dot(view.to_eye).abs()))
        .collect();
    let style = if hull.triangles.len() <= MOST_EDGES { EDGES } else { CRISP };
    view.draw(&mut svg, model, &colors, style);
    let mut x = 30.0;
    for (label, count) in counts {
        let name = match label {
            Label::Projected => "projected",
            Label::Stitched => "stitched",
            Label::Filled => "filled",
        };
        svg.rect([x, 569.0], [12.0, 12.0], &hex(label_color(label)));
        svg.label(x + 18.0, 579.0, 12.0, Anchor::Start, INK, &format!("{name} {count}"));
        x += 140.0;
    }
    svg.artifact("plots/hull_stage.svg")
}

/// `plots/hull_exitance.svg`.
pub fn exitance_map(model: &Model) -> Artifact {
    let exitance = exitance(model);
    let of_triangle = |corners: &[u32; 3]| -> f64 {
        corners.iter().map(|vertex| exitance.values.get(*vertex as usize).copied().unwrap_or(0.0)).sum::<f64>() / 3.0
    };
    let values: Vec<f64> = model.hull.triangles.iter().map(of_triangle).collect();
    let max = values.iter().copied().fold(0.0, f64::max);
    let top = scale_top(&values, max);
    let mean = model.surface.vertices.total();
    let mean = mean.luminous_lm.or(mean.radiant_w).unwrap_or(0.0) / model.hull.total_area_mm2().max(f64::MIN_POSITIVE);
    let unit = exitance.unit;
    let clipped = if top < max { ", above the bar" } else { "" };
    let subtitle = format!("exitance   ·   mean {} {unit}   ·   max {} {unit}{clipped}", text(mean, 4), text(max, 4));
    let mut svg = Svg::sheet(680.0, 600.0, &one_line(&source_name(model), 64), &subtitle);
    let colors: Vec<[u8; 3]> = values.iter().map(|value| viridis(value / top.max(f64::MIN_POSITIVE))).collect();
    View::new(model).draw(&mut svg, model, &colors, CRISP);
    color_bar(&mut svg, [604.0, 130.0], 330.0, top, unit);
    svg.artifact("plots/hull_exitance.svg")
}

/// The zones that follow the surface, a colour each: `name` is the path in the zip.
pub fn zone_map(model: &Model, name: &str) -> Artifact {
    let goniograms = &model.goniograms;
    let view = View::new(model);
    let zone_of = |corners: &[u32; 3]| goniograms.zone_of_vertex.get(corners[0] as usize).copied().unwrap_or(0);
    let color = |(triangle, corners): (usize, &[u32; 3])| {
        let facing = model.hull.normal(triangle).dot(view.to_eye).abs();
        shaded(zone_color(zone_of(corners)), facing)
    };
    let colors: Vec<[u8; 3]> = model.hull.triangles.iter().enumerate().map(color).collect();
    let subtitle = format!("{} zones along the surface, a colour each", goniograms.zones.len());
    let mut svg = Svg::sheet(680.0, 600.0, &one_line(&source_name(model), 64), &subtitle);
    view.draw(&mut svg, model, &colors, CRISP);
    svg.artifact(name)
}

/// Colours of neighbouring numbers lie far apart: hues a golden angle from one to the next.
fn zone_color(zone: u32) -> [u8; 3] {
    let hue = (f64::from(zone) * 0.618_033_988_75).fract() * 6.0;
    let lightness = if zone.is_multiple_of(2) { 0.85 } else { 0.65 };
    [5.0, 3.0, 1.0].map(|shift| {
        let k: f64 = (shift + hue) % 6.0;
        let full = 1.0 - 0.65 * k.min(4.0 - k).clamp(0.0, 1.0);
        (255.0 * lightness * full).round() as u8
    })
}

/// Top of the colour bar: the maximum, unless a few bright specks would leave all else dark.
fn scale_top(values: &[f64], max: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let nearly_all = sorted.get(sorted.len() * 995 / 1000).copied().unwrap_or(max);
    if nearly_all > 0.0 && max > 1.5 * nearly_all { nearly_all } else { max }
}

/// Brighter where it faces the eye, so that the shape is seen.
fn shaded(color: [u8; 3], facing: f64) -> [u8; 3] {
    let facing = (facing * 16.0).round() / 16.0; // few shades: rows of equal colour stay long
    color.map(|component| (f64::from(component) * (0.72 + 0.28 * facing)).round() as u8)
}

/// Where the eye is and how mm become px.
pub(super) struct View {
    pub(super) to_eye: DVec3,
    right: DVec3,
    up: DVec3,
    middle: DVec3,
    px_per_mm: f64,
    emission: Axis,
}

impl View {
    /// The direction of emission is up, C0 goes to the right and towards the eye.
    pub(super) fn new(model: &Model) -> View {
        let frame = &model.goniograms.frame;
        let (emission, ahead) = (frame.nadir.vector(), frame.x());
        let aside = emission.cross(ahead);
        let (elevation, azimuth) = (ELEVATION_DEG.to_radians(), AZIMUTH_DEG.to_radians());
        let to_eye = elevation.cos() * (azimuth.cos() * ahead + azimuth.sin() * aside) + elevation.sin() * emission;
        let right = emission.cross(to_eye).normalize_or(ahead);
        let mut view =
            View { to_eye, right, up: to_eye.cross(right), middle: DVec3::ZERO, px_per_mm: 1.0, emission: frame.nadir };
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for vertex in &model.hull.vertices_mm {
            let seen = DVec3::new(vertex.dot(view.right), vertex.dot(view.up), vertex.dot(view.to_eye));
            (min, max) = (min.min(seen), max.max(seen));
        }
        if min.x <= max.x {
            let (center, size) = (0.5 * (min + max), max - min);
            view.middle = center.x * view.right + center.y * view.up + center.z * view.to_eye;
            let fit = (STAGE[2] / size.x).min(STAGE[3] / size.y);
            view.px_per_mm = if fit.is_finite() { fit } else { 1.0 };
        }
        view
    }

    /// px on the sheet and depth in mm, larger nearer.
    fn place(&self, point_mm: DVec3) -> [f64; 3] {
        let from_middle = point_mm - self.middle;
        let [left, top, width, height] = STAGE;
        [
            left + 0.5 * width + self.px_per_mm * from_middle.dot(self.right),
            top + 0.5 * height - self.px_per_mm * from_middle.dot(self.up),
            from_middle.dot(self.to_eye),
        ]
    }

    /// A point that is seen at a place on the sheet, px.
    pub(super) fn point_mm(&self, [x, y]: [f64; 2]) -> DVec3 {
        let [left, top, width, height] = STAGE;
        let across_mm = (x - left - 0.5 * width) / self.px_per_mm;
        let up_mm = (top + 0.5 * height - y) / self.px_per_mm;
        self.middle + across_mm * self.right + up_mm * self.up
    }

    /// All triangles, then the axes and a scale. Rays that do not fit a focal surface have a hull round it with hardly any light: it is
    /// drawn behind, or it would hide what shines.
    fn draw(&self, svg: &mut Svg, model: &Model, colors: &[[u8; 3]], style: &str) {
        let first_behind = model.hull.focal.as_ref().map_or(usize::MAX, |grid| grid.triangle_count);
        let behind_mm = model.hull.bounds_mm().size().length();
        let place = |triangle: usize| {
            let depth_mm = if triangle < first_behind { 0.0 } else { 2.0 * behind_mm };
            model.hull.corners_mm(triangle).map(|corner| {
                let [x, y, z] = self.place(corner);
                [x, y, z - depth_mm]
            })
        };
        let triangles: Vec<[[f64; 3]; 3]> = (0..model.hull.triangles.len()).map(place).collect();
        if triangles.len() <= MOST_POLYGONS {
            polygons(svg, &triangles, colors, style);
        } else {
            let [left, top, width, height] = STAGE;
            let mut raster = Raster::new((width / CELL_PX) as usize + 1, (height / CELL_PX) as usize + 1);
            for (corners, color) in triangles.iter().zip(colors) {
                raster.triangle(corners.map(|[x, y, z]| [(x - left) / CELL_PX, (y - top) / CELL_PX, z]), *color);
            }
            raster.draw(svg, [left, top], CELL_PX);
        }
        self.axes(svg);
        self.ruler(svg);
    }

    pub(super) fn axes(&self, svg: &mut Svg) {
        let origin = [62.0, 118.0];
        for axis in [Axis::PosX, Axis::PosY, Axis::PosZ] {
            let (x, y) = (axis.vector().dot(self.right), -axis.vector().dot(self.up));
            let tip = [origin[0] + 30.0 * x, origin[1] + 30.0 * y];
            svg.line(origin, tip, if axis.component() == self.emission.component() { INK } else { MUTED }, 1.4);
            svg.label(origin[0] + 40.0 * x, origin[1] + 40.0 * y + 4.0, 11.0, Anchor::Middle, MUTED, axis.name());
        }
    }

    pub(super) fn ruler(&self, svg: &mut Svg) {
        let length_mm = nice_step(STAGE[2] / self.px_per_mm, 5.0);
        let [x, y] = [620.0 - length_mm * self.px_per_mm, 576.0];
        svg.line([x, y], [620.0, y], INK, 2.0);
        svg.label(626.0, y + 4.0, 12.0, Anchor::Start, INK, &format!("{} mm", text(length_mm, 3)));
    }
}

/// Painter's algorithm: the farthest first.
fn polygons(svg: &mut Svg, triangles: &[[[f64; 3]; 3]], colors: &[[u8; 3]], style: &str) {
    let depth = |triangle: usize| triangles[triangle].iter().map(|corner| corner[2]).sum::<f64>();
    let mut order: Vec<usize> = (0..triangles.len().min(colors.len())).collect();
    order.sort_by(|a, b| depth(*a).total_cmp(&depth(*b)));
    svg.put(format_args!("<g {style}>\n"));
    for triangle in order {
        let [a, b, c] = triangles[triangle];
        svg.put(format_args!(
            "<path d=\"M{:.1} {:.1}L{:.1} {:.1}L{:.1} {:.1}Z\" fill=\"{}\"/>\n",
            a[0],
            a[1],
            b[0],
            b[1],
            c[0],
            c[1],
            hex(colors[triangle])
        ));
    }
    svg.put(format_args!("</g>\n"));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::fixture;

    /// A rough sheet of `2 n²` triangles, each as bright as chance has it: the worst case for runs of equal colour.
    fn rough(n: u32) -> Model {
        let mut model = fixture::model();
        let hull = &mut model.hull;
        let at = |row: u32, column: u32| row * (n + 1) + column;
        let cell = |k: u32| (0..=n).flat_map(move |row| (0..=n).map(move |column| [row, column][k as usize]));
        hull.vertices_mm =
            cell(0).zip(cell(1)).map(|(row, column)| DVec3::new(f64::from(column), f64::from(row), 0.0)).collect();
        hull.triangles = (0..n * n)
            .map(|cell| (cell / n, cell % n))
            .flat_map(|(row, column)| {
                let corner = at(row + 1, column + 1);
                [[at(row, column), at(row, column + 1), corner], [at(row, column), corner, at(row + 1, column)]]
            })
            .collect();
        hull.labels = vec![Label::Projected; hull.triangles.len()];
        let bright = |vertex: usize| (vertex as u32).wrapping_mul(2_654_435_761) as f64;
        model.surface.vertices.luminous_lm = Some((0..hull.vertices_mm.len()).map(bright).collect());
        model
    }

    #[test]
    fn drawings_stay_below_3_mb_on_both_sides_of_the_threshold() {
        for n in [99, 101, 400] {
            let model = rough(n);
            for drawing in [stage(&model), exitance_map(&model)] {
                let text = String::from_utf8(drawing.bytes).unwrap();
                let polygons = text.matches("Z\" fill=").count();
                let triangles = model.hull.triangles.len();
                assert_eq!(polygons, if triangles <= MOST_POLYGONS { triangles } else { 0 });
                assert!((4_000..3_000_000).contains(&text.len()), "{n}: {} bytes", text.len());
            }
        }
    }

    #[test]
    fn the_view_looks_down_on_the_emission() {
        let view = View::new(&fixture::model());
        assert!(view.to_eye.dot(DVec3::Z) > 0.0 && view.up.dot(DVec3::Z) > 0.0 && view.right.dot(DVec3::X) > 0.0);
        assert!((view.right.cross(view.up) - view.to_eye).length() < 1e-12, "right-handed: no mirror image");
        let [near, far] = [DVec3::Z, DVec3::NEG_Z].map(|point| view.place(point));
        assert!(near[2] > far[2] && near[1] < far[1]);
    }
}
