//! From rays to emission points: its own step, because in real files the origins often are not the emitter.
//!
//! Rays are lines; in air the radiance along a line does not change, so an emission point may be any point of its ray without
//! changing any light outside. The paper takes the origins as given.

use crate::error::Error;
use crate::options::Emission;
use crate::source::Ray;
use crate::source::Source;
use crate::vocabulary::space::Bounds;
use crate::vocabulary::watch::StageWatch;

/// A source seen as emission points: every [`Ray::origin_mm`] that comes out of here is an emission point.
pub struct Cloud<'a> {
    /// The rays.
    pub source: &'a Source,
    /// The rule that turns an origin into an emission point.
    pub emission: Emission,
    /// Box of the emission points, mm.
    pub bounds_mm: Bounds,
}

/// The emission points of `source`.
pub fn emission(source: &Source, emission: Emission) -> Cloud<'_> {
    match emission {
        Emission::Origins => Cloud { source, emission, bounds_mm: source.survey.bounds_mm },
    }
}

impl Cloud<'_> {
    /// One pass over all emission points: as [`Source::fold`].
    ///
    /// # Errors
    /// As [`Source::fold`].
    pub fn fold<T: Send, A>(
        &self,
        watch: StageWatch<'_>,
        start: A,
        work: impl Fn(&[Ray]) -> Result<T, Error> + Sync,
        merge: impl FnMut(&mut A, T),
    ) -> Result<A, Error> {
        match self.emission {
            Emission::Origins => self.source.fold(watch, start, work, merge),
        }
    }
}

/// One pass over all emission points: shows every chunk to the visitor, on any thread and in any order, so what a visitor
/// gathers must not depend on either.
pub type Pass<'a> = dyn Fn(StageWatch<'_>, &(dyn Fn(&[Ray]) + Sync)) -> Result<(), Error> + 'a;
