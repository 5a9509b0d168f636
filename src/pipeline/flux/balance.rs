//! Where every ray and every watt went.

use crate::vocabulary::units::Flux;
use serde::Serialize;

/// One fate of rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Share {
    /// How many rays.
    pub rays: u64,
    /// Their flux.
    pub flux: Flux,
}

/// Flux in = hit + snapped + rejected, in count and in flux.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Balance {
    /// All rays of the source.
    pub incoming: Share,
    /// Rays whose line meets the hull.
    pub hit: Share,
    /// Rays laid on the nearest triangle, because their line meets none.
    pub snapped: Share,
    /// Rays that are farther from the hull than the tolerance; their flux is not in the model.
    pub rejected: Share,
    /// Sum over triangles.
    pub on_triangles: Flux,
    /// Sum over vertices, before smoothing.
    pub on_vertices: Flux,
    /// Sum over vertices, after smoothing.
    pub after_smoothing: Flux,
}

impl Balance {
    /// Largest relative difference between flux in, fates, triangles, vertices and smoothed vertices, over both quantities.
    pub fn error(&self) -> f64 {
        let quantity = |of: &dyn Fn(&Flux) -> Option<f64>| {
            let value = |flux: &Flux| of(flux).unwrap_or(0.0);
            let total = value(&self.incoming.flux);
            let on_hull = value(&self.hit.flux) + value(&self.snapped.flux);
            let fates = (on_hull + value(&self.rejected.flux) - total).abs();
            let sums = [&self.on_triangles, &self.on_vertices, &self.after_smoothing];
            let worst = sums.iter().map(|sum| (value(sum) - on_hull).abs()).fold(fates, f64::max);
            if total > 0.0 { worst / total } else { 0.0 }
        };
        quantity(&|flux| flux.radiant_w).max(quantity(&|flux| flux.luminous_lm))
    }

    /// True when every ray met exactly one fate.
    pub fn every_ray_once(&self) -> bool {
        self.hit.rays + self.snapped.rays + self.rejected.rays == self.incoming.rays
    }
}
