//! IES LM-63: what every reader accepts (`openapi/README.md`; each rule there was found by a reader that fails without it).
//!
//! Type C, always full: γ 0..=180, C 0..=360 with plane 360 a copy of plane 0. Absolute photometry: one lamp, -1 lumens per
//! lamp, multipliers 1. ASCII, CR LF, one blank between numbers, ten numbers a line; every record starts a line.

use super::photometry::{Part, decimals, flux_of_nodes, issue_date, parts, sides_mm, whole};
use super::provenance::{generator, header_text, input_kind, source_name};
use crate::goniogram::Zone;
use crate::model::Model;
use crate::options::{IesEdition, Options as RunOptions};
use crate::vocabulary::space::{Bounds, Frame};
use crate::writing::Artifact;
use crate::writing::number::{plain, text};

/// Longest value of a keyword: LM-63-2002 allows lines of 256 characters with CR LF, Radiance's label buffer holds as many.
const VALUE_CHARACTERS: usize = 200;
/// Smallest side of a luminous opening, m: a side of 0 would say "point".
const SMALLEST_SIDE_M: f64 = 1e-6;

/// Path of the whole source's file.
pub const TOTAL: &str = "ies/total.ies";

/// Path of a zone's file.
pub fn zone_name(zone: &Zone) -> String {
    format!("ies/{}.ies", zone.name())
}

/// What the format is called.
pub const MEDIA_TYPE: &str = "application/x-ies-lm-63";

/// `ies/total.ies` and one file for each zone that gets files; none where luminous intensity is unknown or the source
/// is invisible, because LM-63 has no radiant unit.
pub fn artifacts(model: &Model, options: &RunOptions) -> Vec<Artifact> {
    let file = |part: Part<'_>| {
        let name = format!("{}.ies", part.stem);
        Artifact { name, media_type: MEDIA_TYPE, bytes: text_of(model, options, part) }
    };
    parts(model).into_iter().map(file).collect()
}

/// The bytes of `ies/total.ies`; `None` where there is no such file.
pub fn total(model: &Model, options: &RunOptions) -> Option<Vec<u8>> {
    Some(text_of(model, options, whole(model)?))
}

fn text_of(model: &Model, options: &RunOptions, part: Part<'_>) -> Vec<u8> {
    let edition = options.artifacts.ies_edition.unwrap_or_default();
    Sheet { model, edition, part }.lines().into_bytes()
}

/// What one file is made of.
struct Sheet<'a> {
    model: &'a Model,
    edition: IesEdition,
    part: Part<'a>,
}

impl Sheet<'_> {
    fn lines(&self) -> String {
        let grid = &self.model.goniograms.grid;
        let mut lines = self.keywords();
        lines.push("TILT=NONE".to_owned());
        let generation = match self.edition {
            IesEdition::Lm63Of2002 => "1",
            IesEdition::Lm63Of2019 => "1.00010", // computer simulation
        };
        let (planes, nodes) = (grid.c_planes(), grid.gamma_nodes());
        let opening = opening_m(&self.part.bounds_mm, &self.model.goniograms.frame);
        lines.push(format!("1 -1 1 {nodes} {} 1 2 {opening}", planes + 1));
        lines.push(format!("1 {generation} 0"));
        let angle = |degrees: &f64| plain(*degrees, 6);
        push_record(&mut lines, grid.gamma_deg().iter().map(angle));
        push_record(&mut lines, grid.c_deg().iter().chain(&[360.0]).map(angle));
        let decimals = decimals(self.part.candela);
        for plane in (0..planes).chain([0]) {
            let row = self.part.candela.iter().skip(plane * nodes).take(nodes);
            push_record(&mut lines, row.map(|candela| format!("{candela:.decimals$}")));
        }
        lines.push(String::new());
        lines.join("\r\n")
    }

    fn keywords(&self) -> Vec<String> {
        let (model, frame) = (self.model, &self.model.goniograms.frame);
        let edition = match self.edition {
            IesEdition::Lm63Of2002 => "IESNA:LM-63-2002",
            IesEdition::Lm63Of2019 => "IES:LM-63-2019",
        };
        let name = source_name(model);
        let digest = model.origins.first().map_or("", |origin| origin.sha256.as_str());
        let own_flux = text(flux_of_nodes(self.part.candela, &model.goniograms.grid), 7);
        let c90 = crate::vocabulary::space::Axis::nearest(frame.y()).name();
        let keyword = |key: &str, value: &str| format!("[{key}] {}", label(value));
        vec![
            edition.to_owned(),
            keyword("TEST", &format!("computed from {} sha256 {digest}", input_kind(model))),
            keyword("TESTLAB", &generator()),
            keyword("ISSUEDATE", &issue_date(header_text(model, "creation date"))),
            keyword("MANUFAC", header_text(model, "manufacturer").unwrap_or("unknown")),
            keyword("LUMCAT", &name),
            keyword("LUMINAIRE", &format!("{} of {name}", self.part.words)),
            keyword(
                "OTHER",
                &format!("nadir=source {} C0=source {} C90=source {c90}", frame.nadir.name(), frame.c0.name()),
            ),
            keyword("OTHER", &format!("flux lm={own_flux} by node-centred cells")),
            keyword("_RAYS", &text(self.part.rays, 9)),
        ]
    }
}

