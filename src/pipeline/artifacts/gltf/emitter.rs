//! `meshes[0].extras.emitter` of the glTF: what the attributes mean, and the vertex spectra as numbers
//! (`openapi/emitter-extras.schema.json`).

use crate::artifacts::exitance::Colors;
use crate::artifacts::facts::{Box3, FrameFacts, Spectrum};
use crate::artifacts::goniograms;
use crate::artifacts::provenance::Provenance;
use crate::flux::Amounts;
use crate::goniogram::Zone;
use crate::hull::Label;
use crate::model::Model;
use crate::options::{Options as RunOptions, Spectra};
use crate::source::Columns;
use crate::volume::Volume;
use crate::writing::number::{Numbers, SUM_DIGITS, rounded, sum};
use schemars::JsonSchema;
use serde::{Serialize, Serializer};

/// What the object calls its schema.
pub const URN: &str = "urn:lampwright:emitter-extras:2";
/// Attribute of the vertices' radiant flux, W.
pub const FLUX_W: &str = "_FLUX_W";
/// Attribute of the vertices' luminous flux, lm.
pub const FLUX_LM: &str = "_FLUX_LM";
/// Attribute of the vertices' tristimulus X, Y, Z, lm.
pub const XYZ_LM: &str = "_XYZ_LM";
/// Attribute of the vertices' zone ids, four each.
pub const ZONES: &str = "_ZONES";
/// Attribute of the weights of those zones.
pub const WEIGHTS: &str = "_ZONE_WEIGHTS";
/// Attribute of the volume that a node of the lattice stands for, mm³.
pub const VOLUME_MM3: &str = "_VOLUME_MM3";

/// Most spectral numbers that are repeated in extras unasked: these are about 3 MB of text, in a file that shall have less than 10 MB.
const MOST_INLINE: usize = 500_000;
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
        Spectra::Auto => Err("more than 500 000 numbers; spectra=both writes them here too"),
    }
}

/// What the attributes of the emitter's surface mean, and the same numbers as lists.
#[derive(Serialize, JsonSchema)]
#[schemars(title = "meshes[0].extras.emitter of emitter.glb", extend("$id" = URN))]
pub struct Emitter<'a> {
    /// Which schema this follows; another number means a change that breaks readers.
    #[schemars(extend("const" = URN))]
    schema: &'static str,
    /// The photometric frame of the goniograms.
    frame: FrameFacts,
    /// Column-major 4x4: glTF metres, Y up, to the ray file's mm.
    gltf_to_source_mm: [f64; 16],
    /// How fluxes of vertices become exitance.
    exitance: &'static str,
    /// How exitance and goniograms become radiance.
    radiance: &'static str,
    /// What holds where attributes and the lists here differ.
    precedence: &'static str,
    /// Luminance of a Lambertian surface whose COLOR_0 has relative luminance 1: M/pi, cd/m2; null where luminous flux is
    /// unknown.
    #[schemars(range(min = 0))]
    luminance_scale_cd_m2: Option<f64>,
    /// The bands of every spectral number; null without bands.
    spectrum: Option<Spectrum>,
    /// Spectral flux of the vertices; null without bands.
    vertex_spectra: Option<VertexSpectra<'a>>,
    /// Tristimulus flux of the vertices; null unless the rays are tristimulus.
    vertex_tristimulus: Option<VertexTristimulus>,
    /// One list for each known flux; their sums are the model's flux.
    #[schemars(length(min = 1))]
    vertex_flux: Vec<VertexFlux<'a>>,
    /// One list for each known flux, as counted, before smoothing.
    #[schemars(length(min = 1))]
    triangle_flux: Vec<TriangleFlux<'a>>,
    /// Which step of the hull made each triangle.
    triangle_stage: Stages<'a>,
    /// The zones; the index is the zone's id.
    #[schemars(length(min = 1))]
    zones: Vec<ZoneFacts>,
    /// How vertices belong to zones.
    zone_weights: ZoneWeights,
    /// The volume that the light comes from; null where it comes from the surface. Then the volume is the model, and the surface with its
    /// zones is the same light once more, for programs that know only surfaces: use one of the two.
    volume: Option<VolumeFacts>,
    /// The file in the zip that holds the zones' goniograms.
    #[schemars(extend("const" = goniograms::NAME))]
    goniograms: &'static str,
    /// What makes the same bytes again.
    provenance: Provenance<'a>,
}

