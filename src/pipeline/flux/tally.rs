//! Sums per site that do not depend on the number of threads.
//!
//! Fluxes are counted in whole quanta, a power of two chosen from the total, so that addition is exact and commutative: any
//! number of threads may add in any order, a ray split between sites loses nothing, and every balance closes to the bit. A
//! quantum is at most 2⁻⁶⁰ of the total: the largest set of rays (2³¹) still has 2²⁹ quanta in an average ray, more than an f32
//! file can tell apart.

use crate::error::Error;
use crate::hull::Cloud;
use crate::source::{Ray, Spectral};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::units::Flux;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Quanta in one ray's count: shares of a ray are counted to a millionth.
const RAY_QUANTA: f64 = (1u64 << 20) as f64;
/// A total is at most 2^this quanta; sums of it and its rounding stay below 2⁶⁴.
const TOTAL_BITS: i32 = 61;
/// Tristimulus X and Z may exceed Y (the total) by up to 2^this: z̄/ȳ of any wavelength above 400 nm.
const TRISTIMULUS_BITS: i32 = 8;
/// Values in front of the columns of a site: rays, radiant, luminous.
pub const FIXED: usize = 3;
/// Most columns one ray deposits into.
const MOST_COLUMNS: usize = 3;

/// Quanta per unit of each quantity of one source; powers of two.
#[derive(Clone, Debug)]
pub struct Quanta {
    spectral: Spectral,
    flux: Flux,
    per_w: f64,
    per_lm: f64,
    per_column: f64,
    /// The part of a ray that each of its images has.
    per_image: f64,
}

impl Quanta {
    /// Quanta for `cloud`.
    pub fn of(cloud: &Cloud<'_>) -> Quanta {
        let quanta = Quanta::new(cloud.spectral().clone(), cloud.flux());
        Quanta { per_image: 1.0 / cloud.images() as f64, ..quanta }
    }

    /// Quanta for rays of one quantity or both that sum to `flux`, each whole.
    pub fn new(spectral: Spectral, flux: Flux) -> Quanta {
        let per = |total: Option<f64>| match total {
            Some(total) if total > 0.0 && total.is_finite() => 2f64.powi(TOTAL_BITS - 1 - total.log2().ceil() as i32),
            // Known to be nothing (lumens of infrared), or unknown: every amount is 0 of any quantum.
            _ => 1.0,
        };
        let (per_w, per_lm) = (per(flux.radiant_w), per(flux.luminous_lm));
        let per_column = if spectral.has_bands() { per_w } else { per_lm * 2f64.powi(-TRISTIMULUS_BITS) };
        Quanta { spectral, flux, per_w, per_lm, per_column, per_image: 1.0 }
    }

    /// What `ray` deposits, or each of its images.
    pub fn deposit(&self, ray: &Ray) -> Deposit {
        let count = |amount: f64, per_unit: f64| quanta(self.per_image * amount * per_unit);
        let fixed = [count(1.0, RAY_QUANTA), count(ray.radiant_w, self.per_w), count(ray.luminous_lm, self.per_lm)];
        let mut deposit = Deposit { fixed, ..Deposit::default() };
        self.spectral.deposit(ray, |column, amount| {
            if let Some(slot) = deposit.columns.get_mut(deposit.used) {
                *slot = (column, count(amount, self.per_column));
                deposit.used += 1;
            }
        });
        deposit
    }
}

/// Rounds to whole quanta; negative and not-a-number become 0. (`round` is a call on most processors' common instructions.)
fn quanta(amount: f64) -> u64 {
    (amount + 0.5) as u64
}

/// What one ray, or a share of it, adds to a site; in quanta.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Deposit {
    fixed: [u64; FIXED],
    columns: [(usize, u64); MOST_COLUMNS],
    /// How many of the columns it adds to.
    used: usize,
}

impl Deposit {
    /// Adds the count and fluxes of `other` so many `times`, not its spectrum: for sums that a thread keeps to itself.
    pub fn gather(&mut self, other: &Deposit, times: u64) {
        self.fixed.iter_mut().zip(other.fixed).for_each(|(sum, amount)| *sum += times * amount);
    }

    /// Splits by `shares` (not negative, sum 1) without losing a quantum: the last part takes what the others leave.
    pub fn split<const N: usize>(&self, shares: [f64; N]) -> [Deposit; N] {
        let mut left = *self;
        let mut number = 0;
        shares.map(|share| {
            number += 1;
            if number == N {
                return left;
            }
            let mut part = left;
            let cut = |whole: u64, left: &mut u64| {
                let value = quanta(whole as f64 * share).min(*left);
                *left -= value;
                value
            };
            for slot in 0..FIXED {
                part.fixed[slot] = cut(self.fixed[slot], &mut left.fixed[slot]);
            }
            for slot in 0..self.used {
                part.columns[slot].1 = cut(self.columns[slot].1, &mut left.columns[slot].1);
            }
            part
        })
    }
}

