//! What is looked at: directions, a rectangle of a plane, or the picture of a camera; and where in the source frame its cells lie.

use super::irradiance::Receiver;
use super::radiance::Line;
use crate::error::{Error, Place};
use crate::vocabulary::space::{Axis, Bounds, Frame};
use glam::{DVec2, DVec3};

/// Most columns and rows of a picture, and most directions in a list.
pub const MOST_SIDE: usize = 4096;
/// Most lines along each side of a cell of a camera.
pub const MOST_SAMPLES: usize = 16;
/// Up, where nothing is said and it does not lie along what is looked at; else the second one.
const UP: [DVec3; 2] = [DVec3::Z, DVec3::Y];
/// Vectors nearer to each other than this sine have no common plane.
const LEAST_SINE: f64 = 1e-6;
/// How far a step may be from a whole part of the circle, as a part.
const UNEVEN: f64 = 1e-9;
/// What is nearer to a plane than this part of the source's size touches it.
const TOUCHING: f64 = 1e-6;
/// Farthest that a place may be, mm.
const FARTHEST_MM: f64 = 1e12;

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub enum View {
    /// Intensity on a grid of the photometric frame: half-planes C from 0 on, γ from 0 to 180°.
    Grid {
        /// Step of C, degrees; divides 360.
        c_step_deg: f64,
        /// Step of γ, degrees; divides 180.
        gamma_step_deg: f64,
    },
    /// Intensity in directions of the source frame, of any length but 0.
    Directions(Vec<DVec3>),
    /// Intensity at pairs of C and γ, degrees.
    Angles(Vec<[f64; 2]>),
    /// Irradiance or illuminance on a rectangle.
    Plane(Plane),
    /// Radiance or luminance as a camera sees it.
    Camera(Camera),
}

/// A rectangle of a plane. Its picture is what is seen from the side that is lit, `up` at the top.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Its middle, mm.
    pub center_mm: DVec3,
    /// Normal towards the side that is lit; where nothing is said that across γ = 0, to the side of the source ([`Plane::facing`]).
    pub normal: Option<DVec3>,
    /// What is up; +Z where nothing is said, +Y on a plane across Z.
    pub up: Option<DVec3>,
    /// Along its rows, mm.
    pub width_mm: f64,
    /// Along its columns, mm.
    pub height_mm: f64,
    /// Cells along its rows.
    pub columns: usize,
    /// Cells along its columns.
    pub rows: usize,
}

/// A camera with square cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Where it is, mm. An orthographic camera is infinitely far away in the same direction.
    pub eye_mm: DVec3,
    /// What is in the middle of the picture, mm.
    pub target_mm: DVec3,
    /// What is up; +Z where nothing is said, +Y of a camera that looks along Z.
    pub up: Option<DVec3>,
    /// How wide it sees.
    pub width: Width,
    /// Cells along the rows of the picture.
    pub columns: usize,
    /// Cells along its columns.
    pub rows: usize,
    /// Lines along each side of a cell whose mean is the cell's; 1: the line through its middle.
    pub samples: usize,
}

impl View {
    /// Step of C of a grid where nothing is said, degrees.
    pub const C_STEP_DEG: f64 = 15.0;
    /// Step of γ, likewise.
    pub const GAMMA_STEP_DEG: f64 = 5.0;

    /// Refuses what cannot be looked at, whatever the model.
    ///
    /// # Errors
    /// [`Error::Unusable`] where a size, a vector, an angle or a count cannot be.
    pub fn check(&self) -> Result<(), Error> {
        match self {
            View::Grid { .. } => Ok(()),
            View::Directions(directions) => {
                directions.iter().try_for_each(|along| unit("view.directions", *along).map(drop))
            }
            View::Angles(angles) if angles.iter().flatten().all(|degrees| degrees.is_finite()) => Ok(()),
            View::Angles(_) => Err(geometry("view.angles", "An angle is no number.", "Give C and gamma in degrees.")),
            View::Plane(plane) if plane.normal.is_some() => plane.sheet(&Frame::looking(Axis::PosZ)).map(drop),
            View::Plane(plane) => {
                plane.up.map_or(Ok(DVec3::Z), |up| unit("view.plane.up", up))?;
                Plane { up: None, ..*plane }.sheet(&Frame::looking(Axis::PosZ)).map(drop)
            }
            View::Camera(camera) => camera.lens().map(drop),
        }
    }
}

impl Plane {
    /// Cells in a row where nothing is said.
    pub const COLUMNS: usize = 64;

    /// Rows where nothing is said: so many that cells are square.
    pub fn square_rows(width_mm: f64, height_mm: f64, columns: usize) -> usize {
        (columns as f64 * height_mm / width_mm).round().max(1.0) as usize
    }
}

