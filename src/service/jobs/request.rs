//! The channels of a source, as clients send them and as they are stored: ray sets with declarations. The pipeline checks whether
//! they form one source before the job is queued.

use super::Priority;
use super::evaluation::{JobEvaluation, NumberPair};
use super::options::JobOptions;
use crate::metadata::Metadata;
use crate::ray_sets::declaration::columns;
use crate::ray_sets::declaration::{FileDeclaration, LengthUnit, QuantityName};
use pipeline::Options;
use pipeline::{Error, FluxOverride, Place, Table};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A request for a job: what is to be made, and behind that what every such request may say. (Not a struct that is flattened in: of what is
/// wrong in one of those, serde does not tell the place.)
macro_rules! asked {
    ($(#[$about:meta])* pub struct $name:ident { $($made:tt)* }) => {
        $(#[$about])*
        #[derive(Clone, Debug, Serialize, Deserialize, ToSchema)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            $($made)*
            /// Priority among the queued jobs of the tenant. It has no effect on other tenants: tenants take turns. Default: normal.
            #[serde(default)]
            #[schema(nullable)]
            pub priority: Priority,
            /// Longest time that an attempt may take, s. Default and upper limit: the limit of the service.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            #[schema(minimum = 1, maximum = 4_294_967_295_u32)]
            pub timeout_s: Option<u32>,
            /// The client's own keys and values.
            #[serde(default, skip_serializing_if = "Metadata::is_empty")]
            #[schema(nullable)]
            pub metadata: Metadata,
            /// Whether the answer may be an equal job of the tenant that is queued, is running or has succeeded: one of the same files, names,
            /// declarations and options, or the same evaluation of the same model, by the same version of the computation, and, if the request has
            /// metadata, with the same metadata. Default: true.
            #[serde(default = "crate::jobs::request::yes")]
            #[schema(nullable)]
            pub reuse: bool,
        }
    };
}
pub(super) use asked;

asked! {
    /// A request for a job.
    pub struct NewJob {
        /// The channels of the source: ray sets in one common coordinate frame, with declarations about each.
        #[schema(min_items = 1, max_items = 8)]
        pub channels: Vec<Channel>,
        /// Total flux of the source; required if the channels have shares of it, and not allowed otherwise.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub total: Option<TotalFlux>,
        /// Options of the computation; those that are left out follow from the rays.
        #[serde(default)]
        #[schema(nullable, value_type = JobOptions)]
        pub options: Options,
        /// What is evaluated, of a job that was asked for as an evaluation; it then has no channels.
        #[serde(skip)]
        pub evaluation: Option<JobEvaluation>,
    }
}

/// What a request means by leaving `reuse` out.
pub(super) fn yes() -> bool {
    true
}

/// One channel of a source: a ray set, and declarations that override what its file says. Fields that are left out are taken from
/// the file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// Identifier of the ray set. Two channels may name the same ray set only if each of them has a flux.
    #[schema(format = Uuid)]
    pub ray_set: String,
    /// Name of the channel in the report. Default: the name of the ray set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_length = 1, max_length = 255, example = "blue")]
    pub name: Option<String>,
    /// Length unit of the ray positions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_unit: Option<LengthUnit>,
    /// Whether the flux values are radiant (W) or luminous (lm).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quantity: Option<QuantityName>,
    /// The meaning of each column, for text files only: x, y, z, l, m, n, flux, radiant_flux, luminous_flux,
    /// wavelength_nm, wavelength_um, tristimulus_x, tristimulus_z, ignored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(max_items = 64, example = json!(["x", "y", "z", "l", "m", "n", "flux"]))]
    pub columns: Option<Vec<String>>,
    /// Spectrum of the channel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spectrum: Option<SpectrumChoice>,
    /// Flux of the channel, radiant (W) or luminous (lm). The other of the two follows from the spectrum, and is unknown without
    /// one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flux: Option<ChannelFlux>,
}

/// A spectrum: an uploaded one, or its points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SpectrumChoice {
    /// Identifier of an uploaded spectrum.
    Id(String),
    /// Points of wavelength, nm, increasing, and spectral density, in any scale; linear between them, 0 outside.
    #[schema(value_type = Vec<NumberPair>, example = json!({"nm_value": [[440.0, 0.0], [450.0, 1.0], [460.0, 0.0]]}))]
    NmValue(Vec<(f64, f64)>),
}

