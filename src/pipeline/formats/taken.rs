//! What a file is where another one was expected: a ray file for a model, anything for a spectrum.

use super::detect::{NOT_RAYS, detect_start};
use super::foreign::gldf;
use super::own;
use super::record::{Format, Reader};
use crate::error::Error;

/// How the refusal of something that has a name ends, where rays are wanted.
const NO_RAY_FILE: &str = ", not a ray file.";

/// What to name where a model is wanted.
const NAME_MODEL: &str = "Name a model's folder or its model.zip; lampwright build makes one of a ray file.";

/// The refusal of a file that starts with `start` and is `length` bytes long where a model is wanted: what it is, and what to name.
pub fn no_model(readers: &[Reader], start: &[u8], length: u64) -> Error {
    let (what, remedy) = match own::part(start) {
        None => {
            let what = match detect_start(readers, start, Some(length)) {
                Ok(Some(reader)) => format!("This is a ray file ({}), no model.", reader.format.name()),
                Ok(None) => "This is no model.".to_owned(),
                Err(error) => said(&error).map_or("This is no model.".to_owned(), |what| format!("{what}, no model.")),
            };
            (what, NAME_MODEL)
        }
        Some(part) => (
            format!("This is {part}, not a whole one."),
            "Name the folder that it is in, or the model.zip: emitter.glb and goniograms.json are read together.",
        ),
    };
    Error::refused("model.not_model", what, remedy)
}

/// The refusal of a GLDF file where a model is wanted.
pub fn no_model_but_gldf() -> Error {
    let what = said(&gldf()).unwrap_or_default().to_owned();
    Error::refused("model.not_model", format!("{what}, no model."), NAME_MODEL)
}

/// The refusal of a file where a spectrum is wanted, where it is known to be something else. A text of columns may be a spectrum with a fault.
pub fn no_spectrum(readers: &[Reader], bytes: &[u8]) -> Option<Error> {
    const MAYBE: [&str; 3] = ["detect.spectrum", NOT_RAYS, own::MODEL];
    let what = match detect_start(readers, bytes, Some(bytes.len() as u64)) {
        Ok(Some(reader)) if reader.format != Format::Columns => {
            format!("This is a ray file ({})", reader.format.name())
        }
        Err(error) if !MAYBE.contains(&error.code()) => said(&error)?.to_owned(),
        _ => return None,
    };
    let remedy = "Name a spectrum: two columns (wavelength in nm, value), LightTools .sre, Zemax .spcd, Speos .spectrum or IES TM-27.";
    Some(Error::refused("spectrum.not_spectrum", format!("{what}, no spectrum."), remedy))
}

/// "This is a PDF document", of the refusal of one where rays are wanted; `None` where only that is told what the file is not.
fn said(refused: &Error) -> Option<&str> {
    match refused {
        Error::Malformed(fault) | Error::Refused(fault) => fault.found.strip_suffix(NO_RAY_FILE),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::FORMATS;

    #[test]
    fn what_is_given_for_a_spectrum_is_told_by_what_it_is() {
        let told =
            |bytes: &[u8]| crate::formats::spectrum(bytes).err().map(|error| (error.code(), error.found().to_owned()));
        for (bytes, what) in [
            (b"TM25\xdd\x07\0\0".as_slice(), "This is a ray file (IES TM-25), no spectrum."),
            (b"%PDF-1.7 ...", "This is a PDF document, no spectrum."),
            (b"{\"nm\": [1, 2]}", "This is JSON, no spectrum."),
        ] {
            assert_eq!(told(bytes), Some(("spectrum.not_spectrum", what.to_owned())));
        }
        // A fault of what may be one is told as that fault.
        assert!(
            told(b"400 1\n500 x\n")
                .is_some_and(|(code, _)| code.starts_with("spectrum.") && code != "spectrum.not_spectrum")
        );
        assert_eq!(told(b"400 1\n500 2\n600 1\n"), None);
    }

    #[test]
    fn what_is_given_for_a_model_is_told_by_what_it_is() {
        let told = |bytes: &[u8]| no_model(&FORMATS, bytes, bytes.len() as u64).to_string();
        for (bytes, what) in [
            (b"TM25\xdd\x07\0\0".as_slice(), "This is a ray file (IES TM-25), no model."),
            (
                b"IESNA:LM-63-2002\n[TEST] 1\nTILT=NONE\n",
                "an IES photometric file: directions without places, no model.",
            ),
            (b"%PDF-1.7", "This is a PDF document, no model."),
            (b"\x1f\x8b\x08", "This is a gzip file, no model."),
            (b"A letter.", "This is text, no model."),
            (&[0; 5000], "This is no model."),
            (
                b"glTF\x02\0\0\0{\"asset\":{\"generator\":\"Lampwright 0.1.0\"}}",
                "This is the emitter.glb of a model, not a whole one. Name the folder",
            ),
        ] {
            assert!(told(bytes).contains(what), "{what}: {}", told(bytes));
        }
    }
}
