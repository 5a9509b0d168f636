//! Which spectral bands a source gets: the user's, or 380..780 nm in 10 nm, wider where the rays are.

use crate::error::Error;
use crate::options::{RaysOptions, bad_bands};
use crate::vocabulary::notice::Notices;
use crate::vocabulary::spectrum::{Bands, Table, wider};
use crate::vocabulary::wavelength::LIGHT_NM;

/// Range and step of the default bands, nm.
const DEFAULT_NM: (f64, f64, f64) = (380.0, 780.0, 10.0);
/// Most bands the default grows to.
const MOST_BANDS: f64 = 400.0;

/// The bands before the rays are known.
pub struct RequestedBands {
    bands: Bands,
    may_grow: bool,
}

/// What the options ask for.
///
/// # Errors
/// `options.band_edges`.
pub fn asked(options: &RaysOptions) -> Result<RequestedBands, Error> {
    if let Some(bands) = options.bands()? {
        return Ok(RequestedBands { bands, may_grow: false });
    }
    let (low, high, step) = DEFAULT_NM;
    let bands = Bands::regular(low, high, step).ok_or_else(|| bad_bands("There are no default bands.".to_owned()))?;
    Ok(RequestedBands { bands, may_grow: true })
}

/// The wavelengths of a channel whose rays were read.
pub struct ChannelSpectrum<'a> {
    /// From the shortest to the longest wavelength, nm; `None` without a spectrum.
    pub range_nm: Option<(f64, f64)>,
    /// Its spectral tables.
    pub tables: &'a [Table],
    /// How many rays lie outside [`RequestedBands::bands`], and the index of the first.
    pub outside: (u64, Option<u64>),
}

/// Which wavelengths a channel has, as far as that is known before its rays are read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reach {
    /// None.
    Nothing,
    /// From the first to the second, nm.
    Range(f64, f64),
    /// Those of its rays, which have not been read yet.
    Unknown,
}

impl Reach {
    fn range_nm(self) -> Option<(f64, f64)> {
        match self {
            Reach::Range(low, high) => Some((low, high)),
            Reach::Nothing | Reach::Unknown => None,
        }
    }
}

/// Range of the default bands when they are widened to hold `low..high`, nm; `None` where that is too wide, or no light anybody models.
fn widened(low: f64, high: f64) -> Option<(f64, f64)> {
    let (from, to, step) = DEFAULT_NM;
    let (from, to) = (from.min((low / step).floor() * step), to.max((high / step).ceil() * step));
    let fits = LIGHT_NM.contains(&from) && LIGHT_NM.contains(&to) && (to - from) / step <= MOST_BANDS;
    fits.then_some((from, to))
}

/// Most bands that channels with these wavelengths can get.
pub fn most(options: &RaysOptions, reaches: &[Reach]) -> f64 {
    if let Some(edges) = &options.band_edges_nm {
        return edges.len().saturating_sub(1) as f64;
    }
    if reaches.contains(&Reach::Unknown) {
        return MOST_BANDS;
    }
    let (from, to, step) = DEFAULT_NM;
    let range = reaches.iter().fold(None, |range, reach| wider(range, reach.range_nm()));
    let (from, to) = range.and_then(|(low, high)| widened(low, high)).unwrap_or((from, to));
    (to - from) / step
}

impl RequestedBands {
    /// The bands as asked for.
    pub fn bands(&self) -> &Bands {
        &self.bands
    }

    /// The bands as asked for; ends the request.
    pub fn into_bands(self) -> Bands {
        self.bands
    }

    /// The bands of the source; a notice tells what lies outside them.
    pub fn settle(self, channels: &[ChannelSpectrum<'_>], notices: &mut Notices) -> Bands {
        let range = channels.iter().fold(None, |range, channel| wider(range, channel.range_nm));
        let Some((low, high)) = range else { return self.bands };
        if self.may_grow {
            let widened = widened(low, high).and_then(|(from, to)| Bands::regular(from, to, DEFAULT_NM.2));
            if let Some(bands) = widened {
                return bands;
            }
            let told = format!("Wavelengths from {low} to {high} nm are too far apart for the default bands.");
            notices.add("rays.bands_not_widened", told);
        }
        self.tell_outside(channels, notices);
        self.bands
    }

    fn tell_outside(&self, channels: &[ChannelSpectrum<'_>], notices: &mut Notices) {
        const CODE: &str = "rays.outside_bands";
        for channel in channels {
            let (count, first) = channel.outside;
            if count > 0 {
                let told = "Rays have wavelengths outside the spectral bands; they count in the totals only.";
                notices.count(CODE, count, first, told);
            }
            let least =
                channel.tables.iter().map(|table| table.shares(&self.bands).iter().sum::<f64>()).fold(1.0, f64::min);
            if least < 1.0 - 1e-9 {
                let told = format!(
                    "Up to {:.3} % of a spectral table lies outside the spectral bands; it counts in the totals only.",
                    100.0 * (1.0 - least)
                );
                notices.add(CODE, told);
            }
        }
    }
}
