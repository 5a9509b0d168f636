//! What the files of the adapters hold, against what is known of the sources. That renderers find the same light in them, `tests/judges` shows.

use super::models::{Way, made};
use super::read_back::read_back;
use glam::DVec3;
use pipeline::adapters::{Adapted, Renderer, adapt};
use pipeline::artifacts::read::StoredModel;
use pipeline::evaluation::Kind;
use pipeline::known_sources::by_name;
use pipeline::{Declared, Input, Limits, NoProgress, Options, read_model, run};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::Arc;

/// Lumens of a W of white light in Radiance, and what it takes of red, green and blue for its luminance (its `color.h`).
const LM_PER_W: f64 = 179.0;
const LUMINANCE: [f64; 3] = [0.265, 0.670, 0.065];

fn model(name: &str) -> StoredModel {
    read_back(&made(name, 40_000, Way::Default))
}

fn text(adapted: &Adapted, name: &str) -> String {
    let file = adapted.files.iter().find(|file| file.name == name).unwrap();
    String::from_utf8(file.bytes.clone()).unwrap()
}

/// A primitive of a Radiance file.
struct Primitive {
    modifier: String,
    kind: String,
    name: String,
    words: Vec<String>,
    numbers: Vec<f64>,
}

fn primitives(text: &str) -> Vec<Primitive> {
    let mut words =
        text.lines().filter(|line| !line.starts_with('#')).flat_map(str::split_whitespace).map(str::to_owned);
    let mut found = Vec::new();
    while let (Some(modifier), Some(kind), Some(name)) = (words.next(), words.next(), words.next()) {
        let mut next = || {
            let count: usize = words.next().unwrap().parse().unwrap();
            words.by_ref().take(count).collect::<Vec<String>>()
        };
        let [words, whole, numbers] = [next(), next(), next()];
        assert!(whole.is_empty());
        let numbers = numbers.iter().map(|number| number.parse().unwrap()).collect();
        found.push(Primitive { modifier, kind, name, words, numbers });
    }
    found
}

fn brightness(rgb: &[f64]) -> f64 {
    rgb.iter().zip(LUMINANCE).map(|(part, weight)| part * weight).sum()
}

/// Place and flux of each sphere, in red, green and blue, W. Radiance lets no light through one to another: together they are to hide next to nothing of
/// the sources, which are 1 mm² and more.
fn spheres(adapted: &Adapted) -> Vec<(DVec3, [f64; 3])> {
    let (mut radiance, mut spheres, mut hidden_m2) = (Vec::new(), Vec::new(), 0.0);
    for Primitive { kind, numbers, .. } in primitives(&text(adapted, "light.rad")) {
        match kind.as_str() {
            "illum" => radiance.clone_from(&numbers),
            "sphere" => {
                let section_m2 = PI * numbers[3] * numbers[3] * 1e-6;
                let flux = [0, 1, 2].map(|part| radiance[part] * section_m2);
                hidden_m2 += section_m2;
                spheres.push((DVec3::from_slice(&numbers), flux));
            }
            _ => assert_eq!(kind, "brightdata"),
        }
    }
    assert!(hidden_m2 < 5e-3 * 1e-6, "{hidden_m2}");
    spheres
}

/// The flux that the seen triangles show: radiance over the cosine integrates to it, because distributions integrate to 1.
fn seen_w(adapted: &Adapted) -> f64 {
    let (mut glows, mut materials) = (BTreeMap::<String, f64>::new(), BTreeMap::<String, f64>::new());
    let mut sum = 0.0;
    for Primitive { modifier, kind, name, words, numbers } in primitives(&text(adapted, "seen.rad")) {
        match kind.as_str() {
            "glow" => {
                assert_eq!(numbers[3], -1.0, "what is seen lights nothing");
                glows.insert(name, brightness(&numbers));
            }
            "mixfunc" => {
                let rest = materials.get(&words[1]).copied().unwrap_or_default();
                assert!(words[1] == "void" || rest > 0.0, "{name} names what comes later");
                materials.insert(name, numbers[0] * glows[&words[0]] + (1.0 - numbers[0]) * rest);
            }
            "polygon" => {
                let [a, b, c] = [0, 3, 6].map(|at| DVec3::from_slice(&numbers[at..]));
                sum += materials[&modifier] * 0.5 * (b - a).cross(c - a).length() * 1e-6;
            }
            _ => assert_eq!(kind, "brightdata"),
        }
    }
    sum
}

/// Sources and seen triangles have the flux of the source each; colours do not change it. The chip at +X+Y is red, that at -X-Y blue.
#[test]
fn radiance_files_hold_the_flux_once_to_light_and_once_to_be_seen() {
    let source = by_name("four-chips").unwrap();
    let model = model("four-chips");
    for (kind, flux) in [
        (None, source.luminous_lm()),
        (Some(Kind::Luminous), source.luminous_lm()),
        (Some(Kind::Radiant), source.radiant_w() * LM_PER_W),
    ] {
        let adapted = adapt(&model, Renderer::Radiance, kind).unwrap();
        assert_eq!(adapted.kind, kind.unwrap_or(Kind::Color));
        let spheres = spheres(&adapted);
        assert!((900..1100).contains(&spheres.len()), "{}", spheres.len());
        let sum = LM_PER_W * spheres.iter().map(|(_, flux)| brightness(flux)).sum::<f64>();
        assert!((sum / flux - 1.0).abs() < 0.005, "{kind:?}: {sum} of {flux}");
        let seen = LM_PER_W * seen_w(&adapted);
        assert!((seen / flux - 1.0).abs() < 0.005, "{kind:?}: {seen} of {flux}");
        for (place, [r, _, b]) in spheres.into_iter().filter(|_| kind.is_none()) {
            assert!(place.x.min(place.y) < 0.0 || r > 5.0 * b, "{place}: {r} {b}");
            assert!(place.x.max(place.y) > 0.0 || b > 5.0 * r, "{place}: {r} {b}");
        }
    }
}

