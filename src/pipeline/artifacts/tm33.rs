//! `total.tm33.xml`: the far field by ANSI/IES TM-33-23, which holds what LM-63 and EULUMDAT cannot: W beside lm, and spectra.
//!
//! Every direction is written, with plane 360 again, so the optional `Symm` is left out, as are the parts that speak of a measuring device
//! and of a housing. Elements are those of the standard's schema, in its order (`openapi/README.md`, the files).

use super::photometry::{decimals, issue_day};
use super::provenance::{generator, header_text, input_kind, source_name};
use crate::goniogram::SphereGrid;
use crate::model::Model;
use crate::vocabulary::space::Axis;
use crate::writing::number::{ARRAY_DIGITS, SUM_DIGITS, plain, rounded};
use crate::writing::svg::one_line;
use crate::writing::{Artifact, xml::Xml};

/// Name in the zip.
pub const NAME: &str = "total.tm33.xml";
/// Most numbers of spectral intensities: so many are about 12 MB of text.
const MOST_SPECTRAL: usize = 200_000;
/// Longest foreign text.
const TEXT_CHARACTERS: usize = 200;

/// The file; `None` where it would hold no light: luminous intensity is unknown or 0, and the range of the radiant one, which the standard
/// demands, is unknown.
pub fn artifact(model: &Model) -> Option<Artifact> {
    let has_bands = model.spectral.has_bands();
    if !model.is_visible() && (!has_bands || model.goniograms.total.radiant_w_per_sr.is_none()) {
        return None;
    }
    let mut xml = Xml::document();
    xml.open("IESTM33-22", &[]);
    xml.leaf("Version", &[], "1.1");
    header(&mut xml, model);
    xml.open("Emitter", &[]);
    xml.leaf("Quantity", &[], "1");
    xml.leaf("Description", &[], &format!("whole source of {}", one_line(&source_name(model), TEXT_CHARACTERS)));
    xml.leaf("InputWattage", &[], "0"); // electrical power, which rays do not tell
    luminous(&mut xml, model);
    if has_bands {
        radiant(&mut xml, model);
        spectral(&mut xml, model);
    }
    Some(Artifact { name: NAME.to_owned(), media_type: "application/xml", bytes: xml.finish() })
}

/// Whether the file has the spectrum of the whole alone although spectra differ from direction to direction.
pub fn leaves_out_spectra(model: &Model) -> bool {
    let total = &model.goniograms.total;
    model.spectral.has_bands() && total.spectral_w_per_sr_nm.len() > MOST_SPECTRAL
}

fn header(xml: &mut Xml, model: &Model) {
    let frame = &model.goniograms.frame;
    let digest = model.origins.first().map_or("", |origin| origin.sha256.as_str());
    let c90 = Axis::nearest(frame.y()).name();
    xml.open("Header", &[]);
    if let Some(manufacturer) = header_text(model, "manufacturer") {
        xml.leaf("Manufacturer", &[], &one_line(manufacturer, TEXT_CHARACTERS));
    }
    xml.leaf("Description", &[], &one_line(&source_name(model), TEXT_CHARACTERS));
    xml.leaf("Laboratory", &[], &generator());
    xml.leaf("ReportNumber", &[], &format!("{} sha256 {digest}", input_kind(model)));
    xml.leaf("ReportDate", &[], &issue_day(header_text(model, "creation date")));
    let axes = format!("gamma 0 = {}, C0 = {}, C90 = {c90} of the source", frame.nadir.name(), frame.c0.name());
    xml.leaf("Comment", &[], &axes);
    xml.close();
}

fn luminous(xml: &mut Xml, model: &Model) {
    let total = &model.goniograms.total;
    let Some(candela) = total.luminous_cd.as_ref().filter(|_| model.is_visible()) else { return };
    xml.open("LuminousData", &[]);
    photometry(
        xml,
        model,
        ["LuminousIntensity", "AbsolutePhotometry"],
        candela,
        ("LuminousFlux", total.flux.luminous_lm),
    );
    xml.close();
}

