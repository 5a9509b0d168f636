//! Known sources with closed-form answers: what every stage, benchmark and example is measured against.
//!
//! A source is a sum of glowing parts that do not shade each other. Each part gives its own truth: flux, radiance along any
//! line, intensity in any direction, exitance where that has a closed form. Rays are drawn independently, all of the same
//! flux, from a seeded stream in which each ray has its own place: any range can be made without the ones before.

/// Glowing shapes: what is drawn from them and what is true of them.
pub mod shape;
/// A chip under an aspheric lens.
mod aspheric;
/// Spectra to draw wavelengths from.
pub mod glow;
/// The sources by name.
mod catalogue;
/// Known sources as TM-25 files.
mod write;
#[cfg(test)]
mod tests;

pub use catalogue::{all, by_name};
pub use write::{SAMPLE, tm25_bytes, write_sample, write_tm25};

use crate::formats::record::RawRay;
use crate::vocabulary::space::{Axis, Bounds, Frame};
use crate::vocabulary::spectrum::Bands;
use glam::{DMat3, DVec3};
use glow::EmissionSpectrum;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use shape::Shape;

/// Rays per stream of random numbers.
const STREAM_RAYS: u64 = 1 << 14;
/// Random numbers per ray: part, wavelength, five for place and direction, one to spare; and their 32-bit words.
const RAY_NUMBERS: usize = 8;
const RAY_WORDS: u128 = 2 * RAY_NUMBERS as u128;

/// One glowing part.
#[derive(Clone, Debug)]
pub struct Part {
    /// Where it glows and how.
    pub shape: Shape,
    /// Its radiant flux, W.
    pub radiant_w: f64,
    /// Its spectrum.
    pub glow: EmissionSpectrum,
}

/// A source of which everything is known.
#[derive(Clone, Debug)]
pub struct KnownSource {
    /// Name in commands and files.
    pub name: &'static str,
    /// What it is, in a sentence.
    pub description: &'static str,
    /// Its parts, in their own frame: looking along +Z.
    parts: Vec<Part>,
    /// The box round the parts on which its rays start, in the parts' frame, as measured rays often do; `None`: on the parts.
    start: Option<Bounds>,
    /// Takes the parts' frame to the source frame: a signed permutation of the axes.
    turn: DMat3,
}

impl KnownSource {
    fn new(name: &'static str, description: &'static str, parts: Vec<Part>) -> KnownSource {
        KnownSource { name, description, parts, start: None, turn: DMat3::IDENTITY }
    }

    /// The same source with its +Z turned to `axis`: a proper rotation that permutes the axes, +X going where
    /// [`Frame::looking`] has C0, so that its goniogram is the same numbers in that frame.
    pub fn rotate(mut self, axis: Axis) -> KnownSource {
        let frame = Frame::looking(axis);
        self.turn = DMat3::from_cols(frame.x(), axis.vector().cross(frame.x()), axis.vector());
        self
    }

    /// Rays start where the light does, not on a box round it.
    pub fn shows_itself(&self) -> bool {
        self.start.is_none()
    }

    /// Its parts, in their own frame; [`KnownSource::source_from_parts`] takes them to the source frame.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// From the parts' frame to the source frame.
    pub fn source_from_parts(&self) -> DMat3 {
        self.turn
    }

    /// Total radiant flux, W.
    pub fn radiant_w(&self) -> f64 {
        self.parts.iter().map(|part| part.radiant_w).sum()
    }

    /// Total luminous flux, lm.
    pub fn luminous_lm(&self) -> f64 {
        self.parts.iter().map(|part| part.radiant_w * part.glow.table().lm_per_w()).sum()
    }

    /// Radiant flux in each band, W.
    pub fn bands_w(&self, bands: &Bands) -> Vec<f64> {
        let mut watt = vec![0.0; bands.len()];
        for part in &self.parts {
            let shares = part.glow.table().shares(bands);
            watt.iter_mut().zip(shares).for_each(|(sum, share)| *sum += part.radiant_w * share);
        }
        watt
    }

    /// All parts have the same spectrum.
    pub fn has_one_spectrum(&self) -> bool {
        self.parts.windows(2).all(|pair| pair[0].glow == pair[1].glow)
    }

    /// Area of the glowing surfaces, mm²; of a volume, of its boundary.
    pub fn area_mm2(&self) -> f64 {
        self.parts.iter().map(|part| part.shape.area_mm2()).sum()
    }

