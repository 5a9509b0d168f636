//! IES TM-27 spectra: XML with one `SpectralData` element for each wavelength.

use crate::error::Error;

/// Quantities of spectra that are no light.
const NO_LIGHT: [&str; 5] = ["absorptance", "transmittance", "reflectance", "r-values", "t-values"];
/// Name of the elements that hold values.
const DATA: &str = "SpectralData";

/// Wavelengths in nm and values, each with the byte of its element.
///
/// # Errors
/// `spectrum.xml` for other XML and for elements that hold no numbers, `spectrum.quantity` for what is no light.
pub fn rows(text: &str) -> Result<Vec<(f64, f64, u64)>, Error> {
    if !text.to_lowercase().contains("iestm27") {
        let found = "This is XML, and not an IES TM-27 spectrum.";
        let remedy = "Send an IES TM-27 file, or a text of two columns: wavelength in nm (or µm) and spectral density.";
        return Err(Error::malformed("spectrum.xml", found, remedy).at_byte(0));
    }
    let quantity = element(text, "SpectralQuantity").map(str::to_lowercase).unwrap_or_default();
    if NO_LIGHT.contains(&quantity.as_str()) {
        let found = format!("The spectrum is one of {quantity}, not of light.");
        return Err(Error::refused("spectrum.quantity", found, "Send the spectrum of the source.").at_byte(0));
    }
    starts(text, DATA).map(|at| row(text, at)).collect()
}

/// Bytes behind the names of the opening tags of elements called so, in any name space.
fn starts<'t>(text: &'t str, name: &'t str) -> impl Iterator<Item = usize> + 't {
    text.match_indices(name).filter_map(move |(at, _)| {
        let opens = text.get(..at).is_some_and(|before| before.ends_with('<') || is_prefixed(before));
        let rest = text.get(at + name.len()..)?;
        (opens && rest.starts_with(|next: char| next.is_whitespace() || next == '>')).then_some(at + name.len())
    })
}

/// Ends in `<prefix:`.
fn is_prefixed(before: &str) -> bool {
    let prefix = before.strip_suffix(':').map(|rest| rest.trim_end_matches(|sign: char| sign.is_alphanumeric()));
    prefix.is_some_and(|rest| rest.ends_with('<'))
}

/// Content of the first element called so.
fn element<'t>(text: &'t str, name: &'t str) -> Option<&'t str> {
    let (_, rest) = text.get(starts(text, name).next()?..)?.split_once('>')?;
    rest.split('<').next().map(str::trim)
}

/// The element whose attributes begin at byte `at`.
fn row(text: &str, at: usize) -> Result<(f64, f64, u64), Error> {
    let parts = text.get(at..).and_then(|rest| rest.split_once('>'));
    let number = |text: &str| text.trim().parse::<f64>().ok();
    let read = parts.and_then(|(attributes, rest)| {
        let (_, nm) = attributes.split_once("wavelength")?;
        let nm = nm.trim_start().strip_prefix('=')?.trim_start();
        let quote = nm.chars().next().filter(|sign| matches!(sign, '"' | '\''))?;
        Some((number(nm.split(quote).nth(1)?)?, number(rest.split('<').next()?)?))
    });
    let (nm, value) = read.ok_or_else(|| {
        let found = "An element SpectralData has no number as its wavelength, or none as its value.";
        Error::malformed("spectrum.xml", found, "Export the spectrum again.").at_byte(at as u64)
    })?;
    Ok((nm, value, at as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(quantity: &str, data: &str) -> String {
        format!("<?xml version=\"1.0\"?>\n<IESTM2714><SpectralQuantity>{quantity}</SpectralQuantity>{data}</IESTM2714>")
    }

    #[test]
    fn elements_are_rows() {
        for data in [
            "<SpectralData wavelength=\"400\">0.5</SpectralData><SpectralData wavelength=\"500.5\"> 1e0 </SpectralData>",
            "<t:SpectralData\n wavelength='400' >0.5</t:SpectralData>\n<t:SpectralData wavelength = '500.5'>1</t:SpectralData>",
        ] {
            let found: Vec<(f64, f64)> =
                rows(&file("relative", data)).unwrap().into_iter().map(|(nm, value, _)| (nm, value)).collect();
            assert_eq!(found, [(400.0, 0.5), (500.5, 1.0)], "{data}");
        }
    }

    #[test]
    fn what_is_no_light_or_no_number() {
        let code = |text: &str| rows(text).err().map(|error| error.code());
        assert_eq!(code("<rays/>"), Some("spectrum.xml"));
        assert_eq!(code(&file("Transmittance", "")), Some("spectrum.quantity"));
        for data in [
            "<SpectralData>1</SpectralData>",
            "<SpectralData wavelength=\"x\">1</SpectralData>",
            "<SpectralData wavelength",
        ] {
            assert_eq!(code(&file("flux", &format!("{data} "))), Some("spectrum.xml"), "{data}");
        }
        assert_eq!(rows(&file("flux", "")).unwrap(), []);
    }
}
