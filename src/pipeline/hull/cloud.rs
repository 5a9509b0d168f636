//! From rays to emission points: its own step, because in real files the origins often are not the emitter.
//!
//! Rays are lines; in air the radiance along a line does not change, so an emission point may be any point of its ray without
//! changing any light outside. The paper takes the origins as given.

use super::focal::FocalPatch;
use crate::error::Error;
use crate::rays::chunks;
use crate::source::{Ray, Source, Spectral};
use crate::vocabulary::space::Bounds;
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::StageWatch;

/// Rays of a sample in one chunk.
const CHUNK_RAYS: usize = 4096;

/// Where the light of a source is put.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Carrier {
    /// The hull of the origins.
    Origins,
    /// A focal surface, to which rays that fit are slid.
    Focal(FocalPatch),
    /// The volume in which the rays start; the hull round it has the same light for programs that know only surfaces.
    Volume,
}

impl Carrier {
    /// The focal surface, where it is one.
    pub fn patch(self) -> Option<FocalPatch> {
        match self {
            Carrier::Focal(patch) => Some(patch),
            Carrier::Origins | Carrier::Volume => None,
        }
    }
}

/// The rays of a source, or of a sample of it, and where their light is put.
#[derive(Clone, Copy)]
pub struct Cloud<'a> {
    /// The source.
    pub source: &'a Source,
    /// Where the light is put.
    pub carrier: Carrier,
    /// Rays that stand for all; `None`: all.
    sample: Option<&'a Sampled>,
    /// Only the primary quantity of a sample is looked at.
    is_plain: bool,
}

/// Rays that stand for all of a source.
pub struct Sampled {
    /// The rays; their fluxes add up to that of the source.
    pub rays: Vec<Ray>,
    /// The spectral side of a plain look at them: none.
    pub no_spectrum: Spectral,
}

impl<'a> Cloud<'a> {
    /// All rays of `source`.
    pub fn new(source: &'a Source, carrier: Carrier) -> Cloud<'a> {
        Cloud { source, carrier, sample: None, is_plain: false }
    }

    /// Rays that stand for all of `source`.
    pub fn sampled(source: &'a Source, sample: &'a Sampled, carrier: Carrier) -> Cloud<'a> {
        Cloud { source, carrier, sample: Some(sample), is_plain: false }
    }

    /// The flux of the source, in each quantity that is looked at.
    pub fn flux(&self) -> Flux {
        let Flux { radiant_w, luminous_lm } = self.source.flux;
        Flux { radiant_w, luminous_lm: luminous_lm.filter(|_| !(self.is_plain && radiant_w.is_some())) }
    }

    /// The spectral side of the source, as far as it is looked at.
    pub fn spectral(&self) -> &'a Spectral {
        let plain = self.sample.filter(|_| self.is_plain);
        plain.map_or(&self.source.spectral, |sample| &sample.no_spectrum)
    }

    /// How many rays there are; of a symmetric source with their images.
    pub fn ray_count(&self) -> u64 {
        let rays = self.sample.map_or(self.source.survey.rays_used, |sample| sample.rays.len() as u64);
        rays.saturating_mul(self.images() as u64)
    }

    /// The same rays, all of one quantity and without their spectrum, where they are a sample.
    #[must_use]
    pub fn plain(self) -> Cloud<'a> {
        Cloud { is_plain: true, ..self }
    }

    /// The rays of a sample; none where the cloud is of all rays.
    pub fn sampled_rays(&self) -> &'a [Ray] {
        self.sample.map_or(&[], |sample| &sample.rays)
    }

    /// Images that each ray stands for, itself included: a power of two.
    pub fn images(&self) -> usize {
        self.carrier.patch().map_or(1, |patch| patch.symmetry.images())
    }

    /// Box of the origins, mm.
    pub fn bounds_mm(&self) -> Bounds {
        match self.sample {
            Some(sample) => Bounds::of(sample.rays.iter().map(|ray| ray.origin_mm)),
            None => self.source.survey.bounds_mm,
        }
    }

    /// One pass over all rays, as [`Source::fold`]; without their images.
    ///
    /// # Errors
    /// As [`Source::fold`].
    pub fn fold<T: Send, A>(
        &self,
        watch: StageWatch<'_>,
        start: A,
        work: impl Fn(&[Ray]) -> Result<T, Error> + Sync + Send,
        mut merge: impl FnMut(&mut A, T),
    ) -> Result<A, Error> {
        let Some(Sampled { rays, .. }) = self.sample else { return self.source.fold(watch, start, work, merge) };
        let count = rays.len().div_ceil(CHUNK_RAYS);
        let chunk = |first: usize| &rays[first..rays.len().min(first + CHUNK_RAYS)];
        chunks::in_order(
            count as u64,
            watch,
            start,
            || (),
            |(), number| work(chunk(number as usize * CHUNK_RAYS)),
            |answer, part| {
                merge(answer, part);
                Ok(())
            },
        )
    }
}

/// One pass over emission points: shows every chunk to the visitor, on any thread and in any order, so what a visitor
/// gathers must not depend on either.
pub type Pass<'a> = dyn Fn(StageWatch<'_>, &(dyn Fn(&[Ray]) + Sync)) -> Result<(), Error> + 'a;
