//! A sample of the rays, in memory: one part to build candidates of, the other, held out, to judge them by.

use crate::error::Error;
use crate::hull::cloud::Sampled;
use crate::hull::{Carrier, Cloud};
use crate::inspection::sample::hash;
use crate::source::{Columns, Ray, Source, Spectral};
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
        let (held_out, mut training): (Vec<_>, Vec<_>) = picked.into_iter().partition(|(place, _)| is_held_out(*place));
        let scale = |total: Option<f64>, of: fn(&Ray) -> f64| {
            let sum: f64 = training.iter().map(|(_, ray)| of(ray)).sum();
            total.filter(|_| sum > 0.0).map_or(0.0, |total| total / sum)
        };
        let radiant = scale(source.flux.radiant_w, |ray| ray.radiant_w);
        let luminous = scale(source.flux.luminous_lm, |ray| ray.luminous_lm);
        for (_, ray) in &mut training {
            ray.radiant_w *= radiant;
            ray.luminous_lm *= luminous;
            ray.xz_lm = ray.xz_lm.map(|value| value * luminous);
        }
        let rays = |picked: Vec<(u64, Ray)>| picked.into_iter().map(|(_, ray)| ray).collect();
        let no_spectrum = Spectral { columns: Columns::None, ..source.spectral.clone() };
        Ok(Sample {
            training: Sampled { rays: rays(training), no_spectrum },
            held_out: rays(held_out),
            keep_up_to,
            judge_up_to,
        })
    }

    /// Which half of the rays that judge a ray of the source is in; `None` where models were made of it, and of rays too many.
    pub fn judging_half(&self, ray: &Ray) -> Option<usize> {
        let place = ray.hash();
        let judges = place <= self.judge_up_to && (place > self.keep_up_to || is_held_out(place));
        judges.then(|| (hash(!place) >> 63) as usize)
    }
}

fn is_held_out(place: u64) -> bool {
    hash(place).is_multiple_of(HELD_OUT)
}
