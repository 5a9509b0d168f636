//! Which vertices are alike enough to have one goniogram: those of one face of the surface whose light has the same spectrum.

use crate::flux::Amounts;
use crate::hull::Hull;

/// Most kinds of vertices; where a surface has more faces, its parts are told apart, or nothing.
const MOST_KINDS: usize = 64;
/// Vertices are of two spectra where two means explain this part of the variance of their band shares ...
const EXPLAINED: f64 = 0.8;
/// ... which is at least this,
const LEAST_VARIANCE: f64 = 0.01;
/// each has this part of the flux,
const LEAST_SHARE: f64 = 0.02;
/// and so many vertices.
const FEWEST_VERTICES: usize = 16;
/// Rounds of moving vertices to the nearer mean.
const ROUNDS: usize = 20;

/// The kind of each vertex, numbered from 0, and how many there are. `vertices`: flux and spectral columns of each, smoothed.
pub fn kinds(hull: &Hull, vertices: &Amounts) -> (Vec<u32>, usize) {
    let (mut kind, mut count) = if hull.face_count() <= MOST_KINDS {
        (hull.face_of_vertex.clone(), hull.face_count())
    } else if hull.part_count() <= MOST_KINDS {
        (hull.part_of_vertex.clone(), hull.part_count())
    } else {
        (vec![0; hull.vertices_mm.len()], 1)
    };
    let mut open: Vec<u32> = (0..count as u32).collect();
    while let Some(parent) = open.pop().filter(|_| vertices.column_count > 1 && count < MOST_KINDS) {
        let members: Vec<usize> = (0..kind.len()).filter(|vertex| kind[*vertex] == parent).collect();
        if let Some(second) = second_spectrum(vertices, &members) {
            second.iter().for_each(|vertex| kind[*vertex] = count as u32);
            open.extend([parent, count as u32]);
            count += 1;
        }
    }
    (kind, count)
}

/// Those of `members` whose spectrum is the second of two; `None` where one spectrum is as good.
fn second_spectrum(vertices: &Amounts, members: &[usize]) -> Option<Vec<usize>> {
    let lit: Vec<(usize, f64)> = members
        .iter()
        .map(|vertex| (*vertex, vertices.columns_of(*vertex).iter().sum::<f64>()))
        .filter(|(_, flux)| *flux > 0.0)
        .collect();
    if lit.len() < FEWEST_VERTICES {
        return None;
    }
    let share = |(vertex, flux): &(usize, f64), column: usize| vertices.columns_of(*vertex)[column] / flux;
    let mean_of = |chosen: &dyn Fn(usize) -> bool| -> (f64, Vec<f64>) {
        let (mut total, mut sums) = (0.0, vec![0.0; vertices.column_count]);
        for (_, (vertex, flux)) in lit.iter().enumerate().filter(|(k, _)| chosen(*k)) {
            total += flux;
            sums.iter_mut().zip(vertices.columns_of(*vertex)).for_each(|(sum, amount)| *sum += amount);
        }
        (total, sums.into_iter().map(|sum| if total > 0.0 { sum / total } else { 0.0 }).collect())
    };
    let distance = |k: usize, mean: &[f64]| -> f64 {
        mean.iter().enumerate().map(|(column, mean)| (share(&lit[k], column) - mean).powi(2)).sum()
    };
    let (total, mean) = mean_of(&|_| true);
    let spread =
        |column: usize| lit.iter().map(|vertex| vertex.1 * (share(vertex, column) - mean[column]).powi(2)).sum::<f64>();
    let spreads: Vec<f64> = (0..vertices.column_count).map(spread).collect();
    let variance = spreads.iter().sum::<f64>() / total;
    if variance < LEAST_VARIANCE {
        return None;
    }
    let widest = (0..spreads.len()).fold(0, |best, column| if spreads[column] > spreads[best] { column } else { best });
    let mut second: Vec<bool> = lit.iter().map(|vertex| share(vertex, widest) > mean[widest]).collect();
    let (mut within, mut part) = (variance, 0.0);
    for _ in 0..ROUNDS {
        let (_, first_mean) = mean_of(&|k| !second[k]);
        let (flux, second_mean) = mean_of(&|k| second[k]);
        part = flux / total;
        let distances: Vec<[f64; 2]> =
            (0..lit.len()).map(|k| [distance(k, &first_mean), distance(k, &second_mean)]).collect();
        within = lit.iter().zip(&distances).map(|(vertex, both)| vertex.1 * both[0].min(both[1])).sum::<f64>() / total;
        let moved: Vec<bool> = distances.iter().map(|[first, second]| second < first).collect();
        if moved == second {
            break;
        }
        second = moved;
    }
    let told_apart = within < (1.0 - EXPLAINED) * variance && part > LEAST_SHARE && part < 1.0 - LEAST_SHARE;
    told_apart.then(|| lit.iter().zip(&second).filter(|(_, second)| **second).map(|(vertex, _)| vertex.0).collect())
}
