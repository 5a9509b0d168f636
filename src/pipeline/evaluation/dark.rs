//! An answer without any light: whether the light lies beside what was asked for, or between the lines that were drawn.

use super::view::{Lens, View};
use crate::error::Error;
use crate::model::light::Light;
use crate::vocabulary::notice::{Notice, Notices};

/// A notice, where no cell of a plane or a picture has any light (`values` are all its numbers). Directions are asked for one by one, and may
/// well be dark.
///
/// # Errors
/// As [`super::view::Camera::lens`].
pub fn notices(light: &Light<'_>, view: &View, cells: usize, values: &[f64]) -> Result<Vec<Notice>, Error> {
    if values.iter().any(|value| *value > 0.0) {
        return Ok(Vec::new());
    }
    let told = match view {
        View::Camera(camera) if meets(light, &camera.lens()?) => {
            "No line of the camera meets the light, though the light lies in the picture: it is smaller than the distance of the lines. Ask \
             for more columns and rows, more samples, or a picture that is less wide."
        }
        View::Camera(_) => {
            "No line of the camera meets the light: the light lies beside the picture, or behind the camera. See to where the camera is, what \
             is in the middle of the picture, and how wide it is."
        }
        View::Plane(_) => {
            "No light comes to the rectangle on the side that its normal points to: the source sends none there, or shines on the other side. \
             See to its place, and to the normal."
        }
        View::Grid { .. } | View::Directions(_) | View::Angles(_) => return Ok(Vec::new()),
    };
    let mut notices = Notices::default();
    notices.count("evaluation.dark", cells as u64, None, told);
    Ok(notices.to_vec())
}

/// Whether a vertex that sends light lies in the picture.
fn meets(light: &Light<'_>, lens: &Lens) -> bool {
    let sends = |vertex: usize| {
        let has = |flux: &Option<Vec<f64>>| flux.as_ref().is_some_and(|flux| flux[vertex] > 0.0);
        has(&light.vertices.radiant_w) || has(&light.vertices.luminous_lm)
    };
    light.mesh.vertices_mm.iter().enumerate().any(|(vertex, place)| sends(vertex) && lens.sees(*place))
}
