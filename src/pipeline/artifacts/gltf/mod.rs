//! `emitter.glb`: the surface half of the contract (`openapi/README.md`).
//!
//! glTF 2.0 binary. Metres, Y up: (x, z, -y)/1000 is a rotation, so winding and normals keep. Spectra are `_SPECTRUM_nnn`
//! attributes, band-major in one view; attributes are named, never numbered, because accessor indices do not survive a re-save.

/// The axes of glTF.
mod axes;
/// The binary chunk.
mod buffer;
/// The JSON chunk.
mod document;
/// What the attributes mean: `meshes[0].extras.emitter`.
pub mod emitter;
/// The far field as a point light: `EXT_lights_ies`.
mod point_light;

use super::exitance::{Colors, colors, colors_of};
use super::provenance;
use crate::error::Error;
use crate::flux::Amounts;
use crate::model::Model;
use crate::options::Options as RunOptions;
use crate::source::Columns;
use crate::volume::Volume;
use crate::writing::Artifact;
use crate::writing::json::unwritten;
use axes::gltf_from_source;
use buffer::Buffer;
use document::{Asset, BufferEntry, Document, Extras, LIGHTS_IES, Material, Mesh, Node, Primitive, Scene};
use emitter::Emitter;
use glam::DVec3;
use point_light::PointLight;
use std::collections::BTreeMap;

/// Name in the zip.
pub const NAME: &str = "emitter.glb";
/// Modes of primitives.
const POINTS: u32 = 0;
const TRIANGLES: u32 = 4;

/// The file.
///
/// # Errors
/// [`Error::Refused`] above 4 GiB, glTF binary's own limit; as [`crate::writing::json::document`].
pub fn artifact(model: &Model, options: &RunOptions) -> Result<Artifact, Error> {
    let colors = colors(model);
    let mut buffer = Buffer::default();
    let indices = buffer.indices(&model.hull.triangles);
    let has_spectra = emitter::in_attributes(model, options);
    let attributes = attributes(model, &colors, &mut buffer, has_spectra);
    let surface = Primitive { attributes, indices: Some(indices), material: 0, mode: TRIANGLES };
    let points = model.volume.as_ref().map(|volume| Primitive {
        attributes: volume_attributes(model, volume, &mut buffer),
        indices: None,
        material: 0,
        mode: POINTS,
    });
    let light = PointLight::of(model, options, &mut buffer);
    let surface_node = Node { name: "emitter", mesh: Some(0), ..Node::default() };
    let (extensions, light_node) = light.map(|light| (light.extensions, light.node)).unzip();
    let nodes: Vec<Node> = std::iter::once(surface_node).chain(light_node).collect();
    let document = Document {
        asset: Asset { version: "2.0", generator: provenance::generator() },
        extensions_used: std::iter::once("KHR_materials_unlit")
            .chain(extensions.as_ref().map(|_| LIGHTS_IES))
            .collect(),
        extensions,
        scene: 0,
        scenes: [Scene { name: "emitter", nodes: (0..nodes.len()).collect() }],
        nodes,
        materials: [Material::default()],
        meshes: [Mesh {
            name: "emitter",
            primitives: std::iter::once(surface).chain(points).collect(),
            extras: Extras { emitter: Emitter::new(model, options, &colors) },
        }],
        buffers: [BufferEntry { byte_length: buffer.bytes.len() }],
        buffer_views: buffer.views,
        accessors: buffer.accessors,
    };
    let json = serde_json::to_vec(&document).map_err(unwritten)?;
    Ok(Artifact { name: NAME.to_owned(), media_type: "model/gltf-binary", bytes: container(json, buffer.bytes)? })
}

/// Attributes by name, each the index of its accessor.
type Attributes = BTreeMap<String, usize>;

fn vector(v: DVec3) -> [f32; 3] {
    gltf_from_source(v).to_array().map(|component| component as f32)
}

/// Of the vertices of the surface.
fn attributes(model: &Model, colors: &Colors, buffer: &mut Buffer, has_spectra: bool) -> Attributes {
    let points_mm = &model.hull.vertices_mm;
    let mut attributes = light(model, points_mm, &model.surface.vertices, colors, buffer, has_spectra);
    let mut put = |name: &str, accessor: usize| attributes.insert(name.to_owned(), accessor);
    put("NORMAL", buffer.vectors(model.hull.vertex_normals().into_iter().map(vector)));
    // Custom attributes may not be unsigned int; floats are exact up to 2^24 zones.
    let mixtures = &model.goniograms.mixtures;
    put(emitter::ZONES, buffer.quadruples(mixtures.iter().map(|mixture| mixture.zones.map(|zone| zone as f32))));
    put(
        emitter::WEIGHTS,
        buffer.quadruples(mixtures.iter().map(|mixture| mixture.weights.map(|weight| weight as f32))),
    );
    attributes
}

