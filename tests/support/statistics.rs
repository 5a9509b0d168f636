//! Random estimates are judged by their own statistics, with a stated false-alarm rate.

/// z beyond which a check raises the alarm. One-sided normal tail at 6: 1e-9, so that a suite of some thousand such checks
/// raises a false alarm less than once in a hundred thousand runs (and every seed is fixed: a passing test stays passing).
pub const ALARM_Z: f64 = 6.0;

/// How far counts are from what was expected, as a normal deviate: Pearson's χ² over cells with an expectation of at least 10,
/// cells below pooled into one, by the Wilson–Hilferty cube root. Positive is too far, strongly negative too good to be
/// true. Also answers the number of cells judged.
pub fn chi_square_z(counted: &[f64], expected: &[f64]) -> (f64, usize) {
    assert_eq!(counted.len(), expected.len());
    let (mut chi_square, mut cells) = (0.0, 0);
    let (mut rest_counted, mut rest_expected) = (0.0, 0.0);
    for (n, mu) in counted.iter().zip(expected) {
        if *mu >= 10.0 {
            chi_square += (n - mu) * (n - mu) / mu;
            cells += 1;
        } else {
            rest_counted += n;
            rest_expected += mu;
        }
    }
    if rest_expected >= 10.0 {
        chi_square += (rest_counted - rest_expected).powi(2) / rest_expected;
        cells += 1;
    } else {
        // A Poisson count with so small an expectation practically never exceeds this.
        assert!(rest_counted <= 60.0, "{rest_counted} rays where {rest_expected} were expected");
    }
    let k = cells as f64;
    let z = ((chi_square / k).cbrt() - (1.0 - 2.0 / (9.0 * k))) / (2.0 / (9.0 * k)).sqrt();
    (z, cells)
}

/// Mean of `f` over the cell of directions `γ ± step/2, C ± step/2` (clipped at the poles), weighted by solid angle: 8 × 8 midpoints.
pub fn cell_mean(c: f64, gamma: f64, c_step: f64, gamma_step: f64, f: impl Fn(f64, f64) -> f64) -> f64 {
    let (low, high) = ((gamma - 0.5 * gamma_step).max(0.0), (gamma + 0.5 * gamma_step).min(std::f64::consts::PI));
    let (mut sum, mut weight) = (0.0, 0.0);
    for i in 0..8 {
        let g = low + (i as f64 + 0.5) / 8.0 * (high - low);
        for j in 0..8 {
            let at = c + ((j as f64 + 0.5) / 8.0 - 0.5) * c_step;
            sum += f(at, g) * g.sin();
            weight += g.sin();
        }
    }
    sum / weight
}
