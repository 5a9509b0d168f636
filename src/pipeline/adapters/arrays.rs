//! `lampwright_model.npz`: surface, exitance and distributions as arrays, for scripts in Python.

use super::colour::SRGB;
use super::npy::{floats, indices};
use super::surface::Surface;
use crate::artifacts::zip;
use crate::error::Error;
use crate::evaluation::Kind;
use crate::goniogram::mixture::MOST;
use crate::writing::Artifact;

/// The file that the scripts load.
const NAME: &str = "lampwright_model.npz";

/// The arrays: `positions_mm` [vertex][3], `triangles` [triangle][3], `exitance` [vertex][red, green, blue] (linear sRGB, lm/m² or W/m²), `zones`
/// and `weights` [vertex][4], `distributions` [zone][c][gamma] (1/sr), `gamma` (radians), `axes` (of the photometric frame, one a row),
/// `is_photometric` (1 of lm, 0 of W), `luminance` (of red, green and blue).
///
/// # Errors
/// [`Error::Internal`] where the archive cannot be written.
pub fn artifact(surface: &Surface<'_>) -> Result<Artifact, Error> {
    let light = &surface.light;
    let (mesh, grid, frame) = (light.mesh, light.grid, light.frame);
    let [vertices, triangles] = [mesh.vertices_mm.len(), mesh.triangles.len()];
    let shape = [surface.distributions.len(), grid.c_planes(), grid.gamma_nodes()];
    let rgb = surface.rgb(&SRGB);
    let axes = [frame.x(), frame.y(), frame.z()];
    let parts = [
        floats("positions_mm", &[vertices, 3], mesh.vertices_mm.iter().flat_map(|place| place.to_array())),
        indices("triangles", &[triangles, 3], mesh.triangles.iter().flatten().copied()),
        floats("exitance", &[vertices, 3], rgb.iter().flatten().copied()),
        indices("zones", &[vertices, MOST], light.mixtures.iter().flat_map(|mixture| mixture.zones)),
        floats("weights", &[vertices, MOST], light.mixtures.iter().flat_map(|mixture| mixture.weights)),
        floats("distributions", &shape, surface.distributions.iter().flatten().copied()),
        floats("gamma", &[grid.gamma_nodes()], (0..grid.gamma_nodes()).map(|node| grid.gamma(node))),
        floats("axes", &[3, 3], axes.iter().flat_map(|axis| axis.to_array())),
        floats("is_photometric", &[1], std::iter::once(f64::from(u8::from(surface.kind != Kind::Radiant)))),
        floats("luminance", &[3], SRGB.luminance.into_iter()),
    ];
    Ok(Artifact { name: NAME.to_owned(), media_type: "application/zip", bytes: zip(&parts)? })
}
