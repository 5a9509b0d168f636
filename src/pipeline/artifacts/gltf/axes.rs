//! The axes of glTF: Y up.

use glam::DVec3;

/// A vector of the source frame along the axes of glTF.
pub(super) fn gltf_from_source(vector: DVec3) -> DVec3 {
    DVec3::new(vector.x, vector.z, -vector.y)
}
