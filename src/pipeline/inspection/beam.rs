//! The beam of a source: its axis, and how wide it is, which decides how fine a grid of directions must be.

use crate::rays::direction_cube::DirectionCube;
use glam::DVec3;
use schemars::JsonSchema;
use serde::Serialize;

/// Rays within so many times the half width of a beam belong to it.
const REACH: f64 = 4.0;
/// Rounds in which axis and half width of a beam are found, from this width on, degrees.
const ROUNDS: usize = 24;
const WIDEST_DEG: f64 = 90.0;
/// Fewer rays tell nothing of a beam, and this part of all must belong to it.
const FEWEST_RAYS: usize = 200;
const LEAST_PART: f64 = 0.5;
/// Beams narrower than this, degrees, are written as wide as this: intensities of parallel light have no other meaning.
pub const NARROWEST_DEG: f64 = 0.02;
/// Nodes of γ in the full width at half maximum.
pub const NODES_IN_BEAM: f64 = 16.0;
/// The farthest apart that they lie, degrees.
pub const FARTHEST_DEG: f64 = 2.5;
/// Full width at half maximum of a Gaussian, in standard deviations.
const GAUSSIAN_WIDTH: f64 = 2.355;
/// Rings of equal flux by which the profile of a beam is known.
const RINGS: usize = 32;
/// Rings that tell its maximum together, and those that tell where it falls below half of that.
const PEAK_RINGS: usize = 11;
const EDGE_RINGS: usize = 5;
/// Standard deviations below this, rad, are rounding of f32.
const ROUNDING: f64 = 1e-7;

/// The widths of a beam, as they are written.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct BeamWidth {
    /// Its axis.
    pub axis: [f64; 3],
    /// Full width at half maximum across its narrow side, degrees; 0 for parallel light.
    pub least_deg: f64,
    /// The same across its wide side, degrees.
    pub greatest_deg: f64,
    /// Share of the flux that belongs to it, 0..=1.
    pub share: f64,
    /// Distance of directions, degrees, at which a goniogram shows it: a sixteenth of its width, at most 2.5.
    pub goniogram_step_deg: f64,
}

/// The rays near the brightest direction, where most of them are.
pub struct Beam {
    /// Its middle.
    pub axis: DVec3,
    /// It is wider than a hemisphere shows.
    pub wide: bool,
    /// Share of the flux that belongs to it.
    share: f64,
    /// Rays of it and their weights.
    rays: Vec<(DVec3, f64)>,
}

fn angle(axis: DVec3, direction: DVec3) -> f64 {
    axis.cross(direction).length().atan2(axis.dot(direction))
}

/// The middle of the brightest cell.
pub fn brightest(directions: &DirectionCube) -> DVec3 {
    let intensity = |cell: usize| directions.flux[cell] / DirectionCube::solid_angle_sr(cell);
    let better = |best, cell| if intensity(cell) > intensity(best) { cell } else { best };
    DirectionCube::center((0..DirectionCube::CELLS).fold(0, better))
}

impl Beam {
    /// Of rays (unit directions and weights) and the brightest direction; `None` where most of them are in no one beam.
    pub fn of(rays: &[(DVec3, f64)], brightest: DVec3) -> Option<Beam> {
        let total: f64 = rays.iter().map(|(_, weight)| weight).sum();
        let widest = WIDEST_DEG.to_radians();
        let (mut axis, mut reach, mut wide) = (brightest, widest, false);
        let mut within: Vec<(f64, f64)> = Vec::new();
        for _ in 0..ROUNDS {
            let near = rays.iter().filter(|(direction, _)| angle(axis, *direction) <= reach);
            let middle = near.map(|(direction, weight)| *weight * *direction).sum::<DVec3>().normalize_or(axis);
            let near = rays.iter().map(|(direction, weight)| (angle(middle, *direction), *weight));
            within = near.filter(|(off, _)| *off <= reach).collect();
            within.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            let all: f64 = within.iter().map(|(_, weight)| weight).sum();
            let mut seen = 0.0;
            let half = within.iter().find(|(_, weight)| {
                seen += weight;
                2.0 * seen >= all
            });
            let (half_width, _) = half?;
            let next = (REACH * half_width).max(NARROWEST_DEG.to_radians());
            wide |= next > widest;
            let (before, next) = ((axis, reach), next.min(widest));
            (axis, reach) = (middle, next);
            if before == (axis, reach) {
                break;
            }
        }
        let share = within.iter().map(|(_, weight)| weight).sum::<f64>() / total;
        if within.len() < FEWEST_RAYS || share < LEAST_PART {
            return None;
        }
        let rays = rays.iter().filter(|(direction, _)| angle(axis, *direction) <= reach).copied().collect();
        Some(Beam { axis, wide, share, rays })
    }

