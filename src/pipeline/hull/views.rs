//! Six projections and their level grids; the solid they carve.

use super::lattice::{Lattice, Place};
use super::occupancy::Occupancy;

/// One of the six main views: what is seen from one face of the box.
pub struct View {
    /// The axis looked along: 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// Looks from the far face, against the axis.
    pub from_far: bool,
    /// Columns along the two other axes, in cyclic order.
    pub size: [usize; 2],
    /// Cells along the axis.
    depth: usize,
    /// Level of each column: cells between the face and its first occupied cell. `None`: no points, no surface.
    pub levels: Vec<Option<usize>>,
}

/// All six views of the occupied cells.
pub fn six(occupancy: &Occupancy) -> Vec<View> {
    let lattice = &occupancy.lattice;
    let mut views: Vec<View> = [0, 1, 2]
        .into_iter()
        .flat_map(|axis| [false, true].map(|from_far| View::blank(lattice, axis, from_far)))
        .collect();
    for index in (0..lattice.len()).filter(|index| occupancy.points(*index) > 0) {
        let cell = lattice.place(index);
        for view in &mut views {
            let (column, level) = (view.column(cell), view.level(cell));
            view.levels[column] = Some(view.levels[column].map_or(level, |nearest| nearest.min(level)));
        }
    }
    views
}

impl View {
    fn blank(lattice: &Lattice, axis: usize, from_far: bool) -> View {
        let size = [lattice.counts[(axis + 1) % 3], lattice.counts[(axis + 2) % 3]];
        View { axis, from_far, size, depth: lattice.counts[axis], levels: vec![None; size[0] * size[1]] }
    }

    /// The column in which a cell is seen.
    fn column(&self, cell: Place) -> usize {
        cell[(self.axis + 1) % 3] + self.size[0] * cell[(self.axis + 2) % 3]
    }

    /// The level of a cell: cells between it and the face.
    fn level(&self, cell: Place) -> usize {
        if self.from_far { self.depth - 1 - cell[self.axis] } else { cell[self.axis] }
    }

    /// The cell at a level of a column.
    pub fn cell(&self, column: usize, level: usize) -> Place {
        let mut cell = [0; 3];
        cell[self.axis] = if self.from_far { self.depth - 1 - level } else { level };
        cell[(self.axis + 1) % 3] = column % self.size[0];
        cell[(self.axis + 2) % 3] = column / self.size[0];
        cell
    }

    /// True where the view does not see past the cell.
    fn holds(&self, cell: Place) -> bool {
        self.levels[self.column(cell)].is_some_and(|level| self.level(cell) >= level)
    }
}

/// The cells that lie between the levels of all views: a cell to which some view has a free sight is outside.
pub struct Solid {
    /// The cells.
    pub lattice: Lattice,
    /// True for the cells of the solid.
    pub cells: Vec<bool>,
}

/// Carves the solid.
pub fn carve(lattice: Lattice, views: &[View]) -> Solid {
    let cells = (0..lattice.len()).map(|index| {
        let cell = lattice.place(index);
        views.iter().all(|view| view.holds(cell))
    });
    Solid { lattice, cells: cells.collect() }
}

impl Solid {
    /// True when the cell `offset` away belongs to the solid; false outside the lattice.
    pub fn has(&self, cell: Place, offset: [i32; 3]) -> bool {
        self.lattice.beside(cell, offset).is_some_and(|beside| self.cells[self.lattice.index(beside)])
    }
}