fn radiant(xml: &mut Xml, model: &Model) {
    let (total, edges_nm) = (&model.goniograms.total, model.spectral.bands.edges_nm());
    let (Some(watts_per_sr), [from, .., to]) = (&total.radiant_w_per_sr, edges_nm) else { return };
    xml.open("RadiantData", &[]);
    xml.leaf("MinWavelength", &[], &plain(*from, 6));
    xml.leaf("MaxWavelength", &[], &plain(*to, 6));
    photometry(xml, model, ["RadiantIntensity", "Absolute"], watts_per_sr, ("RadiantFlux", total.flux.radiant_w));
    xml.close();
}

/// Intensities, which are absolute, and the flux, in the element that is open.
fn photometry(
    xml: &mut Xml,
    model: &Model,
    names: [&'static str; 2],
    values: &[f64],
    flux: (&'static str, Option<f64>),
) {
    xml.open(names[0], &[]);
    xml.leaf(names[1], &[], "true");
    intensities(xml, &model.goniograms.grid, values, None);
    xml.close();
    if let (name, Some(flux)) = flux {
        xml.leaf(name, &[], &decimal(flux));
    }
}

fn spectral(xml: &mut Xml, model: &Model) {
    let (total, centers_nm) = (&model.goniograms.total, model.spectral.bands.centers_nm());
    xml.open("SpectralData", &[]);
    xml.open("EmitterSpectral", &[]);
    xml.leaf("NumberWavelength", &[], &centers_nm.len().to_string());
    xml.leaf("Normalized", &[], "false");
    for (nm, value) in centers_nm.iter().zip(&total.spectral_flux_w_per_nm) {
        xml.leaf("PwrData", &[("w", &plain(*nm, 6))], &short(*value));
    }
    xml.close();
    if !total.spectral_w_per_sr_nm.is_empty() && !leaves_out_spectra(model) {
        xml.open("AngularSpectral", &[]);
        xml.leaf("Absolute", &[], "true");
        intensities(xml, &model.goniograms.spectral_grid, &total.spectral_w_per_sr_nm, Some(&centers_nm));
        xml.close();
    }
    xml.close();
}

/// How many directions, and a number for each, or one for each wavelength of each; γ (`v`) runs within C (`h`). Where one plane stands for
/// all, it alone is written.
fn intensities(xml: &mut Xml, grid: &SphereGrid, values: &[f64], wavelengths_nm: Option<&[f64]>) {
    let (planes, nodes) = (grid.c_planes(), grid.gamma_nodes());
    let written = if planes == 1 { 1 } else { planes + 1 };
    let bands = wavelengths_nm.map_or(1, <[f64]>::len);
    xml.leaf("NumberMeasured", &[], &(written * nodes).to_string());
    xml.leaf("NumberHorz", &[], &written.to_string());
    xml.leaf("NumberVert", &[], &nodes.to_string());
    let nm: Vec<String> = wavelengths_nm.unwrap_or_default().iter().map(|nm| plain(*nm, 6)).collect();
    if !nm.is_empty() {
        xml.leaf("NumberWavelength", &[], &bands.to_string());
    }
    let places = decimals(values);
    let gamma: Vec<String> = grid.gamma_deg().iter().map(|degrees| plain(*degrees, 6)).collect();
    let c = grid.c_deg().into_iter().chain([360.0]).take(written);
    for (plane, degrees) in c.enumerate() {
        let horizontal = plain(degrees, 6);
        let of_plane = values.chunks(nodes * bands).nth(plane % planes).unwrap_or_default();
        for (vertical, of_direction) in gamma.iter().zip(of_plane.chunks(bands)) {
            for (band, value) in of_direction.iter().enumerate() {
                let angles = [("h", horizontal.as_str()), ("v", vertical.as_str())];
                match nm.get(band) {
                    // Digits of its own: a weak band is as well known as a strong one.
                    Some(nm) => xml.leaf("IntData", &[angles[0], angles[1], ("w", nm)], &short(*value)),
                    None => xml.leaf("IntData", &angles, &plain(*value, places)),
                }
            }
        }
    }
}

/// A number as an xs:float, which may have an exponent.
fn short(value: f64) -> String {
    if value == 0.0 { "0".to_owned() } else { format!("{:e}", rounded(value, ARRAY_DIGITS)) }
}

/// A flux as an xs:decimal, which has no exponent.
fn decimal(flux: f64) -> String {
    let digits = SUM_DIGITS as i32;
    let places = if flux > 0.0 { (digits - 1 - flux.log10().floor() as i32).clamp(0, 20) } else { 0 };
    plain(flux, places as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::fixture::{self, FLUX_W};
    use crate::vocabulary::spectrum::lm_per_w;
    use glam::DVec3;

    /// The elements `name` of a document of ours, one a line: attributes and text.
    fn elements(text: &str, name: &str) -> Vec<(Vec<f64>, f64)> {
        let begin = format!("<{name} ");
        let lines = text.lines().filter_map(|line| line.strip_prefix(begin.as_str()));
        let parsed = lines.map(|line| {
            let (attributes, rest) = line.split_once('>').unwrap();
            let numbers = attributes.split('"').skip(1).step_by(2).map(|number| number.parse().unwrap()).collect();
            (numbers, rest.split_once('<').unwrap().0.parse().unwrap())
        });
        parsed.collect()
    }

    fn text_of(model: &Model) -> String {
        String::from_utf8(artifact(model).unwrap().bytes).unwrap()
    }

    #[test]
    fn a_lambertian_has_its_flux_over_pi_on_its_axis_in_lm_w_and_each_band() {
        let model = fixture::model();
        let text = text_of(&model);
        let all = elements(&text, "IntData");
        let (fine, coarse) = (37 * 37, 13 * 13 * 3);
        assert_eq!(all.len(), 2 * fine + coarse);
        let on_axis = |rows: &[(Vec<f64>, f64)]| rows.iter().find(|(at, _)| at[1] == 0.0).unwrap().1;
        let (lumens, watts) = (model.flux.luminous_lm.unwrap(), model.flux.radiant_w.unwrap());
        assert!((on_axis(&all[..fine]) * std::f64::consts::PI / lumens - 1.0).abs() < 2e-3);
        assert!((on_axis(&all[fine..2 * fine]) * std::f64::consts::PI / watts - 1.0).abs() < 2e-3);
        assert_eq!(all[fine - 1].0, [360.0, 180.0]);
        assert_eq!(all[2 * fine].0, [0.0, 0.0, 450.0]);
        // Bands of 20, 80 and 100 nm have 0.4, 0.3 and 0.3 of 5 W; the two zones are equally bright in W.
        let spectrum = elements(&text, "PwrData");
        let widths_nm = [20.0, 80.0, 100.0];
        let sum: f64 = spectrum.iter().zip(widths_nm).map(|((_, value), width_nm)| value * width_nm).sum();
        assert!((sum / FLUX_W - 1.0).abs() < 1e-5, "{sum}");
        assert_eq!(spectrum.iter().map(|(at, _)| at[0]).collect::<Vec<f64>>(), [450.0, 500.0, 590.0]);
        assert!(text.contains("<MinWavelength>440</MinWavelength>\n<MaxWavelength>640</MaxWavelength>"));
        assert!(lm_per_w(500.0) > 0.0 && text.contains(&format!("<RadiantFlux>{}</RadiantFlux>", plain(watts, 8))));
    }

    #[test]
    fn a_lobe_to_c0_comes_at_c0() {
        let lobe = |direction: DVec3, to: DVec3| (40.0 * (direction.dot(to.normalize()) - 1.0)).exp();
        let model = fixture::model_with(|direction| {
            lobe(direction, DVec3::X + DVec3::Z) + 0.5 * lobe(direction, DVec3::Y + DVec3::Z)
        });
        let rows = elements(&text_of(&model), "IntData");
        let at = |c: f64| rows.iter().find(|(at, _)| at[0] == c && at[1] == 45.0).unwrap().1;
        assert!((at(270.0) / at(0.0) - 0.5).abs() < 1e-3 && at(360.0) == at(0.0) && at(90.0) < 1e-3 * at(0.0));
    }

    #[test]
    fn what_is_unknown_is_left_out() {
        let mut model = fixture::model();
        model.goniograms.total.luminous_cd = None;
        let text = text_of(&model);
        assert!(!text.contains("<LuminousData>") && text.contains("<RadiantData>"));
        model.spectral.columns = crate::source::Columns::None;
        assert_eq!(artifact(&model), None);
    }

    #[test]
    fn no_decimal_has_an_exponent() {
        assert_eq!(decimal(1.5e-9), "0.0000000015");
        assert_eq!(decimal(123_456.789_012), "123456.789");
        assert_eq!(decimal(0.0), "0");
        assert_eq!([short(0.0), short(1.234_567_89e-9)], ["0", "1.23457e-9"]);
    }
}