    /// Box of all origins, mm.
    pub fn bounds_mm(&self) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        let parts = self.parts.iter().map(|part| part.shape.bounds_mm());
        for own in parts.filter(|_| self.start.is_none()).chain(self.start) {
            bounds.grow(self.turn * own.min);
            bounds.grow(self.turn * own.max);
        }
        bounds
    }

    /// Radiant intensity in the unit direction `direction`, W/sr.
    pub fn intensity_w_per_sr(&self, direction: DVec3) -> f64 {
        let own = self.turn.transpose() * direction;
        self.parts.iter().map(|part| part.radiant_w * part.shape.intensity_per_sr(own)).sum()
    }

    /// Radiant intensity of what starts within `region` (source frame, mm), W/sr; `None` where that has no closed form.
    pub fn intensity_of_region_w_per_sr(&self, region: &Bounds, direction: DVec3) -> Option<f64> {
        let back = self.turn.transpose();
        let own_region = Bounds::of([back * region.min, back * region.max]);
        let own = back * direction;
        let of = |part: &Part| {
            Some(part.radiant_w * part.shape.share_within(&own_region)? * part.shape.intensity_per_sr(own))
        };
        self.parts.iter().map(of).sum()
    }

    /// Radiance that arrives along the line through `point` in the unit direction `direction`, far beyond the source,
    /// W/(mm² sr).
    pub fn radiance_w_per_mm2_sr(&self, point: DVec3, direction: DVec3) -> f64 {
        let back = self.turn.transpose();
        let (point, direction) = (back * point, back * direction);
        self.parts.iter().map(|part| part.radiant_w * part.shape.radiance_per_mm2_sr(point, direction)).sum()
    }

    /// Radiant exitance at `point` (mm), W/mm²: 0 off the glowing surfaces, `None` where it has no closed form.
    pub fn exitance_w_per_mm2(&self, point: DVec3) -> Option<f64> {
        let own = self.turn.transpose() * point;
        self.parts.iter().map(|part| Some(part.radiant_w * part.shape.exitance_per_mm2(own)?)).sum()
    }

    /// Appends rays `first..first + count` of the stream of `seed`, each carrying 1/`of` of the flux.
    pub fn rays(&self, seed: u64, of: u64, first: u64, count: usize, rays: &mut Vec<RawRay>) {
        let mut index = first;
        let end = first + count as u64;
        while index < end {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            random.set_stream(index / STREAM_RAYS);
            random.set_word_pos(u128::from(index % STREAM_RAYS) * RAY_WORDS);
            let stop = end.min((index / STREAM_RAYS + 1) * STREAM_RAYS);
            rays.extend((index..stop).map(|_| self.ray(std::array::from_fn(|_| uniform(&mut random)), of)));
            index = stop;
        }
    }

    /// The ray that belongs to eight uniform numbers.
    fn ray(&self, numbers: [f64; RAY_NUMBERS], of: u64) -> RawRay {
        let [choice, color, a, b, c, d, e, _] = numbers;
        let total = self.radiant_w();
        let mut left = choice * total;
        let chosen = self.parts.iter().enumerate().find(|(k, part)| {
            left -= part.radiant_w;
            left < 0.0 || *k + 1 == self.parts.len()
        });
        let Some((table, part)) = chosen else { return RawRay::default() };
        let (origin, direction) = part.shape.draw([a, b, c, d, e]);
        let origin = self.start.map_or(origin, |bounds_mm| leaving(bounds_mm, origin, direction));
        let wavelength_nm = part.glow.draw_nm(color);
        RawRay {
            origin_mm: (self.turn * origin).to_array(),
            direction: (self.turn * direction).to_array(),
            radiant: total / of as f64,
            wavelength_nm,
            table: table as u32,
            ..RawRay::default()
        }
    }
}

/// Where a ray from within leaves a box.
fn leaving(bounds_mm: Bounds, origin_mm: DVec3, direction: DVec3) -> DVec3 {
    let wall_mm = DVec3::select(direction.cmpgt(DVec3::ZERO), bounds_mm.max, bounds_mm.min);
    let distance_mm = ((wall_mm - origin_mm) / direction).to_array().into_iter().filter(|mm| mm.is_finite());
    origin_mm + distance_mm.fold(f64::INFINITY, f64::min) * direction
}

/// Uniform in (0, 1): the middles of 2^53 cells.
pub fn uniform(random: &mut ChaCha8Rng) -> f64 {
    ((random.next_u64() >> 11) as f64 + 0.5) * (-53_f64).exp2()
}
