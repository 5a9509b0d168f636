//! Models changed and combined, judged by their evaluations: light adds up, and a turned model sends what the model sends, turned.

use super::known_sources::built;
use glam::{DMat3, DVec3};
use pipeline::artifacts::read::{StoredModel, read};
use pipeline::artifacts::{gltf, goniograms, ies, report};
use pipeline::evaluation::{Kind, Plane, Request, View, evaluate};
use pipeline::known_sources::by_name;
use pipeline::vocabulary::watch::StageWatch;
use pipeline::{
    Artifact, Change, Component, Emission, Error, Limits, NoProgress, Options, Outcome, Stage, Strength, Table, Total,
    Turn, combine,
};
use serde_json::Value;

const RAYS: u64 = 20_000;

fn bytes<'a>(artifacts: &'a [Artifact], name: &str) -> &'a [u8] {
    &artifacts.iter().find(|artifact| artifact.name == name).unwrap().bytes
}

/// The model of a known source, as a component that is not changed.
fn component(name: &str, options: &Options) -> Component {
    of(&built(&by_name(name).unwrap(), RAYS, options).unwrap())
}

fn of(outcome: &Outcome) -> Component {
    Component {
        emitter: bytes(&outcome.artifacts, gltf::NAME).to_vec(),
        goniograms: bytes(&outcome.artifacts, goniograms::NAME).to_vec(),
        ..Component::default()
    }
}

fn changed(component: &Component, change: Change) -> Component {
    Component { change, ..component.clone() }
}

fn turned(component: &Component, axis: DVec3, degrees: f64, move_mm: DVec3) -> Component {
    changed(component, Change { turns: vec![Turn { axis, degrees }], move_mm, ..Change::default() })
}

fn combined(components: &[Component]) -> Result<Outcome, Error> {
    combine(components, &Options::default(), &Limits::default(), &NoProgress)
}

fn stored(component: &Component) -> StoredModel {
    read(&component.emitter, &component.goniograms, &Limits::default()).unwrap()
}

/// Values and bounds of each channel.
fn values(model: &StoredModel, view: View, kind: Kind) -> Vec<(f64, f64)> {
    let request = Request { kind: Some(kind), ..Request::of(view) };
    let watch = StageWatch::enter(&NoProgress, Stage::Model).unwrap();
    let answer = evaluate(model, "", &request, watch).unwrap();
    // X, Y and Z add up; chromaticities, which follow them, do not.
    let channels = if kind == Kind::Color { &answer.channels[..3] } else { &answer.channels[..] };
    channels.iter().flat_map(|own| own.values.iter().copied().zip(own.bounds.iter().copied())).collect()
}

fn plane(center_mm: DVec3, normal: DVec3, up: DVec3) -> View {
    let side = 3.0;
    let (normal, up) = (Some(normal), Some(up));
    View::Plane(Plane { center_mm, normal, up, width_mm: side, height_mm: side, columns: 2, rows: 2 })
}

/// 100 directions, even over the sphere.
fn directions() -> Vec<DVec3> {
    let direction = |k: i32| {
        let z = 1.0 - (2.0 * f64::from(k) + 1.0) / 100.0;
        let turn = f64::from(k) * 2.399_963_229_728_653;
        DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z)
    };
    (0..100).map(direction).collect()
}

fn total_flux(model: &StoredModel) -> [f64; 2] {
    use pipeline::model::evaluation::{Evaluator, Quantity};
    [Quantity::Radiant, Quantity::Luminous].map(|quantity| Evaluator::new(model, quantity).unwrap().flux())
}

/// `found` is `expected` to `part` of the largest of them, and what the bounds leave open.
fn assert_same(what: &str, found: &[(f64, f64)], expected: &[(f64, f64)], part: f64) {
    assert!(!found.is_empty() && found.len() == expected.len(), "{what}");
    let largest = expected.iter().map(|(value, _)| *value).fold(0.0, f64::max);
    assert!(largest > 0.0, "{what} is dark");
    for ((found, bound), (expected, other)) in found.iter().zip(expected) {
        assert!((found - expected).abs() <= part * largest + bound + other, "{what}: {found}, expected {expected}");
    }
}

