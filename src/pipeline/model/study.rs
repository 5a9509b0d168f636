//! How it was chosen where the light of a model is put, and how good a model of the same source made of a part of its rays is, judged by the others.

use crate::hull::Carrier;
use crate::vocabulary::notice::Notices;
use crate::writing::number::text;
use std::fmt;

/// Choice and verification.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Study {
    /// All surfaces that were tried, the simplest first.
    pub candidates: Vec<Candidate>,
    /// Index of the one that was taken.
    pub chosen: usize,
    /// Rays of which the candidates were made.
    pub training_rays: u64,
    /// Rays by which they were compared.
    pub compared_rays: u64,
    /// Rays by which the chosen one was verified.
    pub judging_rays: u64,
    /// Rays that were drawn from it for that.
    pub drawn_rays: u64,
    /// How good it is, quantity by quantity.
    pub figures: Vec<Figure>,
}

/// A surface that was tried.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Where the light is put.
    pub carrier: Carrier,
    /// Mean logarithm of the radiance that its model gives to the lines of the rays held out, their flux 1, mm and sr.
    pub log_radiance: f64,
    /// By how much that is more than that of the best candidate before it, and the standard error of this; `None` of the first.
    pub gain: Option<(f64, f64)>,
}

impl Candidate {
    /// What kind of surface it is, or a volume.
    pub fn surface(&self) -> &'static str {
        match self.carrier {
            Carrier::Origins => "origins",
            Carrier::Focal(patch) if patch.surface.curvature_per_mm == 0.0 => "plane",
            Carrier::Focal(_) => "sphere",
            Carrier::Volume => "volume",
        }
    }
}

impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let patch = match self.carrier {
            Carrier::Origins => return write!(f, "on the hull of where the rays start"),
            Carrier::Volume => return write!(f, "in the volume in which the rays start"),
            Carrier::Focal(patch) => patch,
        };
        let apex = patch.surface.apex_mm.to_array().map(|at| text(at, 4)).join(", ");
        write!(f, "on the {} through ({apex}) mm", self.surface())?;
        match patch.symmetry.mirrors() {
            0 => Ok(()),
            mirrors => write!(f, ", {mirrors} mirror planes"),
        }
    }
}

/// What is compared with the rays held out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum View {
    /// Irradiance on a plane across the main direction, so many sizes of the source in front of it.
    Plane(f64),
    /// Intensity in all directions.
    FarField,
    /// Luminance of the source as it is seen from so many degrees beside the main direction.
    Seen(f64),
    /// Irradiance on such a plane in each of some groups of bands.
    SpectralPlane(f64),
    /// Intensity in each of some groups of bands.
    SpectralFarField,
}

impl View {
    /// Whether it tells bands apart.
    pub fn is_spectral(self) -> bool {
        matches!(self, View::SpectralPlane(_) | View::SpectralFarField)
    }
}

/// Errors in one view, relative to the root mean square of what is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figure {
    /// What is compared.
    pub view: View,
    /// Root mean square error of the model, the noise of the rays that judge taken out.
    pub model: f64,
    /// The same of the rays of which the model was made.
    pub rays: f64,
    /// Errors below this cannot be told from the noise of the rays that judge.
    pub noise: f64,
    /// Normalised cross-correlation of the model with the truth, the noise taken out: 1 for the same form.
    pub correlation: f64,
}

impl Study {
    /// The surface that was taken.
    pub fn surface(&self) -> Option<&Candidate> {
        self.candidates.get(self.chosen)
    }

    /// Where the model is surely worse than the rays of which it was made.
    pub fn notices(&self) -> Notices {
        let mut notices = Notices::default();
        let views: Vec<String> = self
            .figures
            .iter()
            .filter(|figure| figure.is_worse_than_rays())
            .map(|figure| {
                format!("{}: {:.1} % against {:.1} %", figure.view, 100.0 * figure.model, 100.0 * figure.rays)
            })
            .collect();
        if !views.is_empty() {
            let message = format!(
                "A model of {} of the rays is farther from the others than those rays themselves. {}. Report this source to the makers of the program.",
                self.training_rays,
                views.join("; ")
            );
            notices.add("model.worse_than_rays", message);
        }
        notices
    }
}

impl Figure {
    /// The model is surely farther from the truth than the rays of which it was made.
    pub fn is_worse_than_rays(&self) -> bool {
        self.model.powi(2) > self.rays.powi(2) + 2.0 * self.noise.powi(2)
    }
}

impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [model, rays, noise] = [self.model, self.rays, self.noise].map(|part| format!("{:.1} %", 100.0 * part));
        let model = if self.model < self.noise {
            format!("below the noise of {noise}")
        } else {
            format!("{model} (noise {noise})")
        };
        write!(f, "{model}, rays {rays}")
    }
}

impl fmt::Display for View {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            View::Plane(sizes) => write!(f, "plane at {sizes} sizes"),
            View::FarField => write!(f, "far field"),
            View::Seen(degrees) => write!(f, "seen from {degrees} deg"),
            View::SpectralPlane(sizes) => write!(f, "spectrum at {sizes} sizes"),
            View::SpectralFarField => write!(f, "spectrum, far field"),
        }
    }
}
