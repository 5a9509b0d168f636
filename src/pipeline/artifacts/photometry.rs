//! What the files of photometry (IES, EULUMDAT, TM-33, GLDF) say alike: which goniograms have such files, their date, sizes and decimals.

use super::provenance::VERSION_DATE;
use crate::goniogram::{Goniogram, SphereGrid};
use crate::model::Model;
use crate::vocabulary::space::{Bounds, Frame};

/// Digits of the largest intensity.
const PEAK_DIGITS: i32 = 7;

/// A goniogram with files of its own.
pub(super) struct Part<'a> {
    /// The path of its files in the zip, without extension.
    pub(super) stem: String,
    /// What it is, in words: "whole source", "zone 1 of 4".
    pub(super) words: String,
    /// Rays in it.
    pub(super) rays: f64,
    /// Its luminous intensities, cd, `[c][gamma]`.
    pub(super) candela: &'a [f64],
    /// The box of what sends it, source frame, mm.
    pub(super) bounds_mm: Bounds,
}

/// The whole source; `None` where luminous intensity is unknown or the source is invisible: these formats have no radiant unit.
pub(super) fn whole(model: &Model) -> Option<Part<'_>> {
    let (goniogram, bounds_mm) = (&model.goniograms.total, model.hull.bounds_mm());
    part(model, "total".to_owned(), "whole source".to_owned(), goniogram, bounds_mm)
}

/// The whole source and each zone that gets files; none where [`whole`] is none.
pub(super) fn parts(model: &Model) -> Vec<Part<'_>> {
    let (zones, with_files) = (&model.goniograms.zones, model.goniograms.zones_with_files());
    let count = zones.len();
    let of_zones = zones.iter().filter(|zone| with_files.contains(&zone.id)).filter_map(|zone| {
        let words = format!("zone {} of {count}{}", zone.id + 1, zone.position());
        part(model, zone.name(), words, &zone.goniogram, zone.bounds_mm)
    });
    whole(model).into_iter().chain(of_zones).collect()
}

fn part<'a>(
    model: &'a Model,
    stem: String,
    words: String,
    goniogram: &'a Goniogram,
    bounds_mm: Bounds,
) -> Option<Part<'a>> {
    let candela = goniogram.luminous_cd.as_deref().filter(|_| model.is_visible())?;
    Some(Part { stem: format!("ies/{stem}"), words, rays: goniogram.rays, candela, bounds_mm })
}

/// The ray file's own date (TM-25 writes ISO 8601), else this version's.
pub(super) fn issue_date(created: Option<&str>) -> String {
    let Some(created) = created else { return VERSION_DATE.to_owned() };
    iso_day(created).unwrap_or_else(|| created.chars().take(40).collect())
}

/// The same where nothing but a day of the calendar (xs:date) will do: a day that the file writes in another way is not guessed.
pub(super) fn issue_day(created: Option<&str>) -> String {
    let is_of_calendar = |day: &String| {
        let number = |from: usize, to: usize| day.get(from..to).and_then(|digits| digits.parse::<u32>().ok());
        let [year, month, date] = [number(0, 4), number(5, 7), number(8, 10)].map(Option::unwrap_or_default);
        let most = match month {
            4 | 6 | 9 | 11 => 30,
            2 if year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400)) => 29,
            2 => 28,
            _ => 31,
        };
        year > 0 && (1..=12).contains(&month) && (1..=most).contains(&date)
    };
    created.and_then(iso_day).filter(is_of_calendar).unwrap_or_else(|| VERSION_DATE.to_owned())
}

/// The day that a date by ISO 8601 begins with.
fn iso_day(created: &str) -> Option<String> {
    let day: String = created.chars().take(10).collect();
    let is_iso = day.len() == 10
        && day.bytes().enumerate().all(|(at, byte)| match at {
            4 | 7 => byte == b'-',
            _ => byte.is_ascii_digit(),
        });
    is_iso.then_some(day)
}

/// Sides of a box along C0, along C90 and along γ = 0, mm.
pub(super) fn sides_mm(bounds_mm: &Bounds, frame: &Frame) -> [f64; 3] {
    [frame.x(), frame.y(), frame.z()].map(|axis| bounds_mm.size().dot(axis.abs()))
}

/// Decimals that give the peak about seven digits; one count for the whole file.
pub(super) fn decimals(intensities: &[f64]) -> usize {
    let peak = intensities.iter().copied().fold(0.0, f64::max);
    if peak > 0.0 { (PEAK_DIGITS - 1 - peak.log10().floor() as i32).clamp(0, 20) as usize } else { 1 }
}

/// Flux by the rule of the cells: what a band-weighting reader finds.
pub(super) fn flux_of_nodes(intensities: &[f64], grid: &SphereGrid) -> f64 {
    let weights = grid.plane_solid_angles_sr();
    intensities.chunks(weights.len()).flat_map(|plane| plane.iter().zip(&weights)).map(|(cd, sr)| cd * sr).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_date_of_the_file_the_version_has_one() {
        assert_eq!(issue_date(None), VERSION_DATE);
        assert_eq!(issue_date(Some("2016-10-13T10:00:00+02:00")), "2016-10-13");
        assert_eq!(issue_date(Some("13 Oct 2016")), "13 Oct 2016");
        assert_eq!(issue_day(Some("2016-02-29T10:00:00Z")), "2016-02-29");
        for no_day in
            ["13 Oct 2016", "2015-02-29", "1900-02-29", "2016-13-01", "2016-04-31", "0000-01-01", "2016-01-00"]
        {
            assert_eq!(issue_day(Some(no_day)), VERSION_DATE, "{no_day}");
        }
    }
}
