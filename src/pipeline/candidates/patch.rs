//! The part of a surface that is lit: the rectangle that holds nearly all of the flux that meets it.

use crate::hull::focal::{FocalPatch, FocalSurface};
use crate::hull::symmetry::Symmetry;
use crate::source::Ray;
use crate::vocabulary::space::Bounds;
use glam::DVec2;

/// A patch narrower than this part of the source's size is a point or a line, and no surface.
pub const LEAST_WIDTH: f64 = 1e-5;
/// Cosines below this count as this.
pub const LEAST_COSINE: f64 = 0.02;
/// Parts of the flux left aside on each side of a patch on a plane and on a sphere, ...
const ASIDE: [f64; 2] = [2e-3, 1e-4];
/// ... unless the whole is at most so many times as long.
const NEARLY_WHOLE: f64 = 1.3;
/// Part of its width by which a patch is wider than what was seen of it: other rays lie a little beyond.
const MARGIN: f64 = 0.01;
/// Cells along a side of the rectangle in which rays are counted to find how close they lie.
const LIT_CELLS: usize = 64;

/// The rectangle of a surface that holds nearly all of the flux that meets it, and how much of it is lit.
/// `None` where that is a point or a line.
pub fn patch(surface: FocalSurface, rays: &[Ray]) -> Option<FocalPatch> {
    let met: Vec<(DVec2, f64)> = rays
        .iter()
        .filter_map(|ray| {
            let crossing = surface.meet(ray.origin_mm, ray.direction)?;
            (crossing.cosine > LEAST_COSINE).then_some((crossing.at_mm, ray.weight()))
        })
        .collect();
    let range = |axis: usize| {
        let at = || met.iter().map(|(at, weight)| (at[axis], *weight)).collect();
        let aside = ASIDE[usize::from(surface.curvature_per_mm != 0.0)];
        let ([low, high], [least, greatest]) = (quantiles(at(), aside), quantiles(at(), 0.0));
        if greatest - least < NEARLY_WHOLE * (high - low) { [least, greatest] } else { [low, high] }
    };
    let ([left, right], [lower, upper]) = (range(0), range(1));
    let size_mm = Bounds::of(rays.iter().map(|ray| ray.origin_mm)).size().max_element();
    let found = (right - left).min(upper - lower) > LEAST_WIDTH * size_mm;
    let margin = DVec2::new(right - left, upper - lower) * MARGIN;
    let (min_mm, max_mm) = (DVec2::new(left, lower) - margin, DVec2::new(right, upper) + margin);
    found.then(|| {
        let lit_mm2 = lit_mm2(&met, min_mm, max_mm);
        FocalPatch { surface, min_mm, max_mm, lit_mm2, symmetry: Symmetry::None }
    })
}

/// The area of a rectangle over which its rays would lie as close as they lie around most of them: N²/Σ n(n−1) cells, the number of
/// evenly lit cells in which as many pairs of rays would share one.
fn lit_mm2(met: &[(DVec2, f64)], min_mm: DVec2, max_mm: DVec2) -> f64 {
    let mut counts = vec![0.0; LIT_CELLS * LIT_CELLS];
    for (at_mm, _) in met {
        let at = (*at_mm - min_mm) / (max_mm - min_mm) * LIT_CELLS as f64;
        if at.cmpge(DVec2::ZERO).all() && at.cmplt(DVec2::splat(LIT_CELLS as f64)).all() {
            counts[at.y as usize * LIT_CELLS + at.x as usize] += 1.0;
        }
    }
    let whole_mm2 = (max_mm - min_mm).element_product();
    let (rays, pairs): (f64, f64) =
        counts.iter().fold((0.0, 0.0), |(rays, pairs), count| (rays + count, pairs + count * (count - 1.0)));
    let cells = if pairs > 0.0 { rays * rays / pairs } else { counts.len() as f64 };
    whole_mm2 * (cells / counts.len() as f64).min(1.0)
}

/// Values below and above which the part `aside` of the weights lies.
pub fn quantiles(mut values: Vec<(f64, f64)>, aside: f64) -> [f64; 2] {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = values.iter().map(|(_, weight)| weight).sum();
    let mut reached = [0.0; 2];
    for (value, reached) in [&mut values.iter() as &mut dyn Iterator<Item = &(f64, f64)>, &mut values.iter().rev()]
        .into_iter()
        .zip(&mut reached)
    {
        let mut seen = 0.0;
        for (at, weight) in value {
            seen += weight;
            if seen >= aside * total {
                *reached = *at;
                break;
            }
        }
    }
    reached
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_leave_their_part_aside() {
        let values: Vec<(f64, f64)> = (0..100).map(|k| (f64::from(k * 37 % 100), 2.0)).collect();
        assert_eq!(quantiles(values.clone(), 0.0), [0.0, 99.0]);
        assert_eq!(quantiles(values.clone(), 0.05), [4.0, 95.0]);
        assert_eq!(quantiles(Vec::new(), 0.05), [0.0, 0.0]);
    }
}