    /// Full widths at half maximum, least and greatest, degrees, of the Gaussian with the same second moments.
    pub fn gaussian_widths_deg(&self) -> (f64, f64) {
        let [least, greatest] = principal(&self.across(|_| 1.0))
            .map(|(deviation, _)| (GAUSSIAN_WIDTH * deviation).to_degrees().max(NARROWEST_DEG));
        (least, greatest)
    }

    /// Places of the rays on the plane across the axis, each times what `scale` makes of its cosine, and their weights.
    fn across(&self, scale: impl Fn(f64) -> f64) -> Vec<([f64; 2], f64)> {
        let (u, v) = self.axis.any_orthonormal_pair();
        let place = |direction: DVec3| {
            let scale = scale(direction.dot(self.axis));
            [scale * direction.dot(u), scale * direction.dot(v)]
        };
        self.rays.iter().map(|(direction, weight)| (place(*direction), *weight)).collect()
    }

    /// Its full widths at half maximum, whatever its profile: ellipses of the beam's own shape, the flux between each two of them
    /// over the solid angle there, and the last one at which that is half of the most.
    pub fn width(&self) -> BeamWidth {
        // Lambert's azimuthal projection keeps solid angles.
        let places = self.across(|cosine| (2.0 / (1.0 + cosine.max(0.0))).sqrt());
        let [least, greatest] = principal(&places);
        let ellipse = |[x, y]: [f64; 2]| {
            let part = |(deviation, [u, v]): (f64, [f64; 2])| ((x * u + y * v) / deviation.max(ROUNDING)).powi(2);
            part(least) + part(greatest)
        };
        let mut sizes: Vec<(f64, f64)> = places.iter().map(|(place, weight)| (ellipse(*place), *weight)).collect();
        sizes.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let half = half_maximum(&sizes).sqrt();
        let full_deg = |(deviation, _): (f64, [f64; 2])| match deviation > ROUNDING {
            true => 4.0 * (0.5 * half * deviation).min(1.0).asin().to_degrees(),
            false => 0.0,
        };
        BeamWidth {
            axis: self.axis.to_array(),
            least_deg: full_deg(least),
            greatest_deg: full_deg(greatest),
            share: self.share,
            goniogram_step_deg: (self.gaussian_widths_deg().0 / NODES_IN_BEAM).min(FARTHEST_DEG),
        }
    }
}

/// Standard deviations of the places about 0 along the two axes of their ellipse, the least first, and these axes.
fn principal(places: &[([f64; 2], f64)]) -> [(f64, [f64; 2]); 2] {
    let (mut moments, mut weights) = ([0.0; 3], 0.0);
    for ([x, y], weight) in places {
        moments = [moments[0] + weight * x * x, moments[1] + weight * x * y, moments[2] + weight * y * y];
        weights += weight;
    }
    let [xx, xy, yy] = moments.map(|moment| moment / weights);
    let (mean, spread) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
    let (sin, cos) = (0.5 * (2.0 * xy).atan2(xx - yy)).sin_cos();
    let deviation = |variance: f64| variance.max(0.0).sqrt();
    [(deviation(mean - spread), [-sin, cos]), (deviation(mean + spread), [cos, sin])]
}

