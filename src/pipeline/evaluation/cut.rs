//! A plane that lies in the light: where it cuts through the surface or the volume that sends it, irradiance has two values.

use super::view::{Sheet, touching_mm};
use crate::hull::Mesh;
use crate::model::light::Light;
use crate::vocabulary::notice::{Notice, Notices};
use crate::vocabulary::space::Bounds;
use crate::volume::lattice::VolumeLattice;
use crate::writing::number::text;
use glam::{DVec2, DVec3};

/// How far a rectangle that lies on the surface is moved off it, as a part of the source's size: more than places are rounded by, and less than
/// exitance changes in.
const OFF: f64 = 1e-5;

/// The rectangle in axes of its own: x and y along its sides, z along its normal, mm.
struct Rectangle {
    middle_mm: DVec3,
    along: [DVec3; 3],
    half_mm: DVec2,
    touching_mm: f64,
}

/// How far the rectangle is to be moved against its normal, mm, and the notice that says so, where it lies on the lit surface: there irradiance
/// has two values, and that of the light which leaves the surface is the one that is meant.
pub fn off_the_surface(light: &Light<'_>, sheet: &Sheet, normal: DVec3) -> Option<(f64, Notice)> {
    let (rectangle, size_mm) = rectangle(light, sheet, normal);
    let lies_in = |triangle: usize| {
        let corners = light.mesh.corners_mm(triangle).map(|corner| rectangle.own(corner - rectangle.middle_mm).z);
        corners.into_iter().all(|height| height.abs() <= rectangle.touching_mm)
            && rectangle.meets(&light.mesh, triangle)
    };
    let lit = lit(light).filter(|triangle| light.volume.is_none() && lies_in(*triangle)).count() as u64;
    let off_mm = OFF * size_mm;
    let told = format!(
        "The rectangle lies on the lit surface ({lit} triangles of it), where irradiance has two values. It was moved by {} mm against its normal, so \
         that the surface lies before it: the values are the exitance of the light that leaves the surface to that side.",
        text(off_mm, 3)
    );
    let mut notices = Notices::default();
    notices.count("evaluation.on_surface", lit, None, told);
    notices.to_vec().pop().filter(|_| lit > 0).map(|notice| (off_mm, notice))
}

fn rectangle(light: &Light<'_>, sheet: &Sheet, normal: DVec3) -> (Rectangle, f64) {
    let [right, up] = sheet.half_sides_mm();
    let source_mm = Bounds::of(light.mesh.vertices_mm.iter().copied());
    let rectangle = Rectangle {
        middle_mm: sheet.middle_mm(),
        along: [right.normalize(), up.normalize(), normal],
        half_mm: DVec2::new(right.length(), up.length()),
        touching_mm: touching_mm(source_mm),
    };
    (rectangle, source_mm.size().max_element())
}

/// Triangles that send light.
fn lit<'l>(light: &'l Light<'_>) -> impl Iterator<Item = usize> + 'l {
    let is_lit = |vertex: u32| {
        let has = |flux: &Option<Vec<f64>>| flux.as_ref().is_some_and(|flux| flux[vertex as usize] > 0.0);
        has(&light.vertices.radiant_w) || has(&light.vertices.luminous_lm)
    };
    (0..light.mesh.triangles.len()).filter(move |triangle| light.mesh.triangles[*triangle].into_iter().any(is_lit))
}

/// A notice, where lit parts of the source meet the rectangle.
pub fn notices(light: &Light<'_>, sheet: &Sheet, normal: DVec3) -> Vec<Notice> {
    let (rectangle, _) = rectangle(light, sheet, normal);
    let (count, parts) = match light.volume {
        Some(volume) => (rectangle.cells(&volume.lattice), "lit cells of the source's volume"),
        None => (
            lit(light).filter(|triangle| rectangle.meets(&light.mesh, *triangle)).count() as u64,
            "lit triangles of the source's surface",
        ),
    };
    let mut notices = Notices::default();
    if count > 0 {
        let told = format!(
            "The rectangle lies in the light: {parts} meet it. Light of what is behind it does not count, and values near the cut change \
             steeply. Move it off the source to have what a detector would read."
        );
        notices.count("evaluation.in_light", count, None, told);
    }
    notices.to_vec()
}

impl Rectangle {
    fn own(&self, vector: DVec3) -> DVec3 {
        DVec3::from_array(self.along.map(|axis| axis.dot(vector)))
    }

