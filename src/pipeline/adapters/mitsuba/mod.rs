//! Mitsuba 3: the surface as a PLY file, the light as arrays, and an emitter in Python that samples them.

use super::arrays;
use super::surface::Surface;
use crate::error::Error;
use crate::writing::Artifact;

/// Where the corners of a triangle lie in the unit square of texture coordinates that it has to itself: `lampwright_emitter.py` reads the
/// triangle and the place within it from there.
const CORNERS: [[f32; 2]; 3] = [[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]];

/// The folder's files.
///
/// # Errors
/// As [`arrays::artifact`].
pub fn files(surface: &Surface<'_>, name: &str) -> Result<Vec<Artifact>, Error> {
    let readme = include_str!("README.txt").replace("{name}", name).replace("{unit}", surface.unit());
    let ply = Artifact { name: "surface.ply".to_owned(), media_type: "application/octet-stream", bytes: ply(surface) };
    Ok(vec![
        Artifact::text("README.txt", "text/plain", readme),
        Artifact::text("lampwright_emitter.py", "text/x-python", include_str!("lampwright_emitter.py")),
        Artifact::text("scene.py", "text/x-python", include_str!("scene.py")),
        ply,
        arrays::artifact(surface)?,
    ])
}

/// Triangles that share no vertex, so that each has texture coordinates of its own.
fn ply(surface: &Surface<'_>) -> Vec<u8> {
    let mesh = surface.light.mesh;
    let count = mesh.triangles.len();
    let side = (1..).find(|side| side * side >= count).unwrap_or(1);
    let head = format!(
        "ply\nformat binary_little_endian 1.0\ncomment positions in mm; u and v number the triangles\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\nproperty float u\nproperty float v\nelement face {count}\n\
         property list uchar uint vertex_indices\nend_header\n",
        3 * count
    );
    let mut bytes = head.into_bytes();
    for triangle in 0..count {
        for (corner, [u, v]) in mesh.corners_mm(triangle).into_iter().zip(CORNERS) {
            let place = [u + (triangle % side) as f32, v + (triangle / side) as f32];
            let numbers = corner.to_array().map(|coordinate| coordinate as f32).into_iter().chain(place);
            bytes.extend(numbers.flat_map(f32::to_le_bytes));
        }
    }
    for triangle in 0..count as u32 {
        bytes.push(3);
        bytes.extend([0, 1, 2].into_iter().flat_map(|corner| (3 * triangle + corner).to_le_bytes()));
    }
    bytes
}