/// Foreign text made fit for a keyword line: printable ASCII, one line, bounded, and never the letters that start the data.
fn label(value: &str) -> String {
    let ascii: String = value
        .chars()
        .map(|letter| match letter {
            ' '..='~' => letter,
            _ if letter.is_whitespace() || letter.is_control() => ' ',
            _ => '?',
        })
        .collect();
    let words = ascii.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut kept: String = words.chars().take(VALUE_CHARACTERS).collect();
    // three.js and Babylon.js start reading data at the first line that holds these letters.
    while let Some(at) = kept.to_ascii_uppercase().find("TILT") {
        kept.replace_range(at..at + 4, "T_LT");
    }
    kept.trim_end().to_owned()
}

/// Width (across C0), length (along C0) and height of the luminous opening, m: a rectangle in the plane of C0 and C90.
fn opening_m(bounds_mm: &Bounds, frame: &Frame) -> String {
    let [length, width, _] = sides_mm(bounds_mm, frame).map(|mm| plain((mm * 1e-3).max(SMALLEST_SIDE_M), 9));
    format!("{width} {length} 0")
}

fn push_record(lines: &mut Vec<String>, numbers: impl Iterator<Item = String>) {
    let numbers: Vec<String> = numbers.collect();
    lines.extend(numbers.chunks(10).map(|ten| ten.join(" ")));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::fixture;
    use crate::goniogram::SphereGrid;
    use glam::DVec3;

    /// A model whose only goniogram is `candela` over 0, 90, 180 degrees and the planes C0 and C180.
    fn tiny(candela: [f64; 6]) -> Model {
        let mut model = fixture::model();
        model.goniograms.grid = SphereGrid::new(2, 2);
        model.goniograms.zones.clear();
        model.goniograms.total.luminous_cd = Some(candela.to_vec());
        model
    }

    fn text_of(model: &Model, options: &RunOptions) -> String {
        let text = artifacts(model, options)[0].bytes.clone();
        assert_eq!(total(model, options).as_ref(), Some(&text));
        String::from_utf8(text).unwrap()
    }

    #[test]
    fn the_whole_text_of_a_tiny_grid() {
        // Cells of a 90 degree grid: caps of 2π(1 - cos 45°) = 1.840302 sr, a half ring of 2π cos 45° = 4.442883 sr each, so
        // 100 × 1.840302 + (10 + 20) × 4.442883 + 1 × 1.840302 = 319.1570 lm.
        let expected = [
            "IESNA:LM-63-2002",
            "[TEST] computed from ray file sha256 abababababababababababababababababababababababababababababababab",
            concat!("[TESTLAB] Lampwright ", env!("CARGO_PKG_VERSION")),
            "[ISSUEDATE] 2013-10-16",
            "[MANUFAC] Nobody & Sons",
            "[LUMCAT] rectangle.tm25ray",
            "[LUMINAIRE] whole source of rectangle.tm25ray",
            "[OTHER] nadir=source +Z C0=source +X C90=source -Y",
            "[OTHER] flux lm=319.157 by node-centred cells",
            "[_RAYS] 1000",
            "TILT=NONE",
            "1 -1 1 3 3 1 2 0.001 0.002 0",
            "1 1 0",
            "0 90 180",
            "0 180 360",
            "100.0000 10.0000 1.0000",
            "100.0000 20.0000 1.0000",
            "100.0000 10.0000 1.0000",
            "",
        ];
        let model = tiny([100.0, 10.0, 1.0, 100.0, 20.0, 1.0]);
        assert_eq!(text_of(&model, &RunOptions::default()).split("\r\n").collect::<Vec<_>>(), expected);
    }

    #[test]
    fn the_2019_edition_has_its_own_tag_and_generation_type() {
        let mut options = RunOptions::default();
        options.artifacts.ies_edition = Some(IesEdition::Lm63Of2019);
        let text = text_of(&tiny([1.0; 6]), &options);
        assert!(text.starts_with("IES:LM-63-2019\r\n") && text.contains("\r\n1 1.00010 0\r\n"), "{text}");
    }

    #[test]
    fn small_and_large_candelas_keep_seven_digits_without_exponents() {
        for (peak, expected) in [(3.2e-9, "0.000000003200000"), (4.5e8, "450000000"), (0.0, "0.0")] {
            let text = text_of(&tiny([peak, 0.0, 0.0, peak, 0.0, 0.0]), &RunOptions::default());
            let row = text.split("\r\n").nth(15).unwrap();
            assert_eq!(row.split(' ').next(), Some(expected));
            assert!(!row.contains('e'));
        }
    }

    #[test]
    fn hostile_texts_stay_in_their_lines() {
        let mut model = tiny([1.0; 6]);
        model.origins[0].name = format!("TILT=NONE\r\nTilT\n1 2 3 \u{1F4A1} tTILTILT {}", "x".repeat(10_000));
        let manufacturer = ("Manufacturer".to_owned(), "TITILTLT=INCLUDE\u{0}\u{85}\u{2028}é".to_owned());
        model.origins[0].texts = vec![manufacturer, ("creation date".to_owned(), "yesterday\r\nTILT".to_owned())];
        let text = text_of(&model, &RunOptions::default());
        let lines: Vec<&str> = text.split("\r\n").collect();
        assert_eq!(lines.iter().position(|line| line.to_ascii_uppercase().contains("TILT")), Some(10));
        assert_eq!(lines.iter().filter(|line| line.to_ascii_uppercase().contains("TILT")).count(), 1);
        assert!(text.is_ascii() && !text.replace("\r\n", "").contains(['\r', '\n']));
        assert!(lines.iter().all(|line| line.len() <= 254 && !line.ends_with(' ')), "{text}");
        assert_eq!(lines.len(), 19);
    }

    #[test]
    fn no_file_where_luminous_intensity_is_unknown() {
        let mut model = tiny([1.0; 6]);
        model.goniograms.total.luminous_cd = None;
        assert!(artifacts(&model, &RunOptions::default()).is_empty());
    }

    #[test]
    fn lobes_come_at_c0_and_c270_of_a_source_that_looks_up() {
        // `pipeline/README.md`, frames: lobes at +X+Z (1) and +Y+Z (1/2) must come at C0 and C270.
        let lobe = |direction: DVec3, to: DVec3| (40.0 * (direction.dot(to.normalize()) - 1.0)).exp();
        let model = fixture::model_with(|direction| {
            lobe(direction, DVec3::X + DVec3::Z) + 0.5 * lobe(direction, DVec3::Y + DVec3::Z)
        });
        let text = text_of(&model, &RunOptions::default());
        let numbers: Vec<f64> =
            text.split("TILT=NONE").nth(1).unwrap().split_whitespace().map(|n| n.parse().unwrap()).collect();
        let planes: Vec<&[f64]> = numbers[13 + 37 + 37..].chunks(37).collect();
        assert_eq!(planes.len(), 37);
        let at_45 = |c_deg: usize| planes[c_deg / 10][9];
        let peak = planes.iter().flat_map(|plane| plane.iter()).copied().fold(0.0, f64::max);
        assert_eq!(at_45(0), peak);
        assert!((at_45(270) / peak - 0.5).abs() < 1e-3 && at_45(90) < 1e-3 * peak && at_45(180) < 1e-3 * peak);
    }

    #[test]
    fn sides_of_a_flat_source_are_never_zero() {
        let mut model = tiny([1.0; 6]);
        model.hull.vertices_mm.iter_mut().for_each(|vertex| vertex.y = 0.0);
        assert!(text_of(&model, &RunOptions::default()).contains("\r\n1 -1 1 3 3 1 2 0.000001 0.002 0\r\n"));
    }
}
