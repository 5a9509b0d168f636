//! What Lampwright itself writes: people give a model, or a part of one, for a ray file.

use crate::error::Error;

/// Code of the refusal of a model, or of a part of one, where rays are wanted.
pub const MODEL: &str = "detect.model";
/// What to do with a model where rays are wanted.
const RAYS_OF_IT: &str = "Take the ray file that the model was made of, or draw new rays from the model.";
/// How a glTF file begins; who wrote it stands behind that.
const GLTF: &[u8] = b"glTF";
/// Bytes within which a file of ours says what it is.
const HEAD: usize = 256;

/// What stands in the head of a file of ours, and what the file is. The schemas' numbers are left out: an old model is one too.
const NAMED: [(&[u8], &str); 4] = [
    (b"\"generator\":\"Lampwright", "the emitter.glb of a model"),
    (b"\"urn:lampwright:goniograms:", "the goniograms.json of a model"),
    (b"\"urn:lampwright:report:", "the report.json of a model"),
    (b"\"urn:lampwright:evaluation:", "an evaluation of a model"),
];
/// How our tables begin: with the names of their columns.
const TABLES: [(&[u8], &str); 2] = [
    (b"wavelength_nm,band_from_nm,band_to_nm,", "the spectra.csv of a model"),
    (b"column,row,", "an evaluation of a model"),
];

/// What a file is that starts with `start`, where it is one of ours.
pub fn part(start: &[u8]) -> Option<&'static str> {
    let head = start.get(..start.len().min(HEAD)).unwrap_or_default();
    let may_name = head.starts_with(GLTF) || head.starts_with(b"{");
    let names = |word: &[u8]| may_name && head.windows(word.len()).any(|found| found == word);
    let named = NAMED.into_iter().filter(|(word, _)| names(word));
    named.chain(TABLES.into_iter().filter(|(word, _)| head.starts_with(word))).map(|(_, what)| what).next()
}

/// Whether a file that starts with `start` may be ours, and more of it must be seen to tell.
pub fn may_be(start: &[u8]) -> bool {
    start.starts_with(GLTF) && start.len() < HEAD
}

/// The refusal of a file of ours where a ray file is wanted.
pub fn refused(start: &[u8]) -> Option<Error> {
    part(start).map(|what| Error::refused(MODEL, format!("This is {what}, not a ray file."), RAYS_OF_IT).at_byte(0))
}

/// The refusal of a whole model, a folder or a packed one, where a ray file is wanted.
pub fn model() -> Error {
    Error::refused(MODEL, "This is a model, not a ray file.", RAYS_OF_IT)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::FORMATS;
    use crate::formats::detect::{detect, detect_start};

    fn code(bytes: &[u8]) -> &'static str {
        detect(&FORMATS, &bytes.to_vec()).map_or_else(|error| error.code(), |reader| reader.format.name())
    }

    /// A glTF container whose JSON begins so.
    fn glb(json: &str) -> Vec<u8> {
        [b"glTF\x02\0\0\0\xff\0\0\0\xff\0\0\0JSON".as_slice(), json.as_bytes()].concat()
    }

    #[test]
    fn what_we_wrote_is_told_from_what_others_wrote() {
        let ours = glb("{\"asset\":{\"version\":\"2.0\",\"generator\":\"Lampwright 0.1.0\"}}");
        let theirs = glb("{\"asset\":{\"generator\":\"Khronos glTF Blender I/O\",\"version\":\"2.0\"}}");
        for (bytes, expected) in [
            (ours.as_slice(), MODEL),
            (&theirs, "detect.cad"),
            (b"{\n  \"schema\": \"urn:lampwright:goniograms:2\",", MODEL),
            (b"{\n  \"schema\": \"urn:lampwright:report:9\",", MODEL),
            (b"{\"schema\": \"urn:somebody:report:9\"}", "detect.json"),
            (b"wavelength_nm,band_from_nm,band_to_nm,total_W_per_nm\n385,380,390,0e0\n", MODEL),
            (b"column,row,x_mm,y_mm,z_mm,illuminance_lx\n0,0,1,2,3,4\n", MODEL),
            (b"{\"columns\": \"column,row,x_mm,\"}", "detect.json"),
        ] {
            assert_eq!(code(bytes), expected, "{}", String::from_utf8_lossy(bytes));
        }
        // Of the first bytes of a long file nothing is said yet.
        for bytes in [&ours[..4], &ours[..40]] {
            assert!(matches!(detect_start(&FORMATS, bytes, None), Ok(None)));
        }
        let long = [theirs, vec![b' '; 300]].concat();
        assert!(detect_start(&FORMATS, &long, None).is_err_and(|error| error.code() == "detect.cad"));
    }
}