impl Camera {
    /// Cells in a row, and rows, where nothing is said.
    pub const COLUMNS: usize = 256;
    /// Lines along each side of a cell where nothing is said.
    pub const SAMPLES: usize = 2;
}

/// How wide a camera sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Width {
    /// Orthographic: mm.
    Orthographic(f64),
    /// Perspective: the angle of the whole width, degrees.
    Perspective(f64),
}

/// A picture in space: its middle, its axes of the length of a cell, and its size.
#[derive(Clone, Copy, Debug)]
pub struct Sheet {
    middle: DVec3,
    right: DVec3,
    up: DVec3,
    columns: usize,
    rows: usize,
}

fn geometry(option: &'static str, found: impl Into<String>, remedy: &'static str) -> Error {
    Error::invalid_declaration("evaluation.geometry", Place::Asked(option), found, remedy)
}

/// What is nearer to a plane than this touches it, of a source with this box: files hold places as 32-bit floats.
pub fn touching_mm(source_mm: Bounds) -> f64 {
    TOUCHING * source_mm.size().max_element()
}

/// A number that is positive and no farther than any place may be.
pub fn length_mm(option: &'static str, mm: f64) -> Result<f64, Error> {
    let sound = mm > 0.0 && mm <= FARTHEST_MM;
    sound.then_some(mm).ok_or_else(|| geometry(option, format!("{mm} mm is no size."), "Give a positive length in mm."))
}

fn place_mm(option: &'static str, place: DVec3) -> Result<DVec3, Error> {
    let sound = place.is_finite() && place.abs().max_element() <= FARTHEST_MM;
    sound.then_some(place).ok_or_else(|| geometry(option, "The place is no point.", "Give three numbers in mm."))
}

/// Sides of a picture within what is allowed.
fn sides(option: [&'static str; 2], columns: usize, rows: usize) -> Result<(), Error> {
    for (option, count) in option.into_iter().zip([columns, rows]) {
        if !(1..=MOST_SIDE).contains(&count) {
            return Err(geometry(
                option,
                format!("{count} cells were asked for."),
                "Ask for 1 to 4096 cells along each side.",
            ));
        }
    }
    Ok(())
}

/// The unit vector along `vector`.
pub fn unit(option: &'static str, vector: DVec3) -> Result<DVec3, Error> {
    let largest = vector.abs().max_element();
    let sound = vector.is_finite() && largest > 0.0;
    let none = || geometry(option, "The vector has no direction.", "Give three numbers that are not all 0.");
    sound.then(|| (vector / largest).normalize()).ok_or_else(none)
}

/// Right and up of a picture that is looked at along unit `ahead`.
fn axes(option: &'static str, ahead: DVec3, up: Option<DVec3>) -> Result<[DVec3; 2], Error> {
    let wanted = match up {
        Some(up) => unit(option, up)?,
        None => UP.into_iter().find(|up| up.dot(ahead).abs() < 0.9).unwrap_or(DVec3::Y),
    };
    let right = ahead.cross(wanted);
    if right.length() < LEAST_SINE {
        let found = "Up lies along the line of sight.";
        return Err(geometry(option, found, "Give another direction as up, or leave it out."));
    }
    let right = right.normalize();
    Ok([right, right.cross(ahead)])
}

/// How many steps of `step_deg` there are in `of_deg`.
pub fn steps(option: &'static str, step_deg: f64, of_deg: f64) -> Result<usize, Error> {
    let count = of_deg / step_deg;
    let whole = count.round();
    if !(whole >= 1.0 && whole <= MOST_SIDE as f64 && (count - whole).abs() <= UNEVEN * whole) {
        let found = format!("Steps of {step_deg} degrees do not divide {of_deg} degrees into 1 to {MOST_SIDE} parts.");
        return Err(geometry(option, found, "Give a step such as 1, 2.5 or 15."));
    }
    Ok(whole as usize)
}

impl Sheet {
    /// Its middle.
    pub fn middle_mm(&self) -> DVec3 {
        self.middle
    }

    /// From its middle to those of its right and of its upper side, mm (of a perspective camera, at the distance 1).
    pub fn half_sides_mm(&self) -> [DVec3; 2] {
        [0.5 * self.columns as f64 * self.right, 0.5 * self.rows as f64 * self.up]
    }

    /// Where a place of the picture is; columns and rows from the upper left corner on, cells as 1.
    fn at(&self, column: f64, row: f64) -> DVec3 {
        let from = DVec2::new(column - 0.5 * self.columns as f64, 0.5 * self.rows as f64 - row);
        self.middle + from.x * self.right + from.y * self.up
    }
}

impl Plane {
    /// The same plane; where no normal was given, it lies across γ = 0 and looks to the side on which the middle of the source (its box) lies,
    /// through that middle against the light that goes along γ = 0.
    #[must_use]
    pub fn facing(self, frame: &Frame, source_mm: Bounds) -> Plane {
        let nadir = frame.nadir.vector();
        let is_before = (source_mm.center() - self.center_mm).dot(nadir) > touching_mm(source_mm);
        let towards = if is_before { nadir } else { -nadir };
        Plane { normal: self.normal.or(Some(towards)), ..self }
    }

    /// Its points, from the upper left on, and its normal.
    ///
    /// # Errors
    /// [`Error::Unusable`] where a size, a vector or a count cannot be.
    pub fn sheet(&self, frame: &Frame) -> Result<(Sheet, DVec3), Error> {
        sides(["view.plane.columns", "view.plane.rows"], self.columns, self.rows)?;
        let normal = self.normal.map_or(Ok(-frame.nadir.vector()), |normal| unit("view.plane.normal", normal))?;
        let [right, up] = axes("view.plane.up", -normal, self.up)?;
        let sheet = Sheet {
            middle: place_mm("view.plane.center_mm", self.center_mm)?,
            right: length_mm("view.plane.width_mm", self.width_mm)? / self.columns as f64 * right,
            up: length_mm("view.plane.height_mm", self.height_mm)? / self.rows as f64 * up,
            columns: self.columns,
            rows: self.rows,
        };
        Ok((sheet, normal))
    }
}

impl Sheet {
    /// From a cell to the next in its row, and to that below it.
    pub fn steps_mm(&self) -> [DVec3; 2] {
        [self.right, -self.up]
    }

    /// The point in the middle of a cell.
    pub fn receiver(&self, cell: usize, normal: DVec3) -> Receiver {
        let (column, row) = (cell % self.columns, cell / self.columns);
        Receiver { point_mm: self.at(column as f64 + 0.5, row as f64 + 0.5), normal }
    }
}

/// Lines of a camera.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    sheet: Sheet,
    /// Where all lines end; `None` where all go the same way.
    eye_mm: Option<DVec3>,
    ahead: DVec3,
    samples: usize,
}

