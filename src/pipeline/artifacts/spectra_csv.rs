//! `spectra.csv`: spectral flux of the whole source and of each zone, W/nm, for a spreadsheet.

use crate::model::Model;
use crate::writing::Artifact;
use crate::writing::number::{ARRAY_DIGITS, rounded};

/// The table; `None` where no spectrum is known.
pub fn artifact(model: &Model) -> Option<Artifact> {
    if !model.spectral.has_bands() {
        return None;
    }
    let goniograms = &model.goniograms;
    let mut text = "wavelength_nm,band_from_nm,band_to_nm,total_W_per_nm".to_owned();
    for zone in &goniograms.zones {
        text.push_str(&format!(",{}_W_per_nm", zone.name()));
    }
    text.push_str("\r\n"); // RFC 4180
    let bands = &model.spectral.bands;
    for (band, (center, edge)) in bands.centers_nm().iter().zip(bands.edges_nm().windows(2)).enumerate() {
        text.push_str(&format!("{center},{},{}", edge[0], edge[1]));
        let columns = std::iter::once(&goniograms.total).chain(goniograms.zones.iter().map(|zone| &zone.goniogram));
        for goniogram in columns {
            let value = goniogram.spectral_flux_w_per_nm.get(band).copied().unwrap_or(0.0);
            text.push_str(&format!(",{:e}", rounded(value, ARRAY_DIGITS)));
        }
        text.push_str("\r\n");
    }
    Some(Artifact { name: "spectra.csv".to_owned(), media_type: "text/csv", bytes: text.into_bytes() })
}