/// Most values of the tables that threads have of their own, all threads together: 32 MB. Of more, all threads add to one table.
const MOST_OWN_VALUES: usize = 1 << 22;

/// What is added up at each site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kept {
    /// Rays and fluxes.
    Fluxes,
    /// Spectral columns.
    Columns,
    /// Both.
    All,
}

/// Sums of deposits per site.
pub struct Tally {
    quanta: Quanta,
    /// Values of a site in front of its columns: [`FIXED`], or none.
    fixed: usize,
    column_count: usize,
    values: usize,
    /// Where all threads add to one large table.
    shared: Vec<AtomicU64>,
    /// Otherwise one table per thread at work, here while none adds to it.
    idle: Mutex<Vec<Vec<u64>>>,
}

/// The table of a [`Tally`] that one thread adds to; what was added is in the tally when this is dropped.
pub struct Adding<'a> {
    tally: &'a Tally,
    own: Vec<u64>,
}

impl Tally {
    /// No deposits yet at `sites` sites. Memory: `8 × sites × (3 + columns)` bytes, for each thread while that is at most 32 MB.
    ///
    /// # Errors
    /// `flux.too_large` above [`Limits::max_tally_values`].
    pub fn new(quanta: &Quanta, sites: usize, kept: Kept, limits: &Limits) -> Result<Tally, Error> {
        let column_count = if kept == Kept::Fluxes { 0 } else { quanta.spectral.column_count() };
        let fixed = if kept == Kept::Columns { 0 } else { FIXED };
        let values = sites.saturating_mul(fixed + column_count);
        if values > limits.max_tally_values {
            let found = format!(
                "{sites} places (vertices, or zones times cells of directions) with {column_count} spectral columns each are too many numbers."
            );
            let remedy = "Ask for fewer zones, wider angle steps, fewer bands, or a coarser hull.";
            return Err(Error::refused("flux.too_large", found, remedy));
        }
        let is_shared = values.saturating_mul(rayon::current_num_threads()) > MOST_OWN_VALUES;
        let shared = if is_shared { values } else { 0 };
        Ok(Tally {
            quanta: quanta.clone(),
            fixed,
            column_count,
            values,
            shared: std::iter::repeat_with(|| AtomicU64::new(0)).take(shared).collect(),
            idle: Mutex::default(),
        })
    }

    /// Begins to add on this thread.
    pub fn adding(&self) -> Adding<'_> {
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let own = if self.shared.is_empty() { self.values } else { 0 };
        Adding { tally: self, own: idle.unwrap_or_else(|| vec![0; own]) }
    }

    /// The sums at `sites` other sites: what was added at each of these stands at every one that `images` tells of it.
    #[must_use]
    pub fn spread(self, sites: usize, images: impl Fn(usize, &mut dyn FnMut(usize))) -> Tally {
        let width = self.fixed + self.column_count;
        let mut values = vec![0; sites * width];
        let (quanta, fixed, column_count) = (self.quanta.clone(), self.fixed, self.column_count);
        for (site, row) in self.sums().chunks_exact(width.max(1)).enumerate() {
            if row.iter().any(|amount| *amount != 0) {
                images(site, &mut |image| {
                    values[image * width..][..width].iter_mut().zip(row).for_each(|(sum, amount)| *sum += amount);
                });
            }
        }
        let count = values.len();
        Tally { quanta, fixed, column_count, values: count, shared: Vec::new(), idle: Mutex::new(vec![values]) }
    }

    /// The sums of all threads, in quanta.
    fn sums(self) -> Vec<u64> {
        let mut values: Vec<u64> = self.shared.into_iter().map(AtomicU64::into_inner).collect();
        values.resize(self.values, 0);
        for own in self.idle.into_inner().unwrap_or_else(PoisonError::into_inner) {
            values.iter_mut().zip(own).for_each(|(sum, amount)| *sum += amount);
        }
        values
    }

    /// The sums, in W and lm.
    pub fn amounts(self) -> Amounts {
        let (quanta, fixed, column_count) = (self.quanta.clone(), self.fixed, self.column_count);
        let values = self.sums();
        let rows = || values.chunks_exact((fixed + column_count).max(1));
        let scaled = |slot: usize, per_unit: f64| -> Vec<f64> {
            let rows = rows().filter(|_| slot < fixed);
            rows.map(|row| row[slot] as f64 / per_unit).collect()
        };
        Amounts {
            rays: scaled(0, RAY_QUANTA),
            radiant_w: quanta.flux.radiant_w.map(|_| scaled(1, quanta.per_w)),
            luminous_lm: quanta.flux.luminous_lm.map(|_| scaled(2, quanta.per_lm)),
            columns: rows().flat_map(|row| &row[fixed..]).map(|value| *value as f64 / quanta.per_column).collect(),
            column_count,
        }
    }
}

