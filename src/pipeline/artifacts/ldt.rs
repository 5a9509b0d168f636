//! EULUMDAT: luminous intensities for the lighting programs of Europe (DIALux, Relux), of which LM-63 is a second language.
//!
//! One value a line, Latin-1, CR LF. Absolute photometry, which the format says by a negative number of lamps; intensities in cd per 1000 lm
//! of the lumens in the file. Every C plane is written and plane 360 is not: Isym 0, or Isym 1 where one plane
//! stands for all (`openapi/README.md`, the files).

use super::photometry::{Part, decimals, flux_of_nodes, issue_date, parts, sides_mm};
use super::provenance::{generator, header_text, input_kind, source_name};
use crate::goniogram::{SphereGrid, Zone};
use crate::model::Model;
use crate::vocabulary::space::Axis;
use crate::writing::Artifact;
use crate::writing::number::{plain, text};
use std::borrow::Cow;

/// Longest line of text, characters.
const LINE_CHARACTERS: usize = 78;
/// Most nodes of γ that readers take.
const MOST_GAMMA_NODES: usize = 361;
/// Least height of a luminaire, mm: of none at all readers warn.
const LEAST_HEIGHT_MM: f64 = 1e-3;
/// By how much, degrees, steps of γ may differ and be called even.
const UNEVEN_DEG: f64 = 1e-6;
/// Room indices for which there are direct ratios.
const ROOM_INDICES: usize = 10;

/// Path of the whole source's file.
pub const TOTAL: &str = "ies/total.ldt";

/// Path of a zone's file.
pub fn zone_name(zone: &Zone) -> String {
    format!("ies/{}.ldt", zone.name())
}

/// A file beside each IES file.
pub fn artifacts(model: &Model) -> Vec<Artifact> {
    let file = |part: &Part<'_>| Artifact {
        name: format!("{}.ldt", part.stem),
        media_type: "application/x-eulumdat",
        bytes: text_of(model, part),
    };
    parts(model).iter().map(file).collect()
}

/// The bytes of a part's file.
pub(super) fn text_of(model: &Model, part: &Part<'_>) -> Vec<u8> {
    let (grid, candela) = thinned(&model.goniograms.grid, part.candela);
    let lumens = flux_of_nodes(part.candela, &model.goniograms.grid);
    let mut lines = head(model, part, &grid, lumens);
    lines.extend(grid.c_deg().iter().map(|degrees| plain(*degrees, 6)));
    lines.extend(grid.gamma_deg().iter().map(|degrees| plain(*degrees, 6)));
    let per_klm: Vec<f64> =
        candela.iter().map(|candela| if lumens > 0.0 { candela / lumens * 1e3 } else { 0.0 }).collect();
    let decimals = decimals(&per_klm);
    lines.extend(per_klm.iter().map(|value| format!("{value:.decimals$}")));
    lines.push(String::new());
    // What is not in Latin-1 was taken out of the lines.
    lines.join("\r\n").chars().map(|letter| letter as u8).collect()
}

/// What stands before the angles, in the format's order.
fn head(model: &Model, part: &Part<'_>, grid: &SphereGrid, lumens: f64) -> Vec<String> {
    let frame = &model.goniograms.frame;
    let name = source_name(model);
    let digest = model.origins.first().map_or("", |origin| origin.sha256.as_str());
    let date = issue_date(header_text(model, "creation date"));
    let c90 = Axis::nearest(frame.y()).name();
    let axes = format!("gamma 0 = {}, C0 = {}, C90 = {c90} of the source", frame.nadir.name(), frame.c0.name());
    // The length of a luminaire lies along C90, its width along C0.
    let [width_mm, length_mm, height_mm] = sides_mm(&part.bounds_mm, frame);
    let [width, length, height] = [width_mm, length_mm, height_mm].map(|mm| plain(mm, 4));
    let isym = if grid.c_planes() == 1 { "1" } else { "0" };
    let mut lines = vec![
        line(&format!("{}, {}", line(header_text(model, "manufacturer").unwrap_or("unknown")), generator())),
        "3".to_owned(), // a point source
        isym.to_owned(),
        grid.c_planes().to_string(),
        plain(360.0 / grid.c_planes() as f64, 6),
        grid.gamma_nodes().to_string(),
        even_step_deg(grid).map_or("0".to_owned(), |step_deg| plain(step_deg, 6)),
        line(&format!("{} sha256 {}", input_kind(model), digest.get(..16).unwrap_or(digest))),
        line(&format!("{} of {name}", part.words)),
        line(&axes),
        line(part.stem.trim_start_matches("ies/")).chars().take(8).collect(),
        line(&date),
        length.clone(),
        width.clone(),
        plain(height_mm.max(LEAST_HEIGHT_MM), 4),
        length,
        width,
    ];
    lines.extend(std::iter::repeat_n(height, 4)); // of the luminous area, seen from C0, C90, C180 and C270
    let downward = 100.0 * flux_of_nodes(&downward(&model.goniograms.grid, part.candela), &model.goniograms.grid);
    lines.push(plain(if lumens > 0.0 { downward / lumens } else { 0.0 }, 4));
    lines.extend(["100", "1", "0", "1", "-1"].map(str::to_owned)); // light output ratio, factor, tilt, sets, lamps
    lines.extend(["LED".to_owned(), text(lumens, 9), "unknown".to_owned(), "unknown".to_owned(), "0".to_owned()]);
    // Lighting programs find these from the intensities.
    lines.extend(std::iter::repeat_n("0".to_owned(), ROOM_INDICES));
    lines
}

