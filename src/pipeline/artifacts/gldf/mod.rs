//! `source.gldf`: the source as DIALux and Relux open it, by GLDF 1.0.0-rc.3. The hull is its body (L3D), and its zones are light-emitting
//! objects, each with its own EULUMDAT file: near the lamp, light comes from where it does.
//!
//! Objects are changeable emitters, because that kind alone takes its flux from the file of photometry: all others state whole lumens, and
//! those would replace it.

/// Which zones are one object.
mod emitters;
/// The body, and where the objects are on it.
mod l3d;

use super::archive::zip;
use super::photometry::{issue_day, whole};
use super::provenance::{generator, header_text, source_name};
use crate::error::Error;
use crate::formats::bytes::digest;
use crate::model::Model;
use crate::writing::Artifact;
use crate::writing::json::unwritten;
use crate::writing::svg::one_line;
use crate::writing::xml::{SCHEMA_INSTANCE, Xml};

/// Name in the zip.
pub const NAME: &str = "source.gldf";
const SCHEMA: &str = "https://gldf.io/xsd/gldf/1.0.0-rc.3/gldf.xsd";
/// Path of the body.
const BODY: &str = "geo/source.l3d";
/// Longest foreign text.
const TEXT_CHARACTERS: usize = 200;

/// The file; `None` where luminous intensity is unknown or 0, because its photometry has no radiant unit.
///
/// # Errors
/// As [`zip`].
pub fn artifact(model: &Model) -> Result<Option<Artifact>, Error> {
    if whole(model).is_none() {
        return Ok(None);
    }
    let emitters = emitters::emitters(model);
    let title = one_line(&source_name(model), TEXT_CHARACTERS);
    let file = |name: String, media_type, bytes| Artifact { name, media_type, bytes };
    let mut files =
        vec![file(BODY.to_owned(), "application/zip", l3d::archive(model, &emitters, &title, &time_code(model))?)];
    for (number, emitter) in emitters.iter().enumerate() {
        let bytes = emitter.ldt(model, number, emitters.len());
        files.push(file(format!("ldc/{}.ldt", l3d::object_name(number)), "application/x-eulumdat", bytes));
    }
    let product = product(model, emitters.len(), &title, &files)?;
    files.insert(0, file("product.xml".to_owned(), "application/xml", product));
    Ok(Some(file(NAME.to_owned(), "application/x-gldf", zip(&files)?)))
}

/// A time that both schemas demand: the beginning of the ray file's own day, else of this version's; no file says when it was made.
fn time_code(model: &Model) -> String {
    format!("{}T00:00:00Z", issue_day(header_text(model, "creation date")))
}

fn product(model: &Model, count: usize, title: &str, files: &[Artifact]) -> Result<Vec<u8>, Error> {
    let manufacturer = one_line(header_text(model, "manufacturer").unwrap_or("unknown"), TEXT_CHARACTERS);
    let mut xml = Xml::document();
    xml.open("Root", &[("xmlns:xsi", SCHEMA_INSTANCE), ("xsi:noNamespaceSchemaLocation", SCHEMA)]);
    xml.open("Header", &[]);
    xml.leaf("Manufacturer", &[], &manufacturer);
    xml.empty("FormatVersion", &[("major", "1"), ("minor", "0"), ("pre-release", "3")]);
    xml.leaf("CreatedWithApplication", &[], &generator());
    xml.leaf("GldfCreationTimeCode", &[], &time_code(model));
    let contents: Vec<&[u8]> = files.iter().map(|file| file.bytes.as_slice()).collect();
    let id = identifier(&contents)?;
    xml.leaf("UniqueGldfId", &[], &id);
    xml.close();
    definitions(&mut xml, count);
    xml.open("ProductDefinitions", &[]);
    xml.open("ProductMetaData", &[]);
    xml.leaf("UniqueProductId", &[], &id);
    in_english(&mut xml, "ProductNumber", &id);
    in_english(&mut xml, "Name", title);
    xml.close();
    xml.open("Variants", &[]);
    xml.open("Variant", &[("id", "variant")]);
    in_english(&mut xml, "Name", title);
    xml.open("Geometry", &[]);
    xml.open("ModelGeometryReference", &[("geometryId", "geometry")]);
    for number in 0..count {
        xml.open("EmitterReference", &[("emitterId", &format!("emitter_{number:02}"))]);
        xml.leaf("EmitterObjectExternalName", &[], &l3d::object_name(number));
        xml.close();
    }
    Ok(xml.finish())
}

/// Files, photometry, emitters and geometry.
fn definitions(xml: &mut Xml, count: usize) {
    let names = |kind: &str| (0..count).map(|number| format!("{kind}_{number:02}")).collect::<Vec<String>>();
    let (files, photometries, emitters) = (names("file"), names("photometry"), names("emitter"));
    xml.open("GeneralDefinitions", &[]);
    xml.open("Files", &[]);
    let body = BODY.trim_start_matches("geo/");
    xml.leaf("File", &[("id", "body"), ("contentType", "geo/l3d"), ("type", "localFileName")], body);
    for (number, id) in files.iter().enumerate() {
        let kind = [("id", id.as_str()), ("contentType", "ldc/eulumdat"), ("type", "localFileName")];
        xml.leaf("File", &kind, &format!("{}.ldt", l3d::object_name(number)));
    }
    xml.close();
    xml.open("Photometries", &[]);
    for (id, file) in photometries.iter().zip(&files) {
        xml.open("Photometry", &[("id", id)]);
        xml.empty("PhotometryFileReference", &[("fileId", file)]);
        xml.close();
    }
    xml.close();
    xml.open("Emitters", &[]);
    for (id, photometry) in emitters.iter().zip(&photometries) {
        xml.open("Emitter", &[("id", id)]);
        xml.open("ChangeableLightEmitter", &[]);
        xml.empty("PhotometryReference", &[("photometryId", photometry)]);
        xml.close();
        xml.close();
    }
    xml.close();
    xml.open("Geometries", &[]);
    xml.open("ModelGeometry", &[("id", "geometry")]);
    xml.empty("GeometryFileReference", &[("fileId", "body")]);
    xml.close();
    xml.close();
    xml.close();
}

