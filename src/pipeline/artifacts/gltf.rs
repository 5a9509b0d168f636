//! `emitter.glb`: the surface half of the contract (`openapi/README.md`, `OUTPUTS.md` 3).
//!
//! glTF 2.0 binary. Metres, Y up: (x, z, -y)/1000 is a rotation, so winding and normals keep. Spectra are `_SPECTRUM_nnn`
//! attributes, band-major in one view; attributes are named, never numbered, because accessor indices do not survive a re-save.

use super::super::model::Model;
use super::super::rays::source::Columns;
use super::super::{Error, Options as RunOptions};
use super::emitter::{self, Emitter};
use super::exitance::{Colors, colors};
use super::{Artifact, provenance};
use glam::DVec3;
use serde::Serialize;
use std::collections::BTreeMap;

/// Name in the zip.
pub const NAME: &str = "emitter.glb";

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// The file.
///
/// # Errors
/// [`Error::Refused`] above 4 GiB, glTF binary's own limit; as [`super::json::document`].
pub fn artifact(model: &Model, options: &RunOptions) -> Result<Artifact, Error> {
    let colors = colors(model);
    let mut buffer = Buffer::default();
    let indices = buffer.indices(&model.hull.triangles);
    let attributes = attributes(model, &colors, &mut buffer, emitter::in_attributes(model, options));
    let document = Document {
        asset: Asset { version: "2.0", generator: provenance::generator() },
        extensions_used: ["KHR_materials_unlit"],
        scene: 0,
        scenes: [Scene { name: "emitter", nodes: [0] }],
        nodes: [Node { name: "emitter", mesh: 0 }],
        materials: [Material::default()],
        meshes: [Mesh {
            name: "emitter",
            primitives: [Primitive { attributes, indices, material: 0, mode: 4 }],
            extras: Extras { emitter: Emitter::new(model, options, &colors) },
        }],
        buffers: [BufferEntry { byte_length: buffer.bytes.len() }],
        buffer_views: buffer.views,
        accessors: buffer.accessors,
    };
    let json = serde_json::to_vec(&document).map_err(std::io::Error::from)?;
    Ok(Artifact { name: NAME.to_owned(), media_type: "model/gltf-binary", bytes: container(json, buffer.bytes)? })
}

/// glTF metres, Y up, of source millimetres.
pub fn gltf_from_source(vector: DVec3) -> DVec3 {
    DVec3::new(vector.x, vector.z, -vector.y)
}

fn attributes(
    model: &Model,
    colors: &Colors,
    buffer: &mut Buffer,
    spectra_in_attributes: bool,
) -> BTreeMap<String, usize> {
    let vertices = &model.surface.vertices;
    let vector = |v: DVec3| gltf_from_source(v).to_array().map(|component| component as f32);
    let mut attributes = BTreeMap::new();
    let mut put = |name: &str, accessor: usize| attributes.insert(name.to_owned(), accessor);
    put("POSITION", buffer.positions(model.hull.vertices_mm.iter().map(|vertex| vector(*vertex * 1e-3))));
    put("NORMAL", buffer.vectors(model.hull.vertex_normals().into_iter().map(vector)));
    put("COLOR_0", buffer.vectors(colors.linear_srgb.iter().copied()));
    if let Some(flux) = &vertices.radiant_w {
        put(emitter::FLUX_W, buffer.scalars(flux.iter().map(|flux| *flux as f32)));
    }
    if let Some(flux) = &vertices.luminous_lm {
        put(emitter::FLUX_LM, buffer.scalars(flux.iter().map(|flux| *flux as f32)));
    }
    if model.spectral.columns == Columns::Tristimulus {
        let xyz = |vertex| {
            let columns = vertices.columns_of(vertex);
            [columns[0] as f32, columns[1] as f32, columns[2] as f32]
        };
        put(emitter::XYZ_LM, buffer.vectors((0..vertices.len()).map(xyz)));
    }
    // Custom attributes may not be unsigned int; floats are exact up to 2^24 zones.
    put(emitter::ZONE, buffer.scalars(model.goniograms.zone_of_vertex.iter().map(|zone| *zone as f32)));
    if spectra_in_attributes {
        let bands = model.spectral.bands.len();
        let spectra: Vec<f32> = (0..vertices.len())
            .flat_map(|vertex| model.vertex_spectrum_w_per_nm(vertex))
            .map(|density| density as f32)
            .collect();
        for (band, accessor) in buffer.bands(&spectra, bands).into_iter().enumerate() {
            attributes.insert(emitter::spectrum_attribute(band), accessor);
        }
    }
    attributes
}

/// The binary chunk and what lies where in it.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<View>,
    accessors: Vec<Accessor>,
}

