//! Real text ray files from other programs (`../shared/rays`, never committed; left out aloud where the folder is missing).
#![expect(clippy::unwrap_used, reason = "clippy.toml allows it in #[test] functions only, and these are their tools")]

use lampwright::pipeline::rays::{RawRay, open};
use lampwright::pipeline::{
    Declared, Format, Input, Inspection, LengthUnit, Limits, Options, Outcome, Quantity, Unwatched, inspect, run,
};
use std::path::PathBuf;
use std::sync::Arc;

/// A file under a name and digest that say nothing, so that two containers can give the same bytes.
fn real(name: &str) -> Option<Input> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/rays").join(name);
    let Ok(bytes) = std::fs::read(&path) else {
        println!("LEFT OUT: {} is not here", path.display());
        return None;
    };
    let (name, sha256) = ("container".into(), "0".repeat(64));
    Some(Input { name, sha256, bytes: Arc::new(bytes), declared: Declared::default() })
}

fn codes(inspection: &Inspection) -> Vec<&str> {
    inspection.header.notices.iter().chain(&inspection.notices).map(|notice| notice.code).collect()
}

#[test]
fn measure() {
    for name in ["mu_Cyl10k.1.ray", "mu_ThreeRays_Wavelength.1.txt", "mu_ZemaxText.txt", "mu_ZemaxWavelengthText.txt"] {
        let Some(input) = real(name) else { return };
        let i = inspect(&input, &Limits::default(), &Unwatched).unwrap();
        println!("{name} {i:?} {:?}", codes(&i));
    }
    let built = |name: &str| {
        let mut input = real(name).unwrap();
        input.declared.name = None;
        run(&[input], &Options::default(), &Limits::default(), &Unwatched)
    };
    for (a, b) in [
        ("mu_Cyl10k.1.ray", "mu_Cyl10k.1.tm25ray"),
        ("mu_ThreeRays_Wavelength.1.txt", "mu_ThreeRays_Wavelength_ZMX.ray"),
    ] {
        match (built(a), built(b)) {
            (Ok(a), Ok(b)) => {
                println!("{:?} {:?}", a.notices, b.notices);
                for (x, y) in a.artifacts.iter().zip(&b.artifacts) {
                    let differ = x.bytes.iter().zip(&y.bytes).filter(|(p, q)| p != q).count();
                    println!("{} {} {} {} differ {differ}", x.name, y.name, x.bytes.len(), y.bytes.len());
                }
                println!("{} {}", a.model.hull.vertices_mm.len(), b.model.hull.vertices_mm.len());
            }
            (a, b) => println!("{:?} {:?}", a.err(), b.err()),
        }
    }
}
