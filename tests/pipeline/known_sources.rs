//! Known sources through the whole pipeline, against their closed forms.
//!
//! Rays of a known source all carry the same flux, so flux is a count and its error is known. One million rays each; smoothing
//! is off where statistics are tested, because it makes neighbouring cells share their noise.

use super::models::{Way, made, unsmoothed};
use pipeline::goniogram::{Goniogram, SphereGrid};
use pipeline::known_sources::shape::Shape;
use pipeline::known_sources::{KnownSource, all, by_name, write_tm25};
use pipeline::model::Model;
use pipeline::options::Zones;
use pipeline::vocabulary::space::{Axis, Frame};
use pipeline::{Artifact, Declared, Error, Input, Limits, NoProgress, Options, Outcome, run};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use support::statistics::{ALARM_Z, cell_mean, chi_square_z};

const RAYS: u64 = 1_000_000;
/// Rays of sources that are turned, which are the same rays turned: none of it is judged by statistics.
const TURNED_RAYS: u64 = 150_000;

/// The model of `rays` rays of a known source.
pub fn built(source: &KnownSource, rays: u64, options: &Options) -> Result<Outcome, Error> {
    built_of(source, file(source, rays), options)
}

fn file(source: &KnownSource, rays: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_tm25(source, rays, 7, &mut bytes).unwrap();
    bytes
}

fn built_of(source: &KnownSource, bytes: Vec<u8>, options: &Options) -> Result<Outcome, Error> {
    let input = Input {
        name: source.name.into(),
        sha256: "0".repeat(64),
        bytes: Arc::new(bytes),
        declared: Declared::default(),
        notices: Vec::new(),
    };
    run(&[input], options, &Limits::default(), &NoProgress)
}

fn outcome(source: &KnownSource, rays: u64, options: &Options) -> Outcome {
    built(source, rays, options).unwrap()
}

/// Rays counted in each cell, from intensities of rays of equal flux.
fn counts(goniogram: &Goniogram, grid: &SphereGrid, flux_per_ray_w: f64) -> Vec<f64> {
    let nodes = goniogram.radiant_w_per_sr.as_ref().unwrap();
    let solid_angles_sr = grid.cell_solid_angles_sr();
    let mut cells = vec![0.0; grid.cell_count()];
    for c in 0..grid.c_planes() {
        for gamma in 0..grid.gamma_nodes() {
            let cell = grid.cell_of_node(c, gamma);
            cells[cell] = nodes[c * grid.gamma_nodes() + gamma] * solid_angles_sr[cell] / flux_per_ray_w;
        }
    }
    cells
}

/// Rays expected in each cell for `rays` rays that leave as `share_per_sr(direction angles C, γ)` says.
fn expected(grid: &SphereGrid, rays: f64, share_per_sr: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    let (c_step, gamma_step) = (TAU / grid.c_planes() as f64, PI / (grid.gamma_nodes() - 1) as f64);
    let cell = |((c, gamma), solid_angle): ((f64, f64), f64)| {
        let pole = gamma == 0.0 || gamma == PI;
        rays * solid_angle * cell_mean(c, gamma, if pole { TAU } else { c_step }, gamma_step, &share_per_sr)
    };
    grid.cell_nodes().into_iter().zip(grid.cell_solid_angles_sr()).map(cell).collect()
}

fn judge(what: &str, counted: &[f64], expected: &[f64]) {
    let (z, cells) = chi_square_z(counted, expected);
    println!("{what}: {cells} cells, z = {z:.2}");
    assert!(z < ALARM_Z, "{what}: {cells} cells, z = {z:.2}");
}

/// Every ray once, every watt to rounding, the hull sound, nothing rejected.
fn check_books(source: &KnownSource, model: &Model) {
    let balance = &model.surface.balance;
    assert!(balance.every_ray_once(), "{}: {balance:?}", source.name);
    assert!(balance.error() < 1e-9, "{}: balance off by {:e}", source.name, balance.error());
    assert!(balance.rejected.rays as f64 <= 0.005 * RAYS as f64, "{}: {} rejected", source.name, balance.rejected.rays);
    assert_eq!(model.hull.check(), [], "{}", source.name);
    let zones: f64 = model.goniograms.zones.iter().map(|zone| zone.goniogram.flux.radiant_w.unwrap()).sum();
    assert!((zones / balance.on_vertices.radiant_w.unwrap() - 1.0).abs() < 1e-9);
    assert!((model.flux.radiant_w.unwrap() / source.radiant_w() - 1.0).abs() < 1e-6);
    let lumen_error = model.flux.luminous_lm.unwrap() / source.luminous_lm() - 1.0;
    assert!(lumen_error.abs() < 0.005, "{}: lm off by {lumen_error}", source.name);
}