/// Of the dome's many zones too; and the data file has a distribution for each.
#[test]
fn zones_are_mixed_and_each_has_its_distribution() {
    let source = by_name("dome").unwrap();
    let adapted = adapt(&model("dome"), Renderer::Radiance, Some(Kind::Luminous)).unwrap();
    assert!(adapted.zones > 10);
    let light = LM_PER_W * spheres(&adapted).iter().map(|(_, flux)| brightness(flux)).sum::<f64>();
    assert!((light / source.luminous_lm() - 1.0).abs() < 0.005, "{light}");
    let seen = LM_PER_W * seen_w(&adapted);
    assert!((seen / source.luminous_lm() - 1.0).abs() < 0.005, "{seen}");
    let data = text(&adapted, "lampwright.dat");
    let numbers: Vec<f64> = data.split_whitespace().map(|number| number.parse().unwrap()).collect();
    // Three axes: zones from 0, C to 360, the nodes of gamma one by one.
    let (zones, planes, nodes) = (numbers[3] as usize, numbers[6] as usize, numbers[9] as usize);
    assert_eq!(numbers[..3], [3.0, 0.0, zones as f64 - 1.0]);
    assert_eq!((zones, numbers[4], numbers[5]), (adapted.zones, 0.0, 360.0));
    assert_eq!(numbers.len(), 10 + nodes + zones * planes * nodes);
    let gamma: Vec<f64> = numbers[10..10 + nodes].iter().map(|degrees| degrees.to_radians()).collect();
    for distribution in numbers[10 + nodes..].chunks_exact(planes * nodes) {
        // The trapezoidal rule over steps of some degrees.
        let ring = |plane: usize| -> f64 {
            let at = |node: usize| distribution[plane * nodes + node] * gamma[node].sin();
            (1..nodes).map(|node| 0.5 * (at(node) + at(node - 1)) * (gamma[node] - gamma[node - 1])).sum()
        };
        let integral: f64 = (1..planes).map(|plane| ring(plane) * 2.0 * PI / (planes - 1) as f64).sum();
        assert!((integral - 1.0).abs() < 0.02, "{integral}");
        assert_eq!(distribution[..nodes], distribution[(planes - 1) * nodes..]);
    }
}

/// The texture coordinates of a corner name its triangle: a unit square each.
#[test]
fn the_texture_coordinates_of_the_surface_number_its_triangles() {
    let adapted = adapt(&model("flat-chip"), Renderer::Mitsuba, None).unwrap();
    let ply = &adapted.files.iter().find(|file| file.name == "surface.ply").unwrap().bytes;
    let end = ply.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
    let count = adapted.triangles;
    assert_eq!(ply.len() - end, count * (3 * 20 + 13));
    let side = (count as f64).sqrt().ceil() as usize;
    let numbers: Vec<f32> =
        ply[end..][..count * 60].chunks_exact(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect();
    for (corner, place) in numbers.chunks_exact(5).enumerate() {
        let [u, v] = [place[3], place[4]];
        assert_eq!(u.floor() as usize + side * v.floor() as usize, corner / 3);
        let wanted = [[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]][corner % 3];
        assert!((u.fract() - wanted[0]).abs() < 1e-4 && (v.fract() - wanted[1]).abs() < 1e-4);
    }
}

/// The surface stands for a volume, whatever the renderer.
#[test]
fn a_volume_is_written_as_its_hull() {
    let volume = model("cylinder");
    for renderer in Renderer::ALL {
        let adapted = adapt(&volume, renderer, None).unwrap();
        assert!(adapted.stands_for_volume && adapted.triangles > 100, "{}", renderer.name());
    }
    let flux = LM_PER_W * seen_w(&adapt(&volume, Renderer::Radiance, None).unwrap());
    assert!((flux / by_name("cylinder").unwrap().luminous_lm() - 1.0).abs() < 0.005, "{flux}");
}

#[test]
fn light_that_the_model_does_not_know_is_told() {
    let code = |model: &StoredModel, kind| adapt(model, Renderer::Blender, Some(kind)).unwrap_err().code();
    assert_eq!(code(&model("flat-chip"), Kind::Spectrum), "adapter.light");
    // Without a wavelength in the header nobody knows lumens.
    let mut bytes = support::rays::zemax(3000);
    bytes[116..120].fill(0);
    let input = Input {
        name: "watts".into(),
        sha256: "0".repeat(64),
        bytes: Arc::new(bytes),
        declared: Declared::default(),
        notices: Vec::new(),
    };
    let outcome = run(&[input], &Options::default(), &Limits::default(), &NoProgress).unwrap();
    let file = |name: &str| &outcome.artifacts.iter().find(|artifact| artifact.name == name).unwrap().bytes;
    let radiant = read_model(file("emitter.glb"), file("goniograms.json"), &Limits::default()).unwrap();
    assert_eq!(code(&radiant, Kind::Color), "adapter.unknown_light");
    let adapted = adapt(&radiant, Renderer::Blender, None).unwrap();
    assert_eq!((adapted.kind, adapted.unit), (Kind::Radiant, "W/(m2 sr)"));
}
