//! A sample of the rays, in memory: one part to build candidates of, the other, held out, to judge them by.

use crate::error::Error;
use crate::hull::Cloud;
use crate::hull::cloud::Sampled;
use crate::inspection::sample::hash;
use crate::source::{Columns, Ray, Source, Spectral};
use crate::vocabulary::watch::StageWatch;

/// Rays expected in the sample of a large source; of up to so many, all are taken.
const RAYS: f64 = 131_072.0;
/// No sample is longer, however often a ray is repeated in a file.
const MOST_RAYS: usize = 140_000;
/// One ray in so many is held out.
const HELD_OUT: u64 = 5;

/// Rays to build of, and rays to judge by, in an order that does not follow that of the file. Equal rays are on one side.
pub struct Sample {
    /// Rays to build of; their fluxes are scaled to add up to those of the source.
    pub training: Sampled,
    /// Rays held out, fluxes as in the source.
    pub held_out: Vec<Ray>,
    /// A ray is in the sample when the hash of its content is at most this.
    keep_up_to: u64,
}

impl Sample {
    /// One pass over all rays of `source`.
    ///
    /// # Errors
    /// As [`Source::fold`].
    pub fn take(source: &Source, watch: StageWatch<'_>) -> Result<Sample, Error> {
        let keep_up_to = (RAYS / source.survey.rays_used.max(1) as f64 * u64::MAX as f64) as u64;
        let pick = |rays: &[Ray]| -> Result<Vec<(u64, Ray)>, Error> {
            Ok(rays.iter().map(|ray| (of_content(ray), *ray)).filter(|(hash, _)| *hash <= keep_up_to).collect())
        };
        let mut picked =
            Cloud::new(source, None).fold(watch, Vec::new(), pick, |all: &mut Vec<(u64, Ray)>, part| {
                let room = MOST_RAYS.saturating_sub(all.len());
                all.extend(part.into_iter().take(room));
            })?;
        picked.sort_unstable_by_key(|(hash, ray)| (*hash, ray.index));
        let (held_out, mut training): (Vec<_>, Vec<_>) =
            picked.into_iter().partition(|(content, _)| is_held_out(*content));
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
        Ok(Sample { training: Sampled { rays: rays(training), no_spectrum }, held_out: rays(held_out), keep_up_to })
    }

    /// Which half of the rays that judge a ray of the source is in; `None` where models were made of it.
    pub fn judging_half(&self, ray: &Ray) -> Option<usize> {
        let content = of_content(ray);
        (content > self.keep_up_to || is_held_out(content)).then(|| (hash(!content) >> 63) as usize)
    }
}

fn is_held_out(content: u64) -> bool {
    hash(content).is_multiple_of(HELD_OUT)
}

/// A hash of what a ray is, whatever its place in the file.
fn of_content(ray: &Ray) -> u64 {
    let numbers = [ray.origin_mm.to_array(), ray.direction.to_array(), [ray.radiant_w, ray.luminous_lm, 0.0]];
    numbers.as_flattened().iter().fold(u64::from(ray.column), |sum, number| hash(sum ^ number.to_bits()))
}
