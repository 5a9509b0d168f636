use super::*;
use crate::artifacts::{fixture, gltf, goniograms};
use crate::model::Model;
use crate::model::evaluation::Quantity;
use crate::options::{Options, Spectra};
use crate::writing::Artifact;
use serde_json::{Value, json};

fn files(model: &Model, spectra: Spectra) -> [Vec<u8>; 2] {
    let mut options = Options::default();
    options.artifacts.spectra = Some(spectra);
    [gltf::artifact(model, &options).unwrap().bytes, goniograms::artifact(model, &options).unwrap().bytes]
}

fn read_files([emitter, goniograms]: &[Vec<u8>; 2]) -> Result<StoredModel, Error> {
    read(emitter, goniograms, &Limits::default())
}

/// The files with the JSON of the first, or the second, changed.
fn changed(emitter: impl Fn(&mut Value), angles: impl Fn(&mut Value)) -> Result<StoredModel, Error> {
    let [glb, goniograms] = files(&fixture::model(), Spectra::Auto);
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let mut document: Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    emitter(&mut document);
    let mut text = serde_json::to_vec(&document).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    let whole = 20 + text.len() + glb.len() - 20 - length;
    let mut bytes = [b"glTF".as_slice(), &2_u32.to_le_bytes(), &(whole as u32).to_le_bytes()].concat();
    bytes.extend((text.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(text);
    bytes.extend(&glb[20 + length..]);
    let mut document: Value = serde_json::from_slice(&goniograms).unwrap();
    angles(&mut document);
    read_files(&[bytes, serde_json::to_vec(&document).unwrap()])
}

#[test]
fn a_model_comes_back_wherever_its_spectra_stand() {
    for (model, spectra) in [
        (fixture::model(), Spectra::Auto),
        (fixture::model(), Spectra::Attributes),
        (fixture::model(), Spectra::Extras),
        (fixture::with_volume(), Spectra::Auto),
    ] {
        let stored = read_files(&files(&model, spectra)).unwrap();
        assert_eq!(stored.name, "rectangle.tm25ray");
        for quantity in [Quantity::Radiant, Quantity::Luminous] {
            let (ours, theirs) =
                (Evaluator::new(&model, quantity).unwrap(), Evaluator::new(&stored, quantity).unwrap());
            assert!((theirs.flux() / ours.flux() - 1.0).abs() < 1e-6);
        }
        let (own, back) = (Light::from(&model), Light::from(&stored));
        let largest = own.sites().columns.iter().copied().fold(0.0, f64::max);
        for (own, back) in own.sites().columns.iter().zip(&back.sites().columns) {
            // Five digits of the largest in extras, floats in attributes.
            assert!((own - back).abs() <= 1e-4 * largest, "{own} {back}");
        }
        assert_eq!(own.volume.map(|volume| &volume.lattice), back.volume.map(|volume| &volume.lattice));
    }
}

/// What is wrong is told by a code; none of it is read.
#[test]
fn what_is_wrong_has_a_code() {
    type Change = fn(&mut Value);
    let keep: Change = |_| ();
    let cases: [(&str, Change, Change); 20] = [
        ("model.damaged", |glb| glb["meshes"] = json!([]), keep),
        ("model.damaged", |glb| glb["meshes"][0]["primitives"] = json!([]), keep),
        ("model.damaged", |glb| glb["accessors"][0]["count"] = json!(u64::MAX / 2), keep),
        ("model.damaged", |glb| glb["accessors"][1]["componentType"] = json!(5121), keep),
        ("model.damaged", |glb| glb["bufferViews"][1]["byteOffset"] = json!(u64::MAX), keep),
        ("model.damaged", |glb| glb["bufferViews"][1]["byteStride"] = json!(1), keep),
        ("model.damaged", |glb| glb["accessors"][0]["count"] = json!(4), keep),
        ("model.version", |glb| glb["meshes"][0]["extras"]["emitter"]["schema"] = json!("urn:x:1"), keep),
        ("model.not_one", |glb| glb["meshes"][0]["extras"]["emitter"]["frame"]["nadir"] = json!("-Z"), keep),
        ("model.not_one", |glb| glb["meshes"][0]["extras"]["emitter"]["spectrum"] = Value::Null, keep),
        ("model.surface", |glb| glb["accessors"][1]["count"] = json!(5), keep),
        ("model.version", keep, |angles| angles["schema"] = json!("urn:lampwright:goniograms:1")),
        ("model.goniograms", keep, |angles| angles["zones"] = json!([])),
        ("model.goniograms", keep, |angles| angles["zones"][1]["id"] = json!(0)),
        ("model.goniograms", keep, |angles| angles["grid"]["gamma_deg"][3] = json!(200)),
        ("model.goniograms", keep, |angles| angles["grid"]["c_deg"][3] = json!(31)),
        ("model.goniograms", keep, |angles| {
            angles["zones"][0]["radiant_intensity_W_per_sr"][0][0] = json!(-1);
        }),
        ("model.goniograms", keep, |angles| {
            angles["zones"][0]["spectral_intensity"]["values"].as_array_mut().unwrap().pop();
        }),
        ("model.zones", keep, |angles| {
            angles["zones"].as_array_mut().unwrap().pop();
        }),
        ("model.dark_zone", keep, |angles| {
            let planes = angles["zones"][1]["radiant_intensity_W_per_sr"].as_array_mut().unwrap();
            planes.iter_mut().flat_map(|plane| plane.as_array_mut().unwrap()).for_each(|value| *value = json!(0));
        }),
    ];
    assert!(changed(keep, keep).is_ok());
    for (number, (code, emitter, angles)) in cases.into_iter().enumerate() {
        let error = changed(emitter, angles).err().unwrap_or_else(|| panic!("case {number}, {code}, was read"));
        assert_eq!(error.code(), code, "case {number}: {error}");
    }
    let missing = |name: &'static str| {
        changed(
            |glb| {
                glb["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove(name).unwrap();
            },
            |_| (),
        )
    };
    for (name, code) in [
        ("POSITION", "model.surface"),
        ("_ZONES", "model.zones"),
        ("_ZONE_WEIGHTS", "model.zones"),
        ("_FLUX_W", "model.spectra"),
    ] {
        assert_eq!(missing(name).err().map(|error| error.code()), Some(code), "{name}");
    }
}

/// Prefixes and damaged bytes are refused or read, and nothing panics.
#[test]
fn damaged_files_do_no_harm() {
    let whole = files(&fixture::with_volume(), Spectra::Auto);
    let hash = crate::inspection::sample::hash;
    for try_number in 0..600_u64 {
        let mut damaged = whole.clone();
        let file = &mut damaged[(try_number % 2) as usize];
        let at = (hash(try_number) % file.len() as u64) as usize;
        if try_number % 3 == 0 {
            file.truncate(at)
        } else {
            file[at] ^= 1 << (hash(!try_number) % 8)
        }
        let read = read_files(&damaged);
        assert!(try_number % 3 != 0 || read.is_err(), "a part of {at} bytes was read");
    }
}

#[test]
fn the_zip_of_a_model_holds_both_files() {
    let model = fixture::model();
    let options = Options::default();
    let artifacts = [gltf::artifact(&model, &options).unwrap(), goniograms::artifact(&model, &options).unwrap()];
    let archive = crate::artifacts::zip(&artifacts).unwrap();
    let [emitter, goniograms] = unpack(std::io::Cursor::new(&archive)).unwrap();
    assert!(emitter == artifacts[0].bytes && goniograms == artifacts[1].bytes);
    let half = crate::artifacts::zip(&artifacts[..1]).unwrap();
    assert_eq!(unpack(std::io::Cursor::new(half)).unwrap_err().code(), "model.missing_file");
    assert_eq!(unpack(std::io::Cursor::new(&archive[..100])).unwrap_err().code(), "model.archive");
    // Any zip may have a file of this name; its content tells whether this is a GLDF file.
    let product = |text: &str| {
        let file = Artifact::text("product.xml", "application/xml", text);
        unpack(std::io::Cursor::new(crate::artifacts::zip(&[file]).unwrap())).unwrap_err()
    };
    assert_eq!(product("<?xml version=\"1.0\"?><Root><Price>1</Price></Root>").code(), "model.missing_file");
    let schema = "https://gldf.io/xsd/gldf/1.0.0-rc.3/gldf.xsd";
    let gldf = product(&format!("<?xml version=\"1.0\"?>\n<Root xsi:noNamespaceSchemaLocation=\"{schema}\">"));
    assert_eq!(gldf.code(), "model.not_model");
}