/// Where the density of `sizes` (sorted, with weights) falls below half of its maximum for good.
fn half_maximum(sizes: &[(f64, f64)]) -> f64 {
    let rings = sizes.chunks(sizes.len().div_ceil(RINGS).max(1));
    let mut start = 0.0;
    let mut profile: Vec<(f64, f64)> = Vec::new();
    for ring in rings {
        let end = ring.last().map_or(start, |(size, _)| *size);
        let flux: f64 = ring.iter().map(|(_, weight)| weight).sum();
        if end > start {
            profile.push((end, flux / (end - start)));
            start = end;
        }
    }
    let densities: Vec<f64> = profile.iter().map(|(_, density)| *density).collect();
    let count = densities.len();
    let at = |ring: f64, together: usize| line_through(&densities, ring, together);
    let peak = (0..count).map(|k| at(k as f64, PEAK_RINGS)).fold(at(-0.5, PEAK_RINGS), f64::max);
    let half = 0.5 * peak;
    let near: Vec<f64> = (0..count).map(|k| at(k as f64, EDGE_RINGS)).collect();
    let middle = |k: usize| 0.5 * (profile[k].0 + if k > 0 { profile[k - 1].0 } else { 0.0 });
    match near.iter().rposition(|density| *density >= half) {
        // A sharp edge is where it is; between rings of a soft one, half is reached on the way.
        Some(last) if last + 1 < count && densities[last + 1] > 0.5 * densities[last] => {
            let share = (near[last] - half) / (near[last] - near[last + 1]);
            middle(last) + share * (middle(last + 1) - middle(last))
        }
        Some(last) => profile[last].0,
        None => 0.0,
    }
}

