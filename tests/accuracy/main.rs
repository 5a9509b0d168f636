//! Why believe the numbers: known sources through the whole pipeline, against exact answers. The tables in `ACCURACY.md` beside this
//! file, and the last row of each source in the `README.md` of the project, are made here and compared here, so they hold what was
//! measured and nothing else.
//!
//! `WRITE_README=1 cargo test --test accuracy` writes them anew.

#![expect(clippy::unwrap_used, reason = "what a test stumbles over is its finding")]

use glam::DVec3;
use pipeline::known_sources::{KnownSource, by_name, write_tm25};
use pipeline::model::evaluation::{Evaluator, Quantity};
use pipeline::model::study::{Figure, View};
use pipeline::{Declared, Input, Limits, NoProgress, Options, Outcome, run};
use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};
use std::sync::Arc;

const RAYS: u64 = 1_000_000;
/// Steps of the exact integral, both ways.
const STEPS: usize = 1500;
/// Pages with a table between two marks: that of the project, and all numbers.
const README: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/README.md");
const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/accuracy/ACCURACY.md");
const BEGIN: &str = "<!-- accuracy: made by tests/accuracy -->\n";
const END: &str = "<!-- accuracy: end -->\n";

/// A number that is known, and what the model says.
struct Row {
    source: &'static str,
    what: &'static str,
    unit: &'static str,
    exact: f64,
    ours: f64,
    /// Largest relative error that passes.
    within: f64,
}

impl Row {
    /// As a row of a table.
    fn cells(&self) -> String {
        let Row { source, what, unit, exact, ours, .. } = self;
        let error = format!("{:+.2}", 100.0 * (ours / exact - 1.0)).replace("-0.00", "0.00").replace("+0.00", "0.00");
        let (exact, ours) = (digits(*exact), digits(*ours));
        format!("| {source} | {what} | {exact} {unit} | {ours} {unit} | {error} % |")
    }
}

/// A known source and its model.
struct Bench {
    source: KnownSource,
    outcome: Outcome,
    rows: Vec<Row>,
}

impl Bench {
    fn new(name: &str) -> Bench {
        let source = by_name(name).unwrap();
        let mut bytes = Vec::new();
        write_tm25(&source, RAYS, 1, &mut bytes).unwrap();
        let input = Input {
            name: name.into(),
            sha256: "0".repeat(64),
            bytes: Arc::new(bytes),
            declared: Declared::default(),
            notices: Vec::new(),
        };
        let outcome = run(&[input], &Options::default(), &Limits::default(), &NoProgress).unwrap();
        Bench { source, outcome, rows: Vec::new() }
    }

    /// What the verification of the model says of a view.
    fn figure(&self, view: &View) -> &Figure {
        let study = self.outcome.model.study.as_ref().unwrap();
        study.figures.iter().find(|figure| figure.view == *view).unwrap()
    }

    fn row(mut self, what: &'static str, unit: &'static str, exact: f64, ours: f64, within: f64) -> Bench {
        self.rows.push(Row { source: self.source.name, what, unit, exact, ours, within });
        self
    }

    fn evaluator(&self) -> Evaluator<'_> {
        Evaluator::new(&self.outcome.model, Quantity::Radiant).unwrap()
    }

    fn lumens(self, what: &'static str, within: f64) -> Bench {
        let (exact, ours) = (self.source.luminous_lm(), self.outcome.model.flux.luminous_lm.unwrap());
        self.row(what, "lm", exact, ours, within)
    }

    /// Mean intensity over 36 directions square to z, for a source that looks the same from all of them: the noise of the one
    /// direction (1 % and more) is gone, so that what is left is what smoothing and grid do.
    fn intensity_around(self, what: &'static str, within: f64) -> Bench {
        let directions: Vec<DVec3> =
            (0..36).map(|k| TAU * f64::from(k) / 36.0).map(|angle| DVec3::new(angle.cos(), angle.sin(), 0.0)).collect();
        let mean = |of: &dyn Fn(DVec3) -> f64| directions.iter().map(|at| of(*at)).sum::<f64>() / 36.0;
        let (exact, ours) = {
            let evaluator = self.evaluator();
            (mean(&|at| self.source.intensity_w_per_sr(at)), mean(&|at| evaluator.intensity(at)))
        };
        self.row(what, "W/sr", exact, ours, within)
    }

    fn intensity(self, what: &'static str, direction: DVec3, within: f64) -> Bench {
        let (exact, ours) = (self.source.intensity_w_per_sr(direction), self.evaluator().intensity(direction));
        self.row(what, "W/sr", exact, ours, within)
    }

    fn irradiance(self, what: &'static str, point_mm: DVec3, normal: DVec3, within: f64) -> Bench {
        let (exact, ours) = (irradiance(&self.source, point_mm, normal), self.evaluator().irradiance(point_mm, normal));
        self.row(what, "W/mm²", exact, ours, within)
    }

    /// Flux of the vertices in a quadrant.
    fn flux_within(self, what: &'static str, inside: impl Fn(DVec3) -> bool, exact: f64, within: f64) -> Bench {
        let model = &self.outcome.model;
        let flux_w = model.surface.vertices.radiant_w.as_ref().unwrap();
        let ours = model.hull.vertices_mm.iter().zip(flux_w).filter(|(at, _)| inside(**at)).map(|(_, flux)| flux).sum();
        self.row(what, "W", exact, ours, within)
    }
}

