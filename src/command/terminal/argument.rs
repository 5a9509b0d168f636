//! Values that several verbs read from their arguments. The error is what clap prints after the value.

use pipeline::evaluation::Vector;
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

/// `0,0,1.5`: three numbers.
pub fn vector(text: &str) -> Result<Vector, String> {
    numbers::<3>(text).map(Vector::from_array).ok_or_else(|| "write three numbers, as 0,0,1.5".to_owned())
}

/// `90,45`: two numbers.
pub fn pair(text: &str) -> Result<[f64; 2], String> {
    numbers::<2>(text).ok_or_else(|| "write two numbers, as 90,45".to_owned())
}

fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}