    fn meets(&self, mesh: &Mesh<'_>, triangle: usize) -> bool {
        let corners = mesh.corners_mm(triangle).map(|corner| self.own(corner - self.middle_mm));
        let mut shared: Vec<DVec2> = Vec::new();
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if a.z.abs() <= self.touching_mm {
                shared.push(a.truncate());
            } else if a.z * b.z < 0.0 {
                shared.push((a + (b - a) * (a.z / (a.z - b.z))).truncate());
            }
        }
        !shared.is_empty() && self.overlaps(&shared)
    }

    /// Whether a convex polygon in the plane of the rectangle meets it: no line along a side of either parts them.
    fn overlaps(&self, polygon: &[DVec2]) -> bool {
        let sides = (0..polygon.len()).map(|k| (polygon[(k + 1) % polygon.len()] - polygon[k]).perp());
        let mut across = [DVec2::X, DVec2::Y].into_iter().chain(sides);
        across.all(|axis| {
            let reach = axis.abs().dot(self.half_mm);
            let ends = polygon.iter().map(|corner| axis.dot(*corner));
            let (low, high) =
                ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
            low <= reach && high >= -reach
        })
    }

    /// Lit cells that meet the rectangle, and a few that only come near a corner of it: boxes are parted along the rectangle's axes alone.
    fn cells(&self, lattice: &VolumeLattice) -> u64 {
        let pitch_mm = lattice.pitch_mm;
        let reach = self.along.map(|axis| axis.abs().dot(0.5 * pitch_mm));
        let reach = DVec3::from_array(reach) + self.half_mm.extend(self.touching_mm);
        let meets = |[x, y, z]: [usize; 3]| {
            let at = DVec3::new(x as f64 + 0.5, y as f64 + 0.5, z as f64 + 0.5);
            self.own(lattice.min_mm + at * pitch_mm - self.middle_mm).abs().cmple(reach).all()
        };
        let [columns, rows, _] = lattice.cells;
        let place = |cell: usize| [cell % columns, cell / columns % rows, cell / (columns * rows)];
        (0..lattice.is_lit.len()).filter(|cell| lattice.is_lit[*cell] && meets(place(*cell))).count() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::tests::{Lamp, amounts, answer, glowing_box, lambertian, square};
    use crate::evaluation::view::{Plane, View};
    use crate::goniogram::SphereGrid;

    /// Planes through the source, beside it and before it; what a plane through the dark part of a surface cuts is no light.
    #[test]
    fn a_plane_that_lies_in_the_light_is_told() {
        let mut chip = square(2.0, 4, SphereGrid::new(36, 1), lambertian);
        let plane = |center_mm: DVec3, normal: DVec3, width_mm: f64| {
            View::Plane(Plane {
                center_mm,
                normal: Some(normal),
                up: None,
                width_mm,
                height_mm: 1.0,
                columns: 2,
                rows: 2,
            })
        };
        let told = |lamp: &Lamp, center_mm: [f64; 3], normal: DVec3, width_mm: f64| {
            let notices = answer(lamp, plane(DVec3::from_array(center_mm), normal, width_mm)).notices;
            notices.iter().any(|notice| notice.code == "evaluation.in_light" && notice.count > 0)
        };
        assert!(told(&chip, [0.0; 3], DVec3::X, 9.0), "across it");
        assert!(!told(&chip, [0.0, 0.0, 4e-7], DVec3::NEG_Z, 0.1), "on it, by rounding: it is moved off");
        assert!(!told(&chip, [0.0, 0.0, 0.01], DVec3::NEG_Z, 9.0), "just before it");
        assert!(!told(&chip, [0.0, 0.0, 0.51], DVec3::X, 9.0), "its plane cuts the chip, its rectangle ends above");
        assert!(!told(&chip, [1.6, 0.0, 0.0], DVec3::new(-1.0, 0.0, 1.0), 9.0), "aslant, beside it");
        assert!(told(&chip, [0.9, 0.0, 0.0], DVec3::new(-1.0, 0.0, 1.0), 9.0), "aslant, through its rim");
        // The left half is dark: vertices are in rows along +X.
        let lit = |vertex: usize| if vertex % 5 > 2 { 1.0 } else { 0.0 };
        chip.vertices = amounts((0..25).map(lit).collect());
        assert!(!told(&chip, [-0.7, 0.0, 0.0], DVec3::X, 9.0) && told(&chip, [0.7, 0.0, 0.0], DVec3::X, 9.0));
        let glowing = glowing_box();
        assert!(told(&glowing, [1.0, 0.5, 0.5], DVec3::Z, 0.2) && !told(&glowing, [1.0, 0.5, 1.01], DVec3::Z, 9.0));
        assert!(answer(&chip, View::Directions(vec![DVec3::Z])).notices.is_empty());
    }

    /// A Lambertian chip of exitance 1 W/mm²: just before its surface irradiance is the exitance, seen from either end of rounding, and behind it
    /// there is no light. Without a normal the plane looks against the light.
    #[test]
    fn on_the_surface_the_irradiance_is_the_exitance() {
        let chip = square(2.0, 4, SphereGrid::new(36, 36), lambertian);
        let on = |z_mm: f64, normal: Option<DVec3>| {
            let center_mm = DVec3::new(0.1, 0.2, z_mm);
            let plane = Plane { center_mm, normal, up: None, width_mm: 0.5, height_mm: 0.5, columns: 2, rows: 2 };
            let found = answer(&chip, View::Plane(plane));
            let codes: Vec<String> = found.notices.iter().map(|notice| notice.code.to_string()).collect();
            (found.channels[0].values.iter().map(|value| value * 1e-6).collect::<Vec<f64>>(), codes)
        };
        for (z_mm, normal) in [(0.0, Some(DVec3::NEG_Z)), (4e-7, Some(DVec3::NEG_Z)), (0.0, None), (-4e-7, None)] {
            let (values, codes) = on(z_mm, normal);
            assert!(values.iter().all(|value| (value - 1.0).abs() < 0.01), "{z_mm}: {values:?}");
            assert_eq!(codes, ["evaluation.on_surface"]);
        }
        assert!(on(0.0, Some(DVec3::Z)).0.iter().all(|value| *value == 0.0));
        assert!(on(0.01, None).1.is_empty());
    }
}
