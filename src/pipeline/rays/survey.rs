//! One reading of everything: what was found when every ray was read and checked once.

use super::check::{Checked, Flaw};
use super::conversion::{Conversion, Sums};
use super::direction_cube::DirectionCube;
use super::{check, chunks};
use crate::error::Error;
use crate::formats::record::{CHUNK_RAYS, RawRay, RaySet, SpectralData};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::space::Bounds;
use crate::vocabulary::spectrum::{Bands, wider};
use crate::vocabulary::watch::StageWatch;
use glam::DVec3;

/// What was found in one or more ray sets.
#[derive(Clone, Debug)]
pub struct Survey {
    /// Records read.
    pub rays_read: u64,
    /// Rays that go on: read − refused − dropped.
    pub rays_used: u64,
    /// Sum of the stored radiant values of the used rays.
    pub radiant_sum: f64,
    /// Sum of the stored luminous values of the used rays.
    pub luminous_sum: f64,
    /// Box of the used rays' origins, mm.
    pub bounds_mm: Bounds,
    /// Smallest and largest wavelength of the used rays, nm; `None` without wavelengths.
    pub wavelength_nm: Option<(f64, f64)>,
    /// Flux-weighted mean of the origins, mm.
    pub centroid_mm: DVec3,
    /// Flux by direction.
    pub directions: DirectionCube,
}

impl Survey {
    /// Nothing read.
    pub fn empty() -> Survey {
        Survey {
            rays_read: 0,
            rays_used: 0,
            radiant_sum: 0.0,
            luminous_sum: 0.0,
            bounds_mm: Bounds::EMPTY,
            wavelength_nm: None,
            centroid_mm: DVec3::ZERO,
            directions: DirectionCube::dark(),
        }
    }

    /// Adds another set's survey. Centroids are weighted by the flux in the direction cubes.
    pub fn merge(&mut self, other: &Survey) {
        let (own, others) = (self.primary_sum(), other.primary_sum());
        if own + others > 0.0 {
            self.centroid_mm = (own * self.centroid_mm + others * other.centroid_mm) / (own + others);
        }
        self.rays_read += other.rays_read;
        self.rays_used += other.rays_used;
        self.radiant_sum += other.radiant_sum;
        self.luminous_sum += other.luminous_sum;
        self.bounds_mm = self.bounds_mm.union(other.bounds_mm);
        self.wavelength_nm = wider(self.wavelength_nm, other.wavelength_nm);
        self.directions.merge(&other.directions);
    }

    fn primary_sum(&self) -> f64 {
        self.directions.flux.iter().sum()
    }
}

/// A survey, and the counts by which the file is judged. Scale 1: before a declared total or that of the header is applied.
#[derive(Clone, Debug)]
pub struct Reading {
    /// What was found. The direction cube holds flux at scale 1.
    pub survey: Survey,
    /// Sums as stored.
    pub sums: Sums,
    /// Rays refused.
    pub refused: u64,
    /// Rays dropped for want of flux.
    pub dropped: u64,
    /// The first ray that was refused, and why.
    pub first_refused: Option<(u64, Flaw)>,
    /// What happened to rays.
    pub notices: Notices,
    /// Rays outside the bands asked about, and the first.
    pub outside: (u64, Option<u64>),
    /// Σ flux · origin, at scale 1.
    moment: DVec3,
}

/// What is gathered of rays while they are surveyed, besides the survey itself.
pub trait RayVisitor: Send {
    /// Ray `index` as stored and as checked; `weight` is its flux at scale 1.
    fn visit(&mut self, index: u64, raw: &RawRay, checked: &Checked, weight: f64);
    /// A ray that is refused or dropped, and why.
    fn visit_flawed(&mut self, raw: &RawRay, flaw: Flaw);
    /// Adds what another visitor gathered of later rays.
    fn merge(&mut self, later: Self);
}

/// Reads and checks every ray of `set` once, without rejecting the file (see [`Reading::judge`]), with a visitor made by `fresh` for each chunk; `radiant`
/// chooses the quantity that weights places and directions.
///
/// # Errors
/// [`Error::Cancelled`]; as [`crate::formats::record::Records::read`].
pub fn survey<W: RayVisitor>(
    set: &RaySet,
    radiant: bool,
    bands: &Bands,
    watch: StageWatch<'_>,
    fresh: impl Fn() -> W + Sync + Send,
) -> Result<(Reading, W), Error> {
    let conversion = Conversion::of(&set.facts);
    let chunk_rays = CHUNK_RAYS as u64;
    let count = set.facts.ray_count;
    let (mut reading, visitor) = chunks::in_order(
        count.div_ceil(chunk_rays),
        watch,
        (Reading::new(), fresh()),
        Vec::new,
        |raws: &mut Vec<RawRay>, chunk| {
            let first = chunk * chunk_rays;
            raws.clear();
            set.records.read(first, chunk_rays.min(count - first) as usize, raws)?;
            let (mut part, mut visitor) = (Reading::new(), fresh());
            for (index, raw) in (first..).zip(raws.iter()) {
                let checked = check::check(&set.facts, &conversion, raw);
                part.add(set, radiant, bands, index, raw, &checked);
                match &checked {
                    Ok(checked) => visitor.visit(index, raw, checked, checked.flux[usize::from(!radiant)]),
                    Err(flaw) => visitor.visit_flawed(raw, *flaw),
                }
            }
            Ok((part, visitor))
        },
        |(whole, visitor), (part, seen)| {
            whole.merge(part);
            visitor.merge(seen);
            Ok(())
        },
    )?;
    let weight = reading.survey.primary_sum();
    if weight > 0.0 {
        reading.survey.centroid_mm = reading.moment / weight;
    }
    Ok((reading, visitor))
}