impl<'a> Emitter<'a> {
    /// Of a model.
    pub fn new(model: &'a Model, options: &'a RunOptions, colors: &Colors) -> Emitter<'a> {
        let has_bands = model.spectral.has_bands();
        Emitter {
            schema: URN,
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
                components: COMPONENTS,
            }),
            vertex_flux: flux_lists(&model.surface.vertices).map(VertexFlux::new).collect(),
            triangle_flux: flux_lists(&model.surface.triangles).map(TriangleFlux::new).collect(),
            triangle_stage: Stages { labels: STAGES, values: StageCodes(&model.hull.labels) },
            zones: model.goniograms.zones.iter().map(ZoneFacts::new).collect(),
            zone_weights: ZoneWeights {
                zones_attribute: ZONES,
                weights_attribute: WEIGHTS,
                meaning: "a vertex mixes the distributions of up to four zones by weights that sum to 1; at a point of a \
                          triangle the mixtures of its corners mix by their barycentric coordinates",
            },
            volume: model.volume.as_ref().map(VolumeFacts::new),
            goniograms: goniograms::NAME,
            provenance: Provenance::new(model, options),
        }
    }
}

/// Column-major, as glTF writes matrices: source (x, y, z) mm = 1000 (X, -Z, Y) of glTF metres.
const GLTF_TO_SOURCE_MM: [f64; 16] =
    [1000.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1000.0, 0.0, 0.0, -1000.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];

/// Spectral flux of the vertices.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct VertexSpectra<'a> {
    /// What the numbers are.
    quantity: &'static str,
    /// Their unit.
    #[schemars(extend("const" = "W/nm"))]
    unit: &'static str,
    /// Number of vertices, of bands.
    #[schemars(inner(range(min = 1)))]
    shape: [usize; 2],
    /// One list of bands for each vertex.
    #[schemars(extend("const" = "vertex-major"))]
    layout: &'static str,
    /// Names of the glTF attributes, one per band; they win over values. Null where spectra are no attributes.
    #[schemars(inner(regex(pattern = "^_SPECTRUM_[0-9]{3,}$")))]
    attributes: Option<Vec<String>>,
    /// W/nm of one unit of values; null without values.
    #[schemars(extend("exclusiveMinimum" = 0))]
    scale: Option<f64>,
    /// [vertex][band], whole numbers; null where they are in attributes only.
    #[schemars(with = "Option<Vec<Vec<u64>>>")]
    values: Option<Quantised<'a>>,
    /// Why values is null.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "String")]
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

/// Tristimulus flux of the vertices.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct VertexTristimulus {
    /// What the numbers are.
    quantity: &'static str,
    /// Their unit.
    #[schemars(extend("const" = "lm"))]
    unit: &'static str,
    /// The glTF attribute that holds them.
    #[schemars(extend("const" = XYZ_LM))]
    attribute: &'static str,
    /// Its components, in order.
    #[schemars(extend("const" = COMPONENTS))]
    components: [&'static str; 3],
}

const COMPONENTS: [&str; 3] = ["X", "Y", "Z"];

/// Flux of the vertices, W or lm.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct VertexFlux<'a> {
    /// Which flux.
    #[schemars(extend("enum" = [RADIANT.0, LUMINOUS.0]))]
    quantity: &'static str,
    /// Unit of the values.
    #[schemars(extend("enum" = [RADIANT.1, LUMINOUS.1]))]
    unit: &'static str,
    /// The glTF attribute that holds the same.
    #[schemars(extend("enum" = [FLUX_W, FLUX_LM]))]
    attribute: &'static str,
    /// One number per vertex.
    #[schemars(with = "Vec<f64>", inner(range(min = 0)))]
    values: Numbers<'a>,
}

/// Flux of the triangles, W or lm.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct TriangleFlux<'a> {
    /// Which flux.
    #[schemars(extend("enum" = [RADIANT.0, LUMINOUS.0]))]
    quantity: &'static str,
    /// Unit of the values.
    #[schemars(extend("enum" = [RADIANT.1, LUMINOUS.1]))]
    unit: &'static str,
    /// One number per triangle.
    #[schemars(with = "Vec<f64>", inner(range(min = 0)))]
    values: Numbers<'a>,
}

