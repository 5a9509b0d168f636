//! `meshes[0].extras.emitter` of the glTF: what the attributes mean, and the vertex spectra as numbers
//! (`openapi/emitter-extras.schema.json`).

use crate::artifacts::exitance::Colors;
use crate::artifacts::goniograms;
use crate::artifacts::goniograms::{Box3, FrameFacts, Spectrum};
use crate::artifacts::provenance::Provenance;
use crate::flux::Amounts;
use crate::goniogram::Zone;
use crate::hull::Label;
use crate::model::Model;
use crate::options::{Options as RunOptions, Spectra};
use crate::source::Columns;
use crate::writing::number::{Numbers, SUM_DIGITS, rounded, sum};
use serde::{Serialize, Serializer};

/// Attribute of the vertices' radiant flux, W.
pub const FLUX_W: &str = "_FLUX_W";
/// Attribute of the vertices' luminous flux, lm.
pub const FLUX_LM: &str = "_FLUX_LM";
/// Attribute of the vertices' tristimulus X, Y, Z, lm.
pub const XYZ_LM: &str = "_XYZ_LM";
/// Attribute of the vertices' zone ids.
pub const ZONE: &str = "_ZONE";

/// Most spectral numbers that are repeated in extras unasked: 2 million are about 12 MB of text.
const MOST_INLINE: usize = 2_000_000;
/// Significant digits of the largest spectral number in extras.
const SPECTRUM_DIGITS: i32 = 5;

/// Attribute of a band's spectral flux, W/nm.
pub fn spectrum_attribute(band: usize) -> String {
    format!("_SPECTRUM_{band:03}")
}

/// Whether vertex spectra are attributes.
pub fn in_attributes(model: &Model, options: &RunOptions) -> bool {
    model.spectral.has_bands() && options.artifacts.spectra != Some(Spectra::Extras)
}

/// Whether vertex spectra are numbers in extras; if not, why.
fn in_extras(model: &Model, options: &RunOptions) -> Result<(), &'static str> {
    let count = model.hull.vertices_mm.len() * model.spectral.bands.len();
    match options.artifacts.spectra.unwrap_or_default() {
        Spectra::Both | Spectra::Extras => Ok(()),
        Spectra::Attributes => Err("spectra=attributes was asked for"),
        Spectra::Auto if count <= MOST_INLINE => Ok(()),
        Spectra::Auto => Err("more than 2 million numbers; spectra=both writes them here too"),
    }
}

/// The object `meshes[0].extras.emitter`.
#[derive(Serialize)]
pub struct Emitter<'a> {
    schema: &'static str,
    frame: FrameFacts,
    gltf_to_source_mm: [f64; 16],
    exitance: &'static str,
    radiance: &'static str,
    precedence: &'static str,
    luminance_scale_cd_m2: Option<f64>,
    spectrum: Option<Spectrum>,
    vertex_spectra: Option<VertexSpectra<'a>>,
    vertex_tristimulus: Option<VertexTristimulus>,
    vertex_flux: Vec<FluxList<'a>>,
    triangle_flux: Vec<FluxList<'a>>,
    triangle_stage: Stages<'a>,
    zones: Vec<ZoneFacts>,
    zone_weights: ZoneWeights,
    goniograms: &'static str,
    provenance: Provenance<'a>,
}

impl<'a> Emitter<'a> {
    /// Of a model.
    pub fn new(model: &'a Model, options: &'a RunOptions, colors: &Colors) -> Emitter<'a> {
        let has_bands = model.spectral.has_bands();
        Emitter {
            schema: "urn:lampwright:emitter-extras:1",
            frame: FrameFacts::new(&model.goniograms.frame),
            gltf_to_source_mm: GLTF_TO_SOURCE_MM,
            exitance: "M_l = flux_l / A_l, A_l = a third of the areas of the vertex's triangles in mm2; \
                       linear interpolation over each triangle",
            radiance: "L(x, w, lambda) = M(x, lambda) q(w; x, lambda) / |cos theta|, q from the zones' goniograms by the \
                       zone weights at x",
            precedence: "where attributes and the lists here differ, a tool has changed the vertices: attributes win",
            luminance_scale_cd_m2: colors.luminance_scale_cd_m2.map(sum),
            spectrum: has_bands.then(|| Spectrum::new(model)),
            vertex_spectra: has_bands.then(|| VertexSpectra::new(model, options)),
            vertex_tristimulus: (model.spectral.columns == Columns::Tristimulus).then_some(VertexTristimulus {
                quantity: "tristimulus flux",
                unit: "lm",
                attribute: XYZ_LM,
                components: ["X", "Y", "Z"],
            }),
            vertex_flux: flux_lists(&model.surface.vertices, true),
            triangle_flux: flux_lists(&model.surface.triangles, false),
            triangle_stage: Stages {
                labels: ["projected", "stitched", "filled"],
                values: StageCodes(&model.hull.labels),
            },
            zones: model.goniograms.zones.iter().map(ZoneFacts::new).collect(),
            zone_weights: ZoneWeights {
                rule: "hard",
                attribute: ZONE,
                meaning: "a vertex has weight 1 for the zone with this id and 0 for all others; weights, not ids, are \
                          interpolated over a triangle",
            },
            goniograms: goniograms::NAME,
            provenance: Provenance::new(model, options),
        }
    }
}

