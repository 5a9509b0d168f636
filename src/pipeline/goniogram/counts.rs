//! What is counted in zones while rays land: the flux into each cell of directions, and its spectrum into wider cells.

use super::intensity::{Grids, Measured};
use crate::error::Error;
use crate::flux::Amounts;
use crate::flux::tally::{self, Deposit, Kept, Quanta, Tally};
use crate::source::Spectral;
use crate::vocabulary::limits::Limits;

/// Sums over the cells of some zones; sites are `zone × cells + cell`, over the fine and the spectral grid.
pub struct Counts {
    grids: Grids,
    zones: usize,
    fine: Tally,
    /// `None` where there is no spectrum.
    spectral: Option<Tally>,
}

/// What one thread adds to [`Counts`].
pub struct Adding<'a> {
    grids: &'a Grids,
    fine: tally::Adding<'a>,
    spectral: Option<tally::Adding<'a>>,
}

impl Counts {
    /// Nothing in `zones` zones.
    ///
    /// # Errors
    /// `flux.too_large` above [`Limits::max_tally_values`].
    pub fn new(
        quanta: &Quanta,
        grids: Grids,
        zones: usize,
        spectrum: &Spectral,
        limits: &Limits,
    ) -> Result<Counts, Error> {
        let fine = Tally::new(quanta, zones * grids.fine.cell_count(), Kept::Fluxes, limits)?;
        let spectral = (spectrum.column_count() > 0)
            .then(|| Tally::new(quanta, zones * grids.spectral.cell_count(), Kept::Columns, limits))
            .transpose()?;
        Ok(Counts { grids, zones, fine, spectral })
    }

    /// Begins to add on this thread.
    pub fn adding(&self) -> Adding<'_> {
        Adding { grids: &self.grids, fine: self.fine.adding(), spectral: self.spectral.as_ref().map(Tally::adding) }
    }

    /// The grids, and what was counted in each zone.
    pub fn measured(self) -> (Grids, Vec<Measured>) {
        let Counts { grids, zones, fine, spectral } = self;
        let (fine, spectral) = (fine.amounts(), spectral.map(Tally::amounts));
        let of_zone = |amounts: &Amounts, cells: usize, zone: usize| amounts.slice(zone * cells..(zone + 1) * cells);
        let measured = |zone: usize| {
            let spectral = spectral.as_ref().map(|amounts| of_zone(amounts, grids.spectral.cell_count(), zone));
            Measured::new(of_zone(&fine, grids.fine.cell_count(), zone), spectral.unwrap_or_else(Amounts::none))
        };
        let measured = (0..zones).map(measured).collect();
        (grids, measured)
    }
}

impl Adding<'_> {
    /// Adds what a ray deposits to the zones of the corners it landed between, by their `shares`, at C and γ in radians.
    pub fn add(&mut self, zones: [u32; 3], shares: [f64; 3], [c, gamma]: [f64; 2], deposit: &Deposit) {
        let cell = self.grids.fine.cell(c, gamma);
        let spectral_cell = self.spectral.as_ref().map(|_| self.grids.spectral.cell(c, gamma));
        let mut put = |zone: u32, part: &Deposit| {
            self.fine.add(zone as usize * self.grids.fine.cell_count() + cell, part);
            if let Some((spectral, cell)) = self.spectral.as_mut().zip(spectral_cell) {
                spectral.add(zone as usize * self.grids.spectral.cell_count() + cell, part);
            }
        };
        if zones[0] == zones[1] && zones[1] == zones[2] {
            put(zones[0], deposit);
        } else {
            zones.iter().zip(deposit.split(shares)).for_each(|(zone, part)| put(*zone, &part));
        }
    }
}
