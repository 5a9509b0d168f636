//! Which way the source looks: the axis nearest the direction of maximum intensity, or that round which its light is a belt.

use crate::error::Error;
use crate::options::{GoniogramOptions, parallel};
use crate::rays::direction_cube::CUBE_CELLS;
use crate::rays::direction_cube::DirectionCube;
use crate::vocabulary::space::{Axis, Frame};

/// A belt of light is no wider than this, degrees.
pub const BELT_DEG: f64 = 24.0;
/// Part of the flux that a belt has at least.
pub const FLUX_OF_BELT: f64 = 0.5;
/// The brightest side of a belt is at most so many times as bright as its darkest.
const EVENNESS_OF_BELT: f64 = 1.3;

/// Intensities closer together than this many standard errors are not told apart.
const SIGMAS: f64 = 4.0;

/// The photometric frame: as asked, else looking along the axis whose face of the direction cube holds the highest intensity; of a lamp that
/// sends its light all round in a narrow belt, along the axis of the belt, to the side that gets more.
///
/// # Errors
/// [`Error::Unusable`] when γ = 0 and C0 were asked for along one line.
pub fn frame(directions: &DirectionCube, options: &GoniogramOptions) -> Result<Frame, Error> {
    let looking = Frame::looking(options.nadir_axis.unwrap_or_else(|| brightest(directions)));
    let frame = Frame { c0: options.c0_axis.unwrap_or(looking.c0), ..looking };
    if frame.c0.component() == frame.nadir.component() {
        return Err(parallel(frame.nadir, frame.c0));
    }
    Ok(frame)
}

/// The axis whose face holds the highest intensity, averaged over 3 × 3 cells against noise. Faces whose peaks cannot be told
/// apart (an even source, few rays) are decided by the flux they receive, and where that cannot be told apart either, by the
/// order of [`Axis::ALL`].
fn brightest(directions: &DirectionCube) -> Axis {
    let faces: Vec<(Axis, Peak)> =
        Axis::ALL.into_iter().enumerate().map(|(face, axis)| (axis, peak(directions, face))).collect();
    if let Some(axis) = (0..3).find_map(|component| axis_of_belt(directions, &faces, component)) {
        return axis;
    }
    let highest = faces.iter().map(|(_, peak)| peak.low()).fold(0.0, f64::max);
    let rivals: Vec<&(Axis, Peak)> = faces.iter().filter(|(_, peak)| peak.high() >= highest).collect();
    let fullest = rivals.iter().map(|(_, peak)| peak.flux * (1.0 - SIGMAS * peak.flux_error)).fold(0.0, f64::max);
    rivals
        .iter()
        .find(|(_, peak)| peak.flux * (1.0 + SIGMAS * peak.flux_error) >= fullest)
        .map_or(Axis::PosZ, |(axis, _)| *axis)
}

/// The axis along `component` round which the light is a narrow belt, that is: crosses the other four of the `faces`, about equally bright;
/// `None` where it is no belt.
fn axis_of_belt(directions: &DirectionCube, faces: &[(Axis, Peak)], component: usize) -> Option<Axis> {
    let crossed = || faces.iter().filter(|(axis, _)| axis.component() != component).map(|(_, peak)| peak);
    let brightest = crossed().map(Peak::low).fold(0.0, f64::max);
    // Of very few rays nothing is known.
    if brightest == 0.0 || crossed().any(|peak| peak.high() < brightest / EVENNESS_OF_BELT) {
        return None;
    }
    let mut poles =
        Axis::ALL.into_iter().zip(directions.hemispheres()).filter(|(axis, _)| axis.component() == component);
    let ((plus, share), (minus, other)) = poles.next().zip(poles.next())?;
    // Of two poles that cannot be told apart, the first.
    let error = 1.0 / (directions.rays.iter().sum::<u64>() as f64).sqrt();
    let axis = if other - share > SIGMAS * error { minus } else { plus };
    let gamma_deg = |cell: usize| DirectionCube::center(cell).dot(axis.vector()).acos().to_degrees();
    let mut cells: Vec<(f64, f64)> =
        directions.flux.iter().enumerate().map(|(cell, flux)| (gamma_deg(cell), *flux)).collect();
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut sums, mut sum) = (vec![0.0], 0.0);
    cells.iter().for_each(|(_, flux)| {
        sum += flux;
        sums.push(sum);
    });
    let in_belt = |first: usize| {
        let end = cells.partition_point(|(gamma, _)| *gamma < cells[first].0 + BELT_DEG);
        sums[end] - sums[first]
    };
    (0..cells.len()).any(|first| in_belt(first) >= FLUX_OF_BELT * sum).then_some(axis)
}