/// The value at ring `at` of the straight line through `together` neighbours of it, by least squares. A Gaussian's density falls along
/// a straight line from one ring of equal flux to the next.
fn line_through(values: &[f64], at: f64, together: usize) -> f64 {
    let first = (at - 0.5 * (together - 1) as f64).max(0.0) as usize;
    let first = first.min(values.len().saturating_sub(together));
    let window = values.iter().skip(first).take(together);
    let middle = first as f64 + 0.5 * (values.len().min(together) as f64 - 1.0);
    let (mut sum, mut slope, mut square) = (0.0, 0.0, 0.0);
    for (k, value) in (first..).zip(window.clone()) {
        let off = k as f64 - middle;
        sum += value;
        slope += off * value;
        square += off * off;
    }
    let mean = sum / window.len().max(1) as f64;
    if square > 0.0 { mean + (at - middle) * slope / square } else { mean }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspection::sample::hash;
    use std::f64::consts::TAU;

    /// Even numbers in 0..1.
    struct Even(u64);

    impl Even {
        fn next(&mut self) -> f64 {
            self.0 += 1;
            (hash(self.0) >> 11) as f64 / (1_u64 << 53) as f64
        }
    }

    fn towards(axis: DVec3, theta: f64, phi: f64) -> DVec3 {
        let (u, v) = axis.any_orthonormal_pair();
        theta.cos() * axis + theta.sin() * (phi.cos() * u + phi.sin() * v)
    }

    const RAYS: usize = 18_000;

    fn measured(axis: DVec3, mut ray: impl FnMut(&mut Even) -> (f64, f64)) -> BeamWidth {
        let mut even = Even(0);
        let rays: Vec<(DVec3, f64)> = (0..RAYS)
            .map(|_| {
                let (theta, phi) = ray(&mut even);
                (towards(axis, theta, phi), 1.0)
            })
            .collect();
        Beam::of(&rays, axis).unwrap().width()
    }

    /// Intensity exp(−4 ln 2 (θ/w)²) is half of its maximum at θ = w/2.
    #[test]
    fn gaussian_beams_have_the_width_they_were_made_with() {
        let axis = DVec3::new(0.3, -0.5, 0.8).normalize();
        for width_deg in [0.1_f64, 1.0, 3.0, 10.0, 30.0] {
            let sigma = width_deg.to_radians() / (8.0 * 2.0_f64.ln()).sqrt();
            let beam = measured(axis, |even| {
                // A flat Gaussian, thinned out by sin θ / θ.
                loop {
                    let theta = sigma * (-2.0 * (1.0 - even.next()).ln()).sqrt();
                    if theta < 3.0 && even.next() * theta <= theta.sin() {
                        return (theta, TAU * even.next());
                    }
                }
            });
            for found in [beam.least_deg, beam.greatest_deg] {
                assert!((found / width_deg - 1.0).abs() < 0.05, "{found} instead of {width_deg}");
            }
            assert!((beam.goniogram_step_deg / (width_deg / 16.0) - 1.0).abs() < 0.06, "{beam:?}");
            assert!(DVec3::from_array(beam.axis).dot(axis) > 1.0 - 1e-4 && beam.share > 0.99);
        }
    }

    /// An even cone with 4 % of the light around it.
    #[test]
    fn stray_light_does_not_move_a_sharp_edge() {
        let cap = |even: &mut Even, deg: f64| (1.0 - even.next() * (1.0 - deg.to_radians().cos())).acos();
        let beam = measured(DVec3::Z, |even| {
            let deg = if even.next() < 0.04 { 18.0 } else { 5.0 };
            (cap(even, deg), TAU * even.next())
        });
        assert!((beam.least_deg / 10.0 - 1.0).abs() < 0.05, "{beam:?}");
    }

    /// cos θ is 1/2 at 60°; an even cone ends at its edge; both are flat or steep where a Gaussian is not.
    #[test]
    fn other_profiles_have_theirs() {
        let lambert = measured(DVec3::Z, |even| (even.next().sqrt().asin(), TAU * even.next()));
        assert!((lambert.least_deg / 120.0 - 1.0).abs() < 0.05, "{lambert:?}");
        assert_eq!(lambert.goniogram_step_deg, FARTHEST_DEG);
        let edge = 10_f64.to_radians().cos();
        let cone = measured(DVec3::X, |even| ((1.0 - even.next() * (1.0 - edge)).acos(), TAU * even.next()));
        assert!((cone.least_deg / 20.0 - 1.0).abs() < 0.05, "{cone:?}");
    }

    /// 2° x 8°: a Gaussian of two widths.
    #[test]
    fn an_oblong_beam_has_two_widths() {
        let sigma = [2.0_f64, 8.0].map(|width| width.to_radians() / 2.354_82);
        let beam = measured(DVec3::NEG_Y, |even| {
            let radius = (-2.0 * (1.0 - even.next()).ln()).sqrt();
            let (sin, cos) = (TAU * even.next()).sin_cos();
            let (x, y): (f64, f64) = (sigma[0] * radius * cos, sigma[1] * radius * sin);
            (x.hypot(y), y.atan2(x))
        });
        assert!((beam.least_deg / 2.0 - 1.0).abs() < 0.05 && (beam.greatest_deg / 8.0 - 1.0).abs() < 0.05, "{beam:?}");
    }

    #[test]
    fn parallel_light_has_no_width_and_light_everywhere_no_beam() {
        let parallel = measured(DVec3::Z, |_| (0.0, 0.0));
        assert_eq!((parallel.least_deg, parallel.goniogram_step_deg), (0.0, NARROWEST_DEG / NODES_IN_BEAM));
        let mut even = Even(0);
        let rays: Vec<_> =
            (0..RAYS).map(|_| (towards(DVec3::Z, (1.0 - 2.0 * even.next()).acos(), TAU * even.next()), 1.0)).collect();
        assert!(Beam::of(&rays, DVec3::Z).is_none_or(|beam| beam.wide));
        assert!(Beam::of(&rays[..10], DVec3::Z).is_none());
    }
}