/// Column-major, as glTF writes matrices: source (x, y, z) mm = 1000 (X, -Z, Y) of glTF metres.
const GLTF_TO_SOURCE_MM: [f64; 16] =
    [1000.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1000.0, 0.0, 0.0, -1000.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];

#[derive(Serialize)]
struct VertexSpectra<'a> {
    quantity: &'static str,
    unit: &'static str,
    shape: [usize; 2],
    layout: &'static str,
    attributes: Option<Vec<String>>,
    scale: Option<f64>,
    values: Option<Quantised<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    values_absent_because: Option<&'static str>,
}

impl<'a> VertexSpectra<'a> {
    fn new(model: &'a Model, options: &RunOptions) -> VertexSpectra<'a> {
        let bands = model.spectral.bands.len();
        let inline = in_extras(model, options);
        let exponent = inline.is_ok().then(|| exponent(model));
        VertexSpectra {
            quantity: "spectral radiant flux; number = scale times value",
            unit: "W/nm",
            shape: [model.hull.vertices_mm.len(), bands],
            layout: "vertex-major",
            attributes: in_attributes(model, options).then(|| (0..bands).map(spectrum_attribute).collect()),
            scale: exponent.map(power_of_ten),
            values: exponent.map(|exponent| Quantised { model, exponent }),
            values_absent_because: inline.err(),
        }
    }
}

/// The power of ten that gives the largest spectral number five digits before the point.
fn exponent(model: &Model) -> i32 {
    let spectra = (0..model.hull.vertices_mm.len()).flat_map(|vertex| model.vertex_spectrum_w_per_nm(vertex));
    let max = spectra.fold(0.0, f64::max);
    if max > 0.0 { max.log10().floor() as i32 + 1 - SPECTRUM_DIGITS } else { 0 }
}

/// Through text, because `powi` is not exactly rounded.
fn power_of_ten(exponent: i32) -> f64 {
    rounded(10_f64.powi(exponent), 1)
}

/// `[vertex][band]` integers, made while they are written.
struct Quantised<'a> {
    model: &'a Model,
    exponent: i32,
}

impl Serialize for Quantised<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let scale = power_of_ten(self.exponent);
        let row = |vertex| -> Vec<i64> {
            self.model.vertex_spectrum_w_per_nm(vertex).iter().map(|density| (density / scale).round() as i64).collect()
        };
        serializer.collect_seq((0..self.model.hull.vertices_mm.len()).map(row))
    }
}

#[derive(Serialize)]
struct VertexTristimulus {
    quantity: &'static str,
    unit: &'static str,
    attribute: &'static str,
    components: [&'static str; 3],
}

#[derive(Serialize)]
struct FluxList<'a> {
    quantity: &'static str,
    unit: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    attribute: Option<&'static str>,
    values: Numbers<'a>,
}

/// One list for each flux that is known.
fn flux_lists(amounts: &Amounts, attributes: bool) -> Vec<FluxList<'_>> {
    let radiant = amounts.radiant_w.as_ref().map(|values| ("radiant flux", "W", FLUX_W, values));
    let luminous = amounts.luminous_lm.as_ref().map(|values| ("luminous flux", "lm", FLUX_LM, values));
    radiant
        .into_iter()
        .chain(luminous)
        .map(|(quantity, unit, attribute, values)| FluxList {
            quantity,
            unit,
            attribute: attributes.then_some(attribute),
            values: Numbers(values, SUM_DIGITS),
        })
        .collect()
}

#[derive(Serialize)]
struct Stages<'a> {
    labels: [&'static str; 3],
    values: StageCodes<'a>,
}

/// Index into `labels`, one per triangle.
struct StageCodes<'a>(&'a [Label]);

impl Serialize for StageCodes<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(|label| match label {
            Label::Projected => 0,
            Label::Stitched => 1,
            Label::Filled => 2,
        }))
    }
}

#[derive(Serialize)]
struct ZoneFacts {
    id: u32,
    row: usize,
    column: usize,
    bounds_mm: Box3,
}

impl ZoneFacts {
    fn new(zone: &Zone) -> ZoneFacts {
        ZoneFacts { id: zone.id, row: zone.row, column: zone.column, bounds_mm: Box3::new(&zone.bounds_mm) }
    }
}

#[derive(Serialize)]
struct ZoneWeights {
    rule: &'static str,
    attribute: &'static str,
    meaning: &'static str,
}
