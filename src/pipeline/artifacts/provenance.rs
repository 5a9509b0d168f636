//! What every artifact says of where it came from.

use crate::formats::bytes::digest;
use crate::model::Model;
use crate::model::ancestor::Ancestor;
use crate::model::channel::Origin;
use crate::options::{
    ArtifactsOptions, FluxOptions, GoniogramOptions, HullOptions, Options as RunOptions, RaysOptions,
};
use crate::vocabulary::declaration::{Column, FluxOverride, Total};
use crate::vocabulary::spectrum::Table;
use crate::vocabulary::units::{LengthUnit, Quantity};
use crate::writing::number::sum;
use crate::writing::schema::SHA256;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

/// The program's name, as artifacts say it.
pub const NAME: &str = "Lampwright";
/// The program's version.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
/// The day this version was made: artifacts hold no time of making, but LM-63 demands a date.
pub const VERSION_DATE: &str = "2026-11-21";

/// "Lampwright 0.1.0".
pub fn generator() -> String {
    format!("{NAME} {VERSION}")
}

/// Who made an artifact.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Generator {
    /// The program's name.
    name: &'static str,
    /// Its version.
    version: &'static str,
}

/// This program.
pub const GENERATOR: Generator = Generator { name: NAME, version: VERSION };

/// One input file.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct InputFile<'a> {
    /// Name of the file.
    name: &'a str,
    /// SHA-256 of the file.
    #[schemars(regex(pattern = SHA256))]
    sha256: &'a str,
    /// Length of the file, bytes.
    byte_count: u64,
    /// The format it was read as, e.g. "IES TM-25".
    format: &'a str,
    /// Rays in the file.
    ray_count: u64,
    /// Rays of it that can be used.
    rays_used: u64,
    /// What the user said of it.
    declared: DeclaredFacts,
}

/// What the user said of the file, and was obeyed in; null: nothing.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct DeclaredFacts {
    /// Unit of its positions.
    #[schemars(extend("enum" = LengthUnit::symbols_and_null()))]
    length_unit: Option<&'static str>,
    /// Whether its flux values are W or lm.
    quantity: Option<Quantity>,
    /// What stands in each column of a text file.
    columns: Option<Vec<Column>>,
    /// Its total flux as it was declared.
    flux: Option<FluxOverride>,
    /// What the flux came to: itself, or its share of the source's total.
    total: Option<Total>,
    /// Wavelengths of the spectrum, nm.
    spectrum_range_nm: Option<(f64, f64)>,
    /// SHA-256 of the spectrum's points as f64, little-endian, wavelength (nm) and value in turn.
    #[schemars(regex(pattern = SHA256))]
    spectrum_sha256: Option<String>,
}

impl DeclaredFacts {
    /// Of a channel.
    pub fn new(origin: &Origin) -> DeclaredFacts {
        let declared = &origin.declared;
        DeclaredFacts {
            length_unit: declared.length_unit.map(LengthUnit::symbol),
            quantity: declared.quantity,
            columns: declared.columns.clone(),
            flux: declared.flux,
            total: origin.fixed,
            spectrum_range_nm: declared.spectrum.as_ref().map(Table::range_nm),
            spectrum_sha256: declared.spectrum.as_ref().and_then(table_sha256),
        }
    }
}

fn table_sha256(table: &Table) -> Option<String> {
    let bytes: Vec<u8> = table.points().flat_map(|(nm, value)| [nm, value]).flat_map(f64::to_le_bytes).collect();
    digest(&bytes).ok()
}

/// Same inputs, declarations, options and version give the same bytes; these are they.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Provenance<'a> {
    /// Who made it.
    generator: Generator,
    /// The ray files, in the order of the channels; of a combination the models, each by its emitter.glb.
    #[schemars(length(min = 1))]
    inputs: Vec<InputFile<'a>>,
    /// Every option of the run, as used.
    options: OptionsEcho<'a>,
    /// What was changed of each model of a combination, in the order of inputs; left out where inputs are ray files.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Vec<ModelFacts>")]
    models: Option<Vec<ModelFacts<'a>>>,
}