impl Buffer {
    fn indices(&mut self, triangles: &[[u32; 3]]) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(triangles.iter().flatten().flat_map(|index| index.to_le_bytes()));
        let view = self.view(start, ELEMENT_ARRAY_BUFFER, None);
        self.accessor(Accessor { component_type: UNSIGNED_INT, ..Accessor::new(view, "SCALAR", 3 * triangles.len()) })
    }

    fn positions(&mut self, positions: impl Iterator<Item = [f32; 3]> + Clone) -> usize {
        let mut min = [f32::INFINITY; 3];
        let mut max = [f32::NEG_INFINITY; 3];
        for position in positions.clone() {
            for k in 0..3 {
                min[k] = min[k].min(position[k]);
                max[k] = max[k].max(position[k]);
            }
        }
        let accessor = self.vectors(positions);
        if let Some(accessor) = self.accessors.get_mut(accessor) {
            // Exact in f64: readers compare the text with the floats in the buffer.
            (accessor.min, accessor.max) = (Some(min.map(f64::from)), Some(max.map(f64::from)));
        }
        accessor
    }

    fn vectors(&mut self, vectors: impl Iterator<Item = [f32; 3]>) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(vectors.flatten().flat_map(f32::to_le_bytes));
        let view = self.view(start, ARRAY_BUFFER, None);
        self.accessor(Accessor::new(view, "VEC3", (self.bytes.len() - start) / 12))
    }

    fn scalars(&mut self, scalars: impl Iterator<Item = f32>) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(scalars.flat_map(f32::to_le_bytes));
        let view = self.view(start, ARRAY_BUFFER, None);
        self.accessor(Accessor::new(view, "SCALAR", (self.bytes.len() - start) / 4))
    }

    /// Vertex-major `values` as one scalar accessor per band. They share a view, which then must state its stride.
    fn bands(&mut self, values: &[f32], bands: usize) -> Vec<usize> {
        let start = self.bytes.len();
        for band in 0..bands {
            self.bytes.extend(values.iter().skip(band).step_by(bands).flat_map(|value| value.to_le_bytes()));
        }
        let view = self.view(start, ARRAY_BUFFER, Some(4));
        let count = values.len() / bands.max(1);
        (0..bands)
            .map(|band| {
                let byte_offset = 4 * count * band;
                self.accessor(Accessor { byte_offset, ..Accessor::new(view, "SCALAR", count) })
            })
            .collect()
    }

    fn view(&mut self, start: usize, target: u32, byte_stride: Option<usize>) -> usize {
        let byte_length = self.bytes.len() - start;
        self.views.push(View { buffer: 0, byte_offset: start, byte_length, byte_stride, target });
        self.views.len() - 1
    }

    fn accessor(&mut self, accessor: Accessor) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

/// Header, JSON chunk padded with blanks, binary chunk (a multiple of four by construction).
fn container(mut json: Vec<u8>, binary: Vec<u8>) -> Result<Vec<u8>, Error> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = 12 + 8 + json.len() + 8 + binary.len();
    let Ok(whole) = u32::try_from(length) else {
        return Err(Error::refused(
            "artifacts.glb_too_large",
            format!("emitter.glb would have {length} bytes; its format ends at 4 GiB."),
            "Choose a lower hull resolution or wider spectral bands.",
        ));
    };
    let mut bytes = Vec::with_capacity(length);
    for (part, kind) in [(json, *b"JSON"), (binary, *b"BIN\0")] {
        if bytes.is_empty() {
            bytes.extend(b"glTF");
            bytes.extend(2_u32.to_le_bytes());
            bytes.extend(whole.to_le_bytes());
        }
        bytes.extend((part.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(part);
    }
    Ok(bytes)
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Document<'a> {
    asset: Asset,
    extensions_used: [&'static str; 1],
    scene: usize,
    scenes: [Scene; 1],
    nodes: [Node; 1],
    materials: [Material; 1],
    meshes: [Mesh<'a>; 1],
    buffers: [BufferEntry; 1],
    buffer_views: Vec<View>,
    accessors: Vec<Accessor>,
}

#[derive(Serialize)]
struct Asset {
    version: &'static str,
    generator: String,
}

#[derive(Serialize)]
struct Scene {
    name: &'static str,
    nodes: [usize; 1],
}

#[derive(Serialize)]
struct Node {
    name: &'static str,
    mesh: usize,
}

#[derive(Serialize)]
struct Mesh<'a> {
    name: &'static str,
    primitives: [Primitive; 1],
    extras: Extras<'a>,
}

/// On the mesh, not on the primitive: Blender and trimesh lose the latter.
#[derive(Serialize)]
struct Extras<'a> {
    emitter: Emitter<'a>,
}

#[derive(Serialize)]
struct Primitive {
    attributes: BTreeMap<String, usize>,
    indices: usize,
    material: usize,
    mode: u32,
}

/// Unlit: COLOR_0 is the light itself, and glTF has no emission per vertex. Double-sided: hulls may have holes.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Material {
    name: &'static str,
    double_sided: bool,
    pbr_metallic_roughness: Pbr,
    extensions: MaterialExtensions,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Pbr {
    metallic_factor: f64,
    roughness_factor: f64,
}

#[derive(Serialize)]
struct MaterialExtensions {
    #[serde(rename = "KHR_materials_unlit")]
    unlit: BTreeMap<(), ()>,
}

impl Default for Material {
    fn default() -> Material {
        Material {
            name: "exitance",
            double_sided: true,
            pbr_metallic_roughness: Pbr { metallic_factor: 0.0, roughness_factor: 1.0 },
            extensions: MaterialExtensions { unlit: BTreeMap::new() },
        }
    }
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct BufferEntry {
    byte_length: usize,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct View {
    buffer: usize,
    byte_offset: usize,
    byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    byte_stride: Option<usize>,
    target: u32,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: usize,
    byte_offset: usize,
    component_type: u32,
    count: usize,
    #[serde(rename = "type")]
    kind: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    min: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    max: Option<[f64; 3]>,
}

impl Accessor {
    fn new(buffer_view: usize, kind: &'static str, count: usize) -> Accessor {
        Accessor { buffer_view, byte_offset: 0, component_type: FLOAT, count, kind, min: None, max: None }
    }
}