impl Camera {
    /// Its lines.
    ///
    /// # Errors
    /// [`Error::Unusable`] where a size, a vector or a count cannot be.
    pub fn lens(&self) -> Result<Lens, Error> {
        sides(["view.camera.columns", "view.camera.rows"], self.columns, self.rows)?;
        if !(1..=MOST_SAMPLES).contains(&self.samples) {
            let found = format!("{} lines along each side of a cell were asked for.", self.samples);
            return Err(geometry("view.camera.samples", found, "Ask for 1 to 16."));
        }
        let eye_mm = place_mm("view.camera.eye_mm", self.eye_mm)?;
        let target_mm = place_mm("view.camera.target_mm", self.target_mm)?;
        let ahead = unit("view.camera.target_mm", target_mm - eye_mm).map_err(|_| {
            geometry("view.camera.target_mm", "The camera is where it looks at.", "Give another place of the camera.")
        })?;
        let [right, up] = axes("view.camera.up", ahead, self.up)?;
        let (middle, width, eye_mm) = match self.width {
            Width::Orthographic(width_mm) => (target_mm, length_mm("view.camera.width_mm", width_mm)?, None),
            Width::Perspective(field_deg) if field_deg > 0.0 && field_deg < 180.0 => {
                (eye_mm + ahead, 2.0 * (0.5 * field_deg).to_radians().tan(), Some(eye_mm))
            }
            Width::Perspective(field_deg) => {
                let found = format!("A field of {field_deg} degrees cannot be projected on a plane.");
                return Err(geometry("view.camera.field_deg", found, "Give an angle between 0 and 180 degrees."));
            }
        };
        let cell = width / self.columns as f64;
        let sheet = Sheet { middle, right: cell * right, up: cell * up, columns: self.columns, rows: self.rows };
        Ok(Lens { sheet, eye_mm, ahead, samples: self.samples })
    }
}

impl Lens {
    /// What it sees.
    pub fn sheet(&self) -> &Sheet {
        &self.sheet
    }

    /// Whether a place is in its picture.
    pub fn sees(&self, place_mm: DVec3) -> bool {
        let from_middle = match self.eye_mm {
            None => place_mm - self.sheet.middle,
            Some(eye_mm) => {
                let depth = (place_mm - eye_mm).dot(self.ahead);
                if depth <= 0.0 {
                    return false;
                }
                (place_mm - eye_mm) / depth - (self.sheet.middle - eye_mm)
            }
        };
        let within = |side: DVec3| from_middle.dot(side).abs() <= side.length_squared();
        self.sheet.half_sides_mm().into_iter().all(within)
    }

