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
    /// ∫ weight dλ up to each point.
    #[serde(skip)]
    below: Vec<f64>,
    /// Luminous efficacy of the radiation, lm/W.
    #[serde(skip)]
    lm_per_w: f64,
}

impl Table {
    /// A table of `(nm, weight per nm)`; `None` unless wavelengths are finite, positive and strictly increasing, weights finite and
    /// not negative with at least one positive. A single point is a line (all energy at that wavelength).
    pub fn new(points: &[(f64, f64)]) -> Option<Table> {
        let ordered = points.windows(2).all(|pair| pair[0].0 < pair[1].0);
        let sane =
            points.iter().all(|(nm, weight)| nm.is_finite() && *nm > 0.0 && weight.is_finite() && *weight >= 0.0);
        let lit = points.iter().any(|(_, weight)| *weight > 0.0);
        if !(ordered && sane && lit) {
            return None;
        }
        let mut below = vec![0.0];
        for pair in points.windows(2) {
            below.push(below[below.len() - 1] + 0.5 * (pair[1].0 - pair[0].0) * (pair[0].1 + pair[1].1));
        }
        let lm_per_w = match points {
            [(nm, _)] => lm_per_w(*nm),
            _ => points.windows(2).map(lumens).sum::<f64>() / below[below.len() - 1],
        };
        let (nm, weight) = points.iter().copied().unzip();
        Some(Table { nm, weight, below, lm_per_w })
    }

    /// Its points, `(nm, weight per nm)`, by wavelength.
    pub fn points(&self) -> impl ExactSizeIterator<Item = (f64, f64)> + '_ {
        self.nm.iter().copied().zip(self.weight.iter().copied())
    }

    /// First and last wavelength, nm.
    pub fn range_nm(&self) -> (f64, f64) {
        (self.nm[0], self.nm[self.nm.len() - 1])
    }

    /// Share of the radiant flux in each band; sums to 1 less what lies outside the bands.
    pub fn shares(&self, bands: &Bands) -> Vec<f64> {
        if self.nm.len() == 1 {
            let band = bands.band(self.nm[0]);
            return (0..bands.len()).map(|k| if Some(k) == band { 1.0 } else { 0.0 }).collect();
        }
        let below: Vec<f64> = bands.edges_nm().iter().map(|edge| self.share_below(*edge)).collect();
        below.windows(2).map(|pair| pair[1] - pair[0]).collect()
    }

    /// Share of the radiant flux below `nm`.
    fn share_below(&self, nm: f64) -> f64 {
        let next = self.nm.partition_point(|point| *point <= nm);
        let last = self.nm.len() - 1;
        let area = match next {
            0 => 0.0,
            next if next > last => self.below[last],
            next => {
                let (from, span) = (self.nm[next - 1], self.nm[next] - self.nm[next - 1]);
                let slope = (self.weight[next] - self.weight[next - 1]) / span;
                self.below[next - 1] + (nm - from) * (self.weight[next - 1] + 0.5 * slope * (nm - from))
            }
        };
        area / self.below[last]
    }

    /// Luminous efficacy of the radiation, lm/W.
    pub fn lm_per_w(&self) -> f64 {
        self.lm_per_w
    }
}

/// `∫ 683 V(λ) weight(λ) dλ` between two neighbouring points of a table, by Simpson's rule on pieces of at most 1 nm within the
/// range where V(λ) is not 0: the work is bounded by the visible range, whatever the table says.
fn lumens(pair: &[(f64, f64)]) -> f64 {
    let [(nm, weight), (next_nm, next_weight)] = pair else { return 0.0 };
    let last_nm = FIRST_NM + (CMF.len() - 1) as f64;
    let (from, to) = (nm.max(FIRST_NM), next_nm.min(last_nm));
    if to <= from {
        return 0.0;
    }
    let value = |at: f64| (weight + (at - nm) / (next_nm - nm) * (next_weight - weight)) * lm_per_w(at);
    let pieces = (to - from).ceil().max(1.0);
    let step = (to - from) / pieces;
    (0..pieces as usize)
        .map(|piece| from + piece as f64 * step)
        .map(|a| step / 6.0 * (value(a) + 4.0 * value(a + 0.5 * step) + value(a + step)))
        .sum()
}

/// The smallest range that holds both.
pub fn wider(a: Option<(f64, f64)>, b: Option<(f64, f64)>) -> Option<(f64, f64)> {
    match (a, b) {
        (Some((low, high)), Some((other_low, other_high))) => Some((low.min(other_low), high.max(other_high))),
        (a, b) => a.or(b),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_areas_under_the_table() {
        // A triangle of area 20 from 500 to 540 nm: 1/8 of it below 510, 1/2 below 520.
        let table = Table::new(&[(500.0, 0.0), (520.0, 1.0), (540.0, 0.0)]).unwrap();
        let bands = Bands::new(vec![490.0, 510.0, 520.0, 535.0]).unwrap();
        let expected = [0.125, 0.375, 0.5 - 12.5 / 400.0];
        table.shares(&bands).iter().zip(expected).for_each(|(share, exact)| assert!((share - exact).abs() < 1e-15));
    }

    #[test]
    fn efficacies_are_those_of_the_standard() {
        // CIE: 683 lm/W at 555 nm; V(507 nm) = 0.4442 and V(610 nm) = 0.503 (CIE 1924 table).
        for (nm, v) in [(555.0, 1.0), (507.0, 0.4441), (610.0, 0.503), (940.0, 0.0)] {
            let line = Table::new(&[(nm, 3.0)]).unwrap();
            assert!((line.lm_per_w() - 683.0 * v).abs() < 0.2, "{nm} nm: {}", line.lm_per_w());
        }
        // Equal energy over the visible range: ∫ V = 106.857 nm (CIE 018), so 683 × 106.857 / 470 lm/W.
        let even = Table::new(&[(360.0, 1.0), (830.0, 1.0)]).unwrap();
        assert!((even.lm_per_w() / (683.0 * 106.857 / 470.0) - 1.0).abs() < 1e-4, "{}", even.lm_per_w());
    }

    #[test]
    fn a_table_over_all_the_world_costs_no_more_than_the_visible_range() {
        let wide: Vec<(f64, f64)> = (0..100_000).map(|k| (1.0 + 1e30 * k as f64, 1.0)).collect();
        assert!(Table::new(&wide).unwrap().lm_per_w() < 1e-20);
    }
}
