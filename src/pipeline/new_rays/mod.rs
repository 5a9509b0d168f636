//! New rays from a model, as a ray file: as many as are asked for, all of the same flux. Ray i depends on the seed and on i alone, so that any
//! part of the file can be made without the rest, on any number of threads.
//!
//! Places and directions are drawn from the radiance L of the model (`openapi/README.md`), radiant where that is known; the wavelength
//! then from the spectral radiance of the ray's place and direction. By chance, or by numbers of low discrepancy: then each 256, 512, 1024 … rays from
//! a multiple of that on are spread over places, directions and wavelengths more evenly than chance has it, and what is computed of them has less noise.

/// What stands before the rays.
mod head;

pub use head::{RayFile, Request};

use crate::convert::Failed;
use crate::error::Error;
use crate::formats::record::RawRay;
use crate::model::chance::Numbers;
use crate::model::evaluation::Evaluator;
use crate::model::light::Light;
use crate::model::low_discrepancy::Sequence;
use crate::model::sampling::{Batch, Drawn, Sampler};
use crate::model::wavelengths::Wavelengths;
use crate::rays::chunks;
use crate::source::Columns;
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::StageWatch;
use head::Rows;
use std::io::Write;
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Most rays of a file: 32 TB of them.
pub const MOST_RAYS: u64 = 1_000_000_000_000;

/// Rays of a piece of work: what waits to be written has at most some megabytes.
const CHUNK_RAYS: u64 = 1 << 12;
/// Rays that are drawn together: what they read fits into the first cache.
const BATCH_RAYS: u64 = 128;

/// A ray file that is made as it is read.
pub struct NewRays<'a> {
    request: Request,
    evaluator: Evaluator<'a>,
    sampler: Sampler<'a>,
    /// Where the rays are of low discrepancy, their numbers.
    sequence: Option<Sequence>,
    wavelengths: Option<Wavelengths<'a>>,
    /// What the file says of its rays.
    file: RayFile,
    /// W of each ray, 0 where they are unknown.
    radiant: f64,
    /// What rays carry besides, by their places; empty where they carry nothing else.
    carried: Vec<Carried>,
    head: Vec<u8>,
    rows: Rows,
}