/// The distribution of the whole source over the angular grid is the closed form's, within counting statistics.
#[test]
fn far_field_of_every_known_source_is_the_closed_form() {
    for source in all().into_iter().filter(KnownSource::shows_itself) {
        let outcome = made(source.name, RAYS, Way::Unsmoothed);
        let model = &outcome.model;
        check_books(&source, model);
        let (grid, frame) = (&model.goniograms.grid, model.goniograms.frame);
        let share = |c: f64, gamma: f64| source.intensity_w_per_sr(frame.direction(c, gamma)) / source.radiant_w();
        let per_ray = source.radiant_w() / RAYS as f64;
        judge(source.name, &counts(&model.goniograms.total, grid, per_ray), &expected(grid, RAYS as f64, share));
        spectra_sum_to_the_sources(&source, model);
    }
}

/// Spectra of the vertices sum to the source's spectrum: per band within counting statistics, in total to rounding.
fn spectra_sum_to_the_sources(source: &KnownSource, model: &Model) {
    let bands = &model.spectral.bands;
    let mut watt = vec![0.0; bands.len()];
    for vertex in 0..model.hull.vertices_mm.len() {
        let spectrum = model.vertex_spectrum_w_per_nm(vertex);
        watt.iter_mut().zip(spectrum).zip(bands.widths_nm()).for_each(|((sum, value), width)| *sum += value * width);
    }
    let total: f64 = watt.iter().sum();
    assert!(
        (total / model.surface.balance.on_vertices.radiant_w.unwrap() - 1.0).abs() < 1e-9,
        "{}: {total} W",
        source.name
    );
    let per_ray = source.radiant_w() / RAYS as f64;
    let rays = |watt: &[f64]| watt.iter().map(|watt| watt / per_ray).collect::<Vec<f64>>();
    if source.has_one_spectrum() {
        // The file carries the table itself: no statistics, only the table's f32 rounding.
        watt.iter().zip(source.bands_w(bands)).for_each(|(ours, exact)| assert!((ours - exact).abs() < 1e-5 * total));
    } else {
        judge(&format!("{} spectrum", source.name), &rays(&watt), &rays(&source.bands_w(bands)));
    }
}

/// Every zone of a flat Lambertian source has the cosine distribution about the source's normal.
#[test]
fn zones_of_lambertian_sources_are_cosines() {
    for name in ["flat-chip", "four-chips", "tilted-strip", "phosphor-ring"] {
        let (source, outcome) = (by_name(name).unwrap(), made(name, RAYS, Way::Unsmoothed));
        let model = &outcome.model;
        let (grid, frame) = (&model.goniograms.grid, model.goniograms.frame);
        assert!(model.goniograms.zones.len() >= 8, "{name}: {} zones", model.goniograms.zones.len());
        let share = |c: f64, gamma: f64| source.intensity_w_per_sr(frame.direction(c, gamma)) / source.radiant_w();
        let per_ray = source.radiant_w() / RAYS as f64;
        for zone in &model.goniograms.zones {
            let counted = counts(&zone.goniogram, grid, per_ray);
            judge(&format!("{name} {}", zone.name()), &counted, &expected(grid, zone.goniogram.rays, share));
        }
    }
}

/// A uniform chip gives each zone flux in proportion to the area its vertices stand for.
#[test]
fn zones_of_a_uniform_chip_share_its_flux_by_area() {
    let (source, outcome) = (by_name("flat-chip").unwrap(), made("flat-chip", RAYS, Way::Unsmoothed));
    let model = &outcome.model;
    let area_mm2 = model.hull.total_area_mm2();
    assert!((area_mm2 / source.area_mm2() - 1.0).abs() < 1e-3, "area {area_mm2} mm²");
    let rays: Vec<f64> = model.goniograms.zones.iter().map(|zone| zone.goniogram.rays).collect();
    let by_area: Vec<f64> = model.goniograms.zones.iter().map(|zone| RAYS as f64 * zone.area_mm2 / area_mm2).collect();
    judge("flux of zones", &rays, &by_area);
    // And each vertex, with A_l a third of its triangles' areas; shared rays scatter less than counted ones.
    let vertices: Vec<f64> = model.hull.vertex_areas_mm2().iter().map(|area| RAYS as f64 * area / area_mm2).collect();
    judge("flux of vertices", &model.surface.vertices.rays, &vertices);
}

