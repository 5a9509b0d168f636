//! What the files of the adapters hold, against what is known of the source. That renderers find the same light in them, `tests/judges` shows.

use super::colour::{RADIANCE, SRGB};
use super::*;
use crate::artifacts::read::read;
use crate::known_sources::{by_name, write_tm25};
use crate::model::light::Light;
use crate::{Declared, Input, Limits, NoProgress, Options, run};
use glam::DVec3;
use std::f64::consts::PI;
use std::sync::Arc;

const RAYS: u64 = 40_000;

fn model(name: &str) -> StoredModel {
    let mut bytes = Vec::new();
    write_tm25(&by_name(name).unwrap(), RAYS, 1, &mut bytes).unwrap();
    let (name, sha256) = (name.into(), "0".repeat(64));
    let input = Input { name, sha256, bytes: Arc::new(bytes), declared: Declared::default(), notices: Vec::new() };
    let outcome = run(&[input], &Options::default(), &Limits::default(), &NoProgress).unwrap();
    let file = |name: &str| &outcome.artifacts.iter().find(|artifact| artifact.name == name).unwrap().bytes;
    read(file("emitter.glb"), file("goniograms.json"), &Limits::default()).unwrap()
}

fn text(adapted: &Adapted, name: &str) -> String {
    let file = adapted.files.iter().find(|file| file.name == name).unwrap();
    String::from_utf8(file.bytes.clone()).unwrap()
}

/// Primitives of a Radiance file: modifier, type, and the numbers of the last line.
fn primitives(text: &str) -> Vec<(String, String, Vec<f64>)> {
    let words = text.lines().filter(|line| !line.starts_with('#')).flat_map(str::split_whitespace);
    let mut words = words.map(str::to_owned);
    let mut found = Vec::new();
    while let (Some(modifier), Some(kind), Some(_)) = (words.next(), words.next(), words.next()) {
        let mut next = || -> Vec<String> {
            let count: usize = words.next().unwrap().parse().unwrap();
            words.by_ref().take(count).collect()
        };
        let [_, _, numbers] = [next(), next(), next()];
        found.push((modifier, kind, numbers.iter().map(|number| number.parse().unwrap()).collect()));
    }
    found
}

fn brightness(rgb: &[f64], primaries: &colour::Primaries) -> f64 {
    rgb.iter().zip(primaries.luminance).map(|(part, weight)| part * weight).sum()
}

/// The chips have 0.9, 0.3, 0.5 and 0.7 W; together their known flux in lm, which colours do not change.
#[test]
fn the_light_of_four_chips_is_theirs_in_every_kind() {
    let source = by_name("four-chips").unwrap();
    let model = model("four-chips");
    for (kind, flux) in [
        (None, source.luminous_lm()),
        (Some(Kind::Luminous), source.luminous_lm()),
        (Some(Kind::Radiant), source.radiant_w()),
    ] {
        let surface = Surface::new(&model, kind).unwrap();
        assert_eq!(surface.kind, kind.unwrap_or(Kind::Color));
        let areas_mm2 = surface.light.mesh.vertex_areas_mm2();
        for primaries in [&SRGB, &RADIANCE] {
            let rgb = surface.rgb(primaries);
            let sum: f64 = rgb.iter().zip(&areas_mm2).map(|(rgb, area)| brightness(rgb, primaries) * area * 1e-6).sum();
            assert!((sum / flux - 1.0).abs() < 0.005, "{kind:?}: {sum} of {flux}");
            // The chip at +X+Y is red, that at -X-Y blue.
            for (vertex, place) in surface.light.mesh.vertices_mm.iter().enumerate().filter(|_| kind.is_none()) {
                let [r, _, b] = rgb[vertex];
                assert!(place.x.min(place.y) < 0.3 || r > 10.0 * b, "{place}: {:?}", rgb[vertex]);
                assert!(place.x.max(place.y) > -0.3 || b > 10.0 * r, "{place}: {:?}", rgb[vertex]);
            }
        }
    }
}

