//! The container of `emitter.glb`, its JSON as far as it is needed, and the numbers that its accessors name.

use crate::artifacts::gltf::emitter;
use crate::error::Error;
use crate::vocabulary::space::{Axis, Frame};
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;

/// What to do about a file that cannot be a model's.
pub const AGAIN: &str = "Take emitter.glb and goniograms.json of one model again, as Lampwright wrote them.";
/// Component types of accessors.
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;
/// Bytes of the header, and of what stands before a chunk.
const HEADER: usize = 12;
const CHUNK: usize = 8;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Document {
    #[serde(default)]
    meshes: Vec<MeshEntry>,
    #[serde(default)]
    accessors: Vec<Accessor>,
    #[serde(default)]
    buffer_views: Vec<View>,
}

#[derive(Deserialize)]
struct MeshEntry {
    primitives: Vec<Primitive>,
    #[serde(default)]
    extras: Option<Extras>,
}

#[derive(Deserialize)]
struct Extras {
    emitter: Option<Emitter>,
}

/// A primitive of the mesh: the triangles, or the nodes of a volume.
#[derive(Deserialize)]
pub struct Primitive {
    attributes: BTreeMap<String, usize>,
    indices: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    count: usize,
    #[serde(rename = "type")]
    kind: String,
    sparse: Option<IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

/// `meshes[0].extras.emitter`, as far as it is needed.
#[derive(Deserialize)]
pub struct Emitter {
    schema: String,
    /// The photometric frame.
    pub frame: Axes,
    /// The bands of every spectral number.
    pub spectrum: Option<Edges>,
    /// Spectra of the vertices.
    pub vertex_spectra: Option<VertexSpectra>,
    /// There where the rays were tristimulus.
    pub vertex_tristimulus: Option<IgnoredAny>,
    /// The lattice of a volume.
    pub volume: Option<Lattice>,
}

/// The axes that fix the photometric frame.
#[derive(Clone, Copy, Deserialize)]
pub struct Axes {
    nadir: Axis,
    c0: Axis,
}

impl Axes {
    /// The frame.
    pub fn frame(self) -> Frame {
        Frame { nadir: self.nadir, c0: self.c0 }
    }
}

/// Edges of the bands.
#[derive(Deserialize)]
pub struct Edges {
    /// nm, increasing.
    pub band_edges_nm: Vec<f64>,
}

/// Spectra of the vertices as numbers in the JSON, where they are no attributes.
#[derive(Deserialize)]
pub struct VertexSpectra {
    /// W/nm of one unit.
    pub scale: Option<f64>,
    /// `[vertex][band]`.
    pub values: Option<Vec<Vec<f64>>>,
}

/// The lattice of a volume.
#[derive(Deserialize)]
pub struct Lattice {
    /// Which primitive has its nodes.
    pub primitive: usize,
    /// Least corner, mm.
    pub min_mm: [f64; 3],
    /// Edges of a cell, mm.
    pub pitch_mm: [f64; 3],
    /// Cells along x, y and z.
    pub cells: [usize; 3],
    /// Lengths of the runs of dark, lit, dark … cells.
    pub lit_runs: Vec<usize>,
}

/// The file, taken apart.
pub struct Glb<'a> {
    document: Document,
    binary: &'a [u8],
}

fn not_glb(why: &str) -> Error {
    Error::malformed("model.not_glb", format!("emitter.glb is no binary glTF 2.0 file: {why}."), AGAIN)
}

fn damaged(why: String) -> Error {
    Error::malformed("model.damaged", format!("emitter.glb is damaged: {why}."), AGAIN)
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?))
}

/// The chunk at `at`: its kind and its bytes.
fn chunk(bytes: &[u8], at: usize) -> Option<([u8; 4], &[u8])> {
    let length = word(bytes, at)? as usize;
    let kind = word(bytes, at + 4)?.to_le_bytes();
    Some((kind, bytes.get(at + CHUNK..(at + CHUNK).checked_add(length)?)?))
}

/// The JSON of a file; `None` where there is none.
pub fn json_chunk(bytes: &[u8]) -> Option<&[u8]> {
    chunk(bytes, HEADER).filter(|(kind, _)| kind == b"JSON").map(|(_, json)| json)
}