/// Under a dome, where light comes out decides where it goes: each quadrant's intensity is the integral of the exact radiance
/// over the quadrant. An odd resolution puts the quadrants' borders midway between vertices.
#[test]
fn quadrants_of_the_dome_are_the_integral_of_its_radiance() {
    let source = by_name("dome").unwrap();
    let mut options = unsmoothed();
    options.goniogram.zones = Some(Zones { columns: 2, rows: 2 });
    options.hull.resolution = Some(47);
    let model = outcome(&source, RAYS, &options).model;
    let Shape::Dome { radius_mm, .. } = source.parts()[0].shape else { panic!("the dome is a dome") };
    let (grid, frame) = (&model.goniograms.grid, model.goniograms.frame);
    for zone in &model.goniograms.zones {
        // Signs of photometric x and y in this quadrant.
        let sign = |index: usize| if index == 0 { -1.0 } else { 1.0 };
        let place = zone.place.unwrap();
        let (sx, sy) = (sign(place.column), sign(place.row));
        let share = |c: f64, gamma: f64| {
            let direction = frame.direction(c, gamma);
            let (steps, mut sum) = (24, 0.0);
            for i in 0..steps {
                // Equal areas: even steps in z and in azimuth.
                let z = (i as f64 + 0.5) / steps as f64;
                for j in 0..steps {
                    let azimuth = (j as f64 + 0.5) / steps as f64 * 0.5 * PI;
                    let across = (1.0 - z * z).sqrt();
                    let normal = sx * across * azimuth.cos() * frame.x() + sy * across * azimuth.sin() * frame.y()
                        - z * frame.z();
                    let cosine = normal.dot(direction);
                    if cosine > 0.0 {
                        sum += source.radiance_w_per_mm2_sr(radius_mm * normal, direction) * cosine;
                    }
                }
            }
            sum / (steps * steps) as f64 * 0.5 * PI * radius_mm * radius_mm / source.radiant_w()
        };
        let counted = counts(&zone.goniogram, grid, source.radiant_w() / RAYS as f64);
        let exact = expected(grid, RAYS as f64, share);
        // Systematic: the border is as wide as a cell and the quadrature coarse at the cone's edge; judged as L2 beside noise.
        let (mut square, mut norm, mut noise) = (0.0, 0.0, 0.0);
        for (n, mu) in counted.iter().zip(&exact) {
            square += (n - mu).powi(2);
            noise += mu;
            norm += mu * mu;
        }
        let error = ((square - noise).max(0.0) / norm).sqrt();
        println!("dome quadrant {}: L2 error {error:.4} beside noise {:.4}", zone.name(), (noise / norm).sqrt());
        assert!(error < 0.02, "quadrant {}: {error}", zone.name());
    }
}

/// The halves of a glowing cylinder mirror each other, and together they shine evenly.
#[test]
fn halves_of_the_cylinder_mirror_each_other() {
    let source = by_name("cylinder").unwrap();
    let mut options = unsmoothed();
    options.goniogram.nadir_axis = Some(Axis::PosX);
    options.goniogram.c0_axis = Some(Axis::PosZ);
    options.goniogram.zones = Some(Zones { columns: 2, rows: 1 });
    options.hull.resolution = Some(47);
    let model = outcome(&source, RAYS, &options).model;
    assert_eq!(model.hull.boundary_edges(), 0, "a glowing volume has a closed hull");
    let grid = &model.goniograms.grid;
    let per_ray = source.radiant_w() / RAYS as f64;
    let halves: Vec<Vec<f64>> =
        model.goniograms.zones.iter().map(|zone| counts(&zone.goniogram, grid, per_ray)).collect();
    // z → −z takes C to 180° − C.
    let mirrored = |(c, gamma): (f64, f64)| grid.cell((PI - c).rem_euclid(TAU), gamma);
    let (mut lower, mut mean) = (Vec::new(), Vec::new());
    for (cell, node) in grid.cell_nodes().into_iter().enumerate() {
        let (a, b) = (halves[0][cell], halves[1][mirrored(node)]);
        // For independent a and b of one mean, (a − b)/√2 + mean scatters like a count about that mean.
        mean.push(0.5 * (a + b));
        lower.push(0.5 * (a + b) + (a - b) / 2f64.sqrt());
    }
    judge("cylinder halves", &lower, &mean);
    let share = |_: f64, _: f64| 1.0 / (4.0 * PI);
    let both: Vec<f64> = halves[0].iter().zip(&halves[1]).map(|(a, b)| a + b).collect();
    judge("cylinder", &both, &expected(grid, RAYS as f64, share));
}

