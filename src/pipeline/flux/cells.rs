//! Which triangles lie near a point: a regular lattice of cells, each with the triangles whose boxes reach into it.

use crate::hull::lattice::Lattice;
use crate::vocabulary::space::Bounds;
use glam::DVec3;

/// Cells to a cell of the hull along each axis: small ones hold few triangles.
const FINER: u32 = 2;
/// Most cells: 8 MB of numbers.
const MOST_CELLS: usize = 1 << 21;
/// How far the lattice reaches beyond the boxes, in cells of the hull, so that a flat hull lies inside of a layer.
const MARGIN: f64 = 1.5;
/// Padding of boxes in units of a cell, against rounding.
const PADDING: f64 = 1e-6;

/// Boxes by the cells that they reach into.
pub struct Cells {
    lattice: Lattice,
    /// Where the items of each cell begin in `items`, and the end of the last.
    starts: Vec<u32>,
    items: Vec<u32>,
}

/// What is known of the neighbourhood of a point.
pub struct Near<'a> {
    /// The items whose boxes reach into the cell of the point.
    pub items: &'a [u32],
    /// The cell, mm: every item that comes into it is among these.
    pub cell: Bounds,
}

impl Cells {
    /// Sorts `boxes`, which are about as large as a cube of edge `size_mm`, into cells.
    pub fn new(boxes: &[Bounds], size_mm: f64) -> Cells {
        let all = boxes.iter().fold(Bounds::EMPTY, |all, next| all.union(*next));
        let margin_mm = DVec3::splat(MARGIN * size_mm);
        let all = if boxes.is_empty() {
            Bounds { min: DVec3::ZERO, max: DVec3::ZERO }
        } else {
            Bounds { min: all.min - margin_mm, max: all.max + margin_mm }
        };
        let mut resolution =
            (f64::from(FINER) * all.size().max_element() / size_mm).clamp(1.0, MOST_CELLS as f64) as u32;
        let mut lattice = Lattice::fit(all, resolution);
        while lattice.len() > MOST_CELLS && resolution > 1 {
            resolution = resolution * 3 / 4;
            lattice = Lattice::fit(all, resolution);
        }
        let mut starts = vec![0_u32; lattice.len() + 1];
        each_cell(&lattice, boxes, |cell, _| starts[cell + 1] += 1);
        for cell in 0..lattice.len() {
            starts[cell + 1] += starts[cell];
        }
        let mut free = starts.clone();
        let mut items = vec![0_u32; starts[lattice.len()] as usize];
        each_cell(&lattice, boxes, |cell, item| {
            items[free[cell] as usize] = item as u32;
            free[cell] += 1;
        });
        Cells { lattice, starts, items }
    }

    /// What is near `point_mm`; `None` outside the lattice.
    pub fn near(&self, point_mm: DVec3) -> Option<Near<'_>> {
        let cell = self.lattice.cell_of(point_mm)?;
        let items = &self.items[self.starts[cell] as usize..self.starts[cell + 1] as usize];
        let place = self.lattice.place(cell);
        Some(Near { items, cell: self.lattice.bounds_mm(place, place) })
    }
}

/// Tells every cell that a box reaches into, and the number of the box; box after box.
fn each_cell(lattice: &Lattice, boxes: &[Bounds], mut tell: impl FnMut(usize, usize)) {
    let last = DVec3::from(lattice.counts.map(|count| count as f64 - 1.0));
    let place = |point_mm: DVec3| ((point_mm - lattice.min_mm) / lattice.cell_mm).clamp(DVec3::ZERO, last);
    for (item, bounds) in boxes.iter().enumerate() {
        let padding_mm = PADDING * lattice.cell_mm;
        let [from, to] = [place(bounds.min - padding_mm), place(bounds.max + padding_mm)];
        for z in from.z as usize..=to.z as usize {
            for y in from.y as usize..=to.y as usize {
                for x in from.x as usize..=to.x as usize {
                    tell(lattice.index([x, y, z]), item);
                }
            }
        }
    }
}
