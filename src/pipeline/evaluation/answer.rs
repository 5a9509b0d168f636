//! The numbers of an answer, with their names and units.

use super::emission::{Emission, Kind, tristimulus_of_bands};
use super::request::Request;
use super::view::View;
use crate::error::Error;
use crate::vocabulary::notice::Notice;
use crate::vocabulary::space::Frame;

/// mm² in a m².
const MM2: f64 = 1e6;

/// Numbers per mm² and in the channels of the emission.
pub struct Raw {
    /// Columns and rows.
    pub shape: [usize; 2],
    /// `[cell][channel]`.
    pub values: Vec<f64>,
    /// Bounds of their errors.
    pub bounds: Vec<f64>,
    /// Points of the model that were evaluated.
    pub evaluations: u64,
}

/// One of the numbers that each cell has.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// The band it is of, nm.
    pub band_nm: Option<[f64; 2]>,
    /// One number a cell, row by row.
    pub values: Vec<f64>,
    /// Bounds of their errors against the model.
    pub bounds: Vec<f64>,
}

/// What a model answers.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// What the source is called.
    pub model: String,
    /// What was asked.
    pub request: Request,
    /// Which light.
    pub kind: Kind,
    /// What the numbers are: illuminance, radiant intensity …
    pub quantity: &'static str,
    /// The photometric frame of the model.
    pub frame: Frame,
    /// Cells in a row.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// The numbers.
    pub channels: Vec<Channel>,
    /// Points of the model that were evaluated.
    pub evaluations: u64,
    /// What whoever reads the numbers must know.
    pub notices: Vec<Notice>,
}

/// Name and unit of what `kind` is in a view.
fn words(view: &View, kind: Kind) -> [&'static str; 2] {
    match (view, kind) {
        (View::Plane(_), Kind::Luminous) => ["illuminance", "lx"],
        (View::Plane(_), Kind::Radiant) => ["irradiance", "W/m²"],
        (View::Plane(_), Kind::Spectrum) => ["spectral irradiance", "W/(m² nm)"],
        (View::Plane(_), Kind::Color) => ["tristimulus illuminance", "lx"],
        (View::Camera(_), Kind::Luminous) => ["luminance", "cd/m²"],
        (View::Camera(_), Kind::Radiant) => ["radiance", "W/(m² sr)"],
        (View::Camera(_), Kind::Spectrum) => ["spectral radiance", "W/(m² sr nm)"],
        (View::Camera(_), Kind::Color) => ["tristimulus luminance", "cd/m²"],
        (_, Kind::Luminous) => ["luminous intensity", "cd"],
        (_, Kind::Radiant) => ["radiant intensity", "W/sr"],
        (_, Kind::Spectrum) => ["spectral intensity", "W/(sr nm)"],
        (_, Kind::Color) => ["tristimulus intensity", "cd"],
    }
}

