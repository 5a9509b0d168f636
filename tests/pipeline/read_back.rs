//! A model read back from its two files is the model that was written, to the rounding of the files.

use super::models::{Way, made};
use glam::DVec3;
use pipeline::artifacts::read::{StoredModel, read};
use pipeline::artifacts::{gltf, goniograms};
use pipeline::known_sources::all;
use pipeline::model::evaluation::{Evaluator, Quantity};
use pipeline::{Limits, Outcome};

/// The model that the files of `outcome` hold.
pub fn read_back(outcome: &Outcome) -> StoredModel {
    let bytes = |name: &str| &outcome.artifacts.iter().find(|artifact| artifact.name == name).unwrap().bytes;
    read(bytes(gltf::NAME), bytes(goniograms::NAME), &Limits::default()).unwrap()
}

/// 200 directions, even over the sphere (a Fibonacci spiral), none of them along an axis.
fn directions() -> impl Iterator<Item = DVec3> {
    (0..200).map(|k| {
        let z = 1.0 - (2.0 * f64::from(k) + 1.0) / 200.0;
        let turn = f64::from(k) * 2.399_963_229_728_653;
        DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z)
    })
}

/// Fluxes, intensities, radiances and an irradiance of every known source. Intensities have six digits in goniograms.json, places and
/// fluxes 24 bits in emitter.glb: an edge that is a hundredth of its distance from the origin has a hundred times the rounding error, and
/// so has the area that a radiance is divided by.
#[test]
fn known_sources_come_back_from_their_files() {
    for source in all() {
        let outcome = made(source.name, 100_000, Way::OnTwoThreads);
        let (model, stored) = (&outcome.model, read_back(&outcome));
        for quantity in [Quantity::Radiant, Quantity::Luminous] {
            let own = Evaluator::new(model, quantity).unwrap();
            let Some(back) = Evaluator::new(&stored, quantity) else { panic!("{}: {quantity:?} is lost", source.name) };
            let close = |what: &str, own: f64, back: f64, scale: f64| {
                let (name, part) = (source.name, if what == "radiance" { 2e-4 } else { 3e-5 });
                assert!(
                    (own - back).abs() <= part * own.max(scale),
                    "{name}, {quantity:?}, {what}: {own}, read back {back}"
                );
            };
            close("flux", own.flux(), back.flux(), 0.0);
            let bounds_mm = model.hull.bounds_mm();
            // Intensities have as many decimals as the largest needs for its digits: a dim direction of a narrow beam has few.
            let scale = (own.flux() / 12.6).max(own.intensity(model.goniograms.frame.nadir.vector()) / 30.0);
            for (k, direction) in directions().enumerate() {
                close("intensity", own.intensity(direction), back.intensity(direction), scale);
                let triangle = k * 7919 % model.hull.triangles.len();
                let shares = [0.2, 0.3, 0.5];
                let point_mm = bounds_mm.center() + 0.1 * bounds_mm.size() * direction;
                let of = |evaluator: &Evaluator<'_>| {
                    evaluator.radiance_along(point_mm, direction).unwrap_or_else(|| {
                        evaluator.exitance(triangle, shares) * evaluator.distribution(triangle, shares, direction)
                    })
                };
                close("radiance", of(&own), of(&back), scale / bounds_mm.size().length_squared());
            }
            let outside_mm = bounds_mm.center() + 2.0 * bounds_mm.size().length() * DVec3::new(0.3, 0.2, 0.9);
            let irradiance = |evaluator: &Evaluator<'_>| evaluator.irradiance(outside_mm, DVec3::NEG_Z);
            let distance_mm = outside_mm.distance(bounds_mm.center());
            close("irradiance", irradiance(&own), irradiance(&back), scale / (distance_mm * distance_mm));
        }
    }
}