impl Adding<'_> {
    /// Adds `deposit` to `site`.
    pub fn add(&mut self, site: usize, deposit: &Deposit) {
        let Tally { fixed, column_count, .. } = *self.tally;
        let width = fixed + column_count;
        let row = site * width..(site + 1) * width;
        let columns = if column_count > 0 { &deposit.columns[..deposit.used] } else { &[] };
        if self.own.is_empty() {
            let row = &self.tally.shared[row];
            let add = |sum: &AtomicU64, amount: u64| {
                if amount != 0 {
                    sum.fetch_add(amount, Ordering::Relaxed);
                }
            };
            row.iter().zip(deposit.fixed).take(fixed).for_each(|(sum, amount)| add(sum, amount));
            columns.iter().for_each(|(column, amount)| add(&row[fixed + column], *amount));
            return;
        }
        let row = &mut self.own[row];
        // A number of values that is known when this is compiled takes no loop.
        if fixed == FIXED
            && let Some(sums) = row.first_chunk_mut::<FIXED>()
        {
            sums.iter_mut().zip(deposit.fixed).for_each(|(sum, amount)| *sum += amount);
        }
        columns.iter().for_each(|(column, amount)| row[fixed + column] += amount);
    }
}

impl Drop for Adding<'_> {
    fn drop(&mut self) {
        if !self.own.is_empty() {
            self.tally.idle.lock().unwrap_or_else(PoisonError::into_inner).push(std::mem::take(&mut self.own));
        }
    }
}

/// Amounts per site: a site is a vertex, a triangle, or a cell of directions.
#[derive(Clone, Debug, PartialEq)]
pub struct Amounts {
    /// Rays per site; a ray shared between sites counts by its shares. Empty, as the fluxes, where only columns were kept.
    pub rays: Vec<f64>,
    /// Radiant flux per site, W; `None` where the source's is unknown.
    pub radiant_w: Option<Vec<f64>>,
    /// Luminous flux per site, lm; `None` where the source's is unknown.
    pub luminous_lm: Option<Vec<f64>>,
    /// Spectral columns, `[site][column]` row-major, in the unit of [`Spectral::deposit`].
    pub columns: Vec<f64>,
    /// Columns per site.
    pub column_count: usize,
}

impl Amounts {
    /// Of no sites.
    pub fn none() -> Amounts {
        Amounts { rays: Vec::new(), radiant_w: None, luminous_lm: None, columns: Vec::new(), column_count: 0 }
    }

    /// How many sites.
    pub fn len(&self) -> usize {
        self.columns.len().checked_div(self.column_count).unwrap_or(self.rays.len())
    }

    /// True without sites.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Spectral columns of a site.
    pub fn columns_of(&self, site: usize) -> &[f64] {
        &self.columns[site * self.column_count..][..self.column_count]
    }

    /// The flux that weights sites where one number is wanted: radiant where known, else luminous.
    pub fn primary(&self) -> &[f64] {
        self.radiant_w.as_deref().or(self.luminous_lm.as_deref()).unwrap_or(&[])
    }

    /// Flux of one site.
    pub fn flux_of(&self, site: usize) -> Flux {
        let at = |values: &Option<Vec<f64>>| values.as_ref().map(|values| values[site]);
        Flux { radiant_w: at(&self.radiant_w), luminous_lm: at(&self.luminous_lm) }
    }

    /// Sum over all sites, in site order.
    pub fn total(&self) -> Flux {
        let sum = |values: &Option<Vec<f64>>| values.as_ref().map(|values| values.iter().sum());
        Flux { radiant_w: sum(&self.radiant_w), luminous_lm: sum(&self.luminous_lm) }
    }

    /// Sum of each column over all sites, in site order.
    pub fn column_totals(&self) -> Vec<f64> {
        let mut totals = vec![0.0; self.column_count];
        for site in 0..self.len() {
            for (total, amount) in totals.iter_mut().zip(self.columns_of(site)) {
                *total += amount;
            }
        }
        totals
    }

    /// The columns that hold light.
    pub fn lit_columns(&self) -> Vec<usize> {
        let totals = self.column_totals();
        (0..self.column_count).filter(|column| totals[*column] > 0.0).collect()
    }

    /// One column of all sites.
    pub fn column(&self, column: usize) -> Vec<f64> {
        self.columns.iter().skip(column).step_by(self.column_count).copied().collect()
    }

    /// Replaces one column of all sites.
    pub fn set_column(&mut self, column: usize, values: &[f64]) {
        let slots = self.columns.iter_mut().skip(column).step_by(self.column_count);
        slots.zip(values).for_each(|(slot, value)| *slot = *value);
    }

