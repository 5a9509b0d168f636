//! L3D: the hull as a Wavefront OBJ file, and which of its faces belong to which light-emitting object (schema 0.11).
//!
//! The frame is that of the goniograms: -z is γ = 0 and x is C0, so objects are not turned. `structure.xml` is in metres, the OBJ file in mm.

use super::emitters::Emitter;
use crate::artifacts::archive::zip;
use crate::artifacts::provenance::generator;
use crate::error::Error;
use crate::model::Model;
use crate::writing::Artifact;
use crate::writing::number::plain;
use crate::writing::xml::{SCHEMA_INSTANCE, Xml};
use std::fmt::Write as _;

const SCHEMA: &str = "https://gldf.io/xsd/l3d/0.11.0/l3d.xsd";
/// Id of the geometry, and so the name of its folder.
const HULL: &str = "hull";
/// Smallest side of an object, m: of none at all programs divide by zero.
const LEAST_SIDE_M: f64 = 1e-6;

/// What the object of a number is called.
pub(super) fn object_name(number: usize) -> String {
    format!("leo_{number:02}")
}

/// The archive; `time` is when it says it was made.
///
/// # Errors
/// As [`zip`].
pub(super) fn archive(model: &Model, emitters: &[Emitter], title: &str, time: &str) -> Result<Vec<u8>, Error> {
    let faces = Faces::of(model, emitters);
    let structure = structure(model, emitters, &faces, [title, time]);
    zip(&[
        Artifact { name: "structure.xml".to_owned(), media_type: "application/xml", bytes: structure },
        Artifact { name: format!("{HULL}/{HULL}.obj"), media_type: "model/obj", bytes: faces.obj(model) },
    ])
}

/// The triangles of the hull, those of each object one after another.
struct Faces {
    /// Indices of triangles.
    order: Vec<usize>,
    /// Where the triangles of each object begin in `order`, and behind which they end.
    ranges: Vec<[usize; 2]>,
}

impl Faces {
    /// A triangle belongs to the object that has most of its corners' zones; one whose zones are all dark comes last and to none.
    fn of(model: &Model, emitters: &[Emitter]) -> Faces {
        let goniograms = &model.goniograms;
        let mut emitter_of_zone = vec![None; goniograms.zones.len()];
        for (number, emitter) in emitters.iter().enumerate() {
            emitter.zones.iter().for_each(|zone| emitter_of_zone[*zone] = Some(number));
        }
        let owner = |triangle: &[u32; 3]| {
            let mut weights: Vec<(usize, f64)> = Vec::new();
            for (zone, weight) in triangle.iter().flat_map(|corner| goniograms.mixtures[*corner as usize].parts()) {
                let Some(number) = emitter_of_zone[zone] else { continue };
                match weights.iter_mut().find(|(known, _)| *known == number) {
                    Some((_, sum)) => *sum += weight,
                    None => weights.push((number, weight)),
                }
            }
            let best = weights.into_iter().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
            best.map_or(emitters.len(), |(number, _)| number)
        };
        let owners: Vec<usize> = model.hull.triangles.iter().map(owner).collect();
        let mut order: Vec<usize> = (0..owners.len()).collect();
        order.sort_by_key(|triangle| owners[*triangle]);
        let begin = |number: usize| order.partition_point(|triangle| owners[*triangle] < number);
        let ranges = (0..emitters.len()).map(|number| [begin(number), begin(number + 1)]).collect();
        Faces { order, ranges }
    }

    fn obj(&self, model: &Model) -> Vec<u8> {
        let photometric_from_source = model.goniograms.frame.source_from_photometric().transpose();
        let mut text = String::from("# mm; -z is gamma 0, x is C0\no hull\n");
        for vertex_mm in &model.hull.vertices_mm {
            let [x, y, z] = (photometric_from_source * *vertex_mm).to_array().map(|mm| plain(mm, 6));
            // Writing to a String cannot fail.
            let _ = writeln!(text, "v {x} {y} {z}");
        }
        for [a, b, c] in self.order.iter().map(|triangle| model.hull.triangles[*triangle]) {
            let _ = writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1);
        }
        text.into_bytes()
    }
}

fn structure(model: &Model, emitters: &[Emitter], faces: &Faces, [title, time]: [&str; 2]) -> Vec<u8> {
    let mut xml = Xml::document();
    xml.open("Luminaire", &[("xmlns:xsi", SCHEMA_INSTANCE), ("xsi:noNamespaceSchemaLocation", SCHEMA)]);
    xml.open("Header", &[]);
    xml.leaf("Name", &[], title);
    xml.leaf("CreatedWithApplication", &[], &generator());
    xml.leaf("CreationTimeCode", &[], time);
    xml.empty("FormatVersion", &[("major", "0"), ("minor", "11")]);
    xml.close();
    xml.open("GeometryDefinitions", &[]);
    xml.empty("GeometryFileDefinition", &[("id", HULL), ("filename", "hull.obj"), ("units", "mm")]);
    xml.close();
    xml.open("Structure", &[]);
    xml.open("Geometry", &[("partName", "source"), ("includedInMeasurement", "true")]);
    let origin = [("x", "0"), ("y", "0"), ("z", "0")];
    xml.empty("Position", &origin);
    xml.empty("Rotation", &origin);
    xml.empty("GeometryReference", &[("geometryId", HULL)]);
    xml.open("LightEmittingObjects", &[]);
    for (number, emitter) in emitters.iter().enumerate() {
        object(&mut xml, model, number, emitter);
    }
    xml.close();
    xml.open("LightEmittingSurfaces", &[]);
    for (number, range) in faces.ranges.iter().enumerate() {
        surface(&mut xml, number, *range);
    }
    xml.finish()
}

/// A rectangle across γ = 0, as large as the object's box is there, in the middle of the box.
fn object(xml: &mut Xml, model: &Model, number: usize, emitter: &Emitter) {
    let frame = &model.goniograms.frame;
    let photometric_from_source = frame.source_from_photometric().transpose();
    let middle_m = photometric_from_source * emitter.bounds_mm.center() * 1e-3;
    let [x, y, z] = middle_m.to_array().map(|metres| plain(metres, 9));
    let size_m = (photometric_from_source * emitter.bounds_mm.size()).abs() * 1e-3;
    let [width, length, _] = size_m.to_array().map(|metres| plain(metres.max(LEAST_SIDE_M), 9));
    xml.open("LightEmittingObject", &[("partName", &object_name(number))]);
    xml.empty("Position", &[("x", &x), ("y", &y), ("z", &z)]);
    xml.empty("Rotation", &[("x", "0"), ("y", "0"), ("z", "0")]);
    xml.empty("Rectangle", &[("sizeX", &width), ("sizeY", &length)]);
    xml.close();
}

/// The faces of an object; nothing where its zones have no triangle of their own.
fn surface(xml: &mut Xml, number: usize, [begin, end]: [usize; 2]) {
    if begin == end {
        return;
    }
    xml.open("LightEmittingSurface", &[("partName", &format!("les_{number:02}"))]);
    xml.empty("LightEmittingObjectReference", &[("lightEmittingPartName", &object_name(number))]);
    xml.open("FaceAssignments", &[]);
    let (first, last) = (begin.to_string(), (end - 1).to_string());
    if begin + 1 == end {
        xml.empty("FaceAssignment", &[("faceIndex", &first)]);
    } else {
        xml.empty("FaceRangeAssignment", &[("faceIndexBegin", &first), ("faceIndexEnd", &last)]);
    }
    xml.close();
    xml.close();
}