/// A model that another was made of without its rays, and what was changed: its light was given a spectrum, its flux was multiplied, then it
/// was turned about the origin, then moved.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ModelFacts<'a> {
    /// What it is called.
    name: &'a str,
    /// SHA-256 of its emitter.glb.
    #[schemars(regex(pattern = SHA256))]
    emitter_sha256: &'a str,
    /// SHA-256 of its goniograms.json.
    #[schemars(regex(pattern = SHA256))]
    goniograms_sha256: &'a str,
    /// SHA-256 of the points of the spectrum that its light was given, as in inputs; null: it has its own.
    #[schemars(regex(pattern = SHA256))]
    spectrum_sha256: Option<String>,
    /// What its flux was multiplied by.
    #[schemars(extend("exclusiveMinimum" = 0))]
    flux_factor: f64,
    /// Rows of the rotation that takes its directions to those of the combination.
    turn: [[f64; 3]; 3],
    /// How far it was moved, mm.
    move_mm: [f64; 3],
    /// Where it came from itself: provenance of its goniograms.json.
    provenance: &'a Value,
}

/// The models of a combination; `None` where a model was made of rays.
pub fn models(model: &Model) -> Option<Vec<ModelFacts<'_>>> {
    let facts = |ancestor| ModelFacts::new(ancestor);
    (!model.ancestors.is_empty()).then(|| model.ancestors.iter().map(facts).collect())
}

impl<'a> ModelFacts<'a> {
    fn new(ancestor: &'a Ancestor) -> ModelFacts<'a> {
        ModelFacts {
            name: &ancestor.name,
            emitter_sha256: &ancestor.emitter_sha256,
            goniograms_sha256: &ancestor.goniograms_sha256,
            spectrum_sha256: ancestor.spectrum.as_ref().and_then(table_sha256),
            flux_factor: sum(ancestor.factor),
            turn: ancestor.turn.transpose().to_cols_array_2d().map(|row| row.map(sum)),
            move_mm: ancestor.move_mm.to_array().map(sum),
            provenance: &ancestor.provenance,
        }
    }
}

/// Every choice of the caller, with the default in the place of what was left out.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct OptionsEcho<'a> {
    /// How rays were read.
    rays: RaysEcho<'a>,
    /// How emission points became a surface.
    hull: HullOptions,
    /// How rays were laid on the surface.
    flux: FluxOptions,
    /// How zones and their goniograms were made.
    goniogram: GoniogramOptions,
    /// How results were written.
    artifacts: ArtifactsOptions,
}

/// How rays were read.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct RaysEcho<'a> {
    /// Edges of the spectral bands, nm; null: chosen by the program.
    band_edges_nm: &'a Option<Vec<f64>>,
    /// Total flux of the source, of which the channels have shares; null: the channels' own fluxes hold.
    total: Option<Total>,
}

impl<'a> OptionsEcho<'a> {
    /// Of a run.
    pub fn new(options: &'a RunOptions) -> OptionsEcho<'a> {
        let RunOptions { rays: _, hull, flux, goniogram, artifacts } = options.with_defaults();
        let RaysOptions { band_edges_nm, total } = &options.rays;
        let rays = RaysEcho { band_edges_nm, total: *total };
        OptionsEcho { rays, hull, flux, goniogram, artifacts }
    }
}

impl<'a> Provenance<'a> {
    /// Of a model.
    pub fn new(model: &'a Model, options: &'a RunOptions) -> Provenance<'a> {
        Provenance {
            generator: GENERATOR,
            inputs: model.origins.iter().map(input_file).collect(),
            options: OptionsEcho::new(options),
            models: models(model),
        }
    }
}

fn input_file(origin: &Origin) -> InputFile<'_> {
    InputFile {
        name: &origin.name,
        sha256: &origin.sha256,
        byte_count: origin.byte_count,
        format: origin.format,
        ray_count: origin.ray_count,
        rays_used: origin.rays_used,
        declared: DeclaredFacts::new(origin),
    }
}

/// What the files are that a model was made of.
pub fn input_kind(model: &Model) -> &'static str {
    if model.ancestors.is_empty() { "ray file" } else { "emitter.glb" }
}

/// The source's name: its files' names, joined.
pub fn source_name(model: &Model) -> String {
    model.origins.iter().map(|origin| origin.name.as_str()).collect::<Vec<_>>().join(" + ")
}

/// The first header text that is not blank and whose name contains `words`: in any case, with blanks or underscores.
pub fn header_text<'a>(model: &'a Model, words: &str) -> Option<&'a str> {
    let mut texts = model.origins.iter().flat_map(|origin| &origin.texts);
    let (_, value) = texts.find(|(name, value)| {
        name.to_ascii_lowercase().replace('_', " ").contains(words) && !value.trim().is_empty()
    })?;
    Some(value.trim())
}
