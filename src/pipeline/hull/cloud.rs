//! From rays to emission points: its own step, because in real files the origins often are not the emitter (`MODEL.md` 3).
//!
//! Rays are lines; in air the radiance along a line does not change, so an emission point may be any point of its ray without
//! changing any light outside. The paper takes the origins as given.

use super::super::Error;
use super::super::rays::{Ray, Source};
use super::super::vocabulary::space::Bounds;
use super::super::vocabulary::watch::StageWatch;
use serde::Serialize;

/// Where light is taken to start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Emission {
    /// The ray origins as given: the paper's form.
    #[default]
    Origins,
}

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