/// Flux of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ChannelFlux {
    /// W.
    RadiantW(f64),
    /// lm.
    LuminousLm(f64),
    /// Share of the source's total in W, above 0, at most 1.
    RadiantShare(f64),
    /// Share of the source's total in lm, above 0, at most 1.
    LuminousShare(f64),
}

/// Total flux of a source.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TotalFlux {
    /// W.
    RadiantW(f64),
    /// lm.
    LuminousLm(f64),
}

impl NewJob {
    /// A job of one ray set without declarations, with default options.
    pub fn of(ray_set: &str) -> NewJob {
        NewJob {
            channels: vec![Channel::of(ray_set)],
            total: None,
            options: Options::default(),
            priority: Priority::default(),
            timeout_s: None,
            metadata: Metadata::default(),
            reuse: true,
            evaluation: None,
        }
    }
}

impl Channel {
    /// A channel of a ray set without declarations.
    pub fn of(ray_set: &str) -> Channel {
        Channel { ray_set: ray_set.to_owned(), ..Channel::default() }
    }

    /// Identifier of the uploaded spectrum that the channel names.
    pub fn spectrum_id(&self) -> Option<&str> {
        match &self.spectrum {
            Some(SpectrumChoice::Id(id)) => Some(id),
            _ => None,
        }
    }

    /// The channel with the declarations of `file` where it has none of its own.
    pub fn or(self, file: &FileDeclaration) -> Channel {
        Channel {
            length_unit: self.length_unit.or(file.length_unit),
            quantity: self.quantity.or(file.quantity),
            columns: self.columns.or_else(|| file.columns.clone()),
            ..self
        }
    }

    /// The pipeline's own words for it. `index`: its place in the source; `uploaded`: the points of the spectrum it names.
    ///
    /// # Errors
    /// [`Error::Unusable`], at the field: unknown columns, points that are no spectrum.
    pub fn resolve(&self, index: usize, uploaded: Option<&[(f64, f64)]>) -> Result<pipeline::Declared, Error> {
        let points = match &self.spectrum {
            Some(SpectrumChoice::NmValue(points)) => Some(points.as_slice()),
            _ => uploaded,
        };
        Ok(pipeline::Declared {
            name: self.name.clone(),
            length_unit: self.length_unit.map(LengthUnit::unit),
            quantity: self.quantity.map(QuantityName::quantity),
            columns: self.columns.as_ref().map(|names| columns(index, names)).transpose()?,
            spectrum: points.map(|points| table(index, points)).transpose()?,
            flux: self.flux.map(ChannelFlux::flux),
        })
    }
}

fn table(index: usize, points: &[(f64, f64)]) -> Result<Table, Error> {
    Table::new(points).ok_or_else(|| {
        let found = "The points do not form a valid spectrum.";
        let remedy = "Give wavelengths in nm, positive and increasing, with values of 0 or more, one of them above 0.";
        Error::invalid_declaration("rays.spectrum_points", Place::Channel(index, "spectrum"), found, remedy)
    })
}

impl ChannelFlux {
    fn flux(self) -> FluxOverride {
        match self {
            ChannelFlux::RadiantW(value) => FluxOverride::RadiantW(value),
            ChannelFlux::LuminousLm(value) => FluxOverride::LuminousLm(value),
            ChannelFlux::RadiantShare(share) => FluxOverride::RadiantShare(share),
            ChannelFlux::LuminousShare(share) => FluxOverride::LuminousShare(share),
        }
    }
}

impl TotalFlux {
    /// The pipeline's own word for it.
    pub fn total(self) -> pipeline::Total {
        match self {
            TotalFlux::RadiantW(value) => pipeline::Total::RadiantW(value),
            TotalFlux::LuminousLm(value) => pipeline::Total::LuminousLm(value),
        }
    }
}
