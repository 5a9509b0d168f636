//! Whether the spectrum of the light has the mirror planes that its strength has. Candidates are compared without their spectra, and chips of
//! several colours side by side may be equally bright.

use super::verification::GROUPS;
use crate::hull::focal::FocalPatch;
use crate::source::Ray;
use glam::{DVec2, Vec2Swizzles};

/// Cells along each side of the quarter of the patch that images are brought to; directions in each by the quarter that they point to.
const SIDE: usize = 4;
const BINS: usize = SIDE * SIDE * 4;
/// Most images.
const IMAGES: usize = 8;
/// With fewer rays in an image of a bin, or in a part of its spectrum, sums are not yet normally distributed.
const FEWEST_RAYS: f64 = 10.0;
/// Spectra differ where their differences exceed the mean of chance by so many of its standard deviations.
const SURELY: f64 = 5.0;

/// Bins are looked at together, by direction, by place and each by itself: small differences of many show in the first, opposite ones in the last.
const LOOKS: [fn(usize) -> usize; 4] = [|_| 0, |bin| bin % 4, |bin| bin / 4, |bin| bin];

/// What was seen in a bin, of one image.
#[derive(Clone, Copy, Default)]
struct Sums {
    weight: f64,
    squares: f64,
    /// Σ w f of each part of the spectrum, and Σ w f².
    parts: [[f64; 2]; GROUPS],
}

impl Sums {
    fn add(&mut self, other: &Sums) {
        self.weight += other.weight;
        self.squares += other.squares;
        let both = self.parts.iter_mut().flatten().zip(other.parts.iter().flatten());
        both.for_each(|(sum, more)| *sum += more);
    }

    /// Rays of equal weight that tell as much.
    fn rays(&self) -> f64 {
        if self.squares > 0.0 { self.weight * self.weight / self.squares } else { 0.0 }
    }
}

/// False where images of each other surely differ in spectrum: places of `patch` and directions that are images have, within the noise of
/// `rays`, equal shares of their light in each part of the spectrum. `parts` of a ray's light, which sum to 1 at most.
pub fn has_symmetric_spectrum(patch: &FocalPatch, rays: &[Ray], parts: impl Fn(&Ray) -> [f64; GROUPS]) -> bool {
    let mut bins = vec![[Sums::default(); IMAGES]; BINS];
    for ray in rays {
        let Some((bin, image)) = bin(patch, ray) else { continue };
        let (sums, weight) = (&mut bins[bin][image], ray.weight());
        sums.weight += weight;
        sums.squares += weight * weight;
        for (sum, part) in sums.parts.iter_mut().zip(parts(ray)) {
            sum[0] += weight * part;
            sum[1] += weight * part * part;
        }
    }
    LOOKS.into_iter().all(|of_bin| is_alike(&bins, of_bin))
}

/// Whether images have the same spectrum as far as can be told; bins with the same number `of_bin` as one.
fn is_alike(bins: &[[Sums; IMAGES]], of_bin: fn(usize) -> usize) -> bool {
    let mut joined = vec![[Sums::default(); IMAGES]; bins.len()];
    for (number, images) in bins.iter().enumerate() {
        joined[of_bin(number)].iter_mut().zip(images).for_each(|(sum, image)| sum.add(image));
    }
    let (mut square, mut expected) = (0.0, 0.0);
    for images in &joined {
        let seen: Vec<&Sums> = images.iter().filter(|image| image.rays() >= FEWEST_RAYS).collect();
        for part in 0..GROUPS {
            let (found, freedoms) = difference(&seen, part);
            square += found;
            expected += freedoms;
        }
    }
    // χ² of so many degrees of freedom, were parts of a spectrum independent; they are not, so the variance may be so many times larger.
    square <= expected + SURELY * (2.0 * expected * GROUPS as f64).sqrt()
}

/// Σ (share in an image − share in all)² over the variance of the former, and its mean by chance.
fn difference(images: &[&Sums], part: usize) -> (f64, f64) {
    let sum = |of: &dyn Fn(&Sums) -> f64| images.iter().map(|image| of(image)).sum::<f64>();
    let weight = sum(&|image| image.weight);
    let (mean, square) = (sum(&|image| image.parts[part][0]) / weight, sum(&|image| image.parts[part][1]) / weight);
    let variance = square - mean * mean;
    let few = images.iter().any(|image| image.rays() * mean.min(1.0 - mean) < FEWEST_RAYS);
    if images.len() < 2 || few || variance.is_nan() || variance <= 0.0 {
        return (0.0, 0.0);
    }
    let of = |image: &Sums| (image.parts[part][0] / image.weight - mean).powi(2) * image.rays() / variance;
    (sum(&of), images.len() as f64 - 1.0)
}

