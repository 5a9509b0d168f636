//! Spectra to draw wavelengths from.

use crate::vocabulary::spectrum::Table;

/// A spectral table with its running integral.
#[derive(Clone, Debug, PartialEq)]
pub struct EmissionSpectrum {
    points: Vec<(f64, f64)>,
    /// Integral up to each point.
    running: Vec<f64>,
    table: Table,
}

impl EmissionSpectrum {
    /// A spectrum of `(nm, weight per nm)` points; `None` where [`Table::new`] says so or where it is a single line.
    pub fn new(points: &[(f64, f64)]) -> Option<EmissionSpectrum> {
        let table = Table::new(points)?;
        let mut sum = 0.0;
        let mut running = vec![0.0];
        for pair in points.windows(2) {
            sum += 0.5 * (pair[0].1 + pair[1].1) * (pair[1].0 - pair[0].0);
            running.push(sum);
        }
        (sum > 0.0).then_some(EmissionSpectrum { points: points.to_vec(), running, table })
    }

    /// The points, `(nm, weight per nm)`.
    pub fn points(&self) -> &[(f64, f64)] {
        &self.points
    }

    /// The same as a table.
    pub fn table(&self) -> &Table {
        &self.table
    }

    /// The wavelength below which the share `u` (0..1) of the flux lies, nm.
    pub fn draw_nm(&self, u: f64) -> f64 {
        let goal = u * self.running[self.running.len() - 1];
        let k = self.running.partition_point(|sum| *sum <= goal).clamp(1, self.running.len() - 1);
        let ((from_nm, from), (to_nm, to)) = (self.points[k - 1], self.points[k]);
        let (width, rest) = (to_nm - from_nm, goal - self.running[k - 1]);
        // Solves from·t + slope·t²/2 = rest in the form that does not cancel.
        let slope = (to - from) / width;
        let root = (from * from + 2.0 * slope * rest).max(0.0).sqrt();
        let step = if from + root > 0.0 { 2.0 * rest / (from + root) } else { 0.0 };
        from_nm + step.clamp(0.0, width)
    }
}