/// Irradiance on a plane with unit `normal`, W/mm²: E = ∫ L cos θ dω. In u = sin²θ, cos θ dω = ½ du dφ, so E = π times the mean of L
/// over the unit square.
fn irradiance(source: &KnownSource, point_mm: DVec3, normal: DVec3) -> f64 {
    let across = normal.any_orthonormal_vector();
    let middle = |k: usize| (k as f64 + 0.5) / STEPS as f64;
    let mut sum = 0.0;
    for (u, phi) in (0..STEPS * STEPS).map(|k| (middle(k / STEPS), TAU * middle(k % STEPS))) {
        let toward = across * phi.cos() + normal.cross(across) * phi.sin();
        sum += source.radiance_w_per_mm2_sr(point_mm, -(toward * u.sqrt() + normal * (1.0 - u).sqrt()));
    }
    PI * sum / (STEPS * STEPS) as f64
}

/// Share of the light of a Lambertian square of edge `edge_mm` that a plane element over its middle sees, times π E / M: Howell, A
/// Catalog of Radiation Heat Transfer Configuration Factors, B-3, four times.
fn square_overhead(edge_mm: f64, height_mm: f64) -> f64 {
    let a = 0.5 * edge_mm / height_mm;
    4.0 / PI * (a / a.hypot(1.0)) * (a / a.hypot(1.0)).atan()
}

fn benches() -> Vec<Bench> {
    let (up, side) = (DVec3::Z, DVec3::X);
    let slant = DVec3::new(FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2);
    let chip = Bench::new("flat-chip");
    let closed_form = square_overhead(1.0, 1.0);
    assert!((irradiance(&chip.source, DVec3::Z, -up) / closed_form - 1.0).abs() < 1e-3, "the judge is wrong");
    let area_mm2 = chip.outcome.model.hull.total_area_mm2();
    let chip = chip
        .lumens("luminous flux, by the file's spectrum", 1e-6)
        .row("area of the surface", "mm²", 1.0, area_mm2, 0.05)
        .intensity("intensity on the axis", up, 0.02)
        .intensity("intensity at 45°", slant, 0.02)
        .irradiance("irradiance 1 mm above", DVec3::Z, -up, 0.02);
    let four = Bench::new("four-chips")
        .lumens("luminous flux, by each ray's wavelength", 0.005)
        .flux_within("flux of the red chip", |at| at.x > 0.0 && at.y > 0.0, 0.7, 0.01)
        .intensity("intensity on the axis", up, 0.02)
        .irradiance("irradiance 0.5 mm above the red chip", DVec3::new(0.6, 0.6, 0.5), -up, 0.03);
    let cylinder = Bench::new("cylinder")
        .flux_within("flux of its upper half", |at| at.z > 2.0, 1.0, 0.03)
        .intensity_around("intensity to the side, mean all round", 0.02)
        .irradiance("irradiance 1 mm off its side", DVec3::new(1.5, 0.0, 2.0), -side, 0.1);
    // Every point of the dome looks another way; the light is put on a sphere within, where it looks nearly the same way everywhere.
    let dome = Bench::new("dome")
        .intensity("intensity on the axis", up, 0.02)
        .irradiance("irradiance 6 mm above", DVec3::new(0.0, 0.0, 7.5), -up, 0.05)
        .irradiance("irradiance 0.5 mm above", DVec3::new(0.0, 0.0, 2.0), -up, 0.75);
    // The file shows a box of 6 mm; the light comes from a chip of 1 mm within.
    let boxed = Bench::new("boxed-chip").intensity("intensity on the axis", up, 0.02).irradiance(
        "irradiance 1 mm above the chip",
        DVec3::new(-0.6, 0.8, 0.6),
        -up,
        0.03,
    );
    let above =
        |name: &str, what: &'static str, point_mm: DVec3| Bench::new(name).irradiance(what, point_mm, -up, 0.03);
    let on_axis = |name: &str| Bench::new(name).intensity("intensity on the axis", up, 0.02);
    vec![
        chip,
        four,
        cylinder,
        dome,
        boxed,
        above("lit-sides", "irradiance 1 mm above", DVec3::new(0.0, 0.0, 1.3)),
        above("opaque-ball", "irradiance 1 mm off it", DVec3::new(0.0, 0.0, 1.5)),
        above("absorbing-ball", "irradiance 1 mm off it", DVec3::new(0.0, 0.0, 1.5)),
        above("aspheric-dome", "irradiance 1 mm above", DVec3::new(0.0, 0.0, 2.7)),
        above("beside-ring", "irradiance 1 mm above the ring", DVec3::new(1.4, 0.2, 1.0)),
        on_axis("narrow-beam"),
        on_axis("collimated"),
    ]
}