/// Turning a source to any of the six axes turns its model: in the frame that looks along, all numbers are the same.
#[test]
fn a_turned_source_gives_a_turned_model() {
    for name in ["flat-chip", "dome", "tilted-strip"] {
        let source = by_name(name).unwrap();
        let mut options = unsmoothed();
        options.goniogram.nadir_axis = (name == "tilted-strip").then_some(Axis::PosZ);
        let upright = outcome(&source, TURNED_RAYS, &options).model;
        for axis in Axis::ALL {
            // The strip looks between two axes: which of them is nearer is chance, so it is told where to look.
            options.goniogram.nadir_axis = (name == "tilted-strip").then_some(axis);
            let turned = outcome(&source.clone().rotate(axis), TURNED_RAYS, &options).model;
            assert_eq!(turned.goniograms.frame, Frame::looking(axis), "{name} to {}", axis.name());
            let close = |a: f64, b: f64, relative: f64, what: &str| {
                assert!((a - b).abs() <= relative * b.abs(), "{name} to {}: {what} {a} {b}", axis.name());
            };
            close(turned.hull.total_area_mm2(), upright.hull.total_area_mm2(), 0.01, "area");
            let values = |model: &Model| model.goniograms.total.radiant_w_per_sr.clone().unwrap();
            let (ours, theirs) = (values(&turned), values(&upright));
            let peak = theirs.iter().copied().fold(0.0, f64::max);
            for (a, b) in ours.iter().zip(&theirs) {
                assert!((a - b).abs() <= 1e-6 * peak, "{name} to {}: intensity {a} {b}", axis.name());
            }
            assert_eq!(turned.goniograms.zones.len(), upright.goniograms.zones.len());
            for (a, b) in turned.goniograms.zones.iter().zip(&upright.goniograms.zones) {
                close(a.goniogram.flux.radiant_w.unwrap(), b.goniogram.flux.radiant_w.unwrap(), 0.1, "zone flux");
            }
        }
    }
}

/// One thread, two and five: the same bytes in every file.
#[test]
fn the_number_of_threads_changes_no_byte() {
    for name in ["four-chips", "cylinder", "dome", "boxed-chip"] {
        let source = by_name(name).unwrap();
        let with_threads = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| outcome(&source, 100_000, &Options::default()).artifacts)
        };
        let (one, two, five) = (with_threads(1), made(name, 100_000, Way::OnTwoThreads), with_threads(5));
        assert!(one.len() >= 8);
        for (threads, others) in [(2, &two.artifacts), (5, &five)] {
            assert_eq!(one.len(), others.len());
            for (a, b) in one.iter().zip(others) {
                assert!(a == b, "{name}, {threads} threads: {} differs", a.name);
            }
        }
    }
}

/// The rays the other way round, and every seventh first: the same bytes in every file of the model. (README.txt and report.json repeat
/// the inspection, which looks at the order and at a sample by the place in the file.)
#[test]
fn the_order_of_the_rays_changes_no_byte() {
    for name in ["four-chips", "cylinder", "boxed-chip"] {
        let source = by_name(name).unwrap();
        let bytes = file(&source, 100_000);
        let record = file(&source, 2).len() - file(&source, 1).len();
        let (header, rays) = bytes.split_at(bytes.len() - 100_000 * record);
        let rays: Vec<&[u8]> = rays.chunks(record).collect();
        let of_the_model = |mut artifacts: Vec<Artifact>| {
            artifacts.retain(|artifact| !["README.txt", "report.json"].contains(&artifact.name.as_str()));
            artifacts
        };
        let artifacts = |order: Vec<&[u8]>| {
            let bytes = [header, &order.concat()].concat();
            of_the_model(built_of(&source, bytes, &Options::default()).unwrap().artifacts)
        };
        let as_written = of_the_model(made(name, 100_000, Way::OnTwoThreads).artifacts.clone());
        let backwards = artifacts(rays.iter().rev().copied().collect());
        let sevenths = artifacts((0..7).flat_map(|first| rays.iter().skip(first).step_by(7).copied()).collect());
        assert_eq!([backwards.len(), sevenths.len()], [as_written.len(); 2]);
        for ((a, b), c) in as_written.iter().zip(&backwards).zip(&sevenths) {
            assert!(a == b && a == c, "{name}: {} differs", a.name);
        }
    }
}
