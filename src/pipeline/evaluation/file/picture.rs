//! A picture to look at: colours by value, axes in mm or degrees, and a scale with its unit.

use crate::error::Error;
use crate::evaluation::answer::Answer;
use crate::evaluation::view::{Sheet, View, Width};
use crate::vocabulary::space;
use crate::writing::number::text;
use crate::writing::raster::Raster;
use crate::writing::scale::{color_bar, viridis};
use crate::writing::svg::{Anchor, FAINT, INK, MUTED, Svg, nice_step, one_line};
use glam::DVec3;

/// Most cells that are drawn along each side: of more the mean is drawn.
const MOST_CELLS: usize = 256;
/// Shades that are told apart, so that equal neighbours are one stroke.
const SHADES: f64 = 128.0;
/// Corner of the picture, its longer and its shortest side, px.
const CORNER: [f64; 2] = [84.0, 92.0];
const LONGEST: f64 = 520.0;
const SHORTEST: f64 = 24.0;
/// A side lies along an axis whose cosine is at least this.
const ALONG: f64 = 0.999_999;
/// Height of the scale, px.
const BAR: f64 = 260.0;

/// An axis of the picture: the values at its ends, as a function of the place, and what they are called.
struct Axis {
    /// Values at the left or upper end, and at the other one.
    ends: [f64; 2],
    /// Values are degrees of a perspective camera, whose places are their tangents.
    is_tangent: bool,
    name: String,
}

/// The drawing.
///
/// # Errors
/// [`Error::Internal`] of a list of directions, which [`super::Form::check`] refuses before.
pub fn bytes(answer: &Answer) -> Result<Vec<u8>, Error> {
    let none = || Error::Internal("a list of directions has no axes".to_owned());
    let [across, down] = axes(answer)?.ok_or_else(none)?;
    let size = size(answer, &across, &down);
    let (values, quantity, unit) = answer.brightness();
    let largest = values.iter().copied().fold(0.0, f64::max);
    let bound = answer.channels.iter().flat_map(|channel| &channel.bounds).copied().fold(0.0, f64::max);
    let mut told = format!("{quantity}, at most {} {unit}", text(largest, 4));
    if answer.channels.len() == 1 {
        told.push_str(&format!("   ·   error against the model at most {} {unit}", text(no_less(bound), 2)));
    }
    let height = CORNER[1] + size[1].max(BAR + 30.0) + 70.0;
    let mut svg = Svg::sheet(CORNER[0] + size[0] + 150.0, height, &one_line(&answer.model, 64), &told);
    let cells = raster(answer, &values, largest, size);
    cells.0.draw(&mut svg, CORNER, cells.1);
    svg.put(format_args!(
        "<rect x=\"{}\" y=\"{}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"none\" stroke=\"{FAINT}\"/>\n",
        CORNER[0], CORNER[1], size[0], size[1]
    ));
    ticks(&mut svg, &across, size, true);
    ticks(&mut svg, &down, size, false);
    color_bar(&mut svg, [CORNER[0] + size[0] + 40.0, CORNER[1] + 26.0], BAR, largest, unit);
    Ok(svg.artifact("evaluation.svg").bytes)
}

/// Those across and down; `None` of a list.
fn axes(answer: &Answer) -> Result<Option<[Axis; 2]>, Error> {
    let axis = |ends: [f64; 2], is_tangent: bool, name: String| Axis { ends, is_tangent, name };
    let sides = |width: f64, height: f64, is_tangent: bool, sheet: &Sheet| {
        let [right, up] = sheet.half_sides_mm();
        let unit = if is_tangent { "degrees" } else { "mm" };
        [
            axis([-0.5 * width, 0.5 * width], is_tangent, side("right", right, unit)),
            axis([0.5 * height, -0.5 * height], is_tangent, side("up", up, unit)),
        ]
    };
    Ok(match &answer.request.view {
        View::Grid { c_step_deg, gamma_step_deg } => {
            // A node is the middle of its cell.
            let (c, gamma) = (0.5 * c_step_deg, 0.5 * gamma_step_deg);
            let [across, down] = ["C, degrees", "γ, degrees"].map(str::to_owned);
            Some([axis([-c, 360.0 - c], false, across), axis([-gamma, 180.0 + gamma], false, down)])
        }
        View::Directions(_) | View::Angles(_) => None,
        View::Plane(plane) => Some(sides(plane.width_mm, plane.height_mm, false, &plane.sheet(&answer.frame)?.0)),
        View::Camera(camera) => {
            let lens = camera.lens()?;
            let high = answer.rows as f64 / answer.columns as f64;
            Some(match camera.width {
                Width::Orthographic(width_mm) => sides(width_mm, high * width_mm, false, lens.sheet()),
                Width::Perspective(field_deg) => {
                    let width = 2.0 * (0.5 * field_deg).to_radians().tan();
                    sides(width, high * width, true, lens.sheet())
                }
            })
        }
    })
}

/// What a side of the picture is called: where it lies along an axis of the source, by that.
fn side(name: &str, along: DVec3, unit: &str) -> String {
    let axis = space::Axis::nearest(along);
    let is_along = along.dot(axis.vector()) >= ALONG * along.length();
    if is_along {
        format!("{name} ({}), {unit}", axis.name().replace('-', "\u{2212}"))
    } else {
        format!("{name}, {unit}")
    }
}

