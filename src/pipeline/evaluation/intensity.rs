//! Intensity of the whole source: I(ω) = ∫ M q(ω) dA. The zones' goniograms share their grids, so their sum is one goniogram: a closed form.

use super::emission::{Blend, Emission};
use super::lump::{Lump, Piece};
use glam::DVec3;

/// The whole source from afar.
pub struct FarField<'e, 'a> {
    emission: &'e Emission<'a>,
    whole: Blend,
}

impl<'e, 'a> FarField<'e, 'a> {
    /// Of a model.
    pub fn new(emission: &'e Emission<'a>) -> FarField<'e, 'a> {
        let (light, channels) = (emission.light(), emission.channels());
        let mut flux = vec![0.0; emission.zone_count() * channels];
        let mut add = |piece: Piece, lump: &mut Lump| {
            piece.fill(emission, lump);
            for (zone, own) in lump.zones.iter().zip(lump.flux.chunks_exact(channels)) {
                let sums = &mut flux[*zone as usize * channels..];
                sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
            }
        };
        let mut lump = Lump::default();
        match light.volume {
            Some(volume) => volume.lattice.lit_cells().for_each(|cell| add(Piece::cell(cell as u32), &mut lump)),
            None => (0..light.mesh.triangles.len()).for_each(|at| add(Piece::triangle(at as u32), &mut lump)),
        }
        FarField { emission, whole: emission.blend(&flux) }
    }

    /// Adds the intensity in a unit direction, flux/sr, one number a channel.
    pub fn add(&self, direction: DVec3, sums: &mut [f64]) {
        self.emission.add_blend(&self.whole, &self.emission.toward(direction), sums);
    }
}
