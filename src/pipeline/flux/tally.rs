//! Sums per site that do not depend on the number of threads.

use super::super::vocabulary::units::Flux;

/// Amounts per site: a site is a vertex, a triangle, or a cell of directions.
#[derive(Clone, Debug, PartialEq)]
pub struct Amounts {
    /// Rays per site; a ray shared between sites counts by its shares.
    pub rays: Vec<f64>,
    /// Radiant flux per site, W; `None` where the source's is unknown.
    pub radiant_w: Option<Vec<f64>>,
    /// Luminous flux per site, lm; `None` where the source's is unknown.
    pub luminous_lm: Option<Vec<f64>>,
    /// Spectral columns, `[site][column]` row-major, in the unit of [`crate::pipeline::rays::source::Spectral::deposit`].
    pub columns: Vec<f64>,
    /// Columns per site.
    pub column_count: usize,
}

impl Amounts {
    /// How many sites.
    pub fn len(&self) -> usize {
        self.rays.len()
    }

    /// True without sites.
    pub fn is_empty(&self) -> bool {
        self.rays.is_empty()
    }

    /// Spectral columns of a site.
    pub fn columns_of(&self, site: usize) -> &[f64] {
        &self.columns[site * self.column_count..][..self.column_count]
    }

    /// The flux that weights sites where one number is wanted: radiant where known, else luminous.
    pub fn primary(&self) -> &[f64] {
        self.radiant_w.as_deref().or(self.luminous_lm.as_deref()).unwrap_or(&[])
    }

    /// Sum over all sites, in site order.
    pub fn total(&self) -> Flux {
        let sum = |values: &Option<Vec<f64>>| values.as_ref().map(|values| values.iter().sum());
        Flux { radiant_w: sum(&self.radiant_w), luminous_lm: sum(&self.luminous_lm) }
    }
}
