//! A sample of the rays, in memory: one part to build candidates of, the other, held out, to judge them by.

use crate::error::Error;
use crate::hull::cloud::Sampled;
use crate::hull::{Carrier, Cloud};
use crate::inspection::sample::hash;
use crate::source::{Columns, Ray, Source, Spectral};
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::StageWatch;

/// Rays expected in the sample of a large source; of up to so many, all are taken.
const RAYS: f64 = 65_536.0;
/// No sample is longer: 17 standard deviations more.
const MOST_RAYS: usize = 70_000;
/// Rays expected to judge the chosen model: of more, the noise would be below every error.
const JUDGING_RAYS: f64 = 1_048_576.0;
/// One ray in so many is held out.
const HELD_OUT: u64 = 5;

/// Rays to build of, and rays to judge by, in an order that does not follow that of the file.
pub struct Sample {
    /// Rays to build of; their fluxes are scaled to add up to those of the source.
    pub training: Sampled,
    /// Rays held out, fluxes as in the source.
    pub held_out: Vec<Ray>,
    /// What the fluxes of the rays to build of are scaled by, W and lm.
    scales: [f64; 2],
    /// A ray is in the sample when its hash is at most this.
    keep_up_to: u64,
    /// And it may judge when that hash is at most this.
    judge_up_to: u64,
}

impl Sample {
    /// One pass over all rays of `source`.
    ///
    /// # Errors
    /// As [`Source::fold`].
    pub fn take(source: &Source, watch: StageWatch<'_>) -> Result<Sample, Error> {
        let [keep_up_to, judge_up_to] =
            [RAYS, JUDGING_RAYS].map(|rays| (rays / source.survey.rays_used.max(1) as f64 * u64::MAX as f64) as u64);
        let pick = |rays: &[Ray]| -> Result<Vec<(u64, Ray)>, Error> {
            Ok(rays.iter().map(|ray| (ray.hash(), *ray)).filter(|(place, _)| *place <= keep_up_to).collect())
        };
        let mut picked =
            Cloud::new(source, Carrier::Origins).fold(watch, Vec::new(), pick, |all: &mut Vec<(u64, Ray)>, part| {
                let room = MOST_RAYS.saturating_sub(all.len());
                all.extend(part.into_iter().take(room));
            })?;
        picked.sort_unstable_by_key(|(place, _)| *place);
        let (held_out, training): (Vec<_>, Vec<_>) = picked.into_iter().partition(|(place, _)| is_held_out(*place));
        let rays = |picked: Vec<(u64, Ray)>| -> Vec<Ray> { picked.into_iter().map(|(_, ray)| ray).collect() };
        let training = rays(training);
        let scales = scales(&training, &source.flux);
        let no_spectrum = Spectral { columns: Columns::None, ..source.spectral.clone() };
        Ok(Sample {
            training: Sampled { rays: training.into_iter().map(|ray| times(ray, scales)).collect(), no_spectrum },
            scales,
            held_out: rays(held_out),
            keep_up_to,
            judge_up_to,
        })
    }

    /// All rays of the sample; their fluxes are scaled to add up to those of the source.
    pub fn whole(self, source: &Source) -> Sampled {
        let Sampled { mut rays, no_spectrum } = self.training;
        rays.extend(self.held_out.into_iter().map(|ray| times(ray, self.scales)));
        let scales = scales(&rays, &source.flux);
        Sampled { rays: rays.into_iter().map(|ray| times(ray, scales)).collect(), no_spectrum }
    }

    /// Which half of the rays that judge a ray of the source is in; `None` where models were made of it, and of rays too many.
    pub fn judging_half(&self, ray: &Ray) -> Option<usize> {
        let place = ray.hash();
        let judges = place <= self.judge_up_to && (place > self.keep_up_to || is_held_out(place));
        judges.then(|| (hash(!place) >> 63) as usize)
    }
}

/// What brings the sums of W and lm of `rays` to `flux`.
fn scales(rays: &[Ray], flux: &Flux) -> [f64; 2] {
    let scale = |total: Option<f64>, of: fn(&Ray) -> f64| {
        let sum: f64 = rays.iter().map(of).sum();
        total.filter(|_| sum > 0.0).map_or(0.0, |total| total / sum)
    };
    [scale(flux.radiant_w, |ray| ray.radiant_w), scale(flux.luminous_lm, |ray| ray.luminous_lm)]
}

/// The ray with its fluxes scaled.
fn times(ray: Ray, [radiant, luminous]: [f64; 2]) -> Ray {
    Ray {
        radiant_w: ray.radiant_w * radiant,
        luminous_lm: ray.luminous_lm * luminous,
        xz_lm: ray.xz_lm.map(|value| value * luminous),
        ..ray
    }
}

fn is_held_out(place: u64) -> bool {
    hash(place).is_multiple_of(HELD_OUT)
}