    /// The sites `range` alone.
    pub fn slice(&self, range: std::ops::Range<usize>) -> Amounts {
        // Where only columns were kept there is nothing to cut.
        let cut = |values: &Vec<f64>| values.get(range.clone()).unwrap_or_default().to_vec();
        Amounts {
            rays: cut(&self.rays),
            radiant_w: self.radiant_w.as_ref().map(cut),
            luminous_lm: self.luminous_lm.as_ref().map(cut),
            columns: self.columns[range.start * self.column_count..range.end * self.column_count].to_vec(),
            column_count: self.column_count,
        }
    }

    /// Adds `other` site by site.
    pub fn accumulate(&mut self, other: &Amounts) {
        let add = |to: &mut [f64], from: &[f64]| to.iter_mut().zip(from).for_each(|(a, b)| *a += b);
        add(&mut self.rays, &other.rays);
        for (to, from) in [(&mut self.radiant_w, &other.radiant_w), (&mut self.luminous_lm, &other.luminous_lm)] {
            if let (Some(to), Some(from)) = (to, from) {
                add(to, from);
            }
        }
        add(&mut self.columns, &other.columns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::Columns;
    use crate::vocabulary::spectrum::Bands;
    use glam::DVec3;

    fn quanta_of(flux: Flux, columns: Columns) -> Quanta {
        Quanta::new(Spectral { bands: Bands::regular(380.0, 780.0, 10.0).unwrap(), columns }, flux)
    }

    fn ray(radiant_w: f64, column: u32) -> Ray {
        Ray {
            origin_mm: DVec3::ZERO,
            direction: DVec3::Z,
            radiant_w,
            luminous_lm: 100.0 * radiant_w,
            column,
            xz_lm: [0.0; 2],
        }
    }

    #[test]
    fn split_parts_add_up_to_the_quantum() {
        let quanta = quanta_of(Flux { radiant_w: Some(1.0), luminous_lm: Some(100.0) }, Columns::Bands);
        let deposit = quanta.deposit(&ray(1.0 / 3.0, 7));
        for shares in [[0.2, 0.3, 0.5], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0 / 3.0; 3], [1.0 + 1e-16, 1e-16, -2e-16]]
        {
            let parts = deposit.split(shares);
            for slot in 0..FIXED {
                assert_eq!(parts.iter().map(|part| part.fixed[slot]).sum::<u64>(), deposit.fixed[slot]);
            }
            assert_eq!(parts.iter().map(|part| part.columns[0].1).sum::<u64>(), deposit.columns[0].1);
            assert!(parts.iter().all(|part| part.columns[0].0 == 7));
        }
    }

    #[test]
    fn known_to_be_nothing_is_nothing() {
        let quanta = quanta_of(Flux { radiant_w: Some(1.0), luminous_lm: Some(0.0) }, Columns::Bands);
        let tally = Tally::new(&quanta, 1, Kept::All, &Limits::default()).unwrap();
        tally.adding().add(0, &quanta.deposit(&Ray { luminous_lm: 0.0, ..ray(1.0, 40) }));
        assert_eq!(tally.amounts().total(), Flux { radiant_w: Some(1.0), luminous_lm: Some(0.0) });
    }

    #[test]
    fn more_than_the_limit_is_refused_before_it_is_allocated() {
        let quanta = quanta_of(Flux { radiant_w: Some(1.0), luminous_lm: None }, Columns::Bands);
        assert_eq!(
            Tally::new(&quanta, usize::MAX / 2, Kept::All, &Limits::default()).err().unwrap().code(),
            "flux.too_large"
        );
    }

    #[test]
    fn sums_do_not_depend_on_order_and_do_not_overflow() {
        // The whole flux in one site, a million times a millionth: 2^60 quanta, exactly.
        let quanta = quanta_of(Flux { radiant_w: Some(4.0), luminous_lm: None }, Columns::Bands);
        let add = |order: &mut dyn Iterator<Item = usize>| {
            let tally = Tally::new(&quanta, 1, Kept::All, &Limits::default()).unwrap();
            order.for_each(|k| {
                tally.adding().add(0, &quanta.deposit(&ray(4.0 * (k + 1) as f64 / 500_500.0, (k % 41) as u32)))
            });
            tally.amounts()
        };
        let (forth, back) = (add(&mut (0..1000)), add(&mut (0..1000).rev()));
        assert_eq!(forth, back);
        assert!((forth.radiant_w.as_ref().unwrap()[0] - 4.0).abs() < 1e-13);
        assert!((forth.columns.iter().sum::<f64>() - 4.0).abs() < 1e-13);
        assert_eq!(forth.rays, [1000.0]);
        assert_eq!(forth.luminous_lm, None);
    }
}
