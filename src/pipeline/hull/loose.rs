//! The rays that do not fit on a focal surface and keep their origins: often a few in a thousand, so they are looked for once.

use super::cloud::Cloud;
use super::focal::FocalPatch;
use crate::error::Error;
use crate::rays::chunks;
use crate::source::Ray;
use crate::vocabulary::space::Bounds;
use crate::vocabulary::watch::StageWatch;
use std::sync::{Mutex, PoisonError};

/// Most rays that are kept, 14 MB; of more, every pass looks for them again among all.
const MOST_KEPT: usize = 1 << 17;
/// Kept rays that are shown at a time.
const CHUNK_RAYS: usize = 4096;

/// The rays of a cloud that do not fit on a patch.
pub struct Loose<'a> {
    cloud: &'a Cloud<'a>,
    patch: FocalPatch,
    /// `None` where there are too many.
    kept: Option<Vec<Ray>>,
}

impl<'a> Loose<'a> {
    /// Looks at all rays of `cloud` once; `fits` tells whether a ray does, on any thread.
    ///
    /// # Errors
    /// As [`Cloud::fold`].
    pub fn of(
        cloud: &'a Cloud<'a>,
        patch: FocalPatch,
        watch: StageWatch<'_>,
        fits: impl Fn(&Ray) -> bool + Sync + Send,
    ) -> Result<Loose<'a>, Error> {
        let loose =
            |rays: &[Ray]| -> Result<Vec<Ray>, Error> { Ok(rays.iter().filter(|ray| !fits(ray)).copied().collect()) };
        let keep = |kept: &mut Option<Vec<Ray>>, part: Vec<Ray>| match kept {
            Some(all) if all.len() + part.len() <= MOST_KEPT => all.extend(part),
            _ => *kept = None,
        };
        let kept = cloud.fold(watch, Some(Vec::new()), loose, keep)?;
        Ok(Loose { cloud, patch, kept })
    }

    /// All rays fit.
    pub fn is_empty(&self) -> bool {
        self.kept.as_ref().is_some_and(Vec::is_empty)
    }

    /// Box of the origins of the rays and of their images, mm.
    ///
    /// # Errors
    /// As [`Loose::pass`].
    pub fn bounds_mm(&self, watch: StageWatch<'_>) -> Result<Bounds, Error> {
        let bounds_mm = Mutex::new(Bounds::EMPTY);
        self.pass(watch, &|rays| {
            let part_mm = Bounds::of(rays.iter().map(|ray| ray.origin_mm));
            let mut all_mm = bounds_mm.lock().unwrap_or_else(PoisonError::into_inner);
            *all_mm = all_mm.union(part_mm);
        })?;
        Ok(bounds_mm.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Shows all images of the rays ([`super::cloud::Pass`]).
    ///
    /// # Errors
    /// As [`Cloud::fold`].
    pub fn pass(&self, watch: StageWatch<'_>, visit: &(dyn Fn(&[Ray]) + Sync)) -> Result<(), Error> {
        let Some(kept) = &self.kept else {
            let show = |rays: &[Ray]| {
                let loose: Vec<Ray> = rays.iter().filter(|ray| self.patch.meet(ray).is_none()).copied().collect();
                visit(&self.patch.images(&loose));
                Ok(())
            };
            return self.cloud.fold(watch, (), show, |(), ()| ());
        };
        let show = |(): &mut (), chunk: u64| {
            let first = chunk as usize * CHUNK_RAYS;
            visit(&self.patch.images(&kept[first..kept.len().min(first + CHUNK_RAYS)]));
            Ok(())
        };
        chunks::in_order(kept.len().div_ceil(CHUNK_RAYS) as u64, watch, (), || (), show, |(), ()| Ok(()))
    }
}