/// The bin of a ray's place and direction when they are brought to the first quarter, or eighth, of the patch; and which image it was.
fn bin(patch: &FocalPatch, ray: &Ray) -> Option<(usize, usize)> {
    let at_mm = patch.meet(ray)?.at_mm;
    let direction = (patch.surface.axes.transpose() * ray.direction).truncate();
    let sign = DVec2::new(1f64.copysign(at_mm.x), 1f64.copysign(at_mm.y));
    let (mut place, mut along) = ((at_mm / patch.max_mm).abs(), direction * sign);
    let is_swapped = patch.symmetry.images() == IMAGES && place.y > place.x;
    if is_swapped {
        (place, along) = (place.yx(), along.yx());
    }
    let cell = |at: f64| ((at * SIDE as f64) as usize).min(SIDE - 1);
    let bit = |number: usize, is_set: bool| if is_set { number } else { 0 };
    let quarter = bit(1, along.x > 0.0) + bit(2, along.y > 0.0);
    let image = bit(1, sign.x > 0.0) + bit(2, sign.y > 0.0) + bit(4, is_swapped);
    Some(((cell(place.y) * SIDE + cell(place.x)) * 4 + quarter, image))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::focal::FocalSurface;
    use crate::hull::symmetry::Symmetry;
    use crate::known_sources::uniform;
    use glam::DVec3;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    /// Rays of a square of 1 mm, every second one in the first part of the spectrum, or as `first` says.
    fn rays(count: usize, first: impl Fn(DVec2, DVec2) -> f64) -> Vec<Ray> {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut ray = || {
            let [x, y, u, v, w] = [0; 5].map(|_| uniform(&mut random) - 0.5);
            let (at_mm, across) = (DVec2::new(x, y), DVec2::new(u, v));
            let column = u32::from(w + 0.5 >= first(at_mm, across));
            Ray {
                origin_mm: at_mm.extend(0.0),
                direction: across.extend(1.0).normalize(),
                radiant_w: 1.0,
                luminous_lm: 0.0,
                column,
                xz_lm: [0.0; 2],
            }
        };
        (0..count).map(|_| ray()).collect()
    }

    fn is_symmetric(symmetry: Symmetry, rays: &[Ray]) -> bool {
        let surface = FocalSurface::new(DVec3::ZERO, DVec3::Z, 0.0);
        let (min_mm, max_mm) = (DVec2::splat(-0.5), DVec2::splat(0.5));
        let patch = FocalPatch { surface, min_mm, max_mm, lit_mm2: 1.0, symmetry: Symmetry::None }.with(symmetry);
        has_symmetric_spectrum(&patch, rays, |ray| std::array::from_fn(|part| f64::from(part == ray.column as usize)))
    }

    #[test]
    fn spectra_that_a_mirror_changes_are_seen() {
        let (two, four) = (Symmetry::TwoMirrors, Symmetry::FourMirrors);
        let even = rays(50_000, |_, _| 0.5);
        let rings = rays(50_000, |at_mm, _| at_mm.length());
        let (left_right, stripes) = (rays(50_000, |at, _| 0.5 + 0.1 * at.x), rays(50_000, |at, _| at.x.abs()));
        let towards_one_side = rays(50_000, |_, across| 0.5 + 0.1 * across.y);
        for (rays, by_two, by_four) in [
            (&even, true, true),
            (&rings, true, true),
            (&stripes, true, false),
            (&left_right, false, false),
            (&towards_one_side, false, false),
        ] {
            assert_eq!([is_symmetric(two, rays), is_symmetric(four, rays)], [by_two, by_four]);
        }
    }

    #[test]
    fn chance_is_no_difference() {
        for few in [100, 1000, 5000] {
            assert!(is_symmetric(Symmetry::FourMirrors, &rays(few, |at_mm, _| 0.02 + at_mm.length())));
        }
    }
}