impl Reading {
    fn new() -> Reading {
        Reading {
            survey: Survey::empty(),
            sums: Sums::default(),
            refused: 0,
            dropped: 0,
            first_refused: None,
            notices: Notices::default(),
            outside: (0, None),
            moment: DVec3::ZERO,
        }
    }

    fn add(
        &mut self,
        set: &RaySet,
        radiant: bool,
        bands: &Bands,
        index: u64,
        raw: &RawRay,
        checked: &Result<Checked, Flaw>,
    ) {
        self.survey.rays_read += 1;
        match checked {
            Ok(checked) => {
                self.take(raw, checked, index, radiant);
                self.sums.derived += match (set.facts.has_radiant, set.facts.has_luminous) {
                    (true, true) => 0.0,
                    (true, false) => checked.flux[1],
                    (false, _) => checked.flux[0],
                };
                if matches!(set.facts.spectral, SpectralData::Wavelength) {
                    self.add_wavelength(raw.wavelength_nm, index, bands);
                }
            }
            Err(flaw) => self.leave(*flaw, index),
        }
    }

    fn take(&mut self, raw: &RawRay, checked: &Checked, index: u64, radiant: bool) {
        let origin = DVec3::from_array(raw.origin_mm);
        let weight = checked.flux[usize::from(!radiant)];
        self.survey.rays_used += 1;
        self.sums.radiant += raw.radiant;
        self.sums.luminous += raw.luminous;
        self.moment += weight * origin;
        self.survey.bounds_mm.grow(origin);
        self.survey.directions.add(checked.direction, weight);
        if checked.normalized {
            self.notices.add_ray(check::NORMALIZED, index, check::NORMALIZED_MESSAGE);
        }
        if checked.xz_repaired {
            self.notices.add_ray(check::NEGATIVE_XZ, index, check::NEGATIVE_XZ_MESSAGE);
        }
    }

    fn add_wavelength(&mut self, nm: f64, index: u64, bands: &Bands) {
        self.survey.wavelength_nm = wider(self.survey.wavelength_nm, Some((nm, nm)));
        if bands.band(nm).is_none() {
            self.outside = (self.outside.0 + 1, self.outside.1.or(Some(index)));
        }
    }

    fn leave(&mut self, flaw: Flaw, index: u64) {
        self.notices.add_ray(flaw.code(), index, flaw.message());
        if flaw.is_harmless() {
            self.dropped += 1;
        } else {
            self.refused += 1;
            self.first_refused = self.first_refused.or(Some((index, flaw)));
        }
    }

    /// Adds the reading of later rays.
    fn merge(&mut self, later: Reading) {
        self.survey.merge(&later.survey);
        self.sums.radiant += later.sums.radiant;
        self.sums.luminous += later.sums.luminous;
        self.sums.derived += later.sums.derived;
        self.survey.radiant_sum = self.sums.radiant;
        self.survey.luminous_sum = self.sums.luminous;
        self.refused += later.refused;
        self.dropped += later.dropped;
        self.first_refused = self.first_refused.or(later.first_refused);
        self.notices.merge(&later.notices);
        self.outside = (self.outside.0 + later.outside.0, self.outside.1.or(later.outside.1));
        self.moment += later.moment;
    }

    /// Rejects a file without rays, with too many refused rays, or without a usable one.
    ///
    /// # Errors
    /// No rays, too many refused, none usable.
    pub fn judge(&self, limits: &Limits) -> Result<(), Error> {
        let (read, used) = (self.survey.rays_read, self.survey.rays_used);
        if read == 0 {
            return Err(Error::refused("rays.empty", "The file holds no rays.", "Export it again with rays."));
        }
        if let Some((ray, flaw)) = self.first_refused
            && self.refused as f64 > limits.max_refused_share * read as f64
        {
            let found = format!(
                "{} of {read} rays cannot be used, more than the {} % allowed. The first: {}",
                self.refused,
                100.0 * limits.max_refused_share,
                flaw.message()
            );
            let remedy = "Export the file again; a wrong record layout or a damaged file looks like this.";
            return Err(Error::refused("rays.too_many_refused", found, remedy).at_ray(ray));
        }
        if used == 0 {
            let found = format!("None of the {read} rays can be used; {} carry no flux.", self.dropped);
            let remedy = "Declare its flux, if no ray carries any: every ray then has an equal share of it. Or export the file again \
                          with flux per ray.";
            return Err(Error::refused("rays.none_usable", found, remedy));
        }
        Ok(())
    }
}
