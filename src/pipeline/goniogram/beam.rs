//! How wide the beam is, which decides how fine its grid must be.

use crate::rays::direction_cube::DirectionCube;

/// The part of the far field above half maximum.
pub struct Beam {
    solid_angle_sr: f64,
    pub rays: f64,
}

impl Beam {
    pub fn of(directions: &DirectionCube) -> Beam {
        let cells = directions.flux.iter().zip(&directions.rays).enumerate();
        let mut bright: Vec<(f64, f64, f64)> = cells
            .map(|(cell, (flux, rays))| {
                (flux / DirectionCube::solid_angle_sr(cell), DirectionCube::solid_angle_sr(cell), *rays as f64)
            })
            .filter(|(intensity, ..)| *intensity > 0.0)
            .collect();
        bright.sort_by(|a, b| b.0.total_cmp(&a.0));
        // The maximum of many noisy cells is mostly noise: take the mean of those that carry the brightest twentieth of the flux.
        let total: f64 = bright.iter().map(|(intensity, solid_angle, _)| intensity * solid_angle).sum();
        let (mut flux, mut solid_angle_sr) = (0.0, 0.0);
        for (intensity, solid_angle, _) in &bright {
            if flux >= 0.05 * total {
                break;
            }
            flux += intensity * solid_angle;
            solid_angle_sr += solid_angle;
        }
        let half = 0.5 * flux / solid_angle_sr;
        let mut beam = Beam { solid_angle_sr: 0.0, rays: 0.0 };
        for (_, solid_angle, rays) in bright.iter().take_while(|(intensity, ..)| *intensity >= half) {
            beam.solid_angle_sr += solid_angle;
            beam.rays += rays;
        }
        beam
    }

    /// Full width at half maximum, degrees: that of the round beam of the same solid angle.
    pub fn full_width_deg(&self) -> f64 {
        let cosine = 1.0 - self.solid_angle_sr / std::f64::consts::TAU;
        2.0 * cosine.clamp(-1.0, 1.0).acos().to_degrees()
    }

    /// Edge of the square cell that holds `rays` of the beam's rays, degrees.
    pub fn cell_deg(&self, rays: f64) -> f64 {
        (rays * self.solid_angle_sr / self.rays).sqrt().to_degrees()
    }
}