/// What each model's verification says: how far a model of a part of the rays, and these rays themselves, are from up to a million others.
fn proof(benches: &[Bench]) -> String {
    let views = [View::Plane(0.1), View::Plane(0.5), View::Plane(2.0), View::Plane(10.0), View::FarField];
    let mut text = String::from(
        "| known source | rays | at 0.1 sizes: model, rays | at 0.5 sizes | at 2 sizes | at 10 sizes | far field |\n\
         |---|---:|---:|---:|---:|---:|---:|\n",
    );
    for bench in benches {
        let cells: Vec<String> = views.iter().map(|view| told(bench.figure(view))).collect();
        let rays = bench.outcome.model.study.as_ref().unwrap().training_rays;
        text += &format!("| {} | {rays} | {} |\n", bench.source.name, cells.join(" | "));
    }
    text
}

/// One number of each source that is known, and how far its light at half a size from it is from other rays.
fn summary(benches: &[Bench]) -> String {
    let mut text = String::from(
        "| known source | what | exact | ours | error | half a size in front: model, rays |\n|---|---|---:|---:|---:|---:|\n",
    );
    for bench in benches {
        let row = bench.rows.last().unwrap();
        let near = told(bench.figure(&View::Plane(0.5)));
        text += &format!("{} {near} |\n", row.cells());
    }
    text
}

fn told(figure: &Figure) -> String {
    let rays = 100.0 * figure.rays;
    if figure.model > figure.noise {
        format!("{:.1} %, {rays:.1} %", 100.0 * figure.model)
    } else {
        format!("< {:.1} %, {rays:.1} %", 100.0 * figure.noise)
    }
}

fn table(rows: &[&Row]) -> String {
    let mut text = String::from("| known source | what | exact | ours | error |\n|---|---|---:|---:|---:|\n");
    for row in rows {
        text += &row.cells();
        text += "\n";
    }
    text
}

/// Four significant digits.
fn digits(value: f64) -> String {
    format!("{value:.*}", (3.0 - value.log10().floor()).max(0.0) as usize)
}

/// Compares the table between the marks of a page with what was `made`, or writes it there.
fn keep(page: &str, made: &str) {
    let text = std::fs::read_to_string(page).unwrap();
    let (before, rest) = text.split_once(BEGIN).unwrap();
    let (found, after) = rest.split_once(END).unwrap();
    if std::env::var_os("WRITE_README").is_some() {
        std::fs::write(page, [before, BEGIN, made, END, after].concat()).unwrap();
    } else {
        assert_eq!(found, made, "{page} tells other numbers; write them anew with WRITE_README=1");
    }
}

#[test]
fn known_sources_come_back_and_the_readme_says_how_well() {
    let benches = benches();
    let rows: Vec<&Row> = benches.iter().flat_map(|bench| &bench.rows).collect();
    let all = table(&rows) + "\n" + &proof(&benches);
    println!("{all}");
    for row in &rows {
        let error = (row.ours / row.exact - 1.0).abs();
        assert!(error <= row.within, "{}, {}: {error:.4} off, {} allowed", row.source, row.what, row.within);
    }
    for bench in &benches {
        for figure in &bench.outcome.model.study.as_ref().unwrap().figures {
            assert!(!figure.is_worse_than_rays(), "{}, {}: worse than its rays", bench.source.name, figure.view);
        }
    }
    keep(README, &summary(&benches));
    keep(PAGE, &all);
}