/// A flux by name and unit, and the attribute of the vertices'.
type Named = (&'static str, &'static str, &'static str);
const RADIANT: Named = ("radiant flux", "W", FLUX_W);
const LUMINOUS: Named = ("luminous flux", "lm", FLUX_LM);

/// The fluxes that are known.
fn flux_lists(amounts: &Amounts) -> impl Iterator<Item = (Named, Numbers<'_>)> {
    let known = [(RADIANT, &amounts.radiant_w), (LUMINOUS, &amounts.luminous_lm)];
    known.into_iter().filter_map(|(named, values)| Some((named, Numbers(values.as_ref()?, SUM_DIGITS))))
}

impl<'a> VertexFlux<'a> {
    fn new(((quantity, unit, attribute), values): (Named, Numbers<'a>)) -> VertexFlux<'a> {
        VertexFlux { quantity, unit, attribute, values }
    }
}

impl<'a> TriangleFlux<'a> {
    fn new(((quantity, unit, _), values): (Named, Numbers<'a>)) -> TriangleFlux<'a> {
        TriangleFlux { quantity, unit, values }
    }
}

/// The steps of the hull that make triangles.
const STAGES: [&str; 3] = ["projected", "stitched", "filled"];

/// Which step of the hull made each triangle.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct Stages<'a> {
    /// The steps.
    #[schemars(extend("const" = STAGES))]
    labels: [&'static str; 3],
    /// Index into labels, one per triangle.
    #[schemars(with = "Vec<u8>", inner(range(max = 2)))]
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

/// A zone.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct ZoneFacts {
    /// Its index in zones; what the attribute _ZONES holds.
    id: u32,
    /// Its row in the lattice, counted from 0 along photometric y; null where zones follow the surface.
    row: Option<usize>,
    /// Its column in the lattice, counted from 0 along photometric x; null where zones follow the surface.
    column: Option<usize>,
    /// Box of its vertices.
    bounds_mm: Box3,
}

impl ZoneFacts {
    fn new(zone: &Zone) -> ZoneFacts {
        ZoneFacts {
            id: zone.id,
            row: zone.place.map(|place| place.row),
            column: zone.place.map(|place| place.column),
            bounds_mm: Box3::new(&zone.bounds_mm),
        }
    }
}

/// How vertices belong to zones.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct ZoneWeights {
    /// The glTF attribute with the ids of the zones of each vertex, four floats; places that are not used repeat the first zone.
    #[schemars(extend("const" = ZONES))]
    zones_attribute: &'static str,
    /// The glTF attribute with the weights of those zones, four floats.
    #[schemars(extend("const" = WEIGHTS))]
    weights_attribute: &'static str,
    /// The rule in words.
    meaning: &'static str,
}

/// The nodes of a regular lattice, which are the points of the second primitive: flux_n of each as in the surface's attributes.
#[derive(Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
struct VolumeFacts {
    /// Index of the primitive of the mesh whose points are the nodes.
    #[schemars(extend("const" = 1))]
    primitive: usize,
    /// How fluxes of nodes become emission coefficients.
    coefficient: &'static str,
    /// How these and the total goniogram become radiance.
    radiance: &'static str,
    /// The glTF attribute with the volume V_n that each node stands for: an eighth of each lit cell round it, mm3.
    #[schemars(extend("const" = VOLUME_MM3))]
    volumes_attribute: &'static str,
    /// Least corner of the lattice, source frame, mm.
    min_mm: [f64; 3],
    /// Edges of a cell, mm.
    #[schemars(inner(range(min = 0)))]
    pitch_mm: [f64; 3],
    /// Cells along x, y and z of the source frame.
    #[schemars(inner(range(min = 1)))]
    cells: [usize; 3],
    /// Lengths of the runs of cells that are dark, lit, dark and so on, x counted first, then y, then z; they sum to all cells. Nodes are the
    /// corners of lit cells in the same order.
    lit_runs: Vec<usize>,
}

impl VolumeFacts {
    fn new(volume: &Volume) -> VolumeFacts {
        let lattice = &volume.lattice;
        let runs = lattice.is_lit.chunk_by(|a, b| a == b);
        let begins_lit = lattice.is_lit.first() == Some(&true);
        let lit_runs = begins_lit.then_some(0).into_iter().chain(runs.map(<[bool]>::len)).collect();
        VolumeFacts {
            primitive: 1,
            coefficient: "j_n = flux_n / V_n per mm3 into all directions; trilinear between the corners of each lit cell, 0 in dark cells",
            radiance: "L(x, w, lambda) = q(w; lambda) times the integral of j(s, lambda) ds along the line through x in direction w, \
                       s in mm, q the total goniogram divided by its integral over the sphere",
            volumes_attribute: VOLUME_MM3,
            min_mm: lattice.min_mm.to_array(),
            pitch_mm: lattice.pitch_mm.to_array(),
            cells: lattice.cells,
            lit_runs,
        }
    }
}