/// Of the nodes of a volume.
fn volume_attributes(model: &Model, volume: &Volume, buffer: &mut Buffer) -> Attributes {
    // Their spectra stand nowhere else, whatever was asked for those of the surface.
    let has_spectra = model.spectral.has_bands();
    let colors = colors_of(model, &volume.nodes, &volume.volumes_mm3);
    let mut attributes = light(model, &volume.lattice.points_mm(), &volume.nodes, &colors, buffer, has_spectra);
    let volumes_mm3 = buffer.scalars(volume.volumes_mm3.iter().map(|mm3| *mm3 as f32));
    attributes.insert(emitter::VOLUME_MM3.to_owned(), volumes_mm3);
    attributes
}

/// Where sites are, and what light they send.
fn light(
    model: &Model,
    points_mm: &[DVec3],
    sites: &Amounts,
    colors: &Colors,
    buffer: &mut Buffer,
    has_spectra: bool,
) -> Attributes {
    let mut attributes = BTreeMap::new();
    let mut put = |name: &str, accessor: usize| attributes.insert(name.to_owned(), accessor);
    put("POSITION", buffer.positions(points_mm.iter().map(|point| vector(*point * 1e-3))));
    put("COLOR_0", buffer.vectors(colors.linear_srgb.iter().copied()));
    for (name, flux) in [(emitter::FLUX_W, &sites.radiant_w), (emitter::FLUX_LM, &sites.luminous_lm)] {
        if let Some(flux) = flux {
            put(name, buffer.scalars(flux.iter().map(|flux| *flux as f32)));
        }
    }
    if model.spectral.columns == Columns::Tristimulus {
        let xyz = |site| {
            let columns = sites.columns_of(site);
            [columns[0] as f32, columns[1] as f32, columns[2] as f32]
        };
        put(emitter::XYZ_LM, buffer.vectors((0..sites.len()).map(xyz)));
    }
    if has_spectra {
        let bands = model.spectral.bands.len();
        let spectra: Vec<f32> = (0..sites.len())
            .flat_map(|site| model.spectral.bands_w_per_nm(sites.columns_of(site)))
            .map(|density| density as f32)
            .collect();
        for (band, accessor) in buffer.bands(&spectra, bands).into_iter().enumerate() {
            attributes.insert(emitter::spectrum_attribute(band), accessor);
        }
    }
    attributes
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::fixture;
    use crate::options::Spectra;
    use ::gltf::accessor::{DataType, Iter};
    use ::gltf::{Gltf, Semantic};
    use serde_json::Value;

    fn read(model: &Model, spectra: Spectra) -> (Gltf, Value) {
        let mut options = RunOptions::default();
        options.artifacts.spectra = Some(spectra);
        let file = Gltf::from_slice(&artifact(model, &options).unwrap().bytes).unwrap();
        let extras = file.meshes().next().unwrap().extras().as_ref().unwrap().get().to_owned();
        let emitter = serde_json::from_str::<Value>(&extras).unwrap()["emitter"].clone();
        (file, emitter)
    }

    fn scalars(file: &Gltf, name: &str) -> Option<Vec<f32>> {
        let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
        let accessor = primitive.get(&Semantic::Extras(name.trim_start_matches('_').to_owned()))?;
        assert_eq!(accessor.data_type(), DataType::F32);
        Some(Iter::new(accessor, |_| file.blob.as_deref()).unwrap().collect())
    }

    fn quadruples(file: &Gltf, name: &str) -> Vec<[f32; 4]> {
        let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
        let accessor = primitive.get(&Semantic::Extras(name.trim_start_matches('_').to_owned())).unwrap();
        Iter::new(accessor, |_| file.blob.as_deref()).unwrap().collect()
    }

    #[test]
    fn a_foreign_reader_finds_every_value() {
        let model = fixture::model();
        let (file, emitter) = read(&model, Spectra::Auto);
        let mesh = file.meshes().next().unwrap();
        let primitive = mesh.primitives().next().unwrap();
        let reader = primitive.reader(|_| file.blob.as_deref());
        let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        for (position, vertex) in positions.iter().zip(&model.hull.vertices_mm) {
            assert_eq!(*position, [vertex.x * 1e-3, vertex.z * 1e-3, -vertex.y * 1e-3].map(|value| value as f32));
        }
        assert!(reader.read_normals().unwrap().all(|normal| normal == [0.0, 1.0, 0.0]), "+Z of the source is up");
        let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        assert_eq!(indices, model.hull.triangles.concat());
        let as_f32 = |values: &[f64]| values.iter().map(|value| *value as f32).collect::<Vec<f32>>();
        let vertices = &model.surface.vertices;
        assert_eq!(scalars(&file, "_FLUX_W").unwrap(), as_f32(vertices.radiant_w.as_ref().unwrap()));
        assert_eq!(scalars(&file, "_FLUX_LM").unwrap(), as_f32(vertices.luminous_lm.as_ref().unwrap()));
        let mixtures = &model.goniograms.mixtures;
        let zones: Vec<u32> = quadruples(&file, "_ZONES").into_iter().flatten().map(|zone| zone as u32).collect();
        assert_eq!(zones, mixtures.iter().flat_map(|mixture| mixture.zones).collect::<Vec<_>>());
        let weights: Vec<f32> = quadruples(&file, "_ZONE_WEIGHTS").concat();
        assert_eq!(weights, as_f32(&mixtures.iter().flat_map(|mixture| mixture.weights).collect::<Vec<f64>>()));
        assert!(primitive.material().double_sided());
        assert!(file.extensions_used().eq(["KHR_materials_unlit", "EXT_lights_ies"]));
        let scale = emitter["vertex_spectra"]["scale"].as_f64().unwrap();
        for band in 0..3 {
            let attribute = scalars(&file, &emitter::spectrum_attribute(band)).unwrap();
            for (vertex, value) in attribute.iter().enumerate() {
                let density = model.vertex_spectrum_w_per_nm(vertex)[band];
                assert_eq!(*value, density as f32);
                let inline = emitter["vertex_spectra"]["values"][vertex][band].as_i64().unwrap();
                assert!((inline as f64 * scale - density).abs() <= 0.500_001 * scale);
            }
        }
        let largest =
            emitter["vertex_spectra"]["values"].as_array().unwrap().iter().flat_map(|row| row.as_array().unwrap());
        let largest = largest.map(|value| value.as_i64().unwrap()).max().unwrap();
        assert!((10_000..=100_000).contains(&largest), "five digits: {largest}");
    }

    /// The nodes of two cells side by side are twelve points, in the order of the lattice.
    #[test]
    fn a_volume_is_a_primitive_of_points() {
        let model = fixture::with_volume();
        let volume = model.volume.as_ref().unwrap();
        let (file, emitter) = read(&model, Spectra::Auto);
        let points = file.meshes().next().unwrap().primitives().nth(1).unwrap();
        assert_eq!((points.mode(), points.indices().is_none()), (::gltf::mesh::Mode::Points, true));
        let positions: Vec<[f32; 3]> = points.reader(|_| file.blob.as_deref()).read_positions().unwrap().collect();
        assert_eq!(positions.len(), 12);
        for (position, node) in positions.iter().zip(volume.lattice.points_mm()) {
            assert_eq!(*position, [node.x * 1e-3, node.z * 1e-3, -node.y * 1e-3].map(|value| value as f32));
        }
        let values = |name: &str| -> Vec<f32> {
            let accessor = points.get(&Semantic::Extras(name.to_owned())).unwrap();
            Iter::new(accessor, |_| file.blob.as_deref()).unwrap().collect()
        };
        let flux_w: f32 = values("FLUX_W").iter().sum();
        assert!((f64::from(flux_w) / model.flux.radiant_w.unwrap() - 1.0).abs() < 1e-6);
        // An eighth of a cell of 1 mm³ at the ends, of two in the middle.
        assert!(values("VOLUME_MM3").iter().all(|mm3| [0.125, 0.25].contains(mm3)));
        assert_eq!(values("SPECTRUM_001").len(), 12);
        assert_eq!(emitter["volume"]["cells"], serde_json::json!([2, 1, 1]));
        assert_eq!(emitter["volume"]["lit_runs"], serde_json::json!([0, 2]));
        assert!(read(&fixture::model(), Spectra::Auto).1["volume"].is_null());
    }

    #[test]
    fn position_bounds_are_exactly_those_of_the_floats() {
        let mut model = fixture::model();
        model.hull.vertices_mm[3] = DVec3::new(0.1, -7.7, 1.0 / 3.0);
        let (file, _) = read(&model, Spectra::Auto);
        let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
        let positions: Vec<[f32; 3]> = primitive.reader(|_| file.blob.as_deref()).read_positions().unwrap().collect();
        let bounds = primitive.bounding_box();
        for k in 0..3 {
            assert_eq!(bounds.min[k], positions.iter().map(|position| position[k]).fold(f32::INFINITY, f32::min));
            assert_eq!(bounds.max[k], positions.iter().map(|position| position[k]).fold(f32::NEG_INFINITY, f32::max));
        }
    }

    #[test]
    fn spectra_go_where_they_were_asked_to() {
        let model = fixture::model();
        for (spectra, in_attributes, in_extras) in [
            (Spectra::Auto, true, true),
            (Spectra::Both, true, true),
            (Spectra::Attributes, true, false),
            (Spectra::Extras, false, true),
        ] {
            let (file, emitter) = read(&model, spectra);
            assert_eq!(scalars(&file, "_SPECTRUM_000").is_some(), in_attributes);
            assert_eq!(emitter["vertex_spectra"]["attributes"].is_array(), in_attributes);
            assert_eq!(emitter["vertex_spectra"]["values"].is_array(), in_extras);
            assert_eq!(emitter["vertex_spectra"]["values_absent_because"].is_string(), !in_extras);
        }
    }

    #[test]
    fn colors_are_the_exitance_in_linear_srgb() {
        // Left: mostly 450 nm; right: mostly 590 nm and, in lumens, brighter.
        let colors = colors(&fixture::model());
        let [left, right] = [colors.linear_srgb[0], colors.linear_srgb[8]];
        assert!(left[2] > left[0] && left[2] > left[1], "{left:?}");
        assert!(right[0] > right[1] && right[0] > right[2], "{right:?}");
        assert_eq!(colors.linear_srgb.iter().flatten().copied().fold(0.0, f32::max), 1.0);
        assert!(colors.linear_srgb.iter().flatten().all(|component| (0.0..=1.0).contains(component)));
    }

    #[test]
    fn without_a_spectrum_the_preview_is_grey_and_the_scale_is_lambertian() {
        let mut model = fixture::model();
        model.spectral.columns = Columns::None;
        let colors = colors(&model);
        assert!(colors.linear_srgb.iter().all(|[red, green, blue]| red == green && green == blue));
        // White is the brightest vertex: M / π, M in lm/m².
        let areas = model.hull.vertex_areas_mm2();
        let luminous = model.surface.vertices.luminous_lm.as_ref().unwrap();
        let brightest = luminous.iter().zip(&areas).map(|(lm, mm2)| lm / (mm2 * 1e-6)).fold(0.0, f64::max);
        let scale = colors.luminance_scale_cd_m2.unwrap();
        assert!((scale * std::f64::consts::PI / brightest - 1.0).abs() < 1e-12);
        model.surface.vertices.luminous_lm = None;
        assert_eq!(crate::artifacts::exitance::colors(&model).luminance_scale_cd_m2, None);
    }

    #[test]
    fn infrared_is_shown_in_grey_not_in_black() {
        let mut model = fixture::model();
        model.spectral.bands = crate::vocabulary::spectrum::Bands::new(vec![840.0, 850.0, 860.0, 870.0]).unwrap();
        model.surface.vertices.luminous_lm = None;
        assert_eq!(colors(&model).linear_srgb.iter().flatten().copied().fold(0.0, f32::max), 1.0);
    }

    #[test]
    fn tristimulus_rays_give_lumens_and_their_colour() {
        let mut model = fixture::model();
        model.spectral.columns = Columns::Tristimulus;
        let vertices = &mut model.surface.vertices;
        let luminous = vertices.luminous_lm.clone().unwrap();
        // The white of sRGB has x = 0.3127, y = 0.3290 (IEC 61966-2-1).
        vertices.columns = luminous.iter().flat_map(|y| [0.3127 / 0.3290 * y, *y, 0.3583 / 0.3290 * y]).collect();
        vertices.column_count = 3;
        let (file, emitter) = read(&model, Spectra::Auto);
        assert!(emitter["vertex_spectra"].is_null());
        assert_eq!(emitter["vertex_tristimulus"]["attribute"], "_XYZ_LM");
        let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
        let accessor = primitive.get(&Semantic::Extras("XYZ_LM".to_owned())).unwrap();
        let xyz: Vec<[f32; 3]> = Iter::new(accessor, |_| file.blob.as_deref()).unwrap().collect();
        assert!(xyz.iter().zip(&luminous).all(|(xyz, luminous)| xyz[1] == *luminous as f32));
        for [red, green, blue] in colors(&model).linear_srgb {
            assert!((red - green).abs() < 1e-6 * red && (blue - green).abs() < 1e-6 * red, "{red} {green} {blue}");
        }
    }
}
