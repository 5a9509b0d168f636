//! The JSON of a glTF 2.0 file, as far as ours needs it.

use super::emitter::Emitter;
use serde::Serialize;
use std::collections::BTreeMap;

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document<'a> {
    pub(super) asset: Asset,
    pub(super) extensions_used: Vec<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) extensions: Option<RootExtensions>,
    pub(super) scene: usize,
    pub(super) scenes: [Scene; 1],
    pub(super) nodes: Vec<Node>,
    pub(super) materials: [Material; 1],
    pub(super) meshes: [Mesh<'a>; 1],
    pub(super) buffers: [BufferEntry; 1],
    pub(super) buffer_views: Vec<View>,
    pub(super) accessors: Vec<Accessor>,
}

#[derive(Serialize)]
pub(super) struct Asset {
    pub(super) version: &'static str,
    pub(super) generator: String,
}

#[derive(Serialize)]
pub(super) struct Scene {
    pub(super) name: &'static str,
    pub(super) nodes: Vec<usize>,
}

#[derive(Default, Serialize)]
pub(super) struct Node {
    pub(super) name: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) mesh: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) rotation: Option<[f64; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) translation: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) extensions: Option<NodeExtensions>,
}

/// The name of the extension for lights with IES files.
pub(super) const LIGHTS_IES: &str = "EXT_lights_ies";

#[derive(Serialize)]
pub(super) struct RootExtensions {
    #[serde(rename = "EXT_lights_ies")]
    pub(super) lights_ies: Lights,
}

#[derive(Serialize)]
pub(super) struct Lights {
    pub(super) lights: [Light; 1],
}

/// An IES file within this one.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Light {
    pub(super) name: &'static str,
    pub(super) buffer_view: usize,
    pub(super) mime_type: &'static str,
}

#[derive(Serialize)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_lights_ies")]
    pub(super) lights_ies: LightOfNode,
}

#[derive(Serialize)]
pub(super) struct LightOfNode {
    pub(super) light: usize,
}

#[derive(Serialize)]
pub(super) struct Mesh<'a> {
    pub(super) name: &'static str,
    pub(super) primitives: Vec<Primitive>,
    pub(super) extras: Extras<'a>,
}

/// On the mesh, not on the primitive: Blender and trimesh lose the latter.
#[derive(Serialize)]
pub(super) struct Extras<'a> {
    pub(super) emitter: Emitter<'a>,
}

#[derive(Serialize)]
pub(super) struct Primitive {
    pub(super) attributes: BTreeMap<String, usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) indices: Option<usize>,
    pub(super) material: usize,
    pub(super) mode: u32,
}

/// Unlit: COLOR_0 is the light itself, and glTF has no emission per vertex. Double-sided: hulls may have holes.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Material {
    pub(super) name: &'static str,
    pub(super) double_sided: bool,
    pub(super) pbr_metallic_roughness: Pbr,
    pub(super) extensions: MaterialExtensions,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Pbr {
    pub(super) metallic_factor: f64,
    pub(super) roughness_factor: f64,
}

#[derive(Serialize)]
pub(super) struct MaterialExtensions {
    #[serde(rename = "KHR_materials_unlit")]
    pub(super) unlit: BTreeMap<(), ()>,
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
pub(super) struct BufferEntry {
    pub(super) byte_length: usize,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct View {
    pub(super) buffer: usize,
    pub(super) byte_offset: usize,
    pub(super) byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) byte_stride: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) target: Option<u32>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: usize,
    pub(super) byte_offset: usize,
    pub(super) component_type: u32,
    pub(super) count: usize,
    #[serde(rename = "type")]
    pub(super) kind: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) min: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) max: Option<[f64; 3]>,
}

impl Accessor {
    /// Of floats, from the start of a view.
    pub(super) fn new(buffer_view: usize, kind: &'static str, count: usize) -> Accessor {
        Accessor { buffer_view, byte_offset: 0, component_type: FLOAT, count, kind, min: None, max: None }
    }
}

/// Component type of 32-bit floats.
pub(super) const FLOAT: u32 = 5126;