    /// Lines along each side of a cell.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// Calls `visit` with the lines of a cell.
    pub fn lines(&self, cell: usize, mut visit: impl FnMut(Line)) {
        let (column, row) = (cell % self.sheet.columns, cell / self.sheet.columns);
        let part = |k: usize| (k as f64 + 0.5) / self.samples as f64;
        for along in 0..self.samples {
            for across in 0..self.samples {
                let seen = self.sheet.at(column as f64 + part(across), row as f64 + part(along));
                visit(match self.eye_mm {
                    Some(eye_mm) => Line { point_mm: eye_mm, direction: (eye_mm - seen).normalize(), ends: true },
                    None => Line { point_mm: seen, direction: -self.ahead, ends: false },
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane() -> Plane {
        let center_mm = DVec3::new(0.0, 0.0, 3.0);
        Plane { center_mm, normal: None, up: None, width_mm: 4.0, height_mm: 2.0, columns: 4, rows: 2 }
    }

    /// A source that looks along +Z lights a plane above it from below: seen from there, up is +Y and right is -X.
    #[test]
    fn a_plane_is_seen_from_the_side_that_is_lit() {
        let (sheet, normal) = plane().sheet(&Frame::looking(Axis::PosZ)).unwrap();
        assert_eq!(normal, DVec3::NEG_Z);
        assert_eq!(sheet.receiver(0, normal).point_mm, DVec3::new(1.5, 0.5, 3.0));
        assert_eq!(sheet.receiver(7, normal).point_mm, DVec3::new(-1.5, -0.5, 3.0));
    }

    /// A plane behind the source looks at it too; a normal that was given stays.
    #[test]
    fn a_plane_looks_at_the_source() {
        let frame = Frame::looking(Axis::PosZ);
        // The plane lies at z = 3; rounding does not turn it away from the light of a source that it goes through.
        for (source, expected) in
            [(0.0, DVec3::NEG_Z), (9.0, DVec3::Z), (3.0, DVec3::NEG_Z), (3.0 + 1e-8, DVec3::NEG_Z)]
        {
            let middle = DVec3::new(1.0, 2.0, source);
            let faced = plane().facing(&frame, Bounds { min: middle - DVec3::X, max: middle + DVec3::X });
            assert_eq!(faced.sheet(&frame).unwrap().1, expected);
        }
        let given = Plane { normal: Some(DVec3::X), ..plane() };
        assert_eq!(given.facing(&frame, Bounds { min: DVec3::ZERO, max: DVec3::ZERO }), given);
    }

    #[test]
    fn a_camera_sees_right_and_up() {
        let camera = Camera {
            eye_mm: DVec3::new(0.0, 0.0, 10.0),
            target_mm: DVec3::ZERO,
            up: None,
            width: Width::Perspective(90.0),
            columns: 2,
            rows: 2,
            samples: 1,
        };
        let mut lines = Vec::new();
        camera.lens().unwrap().lines(1, |line| lines.push(line));
        // From +Z with +Y up, the upper right cell looks towards +X and +Y.
        let seen = -lines[0].direction;
        assert!((seen - DVec3::new(0.5, 0.5, -1.0).normalize()).length() < 1e-15, "{seen}");
        let from_the_side = Camera { eye_mm: DVec3::X, width: Width::Orthographic(2.0), ..camera };
        from_the_side.lens().unwrap().lines(1, |line| lines.push(line));
        assert!((lines[1].point_mm - DVec3::new(0.0, 0.5, 0.5)).length() < 1e-15);
        assert_eq!(lines[1].direction, DVec3::X);
    }

    #[test]
    fn what_cannot_be_is_told() {
        let frame = Frame::looking(Axis::PosZ);
        let wrong = [
            Plane { columns: 0, ..plane() },
            Plane { rows: 5000, ..plane() },
            Plane { width_mm: -1.0, ..plane() },
            Plane { height_mm: f64::NAN, ..plane() },
            Plane { up: Some(DVec3::Z), ..plane() },
            Plane { normal: Some(DVec3::ZERO), ..plane() },
            Plane { center_mm: DVec3::splat(f64::INFINITY), ..plane() },
        ];
        for plane in wrong {
            assert_eq!(plane.sheet(&frame).unwrap_err().code(), "evaluation.geometry", "{plane:?}");
        }
        assert_eq!(steps("c_step_deg", 2.5, 360.0).unwrap(), 144);
        for step_deg in [0.0, -1.0, 7.0, f64::NAN, 1e-9] {
            assert!(steps("c_step_deg", step_deg, 360.0).is_err(), "{step_deg}");
        }
    }
}
