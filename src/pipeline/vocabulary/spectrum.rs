//! Wavelengths (nm): bands, tables, the CIE 1931 observer, display colour.

use super::cie_1931::{CMF, FIRST_NM};
use super::units::KM_LM_PER_W;
use serde::Serialize;

/// CIE 1931 2° colour-matching functions `[x̄, ȳ, z̄]` at `nm`, linear between the 1 nm table values; 0 outside 360..830 nm.
pub fn color_matching(nm: f64) -> [f64; 3] {
    let at = nm - FIRST_NM;
    if !(at >= 0.0 && at <= (CMF.len() - 1) as f64) {
        return [0.0; 3];
    }
    let low = (at as usize).min(CMF.len() - 2);
    let share = at - low as f64;
    std::array::from_fn(|k| CMF[low][k] + share * (CMF[low + 1][k] - CMF[low][k]))
}

/// Photopic luminous efficiency V(λ), CIE 1924.
pub fn v_lambda(nm: f64) -> f64 {
    color_matching(nm)[1]
}

/// Luminous flux of `1 W` at `nm`, lm/W.
pub fn lm_per_w(nm: f64) -> f64 {
    KM_LM_PER_W * v_lambda(nm)
}

/// Linear sRGB (IEC 61966-2-1, D65) of CIE XYZ; not clipped.
pub fn linear_srgb(xyz: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = xyz;
    [
        3.240_969_941_904_521 * x - 1.537_383_177_570_093 * y - 0.498_610_760_293 * z,
        -0.969_243_636_280_87 * x + 1.875_967_501_507_72 * y + 0.041_555_057_407_175 * z,
        0.055_630_079_696_993 * x - 0.203_976_958_888_976 * y + 1.056_971_514_242_878 * z,
    ]
}

/// Spectral bands: half-open intervals `[edge_k, edge_k+1)`, the last one closed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bands {
    /// Strictly increasing edges, nm; one more than there are bands.
    edges_nm: Vec<f64>,
}

impl Bands {
    /// Bands between `edges_nm`; `None` unless there are at least two, finite, positive and strictly increasing.
    pub fn new(edges_nm: Vec<f64>) -> Option<Bands> {
        let ordered = edges_nm.windows(2).all(|pair| pair[0] < pair[1]);
        let sane = edges_nm.len() >= 2 && edges_nm.iter().all(|edge| edge.is_finite() && *edge > 0.0);
        (ordered && sane).then_some(Bands { edges_nm })
    }

    /// Equal bands of `step_nm` that cover `min_nm..max_nm`, edges at whole multiples of the step.
    pub fn regular(min_nm: f64, max_nm: f64, step_nm: f64) -> Option<Bands> {
        let (first, last) = ((min_nm / step_nm).floor(), (max_nm / step_nm).ceil());
        if !(step_nm > 0.0 && last > first && last - first <= 4096.0) {
            return None;
        }
        Bands::new((0..=(last - first) as usize).map(|k| (first + k as f64) * step_nm).collect())
    }

    /// How many bands.
    pub fn len(&self) -> usize {
        self.edges_nm.len() - 1
    }

    /// Never: there is at least one band.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Edges, nm, one more than bands.
    pub fn edges_nm(&self) -> &[f64] {
        &self.edges_nm
    }

    /// Middles, nm.
    pub fn centers_nm(&self) -> Vec<f64> {
        self.edges_nm.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect()
    }

    /// Widths, nm.
    pub fn widths_nm(&self) -> Vec<f64> {
        self.edges_nm.windows(2).map(|pair| pair[1] - pair[0]).collect()
    }

    /// The band of `nm`, `None` outside.
    pub fn band(&self, nm: f64) -> Option<usize> {
        let last = self.edges_nm.len() - 1;
        if !(nm >= self.edges_nm[0] && nm <= self.edges_nm[last]) {
            return None;
        }
        Some(self.edges_nm.partition_point(|edge| *edge <= nm).min(last) - 1)
    }
}

/// A relative spectral density on a wavelength table, linear between its points, zero outside.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Table {
    nm: Vec<f64>,
    weight: Vec<f64>,
}

impl Table {
    /// A table of `(nm, weight per nm)`; `None` unless wavelengths are finite, positive and strictly increasing, weights finite and
    /// not negative with at least one positive. A single point is a line (all energy at that wavelength).
    pub fn new(points: &[(f64, f64)]) -> Option<Table> {
        let ordered = points.windows(2).all(|pair| pair[0].0 < pair[1].0);
        let sane =
            points.iter().all(|(nm, weight)| nm.is_finite() && *nm > 0.0 && weight.is_finite() && *weight >= 0.0);
        let lit = points.iter().any(|(_, weight)| *weight > 0.0);
        (ordered && sane && lit)
            .then(|| Table { nm: points.iter().map(|p| p.0).collect(), weight: points.iter().map(|p| p.1).collect() })
    }

    /// First and last wavelength, nm.
    pub fn range_nm(&self) -> (f64, f64) {
        (self.nm[0], self.nm[self.nm.len() - 1])
    }

    /// Share of the radiant flux in each band; sums to 1 less what lies outside the bands.
    pub fn shares(&self, bands: &Bands) -> Vec<f64> {
        let total = self.integral(self.nm[0], self.nm[self.nm.len() - 1], |_| 1.0);
        let mut shares = vec![0.0; bands.len()];
        if self.nm.len() == 1 {
            if let Some(band) = bands.band(self.nm[0]) {
                shares[band] = 1.0;
            }
            return shares;
        }
        for (share, edge) in shares.iter_mut().zip(bands.edges_nm().windows(2)) {
            *share = self.integral(edge[0], edge[1], |_| 1.0) / total;
        }
        shares
    }

    /// Luminous efficacy of the radiation, lm/W.
    pub fn lm_per_w(&self) -> f64 {
        if self.nm.len() == 1 {
            return lm_per_w(self.nm[0]);
        }
        let (low, high) = self.range_nm();
        self.integral(low, high, lm_per_w) / self.integral(low, high, |_| 1.0)
    }

    /// `∫ weight(λ) f(λ) dλ` over `low..high` nm: exact for constant `f`, Simpson on pieces of at most 1 nm otherwise.
    fn integral(&self, low: f64, high: f64, f: impl Fn(f64) -> f64) -> f64 {
        let mut sum = 0.0;
        for k in 1..self.nm.len() {
            let (from, to) = (self.nm[k - 1].max(low), self.nm[k].min(high));
            if to <= from {
                continue;
            }
            let weight = |nm: f64| {
                let share = (nm - self.nm[k - 1]) / (self.nm[k] - self.nm[k - 1]);
                self.weight[k - 1] + share * (self.weight[k] - self.weight[k - 1])
            };
            let pieces = (to - from).ceil().clamp(1.0, 10_000.0) as usize;
            let step = (to - from) / pieces as f64;
            for piece in 0..pieces {
                let a = from + piece as f64 * step;
                let (m, b) = (a + 0.5 * step, a + step);
                sum += step / 6.0 * (weight(a) * f(a) + 4.0 * weight(m) * f(m) + weight(b) * f(b));
            }
        }
        sum
    }
}