/// Of a Lambertian chip each direction has cos γ / π.
#[test]
fn distributions_are_normalised_whatever_the_quantity() {
    let model = model("flat-chip");
    for kind in [Kind::Luminous, Kind::Radiant] {
        let surface = Surface::new(&model, Some(kind)).unwrap();
        let [q] = &surface.distributions[..] else { panic!("one zone") };
        assert!((surface.light.grid.integral(q) - 1.0).abs() < 1e-12);
        for degrees in [0.0_f64, 30.0, 60.0] {
            let found = surface.light.grid.interpolate(q, 1.0, degrees.to_radians());
            assert!((found * PI / degrees.to_radians().cos() - 1.0).abs() < 0.05, "{degrees}: {found}");
        }
    }
}

/// Sources and seen triangles of Radiance have the flux of the source each, W by 179 lm, and as many zones as the data file.
#[test]
fn radiance_files_hold_the_flux_twice_once_to_light_and_once_to_be_seen() {
    let source = by_name("dome").unwrap();
    let adapted = adapt(&model("dome"), Renderer::Radiance, None).unwrap();
    let light = primitives(&text(&adapted, "light.rad"));
    let (mut radiance, mut flux, mut spheres) = (Vec::new(), 0.0, 0);
    for (_, kind, numbers) in &light {
        match kind.as_str() {
            "illum" => radiance.clone_from(numbers),
            "sphere" => {
                flux += 179.0 * brightness(&radiance, &RADIANCE) * PI * numbers[3] * numbers[3] * 1e-6;
                spheres += 1;
            }
            _ => assert_eq!(kind, "brightdata"),
        }
    }
    assert!((flux / source.luminous_lm() - 1.0).abs() < 0.01, "{flux}");
    assert!((700..1400).contains(&spheres), "{spheres}");
    // Each material is a glow and then the mixture that takes it; polygons follow.
    let (mut glows, mut seen, mut last) = (Vec::new(), 0.0, Vec::new());
    for (modifier, kind, numbers) in primitives(&text(&adapted, "seen.rad")) {
        match kind.as_str() {
            "glow" => last = numbers,
            "mixfunc" => glows.push(last.clone()),
            "polygon" => {
                let [a, b, c] = [0, 3, 6].map(|at| DVec3::from_slice(&numbers[at..]));
                let glow = &glows[modifier.strip_prefix("lw_m").unwrap().parse::<usize>().unwrap()];
                assert_eq!(glow[3], -1.0, "what is seen lights nothing");
                seen += 179.0 * brightness(glow, &RADIANCE) * 1e-4 * 0.5 * (b - a).cross(c - a).length() * 1e-6;
            }
            _ => assert_eq!(kind, "brightdata"),
        }
    }
    assert!((seen / source.luminous_lm() - 1.0).abs() < 0.01, "{seen}");
    let data = text(&adapted, "lampwright.dat");
    let mut lines = data.lines();
    assert_eq!(lines.next(), Some("3"));
    assert_eq!(lines.next(), Some(format!("0 {} {}", adapted.zones - 1, adapted.zones).as_str()));
    let cal = text(&adapted, "lampwright.cal");
    assert!(cal.contains("lw_z = (Dx*0 + Dy*0 + Dz*-1);") || cal.contains("lw_z = (Dx*-0 + Dy*-0 + Dz*-1);"), "{cal}");
}

/// The texture coordinates of a corner name its triangle: a unit square each, in rows of as many as there are rows.
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

#[test]
fn a_light_that_cannot_be_is_told() {
    let model = model("flat-chip");
    let code = |kind| adapt(&model, Renderer::Blender, Some(kind)).unwrap_err().code();
    assert_eq!(code(Kind::Spectrum), "adapter.light");
    let mut light = Light::from(&model);
    let none = crate::flux::Amounts { luminous_lm: Some(vec![0.0; light.vertices.len()]), ..light.vertices.clone() };
    light.vertices = &none;
    assert_eq!(Surface::new(light.clone(), None).unwrap().kind, Kind::Radiant);
    let dark = |kind| Surface::new(light.clone(), Some(kind)).map(|_| ()).unwrap_err().code();
    assert_eq!(dark(Kind::Luminous), "adapter.dark");
    let unknown = crate::flux::Amounts { luminous_lm: None, ..none.clone() };
    light.vertices = &unknown;
    let code = Surface::new(light, Some(Kind::Color)).map(|_| ()).unwrap_err().code();
    assert_eq!(code, "adapter.unknown_light");
}