/// The highest mean intensity on a face and its flux, with relative standard errors.
struct Peak {
    intensity: f64,
    error: f64,
    flux: f64,
    flux_error: f64,
}

impl Peak {
    fn low(&self) -> f64 {
        self.intensity * (1.0 - SIGMAS * self.error).max(0.0)
    }

    fn high(&self) -> f64 {
        self.intensity * (1.0 + SIGMAS * self.error)
    }
}

fn peak(directions: &DirectionCube, face: usize) -> Peak {
    let side = CUBE_CELLS;
    let relative_error = |rays: u64| if rays > 0 { 1.0 / (rays as f64).sqrt() } else { 0.0 };
    let mut best = Peak { intensity: 0.0, error: 0.0, flux: 0.0, flux_error: 0.0 };
    for row in 1..side - 1 {
        for column in 1..side - 1 {
            let (mut flux, mut rays, mut solid_angle) = (0.0, 0, 0.0);
            for (r, c) in (row - 1..=row + 1).flat_map(|r| (column - 1..=column + 1).map(move |c| (r, c))) {
                let cell = (face * side + r) * side + c;
                flux += directions.flux[cell];
                rays += directions.rays[cell];
                solid_angle += DirectionCube::solid_angle_sr(cell);
            }
            if flux / solid_angle > best.intensity {
                best = Peak { intensity: flux / solid_angle, error: relative_error(rays), ..best };
            }
        }
    }
    let cells = face * side * side..(face + 1) * side * side;
    best.flux = directions.flux[cells.clone()].iter().sum();
    best.flux_error = relative_error(directions.rays[cells].iter().sum());
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// Directions spread evenly over the sphere, each with a flux that its angle from `pole` gives.
    fn all_round(pole: DVec3, flux: impl Fn(f64) -> f64) -> DirectionCube {
        let mut cube = DirectionCube::dark();
        let count = 200_000;
        let (x, y) = pole.any_orthonormal_pair();
        for k in 0..count {
            let cosine = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(count);
            let (sin, cos) = (f64::from(k) * 2.399_963_229_728_653).sin_cos();
            let direction = cosine * pole + (1.0 - cosine * cosine).sqrt() * (cos * x + sin * y);
            cube.add(direction, flux(cosine.acos().to_degrees()));
        }
        cube
    }

    #[test]
    fn a_belt_is_seen_from_its_axis_and_a_tube_from_its_side() {
        let belt = |middle: f64| move |gamma: f64| (-0.5 * ((gamma - middle) / 8.0).powi(2)).exp();
        for (pole, axis) in [(DVec3::Z, Axis::PosZ), (DVec3::NEG_X, Axis::NegX), (DVec3::Y, Axis::PosY)] {
            assert_eq!(brightest(&all_round(pole, belt(80.0))), axis);
        }
        assert_eq!(brightest(&all_round(DVec3::Z, belt(90.0))), Axis::PosZ);
        assert_eq!(brightest(&all_round(DVec3::NEG_Z, belt(53.0))), Axis::NegZ);
        let mut uneven = all_round(DVec3::Z, belt(80.0));
        let brighter = |cell: usize| 1.0 + 0.05 * DirectionCube::center(cell).x;
        uneven.flux.iter_mut().enumerate().for_each(|(cell, flux)| *flux *= brighter(cell));
        uneven.rays.iter_mut().for_each(|rays| *rays *= 1000);
        assert_eq!(brightest(&uneven), Axis::PosZ);
        // A few rays along z are no belt round x.
        let mut few = DirectionCube::dark();
        (0..9).for_each(|k| few.add(DVec3::new(0.01 * f64::from(k), 0.0, 1.0), 1.0));
        assert_eq!(brightest(&few), Axis::PosZ);
        // Two beams to opposite sides are no belt.
        let lobes = |gamma: f64| (-0.5 * (gamma.min(180.0 - gamma) / 8.0).powi(2)).exp();
        assert_eq!(brightest(&all_round(DVec3::X, lobes)).component(), 0);
        // The field of a Lambertian tube along z; and light that is equal everywhere.
        let tube = brightest(&all_round(DVec3::Z, |gamma| gamma.to_radians().sin()));
        assert!(tube.component() != 2, "{tube:?}");
        assert_eq!(brightest(&all_round(DVec3::X, |_| 1.0)), Axis::PosZ);
    }
}