/// Foreign text made fit for a line: Latin-1, one line, bounded.
fn line(value: &str) -> String {
    let latin = value.chars().map(|letter| match letter {
        ' '..='~' | '\u{a1}'..='\u{ff}' => letter,
        _ if letter.is_whitespace() || letter.is_control() => ' ',
        _ => '?',
    });
    let words = latin.collect::<String>().split_whitespace().collect::<Vec<_>>().join(" ");
    words.chars().take(LINE_CHARACTERS).collect::<String>().trim_end().to_owned()
}

/// The step of γ; `None` where steps are uneven.
fn even_step_deg(grid: &SphereGrid) -> Option<f64> {
    let nodes = grid.gamma_deg();
    let step_deg = 180.0 / (nodes.len() - 1) as f64;
    let is_even = nodes.iter().enumerate().all(|(at, node)| (node - at as f64 * step_deg).abs() <= UNEVEN_DEG);
    is_even.then_some(step_deg)
}

/// The intensities below the horizon: half of those on it.
fn downward(grid: &SphereGrid, candela: &[f64]) -> Vec<f64> {
    let gamma_deg = grid.gamma_deg();
    let share = |node: usize| match gamma_deg[node % gamma_deg.len()] {
        degrees if degrees < 90.0 => 1.0,
        90.0 => 0.5,
        _ => 0.0,
    };
    candela.iter().enumerate().map(|(at, candela)| candela * share(at)).collect()
}

