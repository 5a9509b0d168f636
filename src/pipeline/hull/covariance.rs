//! Symmetric 3 x 3 matrices of second moments: along which direction points spread least.

use glam::{DMat3, DVec3};

pub fn trace(m: DMat3) -> f64 {
    m.x_axis.x + m.y_axis.y + m.z_axis.z
}

pub fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// Unit vector along which a covariance is least, of those that are equal the nearest to `start`: inverse iteration.
pub fn flattest(spread: DMat3, start: DVec3) -> DVec3 {
    let trace = trace(spread);
    if trace <= 0.0 {
        return start;
    }
    let inverse = (spread * (1.0 / trace) + DMat3::from_diagonal(DVec3::splat(1e-9))).inverse();
    let mut least = start;
    for _ in 0..16 {
        least = (inverse * least).normalize_or(start);
    }
    least
}
