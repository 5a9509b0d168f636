//! The rays that do not fit on a focal surface and keep their origins: often a few in a thousand, so they are looked for once.

use super::cloud::Cloud;
use super::focal::{Crossing, FocalPatch};
use crate::error::Error;
use crate::rays::chunks;
use crate::source::Ray;
use crate::vocabulary::space::Bounds;
use crate::vocabulary::watch::StageWatch;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Most rays that are kept, 12 MB; of more, every pass looks for them again among all.
pub const MOST_KEPT: usize = 1 << 17;
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
    /// Looks at all rays of `cloud` once, keeps up to `most` that do not fit, and tells `each` where one that does is slid to, on any thread.
    ///
    /// # Errors
    /// As [`Cloud::fold`].
    pub fn of(
        cloud: &'a Cloud<'a>,
        patch: FocalPatch,
        most: usize,
        watch: StageWatch<'_>,
        each: impl Fn(&Crossing) + Sync + Send,
    ) -> Result<Loose<'a>, Error> {
        let count = AtomicUsize::new(0);
        let is_loose = |ray: &&Ray| {
            let crossing = patch.meet(ray);
            crossing.iter().for_each(&each);
            crossing.is_none()
        };
        let loose = |rays: &[Ray]| -> Result<Vec<Ray>, Error> {
            let mut loose: Vec<Ray> = rays.iter().filter(is_loose).copied().collect();
            // When there are too many, none is kept, whichever were seen first.
            if count.fetch_add(loose.len(), Ordering::Relaxed) + loose.len() > most {
                loose = Vec::new();
            }
            Ok(loose)
        };
        let kept = cloud.fold(watch, Vec::new(), loose, |kept: &mut Vec<Ray>, part| kept.extend(part))?;
        Ok(Loose { cloud, patch, kept: (count.into_inner() <= most).then_some(kept) })
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::Carrier;
    use crate::hull::focal::FocalSurface;
    use crate::hull::symmetry::Symmetry;
    use crate::known_sources;
    use crate::options::RaysOptions;
    use crate::rays::Input;
    use crate::source::Source;
    use crate::vocabulary::declaration::Declared;
    use crate::vocabulary::limits::Limits;
    use crate::vocabulary::watch::{NoProgress, Stage};
    use glam::{DVec2, DVec3};
    use std::sync::Arc;

    /// Passes over rays that were kept and over rays that are looked for again show the same rays.
    #[test]
    fn kept_or_looked_for_again() {
        let mut bytes = Vec::new();
        known_sources::write_tm25(&known_sources::by_name("four-chips").unwrap(), 20_000, 1, &mut bytes).unwrap();
        let (name, sha256) = (String::new(), "0".repeat(64));
        let input = Input { name, sha256, bytes: Arc::new(bytes), declared: Declared::default(), notices: Vec::new() };
        let watch = StageWatch::enter(&NoProgress, Stage::Hull).unwrap();
        let source = Source::read(&[input], &RaysOptions::default(), &Limits::default(), watch).unwrap();
        let surface = FocalSurface::new(DVec3::ZERO, DVec3::Z, 0.0);
        let (min_mm, max_mm) = (DVec2::splat(-0.5), DVec2::splat(0.5));
        let patch = FocalPatch { surface, min_mm, max_mm, lit_mm2: 1.0, symmetry: Symmetry::None };
        let cloud = Cloud::new(&source, Carrier::Focal(patch));
        let shown = |most: usize| {
            let slid = AtomicUsize::new(0);
            let count = |_: &Crossing| {
                slid.fetch_add(1, Ordering::Relaxed);
            };
            let loose = Loose::of(&cloud, patch, most, watch, count).unwrap();
            assert_eq!(loose.kept.is_some(), most > 0);
            let places = Mutex::new(Vec::new());
            let note = |rays: &[Ray]| {
                let at = rays.iter().map(|ray| ray.origin_mm.to_array().map(f64::to_bits));
                places.lock().unwrap().extend(at);
            };
            loose.pass(watch, &note).unwrap();
            let mut places = places.into_inner().unwrap();
            places.sort_unstable();
            assert_eq!(places.len() + slid.into_inner(), 20_000);
            (places, loose.bounds_mm(watch).unwrap(), loose.is_empty())
        };
        let (kept, again) = (shown(20_000), shown(0));
        assert!(kept.0.len() > 1000 && !kept.2 && kept == again);
    }
}
