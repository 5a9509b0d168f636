//! What is changed of a model: its flux, which way it looks, where it stands.

use crate::error::{Error, Place};
use crate::vocabulary::declaration::Total;
use crate::vocabulary::spectrum::Table;
use crate::vocabulary::units::Flux;
use glam::{DMat3, DVec3};

/// By how much an entry of a rotation may miss 0, 1 or -1 and be it: quarter turns are exact.
const NEARLY: f64 = 1e-12;
/// Farthest move, mm: as far as a vertex may be.
const FARTHEST_MM: f64 = 1e9;

/// How strong the light becomes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Strength {
    /// So many times what it was.
    Factor(f64),
    /// So much: W or lm; the other quantity goes along.
    Flux(Total),
}

/// A turn about an axis through the origin, counter-clockwise as seen from where the axis points to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// The axis, of any length but 0.
    pub axis: DVec3,
    /// By how much.
    pub degrees: f64,
}

/// What is changed: the spectrum, then the flux; then the model is turned, turn by turn; then moved.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Change {
    /// The spectrum that all of its light gets; `None`: as it is.
    pub spectrum: Option<Table>,
    /// How strong its light becomes; `None`: as it is.
    pub strength: Option<Strength>,
    /// Turns, in their order.
    pub turns: Vec<Turn>,
    /// How far it is moved, mm.
    pub move_mm: DVec3,
}

fn unusable(field: &'static str, found: String, remedy: &str) -> Error {
    Error::invalid_declaration("combination.change", Place::Asked(field), found, remedy)
}

impl Change {
    /// The rotation that all turns together are; quarter turns about axes have entries of exactly 0, 1 and -1.
    ///
    /// # Errors
    /// [`Error::Unusable`] where an axis or an angle is none.
    pub fn rotation(&self) -> Result<DMat3, Error> {
        let mut rotation = DMat3::IDENTITY;
        for turn in &self.turns {
            let axis = turn.axis.try_normalize().filter(|axis| axis.is_finite());
            let (Some(axis), true) = (axis, turn.degrees.is_finite()) else {
                let found = format!("A turn by {} degrees about {} is none.", turn.degrees, turn.axis);
                return Err(unusable("turns", found, "Give an axis that is not 0, and an angle in degrees."));
            };
            rotation = snapped(DMat3::from_axis_angle(axis, turn.degrees.to_radians())) * rotation;
        }
        Ok(snapped(rotation))
    }

    /// How far it is moved.
    ///
    /// # Errors
    /// [`Error::Unusable`] beyond what a model may hold.
    pub fn shift_mm(&self) -> Result<DVec3, Error> {
        if self.move_mm.abs().max_element() <= FARTHEST_MM {
            return Ok(self.move_mm);
        }
        let found = format!("A move by {} mm is farther than 1000 km, or none.", self.move_mm);
        Err(unusable("move_mm", found, "Give three lengths in mm."))
    }

    /// What the flux of a model is multiplied by.
    ///
    /// # Errors
    /// [`Error::Unusable`] where that is no positive number, or the model does not know the quantity.
    pub fn factor(&self, flux: &Flux) -> Result<f64, Error> {
        let factor = match self.strength {
            None => 1.0,
            Some(Strength::Factor(factor)) => factor,
            Some(Strength::Flux(total)) => {
                let known = flux.of(total.quantity()).filter(|known| *known > 0.0);
                let known = known.ok_or_else(|| {
                    let unit = total.quantity().unit();
                    let found =
                        format!("The flux is to be {} {unit}, and the model has no flux in {unit}.", total.value());
                    unusable(
                        "flux",
                        found,
                        "Give the flux in the other unit, or build the model with a spectrum declared.",
                    )
                })?;
                total.value() / known
            }
        };
        let times = |known: Option<f64>| known.map(|known| factor * known);
        let changed = Flux { radiant_w: times(flux.radiant_w), luminous_lm: times(flux.luminous_lm) };
        if factor > 0.0 && changed.is_modelled() {
            return Ok(factor);
        }
        let remedy = "Give a positive factor or flux, such that the flux lies between 1e-20 and 1e24.";
        Err(match self.strength {
            Some(Strength::Flux(total)) => {
                let found = format!("The flux is to be {} {}.", total.value(), total.quantity().unit());
                unusable("flux", found, remedy)
            }
            _ => unusable("scale", format!("The flux is to be {factor} times what it is."), remedy),
        })
    }
}

/// The rotation with entries that are nearly 0, 1 or -1 made so.
fn snapped(rotation: DMat3) -> DMat3 {
    let exact = |entry: f64| if (entry - entry.round()).abs() < NEARLY { entry.round() + 0.0 } else { entry };
    DMat3::from_cols_array(&rotation.to_cols_array().map(exact))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_follow_each_other_and_quarter_turns_are_exact() {
        let change = |turns: &[(DVec3, f64)]| Change {
            turns: turns.iter().map(|(axis, degrees)| Turn { axis: *axis, degrees: *degrees }).collect(),
            ..Change::default()
        };
        // The right hand: a quarter about +Z takes X to Y; then one about +X takes Y to Z.
        let rotation = change(&[(DVec3::Z, 90.0), (3.0 * DVec3::X, 90.0)]).rotation().unwrap();
        assert_eq!(rotation * DVec3::X, DVec3::Z);
        assert_eq!(change(&[(DVec3::Y, 30.0); 12]).rotation().unwrap(), DMat3::IDENTITY);
        let third = change(&[(DVec3::ONE, 120.0)]).rotation().unwrap();
        assert_eq!([third * DVec3::X, third * DVec3::Y, third * DVec3::Z], [DVec3::Y, DVec3::Z, DVec3::X]);
        for (axis, degrees) in [(DVec3::ZERO, 10.0), (DVec3::X, f64::NAN), (DVec3::X * f64::INFINITY, 1.0)] {
            assert_eq!(change(&[(axis, degrees)]).rotation().unwrap_err().code(), "combination.change");
        }
    }

    #[test]
    fn a_flux_is_a_factor_where_the_model_knows_it() {
        let flux = Flux { radiant_w: Some(2.0), luminous_lm: None };
        let factor = |strength| Change { strength: Some(strength), ..Change::default() }.factor(&flux);
        assert_eq!(factor(Strength::Factor(0.5)).unwrap(), 0.5);
        assert_eq!(factor(Strength::Flux(Total::RadiantW(5.0))).unwrap(), 2.5);
        for wrong in [
            Strength::Factor(0.0),
            Strength::Factor(-1.0),
            Strength::Factor(f64::INFINITY),
            Strength::Factor(1e36),
            Strength::Factor(1e-36),
            Strength::Flux(Total::LuminousLm(5.0)),
            Strength::Flux(Total::RadiantW(f64::NAN)),
        ] {
            assert_eq!(factor(wrong).unwrap_err().code(), "combination.change", "{wrong:?}");
        }
        let far = Change { move_mm: DVec3::new(0.0, 2e9, 0.0), ..Change::default() };
        assert_eq!(far.shift_mm().unwrap_err().code(), "combination.change");
    }
}
