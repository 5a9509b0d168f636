//! Values that several verbs read from their arguments. The error is what clap prints after the value.

use pipeline::vocabulary::space::Axis;
use pipeline::vocabulary::spectrum::Bands;

/// `+Z`.
pub fn axis(text: &str) -> Result<Axis, String> {
    Axis::parse(text).ok_or_else(|| "write one of +X -X +Y -Y +Z -Z".to_owned())
}

/// `380:780:10`: first and last edge and step, nm.
pub fn bands(text: &str) -> Result<Bands, String> {
    let numbers: Option<Vec<f64>> = text.split(':').map(|part| part.parse().ok()).collect();
    let bands = match numbers.as_deref() {
        Some(&[min_nm, max_nm, step_nm]) => Bands::regular(min_nm, max_nm, step_nm),
        _ => None,
    };
    bands.ok_or_else(|| "write first:last:step in nm, as 380:780:10".to_owned())
}
