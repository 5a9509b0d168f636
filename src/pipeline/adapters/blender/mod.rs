//! Blender: the light as arrays, and a script that makes a mesh of them whose materials are stock nodes of Cycles.

use super::arrays;
use super::surface::Surface;
use crate::error::Error;
use crate::writing::Artifact;

/// The folder's files.
///
/// # Errors
/// As [`arrays::artifact`].
pub fn files(surface: &Surface<'_>, name: &str) -> Result<Vec<Artifact>, Error> {
    let readme = include_str!("README.txt").replace("{name}", name).replace("{unit}", surface.unit());
    Ok(vec![
        Artifact::text("README.txt", "text/plain", readme),
        Artifact::text("lampwright_blender.py", "text/x-python", include_str!("lampwright_blender.py")),
        arrays::artifact(surface)?,
    ])
}
