//! The far field as a point light: `ies/total.ies` in a view of the binary chunk, by `EXT_lights_ies` of Khronos. A program that knows the
//! extension and not our attributes lights a scene with the source all the same.
//!
//! The extension's light sends γ = 0 along -Z of its node and C270 along +X; so C0 goes along +Y, because C counts counter-clockwise as
//! seen from γ = 180°.

use super::axes::gltf_from_source;
use super::buffer::Buffer;
use super::document::{Light, LightOfNode, Lights, Node, NodeExtensions, RootExtensions};
use crate::artifacts::ies;
use crate::model::Model;
use crate::options::Options as RunOptions;
use crate::vocabulary::space::Frame;
use crate::writing::number::sum;
use glam::{DMat3, DQuat, DVec3};

/// What the document says of it.
pub(super) struct PointLight {
    /// The file.
    pub(super) extensions: RootExtensions,
    /// Where it stands and which way it is turned.
    pub(super) node: Node,
}

impl PointLight {
    /// Of a model, its IES file put into `buffer`; `None` where there is no such file.
    pub(super) fn of(model: &Model, options: &RunOptions, buffer: &mut Buffer) -> Option<PointLight> {
        let buffer_view = buffer.file(&ies::total(model, options)?);
        let light = Light { name: "far field", buffer_view, mime_type: ies::MEDIA_TYPE };
        let place_m = gltf_from_source(middle_mm(model) * 1e-3);
        // Adding zero turns -0 into 0.
        let node = Node {
            name: "far field",
            rotation: Some(rotation(&model.goniograms.frame).to_array().map(|part| sum(part) + 0.0)),
            translation: Some(place_m.to_array().map(|metres| sum(metres) + 0.0)),
            extensions: Some(NodeExtensions { lights_ies: LightOfNode { light: 0 } }),
            ..Node::default()
        };
        Some(PointLight { extensions: RootExtensions { lights_ies: Lights { lights: [light] } }, node })
    }
}

/// The middle of the flux, source frame, mm.
fn middle_mm(model: &Model) -> DVec3 {
    let (points_mm, sites) = match &model.volume {
        Some(volume) => (&volume.lattice.points_mm(), &volume.nodes),
        None => (&model.hull.vertices_mm, &model.surface.vertices),
    };
    let weighed = points_mm.iter().zip(sites.primary());
    let sum = weighed.fold(DVec3::ZERO, |sum, (point_mm, flux)| sum + *flux * *point_mm);
    let flux: f64 = sites.primary().iter().sum();
    if flux > 0.0 { sum / flux } else { model.hull.bounds_mm().center() }
}

/// Takes the light's axes (C270, C0, γ = 180°) to those of glTF.
fn rotation(frame: &Frame) -> DQuat {
    DQuat::from_mat3(&DMat3::from_cols(
        gltf_from_source(-frame.y()),
        gltf_from_source(frame.x()),
        gltf_from_source(frame.z()),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::{fixture, gltf};
    use crate::vocabulary::space::Axis;
    use serde_json::Value;

    fn document_of(glb: &[u8]) -> (Value, usize) {
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        (serde_json::from_slice(&glb[20..20 + length]).unwrap(), 28 + length)
    }

    #[test]
    fn the_ies_file_is_in_the_binary_chunk_and_stands_in_the_middle_of_the_light() {
        let (mut model, options) = (fixture::model(), RunOptions::default());
        model.hull.vertices_mm.iter_mut().for_each(|vertex| vertex.z += 3.0);
        let glb = gltf::artifact(&model, &options).unwrap().bytes;
        let (document, binary) = document_of(&glb);
        let light = &document["extensions"]["EXT_lights_ies"]["lights"][0];
        assert_eq!(light["mimeType"], "application/x-ies-lm-63");
        let view = &document["bufferViews"][light["bufferView"].as_u64().unwrap() as usize];
        let [offset, length] = ["byteOffset", "byteLength"].map(|name| view[name].as_u64().unwrap() as usize);
        let expected = ies::artifacts(&model, &options);
        assert!(glb[binary + offset..][..length] == *expected[0].bytes, "the view is not ies/total.ies");
        assert_eq!(view["target"], Value::Null);
        let node = &document["nodes"][1];
        assert_eq!(node["extensions"]["EXT_lights_ies"]["light"], 0);
        // The rectangle's middle is (0, 0, 3) mm: 3 mm up.
        let place: Vec<f64> =
            node["translation"].as_array().unwrap().iter().map(|metres| metres.as_f64().unwrap()).collect();
        assert!(place.iter().zip([0.0, 3e-3, 0.0]).all(|(found, exact)| (found - exact).abs() < 1e-12), "{place:?}");
        assert_eq!(document["scenes"][0]["nodes"], serde_json::json!([0, 1]));
        model.flux.luminous_lm = None;
        let (document, _) = document_of(&gltf::artifact(&model, &options).unwrap().bytes);
        assert_eq!((&document["extensions"], document["nodes"].as_array().unwrap().len()), (&Value::Null, 1));
        assert_eq!(document["extensionsUsed"], serde_json::json!(["KHR_materials_unlit"]));
    }

    /// For every frame, the axes of the extension's light lie where the goniograms have them.
    #[test]
    fn the_light_is_turned_as_the_goniograms_are() {
        let pairs = Axis::ALL.into_iter().flat_map(|nadir| Axis::ALL.map(|c0| Frame { nadir, c0 }));
        let mut checked = 0;
        for frame in pairs.filter(|frame| frame.nadir.component() != frame.c0.component()) {
            let turned = |c_deg: f64, gamma_deg: f64| {
                gltf_from_source(frame.direction(c_deg.to_radians(), gamma_deg.to_radians()))
            };
            let rotation = rotation(&frame);
            for (own, c_deg, gamma_deg) in [(DVec3::NEG_Z, 0.0, 0.0), (DVec3::X, 270.0, 90.0), (DVec3::Y, 0.0, 90.0)] {
                assert!((rotation * own - turned(c_deg, gamma_deg)).length() < 1e-12, "{frame:?} C{c_deg}");
            }
            checked += 1;
        }
        assert_eq!(checked, 24);
    }
}
