//! What radiance and new rays need of a model, wherever it is held: as it was built, or read back from its files.

use super::Model;
use crate::flux::Amounts;
use crate::goniogram::{Goniogram, Mixture, SphereGrid};
use crate::hull::Mesh;
use crate::source::Spectral;
use crate::vocabulary::space::Frame;
use crate::volume::Volume;

/// The surface or the volume, the light of its places, and the goniograms that they mix.
#[derive(Clone, Debug)]
pub struct Light<'a> {
    /// The surface.
    pub mesh: Mesh<'a>,
    /// Flux and spectral columns of its vertices.
    pub vertices: &'a Amounts,
    /// Zones and weights of each vertex.
    pub mixtures: &'a [Mixture],
    /// The photometric frame.
    pub frame: Frame,
    /// Grid of the luminous and radiant intensities.
    pub grid: &'a SphereGrid,
    /// Grid of the spectral intensities.
    pub spectral_grid: &'a SphereGrid,
    /// Goniogram of each zone.
    pub zones: Vec<&'a Goniogram>,
    /// Goniogram of the whole source.
    pub total: &'a Goniogram,
    /// The volume that the light comes from; then the surface is the same light once more.
    pub volume: Option<&'a Volume>,
    /// The spectral side.
    pub spectral: &'a Spectral,
}

impl<'a> Light<'a> {
    /// The places that the light comes from: nodes of the volume, or vertices of the surface.
    pub fn sites(&self) -> &'a Amounts {
        self.volume.map_or(self.vertices, |volume| &volume.nodes)
    }
}

impl<'a> From<&'a Model> for Light<'a> {
    fn from(model: &'a Model) -> Light<'a> {
        let goniograms = &model.goniograms;
        Light {
            mesh: model.hull.mesh(),
            vertices: &model.surface.vertices,
            mixtures: &goniograms.mixtures,
            frame: goniograms.frame,
            grid: &goniograms.grid,
            spectral_grid: &goniograms.spectral_grid,
            zones: goniograms.zones.iter().map(|zone| &zone.goniogram).collect(),
            total: &goniograms.total,
            volume: model.volume.as_ref(),
            spectral: &model.spectral,
        }
    }
}