/// The same distribution on at most [`MOST_GAMMA_NODES`] of its nodes, with the same integral of what is interpolated between them.
fn thinned<'a>(grid: &'a SphereGrid, candela: &'a [f64]) -> (Cow<'a, SphereGrid>, Cow<'a, [f64]>) {
    let fine_deg = grid.gamma_deg();
    let last = fine_deg.len() - 1;
    if last < MOST_GAMMA_NODES {
        return (Cow::Borrowed(grid), Cow::Borrowed(candela));
    }
    let steps = MOST_GAMMA_NODES - 1;
    let kept: Vec<usize> = (0..=steps).map(|at| (at * last + steps / 2) / steps).collect();
    let coarse = SphereGrid::uneven(kept.iter().map(|node| fine_deg[*node]).collect(), grid.c_planes());
    let planes = candela.chunks_exact(grid.gamma_nodes());
    let mut values: Vec<f64> = planes.flat_map(|plane| kept.iter().map(|node| plane[*node])).collect();
    let found = coarse.integral(&values);
    if found > 0.0 {
        let factor = grid.integral(candela) / found;
        values.iter_mut().for_each(|value| *value *= factor);
    }
    (Cow::Owned(coarse), Cow::Owned(values))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::fixture;
    use std::f64::consts::PI;

    /// A model whose only goniogram is `candela` over `gamma_deg` and `planes` C planes.
    fn model(gamma_deg: Vec<f64>, planes: usize, candela: Vec<f64>) -> Model {
        let mut model = fixture::model();
        model.goniograms.grid = SphereGrid::uneven(gamma_deg, planes);
        model.goniograms.zones.clear();
        model.goniograms.total.luminous_cd = Some(candela);
        model
    }

    fn lines(model: &Model) -> Vec<String> {
        let latin = &artifacts(model)[0].bytes;
        let text: String = latin.iter().map(|byte| char::from(*byte)).collect();
        text.split("\r\n").map(str::to_owned).collect()
    }

    #[test]
    fn the_whole_file_of_a_tiny_grid() {
        // As in `ies.rs`: 319.1570 lm, of which the lower cap and half of the ring 100 × 1.840302 + ½ (10 + 20) × 4.442883 lm go down, 78.5424 %.
        let model = model(vec![0.0, 90.0, 180.0], 2, vec![100.0, 10.0, 1.0, 100.0, 20.0, 1.0]);
        let expected = [
            concat!("Nobody & Sons, Lampwright ", env!("CARGO_PKG_VERSION")),
            "3",
            "0",
            "2",
            "180",
            "3",
            "90",
            "ray file sha256 abababababababab",
            "whole source of rectangle.tm25ray",
            "gamma 0 = +Z, C0 = +X, C90 = -Y of the source",
            "total",
            "2013-10-16",
            "1",
            "2",
            "0.001",
            "1",
            "2",
            "0",
            "0",
            "0",
            "0",
            "78.5424",
            "100",
            "1",
            "0",
            "1",
            "-1",
            "LED",
            "319.157027",
            "unknown",
            "unknown",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "180",
            "0",
            "90",
            "180",
            "313.3254",
            "31.3325",
            "3.1333",
            "313.3254",
            "62.6651",
            "3.1333",
            "",
        ];
        assert_eq!(lines(&model), expected);
    }

    /// 700 nodes of a beam become 361, with the integral of before; fewer are left alone.
    #[test]
    fn a_grid_that_readers_do_not_take_is_thinned_and_keeps_its_flux() {
        let gamma_deg: Vec<f64> = (0..=700).map(|node| 180.0 * (f64::from(node) / 700.0).powi(2)).collect();
        let plane = |k: f64| gamma_deg.iter().map(move |degrees| (-(degrees / 3.0).powi(2)).exp() + 1e-3 * k);
        let candela: Vec<f64> = plane(1.0).chain(plane(2.0)).collect();
        let grid = SphereGrid::uneven(gamma_deg.clone(), 2);
        let (coarse, thin) = thinned(&grid, &candela);
        assert_eq!((coarse.gamma_nodes(), thin.len()), (361, 2 * 361));
        assert!((coarse.integral(&thin) / grid.integral(&candela) - 1.0).abs() < 1e-12);
        let off = |gamma: f64| (coarse.interpolate(&thin, 0.0, gamma) - grid.interpolate(&candela, 0.0, gamma)).abs();
        assert!((0..180).all(|degrees| off(f64::from(degrees) * PI / 180.0) < 1e-3));
        let found = lines(&model(gamma_deg, 2, candela));
        assert_eq!((found[5].as_str(), found[6].as_str()), ("361", "0"));
        assert_eq!(found.len(), 42 + 2 + 361 + 2 * 361 + 1);
        let small = SphereGrid::new(360, 1);
        let even = vec![1.0; 361];
        assert!(matches!(thinned(&small, &even), (Cow::Borrowed(_), Cow::Borrowed(_))));
    }

    #[test]
    fn hostile_texts_stay_in_their_lines_and_letters_of_europe_stay_letters() {
        let mut model = model(vec![0.0, 90.0, 180.0], 1, vec![1.0; 3]);
        model.origins[0].name = format!("Lüster\r\n9 \u{1F4A1}\u{85}{}", "x".repeat(10_000));
        model.origins[0].texts = vec![("Manufacturer".to_owned(), "Sté. Éclat\u{0}\u{2028}".to_owned())];
        let found = lines(&model);
        assert_eq!(found.len(), 42 + 1 + 3 + 3 + 1);
        assert!(found[0].starts_with("Sté. Éclat, Lampwright"), "{}", found[0]);
        assert!(found[8].starts_with("whole source of Lüster 9 ? x") && found[8].chars().count() == 78, "{}", found[8]);
        assert_eq!(found[2], "1");
    }

    #[test]
    fn no_file_where_luminous_intensity_is_unknown() {
        let mut model = fixture::model();
        model.goniograms.total.luminous_cd = None;
        assert!(artifacts(&model).is_empty());
        assert_eq!(artifacts(&fixture::model()).len(), 3);
    }
}
