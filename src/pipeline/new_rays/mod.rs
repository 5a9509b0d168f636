//! New rays from a model, as a ray file: as many as are asked for, all of the same flux. Ray i depends on the seed and on i alone, so that any
//! part of the file can be made without the rest, on any number of threads.
//!
//! Places and directions are drawn from the radiance L of the model (`openapi/README.md`), radiant where that is known; the wavelength
//! then from the spectral radiance of the ray's place and direction.

/// What stands before the rays.
mod head;

pub use head::Request;

use crate::convert::Failed;
use crate::error::Error;
use crate::formats::record::{CHUNK_RAYS, RawRay};
use crate::model::chance::Numbers;
use crate::model::evaluation::Evaluator;
use crate::model::light::Light;
use crate::model::sampling::{Drawn, Sampler};
use crate::model::wavelengths::Wavelengths;
use crate::rays::chunks;
use crate::source::Columns;
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::StageWatch;
use head::Rows;
use std::io::Write;
use std::ops::Range;

/// Most rays of a file: 32 TB of them.
pub const MOST_RAYS: u64 = 1_000_000_000_000;

/// A ray file that is made as it is read.
pub struct NewRays<'a> {
    request: Request,
    evaluator: Evaluator<'a>,
    sampler: Sampler<'a>,
    wavelengths: Option<Wavelengths<'a>>,
    /// W and lm of all rays.
    flux: Flux,
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
        let told = head::Told {
            name,
            request,
            flux,
            bands: wavelengths.is_some().then(|| &evaluator.light().spectral.bands),
            has_color: evaluator.light().spectral.columns == Columns::Tristimulus,
        };
        let (head, rows) = told.write()?;
        Ok(NewRays { request, evaluator, sampler, wavelengths, flux, head, rows })
    }

    /// W and lm of all rays together, each where the model knows it.
    pub fn flux(&self) -> Flux {
        self.flux
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
        let chunk_rays = CHUNK_RAYS as u64;
        let mut unwritten = None;
        let written = chunks::in_order(
            (last - first).div_ceil(chunk_rays),
            watch,
            from % row,
            || (),
            |(), chunk| {
                let rays = first + chunk * chunk_rays..last.min(first + (chunk + 1) * chunk_rays);
                let cut = (rays.end * row).saturating_sub(to) as usize;
                let mut encoded = Vec::with_capacity(((rays.end - rays.start) * row) as usize);
                for ray in rays {
                    self.rows.encode_ray(&self.ray(ray)?, &mut encoded);
                }
                encoded.truncate(encoded.len() - cut);
                Ok(encoded)
            },
            |skipped, encoded| {
                let part = encoded.get(std::mem::take(skipped) as usize..).unwrap_or_default();
                // Whatever stops the work: the stream's own answer is the one told.
                out.write_all(part).map_err(|error| {
                    unwritten = Some(error);
                    Error::Cancelled
                })
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

    /// Ray number `ray`, its flux in W and lm.
    fn ray(&self, ray: u64) -> Result<RawRay, Error> {
        let mut numbers = Numbers::of(self.request.seed, ray);
        let drawn = self.sampler.draw(&mut numbers);
        let drawn = drawn.ok_or_else(|| Error::Internal("a ray was drawn of a zone without directions".to_owned()))?;
        let wavelength_nm = self.wavelengths.as_ref().map(|bands| bands.draw_nm(&drawn, &self.evaluator, &mut numbers));
        let [radiant, luminous] = self.flux_of(&drawn);
        Ok(RawRay {
            origin_mm: drawn.point_mm.to_array(),
            direction: drawn.direction.to_array(),
            radiant,
            luminous,
            wavelength_nm: wavelength_nm.unwrap_or(0.0),
            xz: self.color_of(&drawn, luminous),
            ..RawRay::default()
        })
    }

    /// W and lm of a ray, 0 where they are unknown: all rays have the same of the quantity that they are drawn by, and of the other one as
    /// much as their place has for it.
    fn flux_of(&self, drawn: &Drawn) -> [f64; 2] {
        let count = self.request.count as f64;
        let place = self.evaluator.light().sites().flux_of(drawn.site);
        match (self.flux.radiant_w, self.flux.luminous_lm) {
            (Some(radiant_w), luminous) => {
                let radiant = radiant_w / count;
                let lm_per_w = place.luminous_lm.zip(place.radiant_w).map(|(lm, w)| lm / w);
                [radiant, luminous.and(lm_per_w).map_or(0.0, |lm_per_w| radiant * lm_per_w)]
            }
            (None, luminous) => [0.0, luminous.unwrap_or(0.0) / count],
        }
    }

    /// Tristimulus X and Z of a ray, lm: those of its place for its Y.
    fn color_of(&self, drawn: &Drawn, luminous: f64) -> [f64; 2] {
        let light = self.evaluator.light();
        match light.sites().columns_of(drawn.site) {
            [x, y, z] if light.spectral.columns == Columns::Tristimulus && *y > 0.0 => {
                [x / y * luminous, z / y * luminous]
            }
            _ => [0.0; 2],
        }
    }
}
