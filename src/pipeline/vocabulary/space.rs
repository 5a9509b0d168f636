//! The source frame: the ray file's own right-handed axes, lengths in mm, directions unit vectors.

use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One of the six axis directions of the source frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
pub enum Axis {
    /// +X
    #[serde(rename = "+X")]
    PosX,
    /// -X
    #[serde(rename = "-X")]
    NegX,
    /// +Y
    #[serde(rename = "+Y")]
    PosY,
    /// -Y
    #[serde(rename = "-Y")]
    NegY,
    /// +Z
    #[serde(rename = "+Z")]
    PosZ,
    /// -Z
    #[serde(rename = "-Z")]
    NegZ,
}

impl Axis {
    /// All six, in the order in which ties are broken: an LED file looks along +Z.
    pub const ALL: [Axis; 6] = [Axis::PosZ, Axis::NegZ, Axis::PosX, Axis::NegX, Axis::PosY, Axis::NegY];

    /// Unit vector in the source frame.
    pub fn vector(self) -> DVec3 {
        match self {
            Axis::PosX => DVec3::X,
            Axis::NegX => DVec3::NEG_X,
            Axis::PosY => DVec3::Y,
            Axis::NegY => DVec3::NEG_Y,
            Axis::PosZ => DVec3::Z,
            Axis::NegZ => DVec3::NEG_Z,
        }
    }

    /// 0, 1 or 2 for x, y, z.
    pub fn component(self) -> usize {
        match self {
            Axis::PosX | Axis::NegX => 0,
            Axis::PosY | Axis::NegY => 1,
            Axis::PosZ | Axis::NegZ => 2,
        }
    }

    /// The axis in which `direction` (any length but 0) has its largest component.
    pub fn nearest(direction: DVec3) -> Axis {
        let mut best = Axis::PosZ;
        for axis in Axis::ALL {
            if direction.dot(axis.vector()) > direction.dot(best.vector()) {
                best = axis;
            }
        }
        best
    }

    /// The name users write: "+Z".
    pub fn name(self) -> &'static str {
        match self {
            Axis::PosX => "+X",
            Axis::NegX => "-X",
            Axis::PosY => "+Y",
            Axis::NegY => "-Y",
            Axis::PosZ => "+Z",
            Axis::NegZ => "-Z",
        }
    }

    /// Reads what [`Axis::name`] writes; the sign may be left out when positive.
    pub fn parse(text: &str) -> Option<Axis> {
        Axis::ALL.into_iter().find(|axis| {
            text.eq_ignore_ascii_case(axis.name())
                || axis.name().strip_prefix('+').is_some_and(|bare| text.eq_ignore_ascii_case(bare))
        })
    }
}

/// An axis-parallel box in the source frame, mm. Empty when `min > max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates, mm.
    pub min: DVec3,
    /// Largest coordinates, mm.
    pub max: DVec3,
}

impl Bounds {
    /// Holds nothing.
    pub const EMPTY: Bounds = Bounds { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// The smallest box that holds `points`.
    pub fn of(points: impl IntoIterator<Item = DVec3>) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        for point in points {
            bounds.grow(point);
        }
        bounds
    }

    /// Makes room for `point`.
    pub fn grow(&mut self, point: DVec3) {
        self.min = self.min.min(point);
        self.max = self.max.max(point);
    }

    /// The smallest box that holds both.
    pub fn union(self, other: Bounds) -> Bounds {
        Bounds { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Edge lengths, mm; zero when empty.
    pub fn size(&self) -> DVec3 {
        (self.max - self.min).max(DVec3::ZERO)
    }

    /// Middle, mm.
    pub fn center(&self) -> DVec3 {
        0.5 * (self.min + self.max)
    }
}

/// The photometric frame of a type C goniogram (`pipeline/README.md`, frames; LM-63: γ = 0 is nadir).
/// γ = 0 at `-z`, C0 at `x`, C90 at `y`, C counter-clockwise seen from `z`. For a +Z emitter: x = +X, y = -Y, z = -Z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// The source axis at γ = 0.
    pub nadir: Axis,
    /// The source axis at C0, γ = 90°.
    pub c0: Axis,
}

impl Frame {
    /// The frame looking along `nadir`. C0 defaults to the next axis in cyclic order (+Z → +X, +X → +Y, +Y → +Z), so that
    /// turning a source by a cyclic permutation turns its goniogram with it.
    pub fn looking(nadir: Axis) -> Frame {
        let c0 = match nadir.component() {
            0 => Axis::PosY,
            1 => Axis::PosZ,
            _ => Axis::PosX,
        };
        Frame { nadir, c0 }
    }

    /// Unit vector of C0 in the source frame.
    pub fn x(&self) -> DVec3 {
        self.c0.vector()
    }

    /// Unit vector of C90 in the source frame.
    pub fn y(&self) -> DVec3 {
        self.z().cross(self.x())
    }

    /// Unit vector of the zenith (γ = 180°) in the source frame.
    pub fn z(&self) -> DVec3 {
        -self.nadir.vector()
    }

    /// Takes photometric coordinates to source coordinates (columns x, y, z).
    pub fn source_from_photometric(&self) -> DMat3 {
        DMat3::from_cols(self.x(), self.y(), self.z())
    }

    /// `(C, γ)` of a unit direction in the source frame, radians; C in [0, 2π), γ in [0, π].
    pub fn angles(&self, direction: DVec3) -> (f64, f64) {
        let (x, y, z) = (direction.dot(self.x()), direction.dot(self.y()), direction.dot(self.z()));
        let gamma = (x * x + y * y).sqrt().atan2(-z);
        let c = y.atan2(x);
        // A tiny negative angle plus 2π rounds to 2π itself, which is 0.
        let c = if c < 0.0 { c + std::f64::consts::TAU } else { c };
        (if c >= std::f64::consts::TAU { 0.0 } else { c }, gamma)
    }

    /// Unit direction in the source frame at `(C, γ)` radians.
    pub fn direction(&self, c: f64, gamma: f64) -> DVec3 {
        self.source_from_photometric() * DVec3::new(gamma.sin() * c.cos(), gamma.sin() * c.sin(), -gamma.cos())
    }
}
