//! What stands before new rays in a file, and how the file lays them out.

use crate::convert::Target;
use crate::error::Error;
use crate::formats::lighttools::writer as lighttools;
use crate::formats::record::{DRAWN, LOW_DISCREPANCY, RawRay};
use crate::formats::tm25;
use crate::formats::tm25::Preamble;
use crate::formats::tm25::additional::Additional;
use crate::formats::tm25::header::{Flags, Header, SpectralId};
use crate::formats::tm25::spectra::Spectra;
use crate::formats::writer::{Encode, Writer};
use crate::formats::zemax::writer as zemax;
use crate::vocabulary::spectrum::Bands;
use crate::vocabulary::units::Flux;

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// How many rays.
    pub count: u64,
    /// Which of all the rays that could be drawn: another seed gives other rays of the same light.
    pub seed: u64,
    /// Rays are spread more evenly than chance has it.
    pub low_discrepancy: bool,
    /// The format of the file.
    pub target: Target,
}

/// How the format lays out one ray.
#[derive(Clone, Copy)]
pub enum Rows {
    /// In IES TM-25.
    Tm25(tm25::writer::Rows),
    /// In Zemax binary.
    Zemax(zemax::Rows),
    /// In LightTools binary.
    LightTools(lighttools::Rows),
}

impl Rows {
    /// Bytes per ray.
    pub fn row_bytes(self) -> usize {
        match self {
            Rows::Tm25(rows) => rows.row_bytes(),
            Rows::Zemax(rows) => rows.row_bytes(),
            Rows::LightTools(rows) => rows.row_bytes(),
        }
    }

    /// Appends one ray.
    pub fn encode_ray(self, ray: &RawRay, into: &mut Vec<u8>) {
        match self {
            Rows::Tm25(rows) => rows.encode_ray(ray, into),
            Rows::Zemax(rows) => rows.encode_ray(ray, into),
            Rows::LightTools(rows) => rows.encode_ray(ray, into),
        }
    }

    /// What stands after the last ray.
    pub fn end(&self) -> &'static [u8] {
        match self {
            Rows::Tm25(rows) => rows.end(),
            Rows::Zemax(rows) => rows.end(),
            Rows::LightTools(rows) => rows.end(),
        }
    }
}

/// What files of new rays of a model say of them: it tells how long they are, without the model.
#[derive(Clone, Debug, PartialEq)]
pub struct RayFile {
    /// What the source is called.
    pub(super) name: String,
    /// W and lm of all rays.
    pub(super) flux: Flux,
    /// The bands that wavelengths are drawn of.
    pub(super) bands: Option<Bands>,
    /// Rays have a tristimulus colour.
    pub(super) has_color: bool,
}

impl RayFile {
    /// Bytes of the whole file.
    ///
    /// # Errors
    /// [`Error::Refused`] where the format cannot hold the rays.
    pub fn byte_count(&self, request: Request) -> Result<u64, Error> {
        let (head, rows) = self.write(request)?;
        Ok(head.len() as u64 + request.count * rows.row_bytes() as u64 + rows.end().len() as u64)
    }

    /// What stands before the rays, and the layout of the rays that follow.
    ///
    /// # Errors
    /// [`Error::Refused`] where the format cannot hold the rays.
    pub(super) fn write(&self, request: Request) -> Result<(Vec<u8>, Rows), Error> {
        Told { file: self, request }.write()
    }
}

/// The same of so many rays.
struct Told<'a> {
    file: &'a RayFile,
    request: Request,
}

impl Told<'_> {
    fn write(&self) -> Result<(Vec<u8>, Rows), Error> {
        let mut head = Vec::new();
        let rows = match self.request.target {
            Target::Tm25 => Rows::Tm25(Writer::<tm25::writer::Rows>::start(&mut head, &self.preamble())?.rows()),
            Target::ZemaxBinary => Rows::Zemax(Writer::<zemax::Rows>::start(&mut head, &self.zemax()?)?.rows()),
            Target::LightToolsBinary => {
                Rows::LightTools(Writer::<lighttools::Rows>::start(&mut head, &self.lighttools())?.rows())
            }
        };
        Ok((head, rows))
    }

    /// A wavelength per ray goes with W alone: lm follow from it.
    fn preamble(&self) -> Preamble {
        let has_bands = self.file.bands.is_some();
        let edge = |edge: Option<&f64>| edge.copied();
        let edges_nm = self.file.bands.as_ref().map(Bands::edges_nm).unwrap_or_default();
        let mut texts: [String; 9] = Default::default();
        texts[0] = self.file.name.clone();
        texts[4] = format!("lampwright {}", env!("CARGO_PKG_VERSION"));
        let Request { seed, low_discrepancy, .. } = self.request;
        let spread = if low_discrepancy { format!(", {LOW_DISCREPANCY}") } else { String::new() };
        texts[7] = format!("{DRAWN} of the source{spread}. Seed {seed}.");
        let header = Header {
            luminous_lm: self.file.flux.luminous_lm,
            radiant_w: self.file.flux.radiant_w,
            ray_count: self.request.count,
            spectral_id: if has_bands { SpectralId::PerRay } else { SpectralId::None },
            range_nm: [edge(edges_nm.first()), edge(edges_nm.last())],
            flags: Flags {
                radiant: self.file.flux.radiant_w.is_some(),
                wavelength: has_bands,
                luminous: self.file.flux.luminous_lm.is_some() && !has_bands,
                tristimulus: self.file.has_color,
                ..Flags::default()
            },
            texts,
            ..Header::default()
        };
        Preamble::new(header, Spectra::new(Vec::new()), Additional::default())
    }

    fn lighttools(&self) -> lighttools::Header {
        let color = match (self.file.has_color, &self.file.bands) {
            (true, _) => lighttools::Color::Tristimulus,
            (false, Some(_)) => lighttools::Color::Wavelength,
            (false, None) => lighttools::Color::None,
        };
        let luminous = self.file.has_color || self.file.flux.radiant_w.is_none();
        let flux = if luminous { self.file.flux.luminous_lm } else { self.file.flux.radiant_w };
        let rows = lighttools::Rows { luminous, color };
        lighttools::Header { ray_count: self.request.count, flux: flux.unwrap_or(0.0), rows }
    }

    fn zemax(&self) -> Result<zemax::Header, Error> {
        if self.file.has_color {
            let found = "Each ray has a tristimulus colour, which a Zemax file cannot hold.";
            return Err(Error::refused("zemax.color_per_ray", found, "Write TM-25, which holds it."));
        }
        let count = self.request.count;
        let ray_count = u32::try_from(count).map_err(|_| {
            let found = format!("A Zemax file holds at most {} rays; these are {count}.", u32::MAX);
            Error::refused("zemax.too_many_rays", found, "Write TM-25, or ask for fewer rays.")
        })?;
        let rows = match (&self.file.bands, self.file.flux.radiant_w) {
            (Some(_), _) => zemax::Rows::Spectral,
            (None, Some(_)) => zemax::Rows::Radiant,
            (None, None) => zemax::Rows::Luminous,
        };
        let flux = if rows == zemax::Rows::Luminous { self.file.flux.luminous_lm } else { self.file.flux.radiant_w };
        let description = self.file.name.clone();
        Ok(zemax::Header { ray_count, description, flux: flux.unwrap_or(0.0), wavelength_nm: None, rows })
    }
}
