//! A model as a renderer opens it: a folder of files made of `emitter.glb` and `goniograms.json` alone (`openapi/RENDERERS.md`).
//!
//! Renderers know surfaces that glow, so each adapter takes the model's surface; of a volume that is the same light once more, as programs
//! that know only surfaces find it. The scripts that a renderer runs lie beside this file as they are written.

/// Red, green and blue of renderers.
mod colour;
/// Arrays as numpy stores them.
mod npy;
/// The surface in the numbers that renderers take.
mod surface;
/// Surface, exitance and distributions as arrays, for scripts in Python.
mod arrays;
/// Mitsuba 3: an emitter in Python.
mod mitsuba;
/// Radiance: light sources with data files.
mod radiance;
/// Blender: a script that builds a mesh and its materials.
mod blender;

use crate::artifacts::read::StoredModel;
use crate::error::Error;
use crate::evaluation::Kind;
use crate::writing::Artifact;
use surface::Surface;

/// A renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Renderer {
    /// Blender, with Cycles.
    Blender,
    /// Mitsuba 3.
    Mitsuba,
    /// Radiance.
    Radiance,
}

impl Renderer {
    /// All, in the order in which they are offered.
    pub const ALL: [Renderer; 3] = [Renderer::Blender, Renderer::Mitsuba, Renderer::Radiance];

    /// The name users write.
    pub fn name(self) -> &'static str {
        match self {
            Renderer::Blender => "blender",
            Renderer::Mitsuba => "mitsuba",
            Renderer::Radiance => "radiance",
        }
    }
}

/// What was written for a renderer.
#[derive(Clone, Debug)]
pub struct Adapted {
    /// The files, with names that need no folder.
    pub files: Vec<Artifact>,
    /// Which light they carry.
    pub kind: Kind,
    /// Unit of the radiance that the renderer finds.
    pub unit: &'static str,
    /// Triangles of the surface.
    pub triangles: usize,
    /// Zones, each with a distribution of its own.
    pub zones: usize,
    /// The model is a volume, and its surface stands for it.
    pub stands_for_volume: bool,
}

/// The files that `renderer` opens. `kind`: which light; without it colour where the model knows it, else lm, else W.
///
/// # Errors
/// [`Error::Unusable`] where the model does not know that light, has none of it, or no renderer takes it (a spectrum).
pub fn adapt(model: &StoredModel, renderer: Renderer, kind: Option<Kind>) -> Result<Adapted, Error> {
    let surface = Surface::new(model, kind)?;
    let files = match renderer {
        Renderer::Blender => blender::files(&surface, &model.name)?,
        Renderer::Mitsuba => mitsuba::files(&surface, &model.name)?,
        Renderer::Radiance => radiance::files(&surface, &model.name),
    };
    Ok(Adapted {
        files,
        kind: surface.kind,
        unit: surface.unit(),
        triangles: surface.light.mesh.triangles.len(),
        zones: surface.distributions.len(),
        stands_for_volume: surface.stands_for_volume,
    })
}
