//! Flux on a surface or in a volume, smoothed: every quantity of every site, as far as its rays do not support what was counted.

use super::Amounts;
use crate::error::Error;
use crate::hull::Hull;
use crate::smoothing::{Caution, Counted, Edge, LANES, Levels, PLACES, Sharing, refine, refine_all};
use crate::source::Spectral;
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::StageWatch;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Rounds of proportional fitting, after which the columns of a site add up to its flux and those of the source stay.
const ROUNDS: usize = 3;

/// Smooths `vertices` of a hull from an even exitance, as [`smooth_amounts`].
pub fn smooth(
    hull: &Hull,
    vertices: &mut Amounts,
    ray: &Flux,
    spectral: &Spectral,
    watch: StageWatch<'_>,
) -> Result<(), Error> {
    smooth_amounts(&levels(hull), &hull.vertex_areas_mm2(), vertices, ray, spectral, watch)
}

/// Smooths the flux of sites from a prior in proportion to their `measures` (areas, volumes), the columns from their shares in it. Sums
/// over all sites are kept.
///
/// # Errors
/// [`Error::Cancelled`].
pub fn smooth_amounts(
    levels: &Levels,
    measures: &[f64],
    sites: &mut Amounts,
    ray: &Flux,
    spectral: &Spectral,
    watch: StageWatch<'_>,
) -> Result<(), Error> {
    watch.step(0.0)?;
    let whole = refine(levels, &Counted::new(sites.primary(), measures, ray.primary(), Caution::Edges)).amounts;
    let column_ray = if spectral.has_bands() { ray.primary() } else { ray.luminous_lm.unwrap_or(0.0) };
    let lit = sites.lit_columns();
    let smooth_columns = |part: &[usize]| -> Result<Vec<Vec<f64>>, Error> {
        watch.step(0.0)?;
        let counted: Vec<Vec<f64>> = part.iter().map(|column| sites.column(*column)).collect();
        if lit.len() == 1 {
            return Ok(counted.iter().map(|counted| scaled(&whole, counted.iter().sum())).collect());
        }
        let counted = counted.iter().map(|amounts| Counted::new(amounts, &whole, column_ray, Caution::Edges));
        let refined = refine_all(levels, &counted.collect::<Vec<_>>());
        Ok(refined.into_iter().map(|refined| refined.amounts).collect())
    };
    let smoothed = lit.par_chunks(LANES).map(smooth_columns).collect::<Result<Vec<_>, _>>()?;
    let mut columns: Vec<Vec<f64>> = smoothed.into_iter().flatten().collect();
    if spectral.has_bands() {
        (0..ROUNDS).for_each(|_| fit(&mut columns, &whole));
    }
    if let Some(luminous) = &mut sites.luminous_lm {
        let ray = ray.luminous_lm.unwrap_or(0.0);
        *luminous = match sites.radiant_w {
            Some(_) if lit.len() == 1 => scaled(&whole, luminous.iter().sum()),
            Some(_) => refine(levels, &Counted::new(luminous, &whole, ray, Caution::Edges)).amounts,
            None => whole.clone(),
        };
    }
    lit.iter().zip(&columns).for_each(|(column, values)| sites.set_column(*column, values));
    if let Some(radiant) = &mut sites.radiant_w {
        *radiant = whole;
    }
    Ok(())
}

/// `form` with the sum `total`.
fn scaled(form: &[f64], total: f64) -> Vec<f64> {
    let sum: f64 = form.iter().sum();
    form.iter().map(|value| if sum > 0.0 { value * (total / sum) } else { 0.0 }).collect()
}

/// One round: the columns of a site in proportion to its flux, then each column in proportion to its sum.
fn fit(columns: &mut [Vec<f64>], whole: &[f64]) {
    let totals: Vec<f64> = columns.iter().map(|column| column.iter().sum()).collect();
    let factor = |vertex: usize| {
        let sum: f64 = columns.iter().map(|column| column[vertex]).sum();
        if sum > 0.0 { whole[vertex] / sum } else { 0.0 }
    };
    let factors: Vec<f64> = (0..whole.len()).map(factor).collect();
    columns.par_iter_mut().zip(totals).for_each(|(column, total)| {
        column.iter_mut().zip(&factors).for_each(|(value, factor)| *value *= factor);
        *column = scaled(column, total);
    });
}

/// Vertices of one face that look the same way share clusters, however thin the body is.
fn levels(hull: &Hull) -> Levels {
    let mut edges = BTreeSet::new();
    for [a, b, c] in &hull.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            edges.insert((*from.min(to), *from.max(to)));
        }
    }
    let length = |(a, b): &(u32, u32)| hull.vertices_mm[*a as usize].distance(hull.vertices_mm[*b as usize]);
    let spacing = edges.iter().map(length).sum::<f64>() / edges.len().max(1) as f64;
    let kinds: Vec<u32> =
        hull.vertex_normals().iter().zip(&hull.face_of_vertex).map(|(n, face)| 6 * face + facing(*n)).collect();
    let edges: Vec<Edge> = edges.into_iter().map(|(a, b)| (a, b, 1.0)).collect();
    Levels::new(&hull.vertices_mm, &kinds, &edges, spacing, Sharing::ThreeCorners, PLACES)
}

/// Which face of a cube a normal belongs to, 0 to 5.
fn facing(normal: DVec3) -> u32 {
    let axis = (0..3).fold(0, |best, axis| if normal[axis].abs() > normal[best].abs() + 1e-9 { axis } else { best });
    2 * axis as u32 + u32::from(normal[axis] < 0.0)
}