fn in_english(xml: &mut Xml, name: &'static str, text: &str) {
    xml.open(name, &[]);
    xml.leaf("Locale", &[("language", "en")], text);
    xml.close();
}

/// An identifier that equal contents have and no others: a UUID of version 8 (RFC 9562) of their SHA-256.
fn identifier(contents: &[&[u8]]) -> Result<String, Error> {
    let hex = digest(&contents.concat()).map_err(unwritten)?;
    let mut digits: Vec<char> = hex.chars().take(32).collect();
    if let Some(version) = digits.get_mut(12) {
        *version = '8';
    }
    if let Some(variant) = digits.get_mut(16) {
        let low = variant.to_digit(16).unwrap_or(0) & 3;
        *variant = char::from_digit(8 + low, 16).unwrap_or('8');
    }
    let places = digits.into_iter().enumerate();
    Ok(places.flat_map(|(at, digit)| [8, 12, 16, 20].contains(&at).then_some('-').into_iter().chain([digit])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::fixture;
    use ::zip::ZipArchive;
    use std::io::{Cursor, Read as _};

    fn read(bytes: &[u8], name: &str) -> Vec<u8> {
        let mut archive = ZipArchive::new(Cursor::new(bytes)).unwrap();
        let mut content = Vec::new();
        archive.by_name(name).unwrap().read_to_end(&mut content).unwrap();
        content
    }

    fn numbers(text: &str) -> Vec<f64> {
        text.split_whitespace().filter_map(|word| word.parse().ok()).collect()
    }

    #[test]
    fn each_zone_lies_where_it_is_and_has_its_own_faces_and_lumens() {
        // Two zones of 1 mm x 1 mm side by side along X, looking along +Z: x stays, y and z are turned over.
        let gldf = artifact(&fixture::model()).unwrap().unwrap().bytes;
        let l3d = read(&gldf, BODY);
        let structure = String::from_utf8(read(&l3d, "structure.xml")).unwrap();
        // The vertices at x = 0 belong to the right zone: the left box ends at -0.25 mm.
        for expected in [
            "<Position x=\"-0.000625\" y=\"0\" z=\"0\"/>",
            "<Rectangle sizeX=\"0.00075\" sizeY=\"0.001\"/>",
            "<Position x=\"0.0005\" y=\"0\" z=\"0\"/>",
            "<Rectangle sizeX=\"0.001\" sizeY=\"0.001\"/>",
            "<FaceRangeAssignment faceIndexBegin=\"0\"",
        ] {
            assert!(structure.contains(expected), "{expected} in {structure}");
        }
        let obj = String::from_utf8(read(&l3d, "hull/hull.obj")).unwrap();
        let vertices: Vec<Vec<f64>> = obj.lines().filter(|line| line.starts_with("v ")).map(numbers).collect();
        let faces: Vec<Vec<f64>> = obj.lines().filter(|line| line.starts_with("f ")).map(numbers).collect();
        assert_eq!((vertices.len(), faces.len()), (45, 64));
        assert_eq!(vertices[0], [-1.0, 0.5, 0.0]);
        let begin = structure.split("faceIndexBegin=\"").nth(2).unwrap().split('"').next().unwrap().parse().unwrap();
        let middle = |face: &Vec<f64>| face.iter().map(|at| vertices[*at as usize - 1][0]).sum::<f64>() / 3.0;
        assert!(faces[..begin].iter().all(|face| middle(face) < 0.0), "{begin}");
        assert!(faces[begin..].iter().all(|face| middle(face) > -0.25), "{begin}");
        let lumens = |name: &str| {
            let text = String::from_utf8(read(&gldf, name)).unwrap();
            text.lines().nth(28).unwrap().trim().parse::<f64>().unwrap()
        };
        let found = lumens("ldc/leo_00.ldt") + lumens("ldc/leo_01.ldt");
        let expected = fixture::model().flux.luminous_lm.unwrap();
        assert!((found / expected - 1.0).abs() < 1e-6, "{found} against {expected}");
    }

    #[test]
    fn equal_models_have_equal_bytes_and_identifiers_are_uuids() {
        assert_eq!(artifact(&fixture::model()).unwrap(), artifact(&fixture::model()).unwrap());
        // FIPS 180-4: SHA-256 of "abc" begins with ba7816bf 8f01cfea 414140de 5dae2223.
        assert_eq!(identifier(&[b"a", b"bc"]).unwrap(), "ba7816bf-8f01-8fea-8141-40de5dae2223");
    }

    #[test]
    fn no_file_without_luminous_intensity() {
        let mut model = fixture::model();
        model.goniograms.total.luminous_cd = None;
        assert_eq!(artifact(&model).unwrap(), None);
    }
}