impl<'a> Glb<'a> {
    /// Takes a file apart.
    ///
    /// # Errors
    /// [`Error::Malformed`]; [`Error::Refused`] for another schema.
    pub fn parse(bytes: &'a [u8]) -> Result<Glb<'a>, Error> {
        if bytes.get(..4) != Some(b"glTF") || word(bytes, 4) != Some(2) {
            return Err(not_glb("its first bytes are others"));
        }
        if word(bytes, 8).map(|length| length as usize) != Some(bytes.len()) {
            return Err(not_glb("it does not have the length that it announces"));
        }
        let Some(json) = json_chunk(bytes) else {
            return Err(not_glb("its first chunk is not JSON"));
        };
        let binary = chunk(bytes, HEADER + CHUNK + json.len()).filter(|(kind, _)| kind == b"BIN\0");
        let Some((_, binary)) = binary else { return Err(not_glb("it has no binary chunk")) };
        let document: Document = serde_json::from_slice(json).map_err(|error| damaged(error.to_string()))?;
        let glb = Glb { document, binary };
        let schema = &glb.emitter()?.schema;
        if schema == emitter::URN {
            return Ok(glb);
        }
        let found = format!("emitter.glb follows another schema than {}.", emitter::URN);
        Err(Error::refused("model.version", found, "Build the model again with this version of lampwright."))
    }

    /// What its attributes mean.
    ///
    /// # Errors
    /// [`Error::Malformed`] where it does not say.
    pub fn emitter(&self) -> Result<&Emitter, Error> {
        let extras = self.document.meshes.first().and_then(|mesh| mesh.extras.as_ref());
        extras
            .and_then(|extras| extras.emitter.as_ref())
            .ok_or_else(|| damaged("meshes[0].extras.emitter is missing".to_owned()))
    }

    /// A primitive of the one mesh.
    ///
    /// # Errors
    /// [`Error::Malformed`] where there is none.
    pub fn primitive(&self, index: usize) -> Result<&Primitive, Error> {
        let mesh = self.document.meshes.first();
        mesh.and_then(|mesh| mesh.primitives.get(index))
            .ok_or_else(|| damaged(format!("meshes[0].primitives[{index}] is missing")))
    }

    /// An accessor, the bytes of its view from its start on, and the distance from element to element.
    fn accessor(&self, index: usize, bytes: usize) -> Result<(&Accessor, &'a [u8], usize), Error> {
        let wrong = || damaged(format!("accessor {index} names what the file does not hold"));
        let accessor = self.document.accessors.get(index).ok_or_else(wrong)?;
        let view = accessor.buffer_view.and_then(|view| self.document.buffer_views.get(view)).ok_or_else(wrong)?;
        let end = view.byte_offset.checked_add(view.byte_length).ok_or_else(wrong)?;
        let within = self.binary.get(view.byte_offset..end).and_then(|view| view.get(accessor.byte_offset..));
        let within = within.filter(|_| view.buffer == 0 && accessor.sparse.is_none()).ok_or_else(wrong)?;
        let stride = view.byte_stride.unwrap_or(bytes);
        let last = accessor.count.checked_sub(1).and_then(|before| before.checked_mul(stride));
        let length = last.and_then(|last| last.checked_add(bytes)).filter(|_| stride >= bytes).ok_or_else(wrong)?;
        if length > within.len() {
            return Err(wrong());
        }
        Ok((accessor, within, stride))
    }

    /// The rows of an attribute of `N` floats; `None` where the primitive does not have it.
    ///
    /// # Errors
    /// [`Error::Malformed`] where it is something else, or a number is not finite.
    pub fn rows<const N: usize>(&self, primitive: &Primitive, name: &str) -> Result<Option<Vec<[f64; N]>>, Error> {
        let Some(index) = primitive.attributes.get(name) else { return Ok(None) };
        let (accessor, bytes, stride) = self.accessor(*index, 4 * N)?;
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"].get(N - 1);
        if accessor.component_type != FLOAT || kind != Some(&accessor.kind.as_str()) {
            return Err(damaged(format!("the attribute {name} does not have {N} floats a place")));
        }
        let number = |at: usize| word(bytes, at).map_or(f32::NAN, f32::from_bits);
        let row = |at: usize| -> [f64; N] { std::array::from_fn(|k| f64::from(number(at * stride + 4 * k))) };
        let rows: Vec<[f64; N]> = (0..accessor.count).map(row).collect();
        match rows.iter().position(|row| row.iter().any(|number| !number.is_finite())) {
            Some(place) => Err(damaged(format!("{name} of place {place} is no finite number"))),
            None => Ok(Some(rows)),
        }
    }

    /// Three indices for each triangle.
    ///
    /// # Errors
    /// [`Error::Malformed`] where there are none, or not threes.
    pub fn triangles(&self, primitive: &Primitive) -> Result<Vec<[u32; 3]>, Error> {
        let index = primitive.indices.ok_or_else(|| damaged("the surface has no indices".to_owned()))?;
        let component = self.document.accessors.get(index).map_or(0, |accessor| accessor.component_type);
        let size = match component {
            UNSIGNED_BYTE => 1,
            UNSIGNED_SHORT => 2,
            UNSIGNED_INT => 4,
            _ => return Err(damaged("the indices of the surface are no whole numbers".to_owned())),
        };
        let (accessor, bytes, stride) = self.accessor(index, size)?;
        if accessor.kind != "SCALAR" || !accessor.count.is_multiple_of(3) {
            return Err(damaged("the indices of the surface are not three for each triangle".to_owned()));
        }
        let number = |at: usize| {
            let bytes = bytes.get(at * stride..at * stride + size).unwrap_or_default();
            bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte))
        };
        Ok((0..accessor.count / 3).map(|triangle| [0, 1, 2].map(|corner| number(3 * triangle + corner))).collect())
    }
}