fn document(glb: &[u8]) -> (Value, &[u8]) {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    (serde_json::from_slice(&glb[20..20 + length]).unwrap(), &glb[28 + length..])
}

/// The words of an accessor, tightly packed as the writer has them.
fn words(document: &Value, binary: &[u8], accessor: &Value) -> Vec<u32> {
    let number = |value: &Value| value.as_u64().unwrap_or(0) as usize;
    let accessor = &document["accessors"][number(accessor)];
    let view = &document["bufferViews"][number(&accessor["bufferView"])];
    let start = number(&view["byteOffset"]) + number(&accessor["byteOffset"]);
    let width = match accessor["type"].as_str().unwrap() {
        "SCALAR" => 1,
        "VEC3" => 3,
        _ => 4,
    };
    let bytes = &binary[start..][..4 * width * number(&accessor["count"])];
    bytes.chunks_exact(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect()
}

/// The same vertices, triangles, zones, fluxes and spectra bit by bit; what is found from these (normals, colours) and weights, which are
/// made to sum to 1 when they are read, to the rounding of floats.
fn assert_same_places(name: &str, before: &[u8], after: &[u8]) {
    let [(before, old), (after, new)] = [document(before), document(after)];
    let mut compared = 0;
    for primitive in 0..before["meshes"][0]["primitives"].as_array().unwrap().len() {
        let [one, other] = [&before, &after].map(|document| &document["meshes"][0]["primitives"][primitive]);
        if !one["indices"].is_null() {
            assert!(words(&before, old, &one["indices"]) == words(&after, new, &other["indices"]), "{name}: indices");
        }
        for (attribute, accessor) in one["attributes"].as_object().unwrap() {
            let [a, b] = [words(&before, old, accessor), words(&after, new, &other["attributes"][attribute])];
            let is_found = ["NORMAL", "COLOR_0", "_ZONE_WEIGHTS"].contains(&attribute.as_str());
            let close = |(a, b): (&u32, &u32)| (f32::from_bits(*a) - f32::from_bits(*b)).abs() < 1e-5;
            let same = if is_found { a.len() == b.len() && a.iter().zip(&b).all(close) } else { a == b };
            assert!(same, "{name}: {attribute} has changed");
            compared += 1;
        }
    }
    assert!(compared > 7, "{name}: {compared} attributes");
}

/// Surfaces, goniograms and spectra of each kind come out as they went in.
#[test]
fn a_model_alone_and_unchanged_is_the_same_model() {
    let volume = Options {
        hull: pipeline::options::HullOptions { emission: Some(Emission::Volume), ..Options::default().hull },
        ..Options::default()
    };
    for (name, options) in
        [("four-chips", Options::default()), ("dome", Options::default()), ("absorbing-ball", volume)]
    {
        let first = built(&by_name(name).unwrap(), RAYS, &options).unwrap();
        let second = combined(&[of(&first)]).unwrap();
        assert!(second.notices.is_empty(), "{name}: {:?}", second.notices);
        let [before, after] = [&first, &second].map(|outcome| bytes(&outcome.artifacts, gltf::NAME));
        assert_same_places(name, before, after);
        let angles = |outcome: &Outcome| -> Value {
            let mut angles: Value = serde_json::from_slice(bytes(&outcome.artifacts, goniograms::NAME)).unwrap();
            // Nine digits of a number of which six are kept.
            let zones = angles["zones"].as_array_mut().unwrap().iter_mut();
            zones.for_each(|zone| zone["max_intensity"] = Value::Null);
            angles["total"]["max_intensity"] = Value::Null;
            angles
        };
        let (before, after) = (angles(&first), angles(&second));
        for key in ["schema", "frame", "lattice", "grid", "spectrum", "zones", "total"] {
            assert!(before[key] == after[key], "{name}: {key} has changed");
        }
        let names = |outcome: &Outcome| outcome.artifacts.iter().map(|own| own.name.clone()).collect::<Vec<_>>();
        let kept: Vec<String> = names(&first).into_iter().filter(|name| name != "plots/quality.svg").collect();
        assert_eq!(kept, names(&second), "{name}");
    }
}

/// A quarter turn is exact: directions, places, spectra.
#[test]
fn a_model_turned_by_quarters_and_moved_sends_the_same_light_there() {
    for name in ["four-chips", "dome"] {
        let lamp = component(name, &Options::default());
        let before = stored(&lamp);
        let shift_mm = DVec3::new(4.0, -2.0, 7.0);
        let there = |model: &StoredModel, kind, turn: DMat3| {
            values(model, View::Directions(directions().into_iter().map(|own| turn * own).collect()), kind)
        };
        let kinds = [Kind::Radiant, Kind::Luminous, Kind::Spectrum];
        let expected_there = kinds.map(|kind| there(&before, kind, DMat3::IDENTITY));
        let at = DVec3::new(0.5, 1.0, 6.0);
        let expected_on_plane = values(&before, plane(at, DVec3::NEG_Z, DVec3::Y), Kind::Luminous);
        for (axis, degrees) in [(DVec3::X, 90.0), (DVec3::Z, 270.0), (DVec3::ONE, 120.0)] {
            let outcome = combined(&[turned(&lamp, axis, degrees, shift_mm)]).unwrap();
            assert!(outcome.notices.is_empty(), "{:?}", outcome.notices);
            let after = stored(&of(&outcome));
            let turn = DMat3::from_axis_angle(axis.normalize(), degrees.to_radians());
            for (kind, expected) in kinds.into_iter().zip(&expected_there) {
                let found = there(&after, kind, turn);
                assert_same(&format!("{name}, {kind:?} about {axis} by {degrees}"), &found, expected, 2e-5);
            }
            let moved = plane(turn * at + shift_mm, turn * DVec3::NEG_Z, turn * DVec3::Y);
            let found = values(&after, moved, Kind::Luminous);
            assert_same(&format!("{name}, plane"), &found, &expected_on_plane, 1e-4);
            assert_schema("report", bytes(&outcome.artifacts, report::NAME));
        }
    }
}

/// Another turn needs another grid: the light is the same within the error of interpolation, which is told.
#[test]
fn a_model_turned_by_any_angle_sends_the_same_light_there() {
    let lamp = component("four-chips", &Options::default());
    let (axis, degrees) = (DVec3::new(1.0, 2.0, 3.0), 37.0);
    let after = stored(&of(&combined(&[turned(&lamp, axis, degrees, DVec3::ZERO)]).unwrap()));
    let (turn, before) = (DMat3::from_axis_angle(axis.normalize(), degrees.to_radians()), stored(&lamp));
    let there = |model, turn: DMat3| {
        values(model, View::Directions(directions().into_iter().map(|own| turn * own).collect()), Kind::Color)
    };
    assert_same("directions", &there(&after, turn), &there(&before, DMat3::IDENTITY), 0.01);
    let at = DVec3::new(0.2, 0.1, 3.0);
    let expected = values(&before, plane(at, DVec3::NEG_Z, DVec3::Y), Kind::Radiant);
    let found = values(&after, plane(turn * at, turn * DVec3::NEG_Z, turn * DVec3::Y), Kind::Radiant);
    assert_same("plane", &found, &expected, 0.01);
    let [[w, lm], [watts, lumens]] = [total_flux(&after), total_flux(&before)];
    assert!((w / watts - 1.0).abs() < 1e-6 && (lm / lumens - 1.0).abs() < 1e-6, "{w} {lm}, before {watts} {lumens}");
}

/// A beam of a fraction of a degree cannot be told on a grid round another axis; turned by quarters it can.
#[test]
fn a_narrow_beam_is_turned_by_quarters_only() {
    let lamp = component("collimated", &Options::default());
    assert!(combined(&[turned(&lamp, DVec3::X, 90.0, DVec3::ZERO)]).is_ok());
    let refused = combined(&[turned(&lamp, DVec3::X, 45.0, DVec3::ZERO)]).unwrap_err();
    assert_eq!(refused.code(), "combination.blurred", "{refused}");
}

/// Irradiance, spectra and flux of two models at once are the sums of those of each, whichever way they look and whatever their grids and
/// bands are.
#[test]
fn light_adds_up() {
    let mut wide = Options::default();
    wide.rays.band_edges_nm = Some((0..=16).map(|k| 300.0 + 37.5 * f64::from(k)).collect());
    // C planes of which the others have a common multiple.
    (wide.goniogram.gamma_step_deg, wide.goniogram.c_step_deg) = (Some(4.0), Some(15.0));
    let (chips, dome) = (component("four-chips", &Options::default()), component("dome", &wide));
    let [narrow, flat] = ["narrow-beam", "flat-chip"].map(|name| component(name, &Options::default()));
    let high = DVec3::new(0.0, 0.5, 2.0);
    let cases = [
        ("side by side", [chips.clone(), turned(&dome, DVec3::Z, 0.0, DVec3::new(3.0, 0.0, 0.0))]),
        ("back to back", [chips.clone(), turned(&dome, DVec3::X, 180.0, high)]),
        ("turned about the axis", [narrow, turned(&chips, DVec3::Z, 90.0, high)]),
        ("across", [chips, turned(&flat, DVec3::Y, 90.0, high)]),
    ];
    for (name, pair) in cases {
        let factor = Change { strength: Some(Strength::Factor(2.5)), ..pair[1].change.clone() };
        let pair = [pair[0].clone(), changed(&pair[1], factor)];
        let outcome = combined(&pair).unwrap();
        let both = stored(&of(&outcome));
        let [first, second] = [&pair[..1], &pair[1..]].map(|one| stored(&of(&combined(one).unwrap())));
        // The model that looks across is told on another grid.
        let part = if name == "across" { 0.01 } else { 5e-5 };
        for view in [
            plane(DVec3::new(1.0, 0.0, 8.0), DVec3::NEG_Z, DVec3::Y),
            plane(DVec3::new(9.0, 1.0, 2.0), DVec3::NEG_X, DVec3::Z),
            View::Directions(directions()),
        ] {
            for kind in [Kind::Luminous, Kind::Color] {
                let [sum, one, other] = [&both, &first, &second].map(|model| values(model, view.clone(), kind));
                let expected: Vec<(f64, f64)> = one.iter().zip(&other).map(|(a, b)| (a.0 + b.0, a.1 + b.1)).collect();
                assert_same(&format!("{name}, {kind:?}"), &sum, &expected, part);
            }
        }
        let [sum, one, other] = [&both, &first, &second].map(total_flux);
        for k in 0..2 {
            assert!((sum[k] / (one[k] + other[k]) - 1.0).abs() < 1e-9, "{name}: {} and {}", one[k], other[k]);
        }
        let total = &outcome.model.goniograms.total;
        let zones = outcome.model.goniograms.zones.iter().map(|zone| zone.goniogram.flux.radiant_w.unwrap());
        assert!((zones.sum::<f64>() / total.flux.radiant_w.unwrap() - 1.0).abs() < 1e-8, "{name}");
        for (document, schema) in [(goniograms::NAME, "goniograms"), (report::NAME, "report")] {
            assert_schema(schema, bytes(&outcome.artifacts, document));
        }
        let (document, _) = document(bytes(&outcome.artifacts, gltf::NAME));
        let extras = serde_json::to_vec(&document["meshes"][0]["extras"]["emitter"]).unwrap();
        assert_schema("emitter-extras", &extras);
        assert!(outcome.artifacts.iter().any(|artifact| artifact.name == ies::TOTAL));
    }
}

/// A flux that is asked for is the flux, in both files, and the other quantity goes along.
#[test]
fn a_flux_that_is_asked_for_is_the_flux() {
    let lamp = component("four-chips", &Options::default());
    let [watts, lumens] = total_flux(&stored(&lamp));
    let strength = Some(Strength::Flux(Total::LuminousLm(337.0)));
    let outcome = combined(&[changed(&lamp, Change { strength, ..Change::default() })]).unwrap();
    let [w, lm] = total_flux(&stored(&of(&outcome)));
    assert!((lm / 337.0 - 1.0).abs() < 1e-6 && (w / (watts * 337.0 / lumens) - 1.0).abs() < 1e-6, "{w} W, {lm} lm");
    assert!((outcome.model.flux.luminous_lm.unwrap() / 337.0 - 1.0).abs() < 1e-12);
}

/// Light of one line has its lm/W: 683 V(λ), V(520 nm) = 0.710 (CIE 1924). Places and directions keep their W, and a model that had no spectrum
/// has one.
#[test]
fn a_spectrum_that_is_given_is_the_spectrum() {
    let lamp = component("four-chips", &Options::default());
    let [watts, _] = total_flux(&stored(&lamp));
    let given = |strength| {
        let spectrum = Table::new(&[(520.0, 1.0)]);
        stored(&of(&combined(&[changed(&lamp, Change { spectrum, strength, ..Change::default() })]).unwrap()))
    };
    let green = given(None);
    let [w, lm] = total_flux(&green);
    assert!((w / watts - 1.0).abs() < 1e-6 && (lm / (w * 683.0 * 0.710) - 1.0).abs() < 1e-4, "{w} W, {lm} lm");
    let view = || plane(DVec3::new(1.0, 0.0, 4.0), DVec3::NEG_Z, DVec3::Y);
    let [found, expected] = [&green, &stored(&lamp)].map(|model| values(model, view(), Kind::Radiant));
    assert_same("radiant", &found, &expected, 1e-4);
    let spectrum = values(&green, View::Directions(vec![DVec3::Z]), Kind::Spectrum);
    let lit: Vec<usize> = (0..spectrum.len()).filter(|band| spectrum[*band].0 > 0.0).collect();
    assert_eq!(lit, [14], "520 to 530 nm of bands of 10 nm from 380 on");
    let [w, lm] = total_flux(&given(Some(Strength::Flux(Total::LuminousLm(100.0)))));
    assert!((lm / 100.0 - 1.0).abs() < 1e-6 && (w * 683.0 * 0.710 / 100.0 - 1.0).abs() < 1e-4, "{w} W, {lm} lm");
}

#[test]
fn what_cannot_be_one_is_refused() {
    let mut options = Options::default();
    options.hull.emission = Some(Emission::Volume);
    let (ball, chip) = (component("absorbing-ball", &options), component("flat-chip", &Options::default()));
    let code = |components: &[Component]| combined(components).map(|_| ()).unwrap_err().code();
    assert_eq!(code(&[]), "combination.models");
    assert_eq!(code(&vec![chip.clone(); 65]), "combination.models");
    assert_eq!(code(&[ball.clone(), chip.clone()]), "combination.volume");
    assert_eq!(code(&[turned(&ball, DVec3::X, 90.0, DVec3::ZERO)]), "combination.volume");
    let strength = Some(Strength::Flux(Total::LuminousLm(f64::NAN)));
    assert_eq!(code(&[changed(&chip, Change { strength, ..Change::default() })]), "combination.change");
    assert_eq!(code(&[Component { goniograms: b"{}".to_vec(), ..chip.clone() }]), "model.goniograms");
    // A spectrum may reach far, and every vertex would have all of its bands.
    let spectrum = Table::new(&[(380.0, 1.0), (39_000.0, 1.0)]);
    let far = changed(&chip, Change { spectrum, ..Change::default() });
    let limits = Limits { max_tally_values: 1 << 20, ..Limits::default() };
    let error = combine(&[chip.clone(), far], &Options::default(), &limits, &NoProgress).map(|_| ()).unwrap_err();
    assert_eq!(error.code(), "combination.too_large");
    assert!(error.to_string().contains("Model 2: "), "{error}");
    // A volume alone is moved.
    let shift_mm = DVec3::new(0.0, 0.0, 5.0);
    let moved = stored(&of(&combined(&[changed(&ball, Change { move_mm: shift_mm, ..Change::default() })]).unwrap()));
    let at = DVec3::new(0.0, 3.0, 4.0);
    let [found, expected] = [(&moved, at + shift_mm), (&stored(&ball), at)]
        .map(|(model, at)| values(model, plane(at, DVec3::NEG_Y, DVec3::Z), Kind::Radiant));
    assert_same("volume", &found, &expected, 1e-4);
}

fn assert_schema(name: &str, document: &[u8]) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("openapi/{name}.schema.json"));
    let schema: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let document: Value = serde_json::from_slice(document).unwrap();
    let validator = jsonschema::validator_for(&schema).unwrap();
    let errors: Vec<String> = validator.iter_errors(&document).map(|error| error.to_string()).take(5).collect();
    assert!(errors.is_empty(), "{name}: {errors:#?}");
}