impl Answer {
    /// Of what was computed.
    ///
    /// # Errors
    /// [`Error::Internal`] where a number is not finite.
    pub fn new(emission: &Emission<'_>, name: &str, request: &Request, kind: Kind, raw: Raw) -> Result<Answer, Error> {
        let scale = if matches!(request.view, View::Plane(_) | View::Camera(_)) { MM2 } else { 1.0 };
        let [quantity, unit] = words(&request.view, kind);
        let count = emission.channels();
        // X, Y and Z of a unit of each channel.
        let bands = &emission.light().spectral.bands;
        let weights: Vec<(String, Option<[f64; 2]>, Vec<f64>)> = match kind {
            Kind::Radiant | Kind::Luminous => vec![(quantity.to_owned(), None, vec![1.0])],
            Kind::Spectrum => {
                let one = |(at, edges): (usize, &[f64])| {
                    let alone = (0..count).map(|channel| if channel == at { 1.0 } else { 0.0 }).collect();
                    (format!("{}-{} nm", edges[0], edges[1]), Some([edges[0], edges[1]]), alone)
                };
                bands.edges_nm().windows(2).enumerate().map(one).collect()
            }
            Kind::Color => {
                let of_bands = emission.light().spectral.has_bands().then(|| tristimulus_of_bands(bands));
                let one = |(at, name): (usize, &str)| {
                    let same = (0..count).map(|channel| if channel == at { 1.0 } else { 0.0 }).collect();
                    let weights = of_bands.as_ref().map_or(same, |bands| bands.iter().map(|band| band[at]).collect());
                    (name.to_owned(), None, weights)
                };
                ["X", "Y", "Z"].into_iter().enumerate().map(one).collect()
            }
        };
        let sums = |numbers: &[f64], weights: &[f64]| -> Vec<f64> {
            let sum = |cell: &[f64]| scale * cell.iter().zip(weights).map(|(value, own)| own * value).sum::<f64>();
            numbers.chunks_exact(count).map(sum).collect()
        };
        let channel = |(name, band_nm, weights): (String, Option<[f64; 2]>, Vec<f64>)| Channel {
            name,
            unit,
            band_nm,
            values: sums(&raw.values, &weights),
            bounds: sums(&raw.bounds, &weights),
        };
        let mut channels: Vec<Channel> = weights.into_iter().map(channel).collect();
        if kind == Kind::Color {
            let chromaticity = chromaticity(&channels);
            channels.extend(chromaticity);
        }
        let sound = |channel: &Channel| channel.values.iter().chain(&channel.bounds).all(|value| value.is_finite());
        if !channels.iter().all(sound) {
            return Err(Error::Internal("an evaluation of a model is not finite".to_owned()));
        }
        Ok(Answer {
            model: name.to_owned(),
            request: request.clone(),
            kind,
            quantity,
            frame: emission.light().frame,
            columns: raw.shape[0],
            rows: raw.shape[1],
            channels,
            evaluations: raw.evaluations,
            notices: Vec::new(),
        })
    }

    /// One number a cell where only one is wanted, its name and its unit: Y of tristimulus values, the sum over the bands of a spectrum.
    pub fn brightness(&self) -> (Vec<f64>, &'static str, &'static str) {
        let one = |channel: &Channel| channel.values.clone();
        match self.kind {
            Kind::Spectrum => {
                let mut sums = vec![0.0; self.columns * self.rows];
                for channel in &self.channels {
                    let width_nm = channel.band_nm.map_or(0.0, |[from, to]| to - from);
                    sums.iter_mut().zip(&channel.values).for_each(|(sum, value)| *sum += width_nm * value);
                }
                let [name, unit] = words(&self.request.view, Kind::Radiant);
                (sums, name, unit)
            }
            Kind::Color => {
                let [name, unit] = words(&self.request.view, Kind::Luminous);
                (self.channels.get(1).map(one).unwrap_or_default(), name, unit)
            }
            kind => {
                let [name, unit] = words(&self.request.view, kind);
                (self.channels.first().map(one).unwrap_or_default(), name, unit)
            }
        }
    }
}

/// x and y of X, Y and Z: x = X/(X + Y + Z); 0 where there is no light.
fn chromaticity(xyz: &[Channel]) -> Vec<Channel> {
    let sum = |numbers: fn(&Channel) -> &Vec<f64>, cell: usize| xyz.iter().map(|channel| numbers(channel)[cell]).sum();
    let one = |(channel, name): (&Channel, &str)| {
        let cells = 0..channel.values.len();
        let of = |cell: usize| {
            let (all, error): (f64, f64) = (sum(|of| &of.values, cell), sum(|of| &of.bounds, cell));
            if all <= 0.0 {
                return (0.0, if error > 0.0 { 1.0 } else { 0.0 });
            }
            let share = channel.values[cell] / all;
            // Errors of the sum and of its part; no share is off by more than 1.
            let wrong = (channel.bounds[cell] + share * error) / (all - error).max(f64::MIN_POSITIVE);
            (share, wrong.min(1.0))
        };
        let (values, bounds) = cells.map(of).unzip();
        Channel { name: name.to_owned(), unit: "1", band_nm: None, values, bounds }
    };
    xyz.iter().zip(["x", "y"]).map(one).collect()
}