impl<'a> NewRays<'a> {
    /// Prepares the rays of a model that `name` names.
    ///
    /// # Errors
    /// [`Error::Unusable`] for a count out of range; [`Error::Refused`] where the format cannot hold the rays, or the model is dark.
    pub fn new(light: impl Into<Light<'a>>, name: &str, request: Request) -> Result<NewRays<'a>, Error> {
        if !(1..=MOST_RAYS).contains(&request.count) {
            let found = format!("{} rays were asked for.", request.count);
            return Err(Error::unusable("new_rays.count", "count", found, "Ask for 1 to 1000000000000 rays."));
        }
        let light = light.into();
        let flux = light.sites().total();
        let dark = || {
            Error::refused("new_rays.dark", "The model has no light.", "Build it of rays that have a flux, W or lm.")
        };
        let evaluator = Evaluator::of_primary(light).ok_or_else(dark)?;
        let sampler = Sampler::new(&evaluator).ok_or_else(dark)?;
        let wavelengths = Wavelengths::new(&evaluator);
        let file = RayFile {
            name: name.to_owned(),
            flux,
            bands: wavelengths.is_some().then(|| evaluator.light().spectral.bands.clone()),
            has_color: evaluator.light().spectral.columns == Columns::Tristimulus,
        };
        let (head, rows) = file.write(request)?;
        let count = request.count as f64;
        let radiant = flux.radiant_w.map_or(0.0, |radiant_w| radiant_w / count);
        // Of W and wavelengths nothing of a place is written.
        let carried = if wavelengths.is_some() && flux.radiant_w.is_some() {
            Vec::new()
        } else {
            Carried::of(evaluator.light(), flux, count)
        };
        let sequence = request.low_discrepancy.then(|| Sequence::new(request.seed));
        Ok(NewRays { request, evaluator, sampler, sequence, wavelengths, file, radiant, carried, head, rows })
    }

    /// W and lm of all rays together, each where the model knows it.
    pub fn flux(&self) -> Flux {
        self.file.flux
    }

    /// What files of other counts and seeds say too.
    pub fn file(&self) -> &RayFile {
        &self.file
    }

    /// Bytes of the whole file.
    pub fn byte_count(&self) -> u64 {
        self.byte_of_ray(self.request.count) + self.rows.end().len() as u64
    }

    /// Where in the file a ray begins, or behind the last one the end.
    pub fn byte_of_ray(&self, ray: u64) -> u64 {
        self.head.len() as u64 + ray * self.rows.row_bytes() as u64
    }

    /// Writes these bytes of the file: parts one after another are the whole.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; what `out` answers.
    pub fn write(&self, bytes: Range<u64>, out: &mut dyn Write, watch: StageWatch<'_>) -> Result<(), Failed> {
        let end = bytes.end.min(self.byte_count());
        let (head, row) = (self.head.len() as u64, self.rows.row_bytes() as u64);
        if bytes.start >= end {
            return Ok(());
        }
        let in_head = bytes.start.min(head) as usize..end.min(head) as usize;
        out.write_all(self.head.get(in_head).unwrap_or_default())?;
        let after_rays = self.byte_of_ray(self.request.count);
        let in_rays = |byte: u64| byte.clamp(head, after_rays) - head;
        let (from, to) = (in_rays(bytes.start), in_rays(end));
        let (first, last) = (from / row, to.div_ceil(row));
        let mut unwritten = None;
        let spare = Mutex::new(Vec::new());
        let written = chunks::in_order(
            (last - first).div_ceil(CHUNK_RAYS),
            watch,
            from % row,
            Batch::default,
            |batch, chunk| {
                let rays = first + chunk * CHUNK_RAYS..last.min(first + (chunk + 1) * CHUNK_RAYS);
                let cut = (rays.end * row).saturating_sub(to) as usize;
                // Memory that was written out is taken again: new one would cost a fifth of the time.
                let mut encoded: Vec<u8> = lock(&spare).pop().unwrap_or_default();
                encoded.clear();
                encoded.reserve(((rays.end - rays.start) * row) as usize);
                self.encode(rays, batch, &mut encoded)?;
                encoded.truncate(encoded.len() - cut);
                Ok(encoded)
            },
            |skipped, encoded| {
                let part = encoded.get(std::mem::take(skipped) as usize..).unwrap_or_default();
                // Whatever stops the work: the stream's own answer is the one told.
                out.write_all(part).map_err(|error| {
                    unwritten = Some(error);
                    Error::Cancelled
                })?;
                lock(&spare).push(encoded);
                Ok(())
            },
        );
        match unwritten {
            Some(error) => return Err(Failed::Write(error)),
            None => written.map(|_| ())?,
        }
        let in_tail = |byte: u64| byte.saturating_sub(after_rays) as usize;
        out.write_all(self.rows.end().get(in_tail(bytes.start)..in_tail(end)).unwrap_or_default())?;
        Ok(())
    }

    /// Appends these rays.
    fn encode(&self, rays: Range<u64>, batch: &mut Batch, into: &mut Vec<u8>) -> Result<(), Error> {
        let mut from = rays.start;
        while from < rays.end {
            let to = rays.end.min(from + BATCH_RAYS);
            batch.numbers.clear();
            match &self.sequence {
                Some(sequence) => sequence.numbers(from..to, &mut batch.numbers),
                None => batch.numbers.extend((from..to).map(|ray| Numbers::of(self.request.seed, ray))),
            }
            let dark = || Error::Internal("a ray was drawn of a zone without directions".to_owned());
            self.sampler.draw_all(batch).ok_or_else(dark)?;
            if let Some(wavelengths) = &self.wavelengths {
                wavelengths.draw_all_nm(batch, &self.evaluator);
            }
            let mut wavelengths_nm = batch.wavelengths_nm.iter().copied();
            for drawn in &batch.drawn {
                self.rows.encode_ray(&self.ray(drawn, wavelengths_nm.next()), into);
            }
            from = to;
        }
        Ok(())
    }

    /// A ray as it is written.
    fn ray(&self, drawn: &Drawn, wavelength_nm: Option<f64>) -> RawRay {
        let Carried { luminous, xz } = self.carried.get(drawn.site).copied().unwrap_or_default();
        RawRay {
            origin_mm: drawn.point_mm.to_array(),
            direction: drawn.direction.to_array(),
            radiant: self.radiant,
            luminous,
            wavelength_nm: wavelength_nm.unwrap_or(0.0),
            xz,
            ..RawRay::default()
        }
    }
}

/// What a ray of a place carries besides W.
#[derive(Clone, Copy, Debug, Default)]
struct Carried {
    /// lm; 0 where that is unknown, or follows from the wavelength.
    luminous: f64,
    /// Tristimulus X and Z, lm: those of its place for its Y.
    xz: [f64; 2],
}

impl Carried {
    /// For each place of a light that sends `count` rays of `flux` together: all have the same of the quantity that they are drawn by, and of
    /// the other one as much as their place has for it.
    fn of(light: &Light<'_>, flux: Flux, count: f64) -> Vec<Carried> {
        let sites = light.sites();
        let has_color = light.spectral.columns == Columns::Tristimulus;
        let of = |site: usize| {
            let place = sites.flux_of(site);
            let luminous = match (flux.radiant_w, flux.luminous_lm) {
                (Some(radiant_w), Some(_)) => {
                    let lm_per_w = place.luminous_lm.zip(place.radiant_w).map_or(0.0, |(lm, w)| lm / w);
                    radiant_w / count * lm_per_w
                }
                (_, luminous) => luminous.unwrap_or(0.0) / count,
            };
            let xz = match sites.columns_of(site) {
                [x, y, z] if has_color && *y > 0.0 => [x / y * luminous, z / y * luminous],
                _ => [0.0; 2],
            };
            Carried { luminous, xz }
        };
        (0..sites.len()).map(of).collect()
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