/// Width and height of the picture, px: the longer side fills the sheet.
fn size(answer: &Answer, across: &Axis, down: &Axis) -> [f64; 2] {
    let spans = match answer.request.view {
        View::Grid { .. } => [2.0, 1.0],
        _ => [across, down].map(|axis| (axis.ends[1] - axis.ends[0]).abs()),
    };
    let longest = spans[0].max(spans[1]);
    spans.map(|span| (LONGEST * span / longest).max(SHORTEST))
}

/// The cells as they are drawn, and px of one: squares, each the mean of what it covers.
fn raster(answer: &Answer, values: &[f64], largest: f64, size: [f64; 2]) -> (Raster, f64) {
    let longer = size[0].max(size[1]);
    let count = if answer.columns.max(answer.rows) >= MOST_CELLS { MOST_CELLS } else { fitting(answer, size) };
    let edge_px = longer / count as f64;
    let [columns, rows] = size.map(|side| (side / edge_px).round().max(1.0) as usize);
    let mut raster = Raster::new(columns, rows);
    let covered = |at: usize, of: usize, cells: usize| {
        let from = (at * cells / of).min(cells - 1);
        from..((at + 1) * cells).div_ceil(of).clamp(from + 1, cells)
    };
    for row in 0..rows {
        for column in 0..columns {
            let [mut sum, mut count] = [0.0; 2];
            for from in covered(row, rows, answer.rows) {
                for at in covered(column, columns, answer.columns) {
                    sum += values[from * answer.columns + at];
                    count += 1.0;
                }
            }
            let share = if largest > 0.0 { sum / count / largest } else { 0.0 };
            raster.cell(column, row, viridis((share * SHADES).round() / SHADES));
        }
    }
    (raster, edge_px)
}

/// Squares along the longer side, so many for each cell that the cells come out in their own shape.
fn fitting(answer: &Answer, size: [f64; 2]) -> usize {
    let cells = if size[0] >= size[1] { answer.columns } else { answer.rows };
    let other = if size[0] >= size[1] { answer.rows } else { answer.columns };
    let slender = size[0].max(size[1]) / size[0].min(size[1]);
    let needed = (other as f64 * slender).ceil().max(cells as f64);
    (cells * (needed / cells as f64).ceil() as usize).clamp(1, MOST_CELLS)
}

/// Ticks at round values, and the name.
fn ticks(svg: &mut Svg, axis: &Axis, size: [f64; 2], is_across: bool) {
    let [left, top] = CORNER;
    let length = if is_across { size[0] } else { size[1] };
    let value_of = |end: f64| if axis.is_tangent { end.atan().to_degrees() } else { end };
    let ends = axis.ends.map(value_of);
    let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
    let step = nice_step(high - low, 4.0);
    let first = (low / step - 1e-9).ceil();
    for k in 0..=((high / step + 1e-9).floor() - first).clamp(0.0, 12.0) as u32 {
        let value = (first + f64::from(k)) * step;
        let at = if axis.is_tangent { value.to_radians().tan() } else { value };
        let px = length * (at - axis.ends[0]) / (axis.ends[1] - axis.ends[0]);
        let label = text(value, 4);
        if is_across {
            svg.line([left + px, top + size[1]], [left + px, top + size[1] + 5.0], MUTED, 1.0);
            svg.label(left + px, top + size[1] + 18.0, 11.0, Anchor::Middle, MUTED, &label);
        } else {
            svg.line([left - 5.0, top + px], [left, top + px], MUTED, 1.0);
            svg.label(left - 8.0, top + px + 4.0, 11.0, Anchor::End, MUTED, &label);
        }
    }
    if is_across {
        svg.label(left + 0.5 * length, top + size[1] + 40.0, 12.0, Anchor::Middle, INK, &axis.name);
    } else {
        svg.label(left - 60.0, top - 12.0, 12.0, Anchor::Start, INK, &axis.name);
    }
}

/// A bound with two digits that is not below it.
fn no_less(bound: f64) -> f64 {
    let step = 10f64.powf(bound.log10().floor() - 1.0);
    if step > 0.0 && step.is_finite() { (bound / step).ceil() * step } else { bound }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::file::Form;
    use crate::evaluation::tests::{answer, lambertian, square};
    use crate::evaluation::view::{Camera, Plane};
    use crate::goniogram::SphereGrid;

    /// Where a side of a picture lies along an axis of the source, it is called by that.
    #[test]
    fn drawings_say_which_way_the_axes_lie() {
        let chip = square(1.0, 2, SphereGrid::new(36, 1), lambertian);
        let drawn = |view: View| String::from_utf8(answer(&chip, view).write(Form::Svg).unwrap().bytes).unwrap();
        let center_mm = DVec3::new(0.0, 0.0, 3.0);
        let plane = Plane { center_mm, normal: None, up: None, width_mm: 4.0, height_mm: 2.0, columns: 4, rows: 2 };
        let below = drawn(View::Plane(plane));
        // Seen from the side of the source, with +Y up, +X lies on the left.
        assert!(below.contains("right (\u{2212}X), mm") && below.contains("up (+Y), mm"), "{below}");
        let aslant = drawn(View::Plane(Plane { up: Some(DVec3::new(1.0, 1.0, 0.0)), ..plane }));
        assert!(aslant.contains(">right, mm<") && aslant.contains(">up, mm<"), "{aslant}");
        let camera = Camera {
            eye_mm: DVec3::new(9.0, 0.0, 0.0),
            target_mm: DVec3::ZERO,
            up: None,
            width: Width::Perspective(20.0),
            columns: 4,
            rows: 4,
            samples: 1,
        };
        let beside = drawn(View::Camera(camera));
        assert!(beside.contains("right (+Y), degrees") && beside.contains("up (+Z), degrees"), "{beside}");
    }
}
