//! Triangles to pixels, for hulls too fine to be drawn as polygons: what is seen is decided cell by cell (z-buffer), and equal
//! neighbours in a row become one stroke, so a drawing has a bounded size whatever the hull's.

use super::svg::Svg;
use std::collections::BTreeMap;

/// A picture in the making: the nearest colour in each cell.
pub struct Raster {
    columns: usize,
    rows: usize,
    nearest: Vec<f64>,
    color: Vec<Option<[u8; 3]>>,
}

impl Raster {
    /// An empty picture.
    pub fn new(columns: usize, rows: usize) -> Raster {
        let cells = columns * rows;
        Raster { columns, rows, nearest: vec![f64::NEG_INFINITY; cells], color: vec![None; cells] }
    }

    /// Adds a triangle whose corners are `[x, y, depth]` in cells, larger depth nearer to the eye.
    pub fn triangle(&mut self, corners: [[f64; 3]; 3], color: [u8; 3]) {
        let [a, b, c] = corners;
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        let low = |axis: usize| corners.iter().map(|corner| corner[axis]).fold(f64::INFINITY, f64::min);
        let high = |axis: usize| corners.iter().map(|corner| corner[axis]).fold(f64::NEG_INFINITY, f64::max);
        let mut covered = false;
        for row in first_center(low(1))..first_center(high(1)).min(self.rows) {
            for column in first_center(low(0))..first_center(high(0)).min(self.columns) {
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                let weight_b = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area;
                let weight_c = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area;
                let weight_a = 1.0 - weight_b - weight_c;
                if weight_a >= 0.0 && weight_b >= 0.0 && weight_c >= 0.0 {
                    covered = true;
                    self.put(column, row, weight_a * a[2] + weight_b * b[2] + weight_c * c[2], color);
                }
            }
        }
        if !covered {
            // Smaller than a cell: it still is light, so it marks the cell it lies in.
            let mean = |axis: usize| (a[axis] + b[axis] + c[axis]) / 3.0;
            self.put(mean(0).max(0.0) as usize, mean(1).max(0.0) as usize, mean(2), color);
        }
    }

    /// Adds one cell.
    pub fn cell(&mut self, column: usize, row: usize, color: [u8; 3]) {
        self.put(column, row, 0.0, color);
    }

    fn put(&mut self, column: usize, row: usize, depth: f64, color: [u8; 3]) {
        if column >= self.columns || row >= self.rows {
            return;
        }
        let cell = row * self.columns + column;
        if let (Some(nearest), Some(shown)) = (self.nearest.get_mut(cell), self.color.get_mut(cell))
            && depth > *nearest
        {
            *nearest = depth;
            *shown = Some(color);
        }
    }

    /// Draws the picture with its corner at `corner`, `cell_px` a cell: one path for each colour. Strokes overlap by a fifth of a
    /// cell, so that no seams show at any magnification.
    pub fn draw(&self, svg: &mut Svg, corner: [f64; 2], cell_px: f64) {
        let mut paths: BTreeMap<[u8; 3], String> = BTreeMap::new();
        for row in 0..self.rows {
            let mut column = 0;
            let cells = self.color.get(row * self.columns..(row + 1) * self.columns).unwrap_or(&[]);
            for run in cells.chunk_by(|a, b| a == b) {
                if let Some(color) = run.first().copied().flatten() {
                    paths.entry(color).or_default().push_str(&format!("M{column} {row}h{}.2", run.len()));
                }
                column += run.len();
            }
        }
        svg.put(format_args!(
            "<g transform=\"translate({:.2} {:.2}) scale({cell_px:.4}) translate(0 0.5)\" fill=\"none\" stroke-width=\"1.2\" shape-rendering=\"crispEdges\">\n",
            corner[0], corner[1]
        ));
        for (color, path) in paths {
            svg.put(format_args!("<path stroke=\"{}\" d=\"{path}\"/>\n", super::scale::hex(color)));
        }
        svg.put(format_args!("</g>\n"));
    }
}

/// The first cell whose centre is not before `at`.
fn first_center(at: f64) -> usize {
    (at - 0.5).ceil().max(0.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: [u8; 3] = [255, 0, 0];
    const BLUE: [u8; 3] = [0, 0, 255];

    #[test]
    fn the_nearer_triangle_wins_whatever_the_order() {
        let far = [[0.0, 0.0, 1.0], [8.0, 0.0, 1.0], [0.0, 8.0, 1.0]];
        let near = far.map(|[x, y, _]| [x, y, 2.0]);
        for order in [[(far, RED), (near, BLUE)], [(near, BLUE), (far, RED)]] {
            let mut raster = Raster::new(8, 8);
            order.into_iter().for_each(|(corners, color)| raster.triangle(corners, color));
            assert!(raster.color.iter().flatten().all(|color| *color == BLUE));
            // Half of 8 x 8, and the cells whose centre lies on the long edge.
            assert_eq!(raster.color.iter().flatten().count(), 36);
        }
    }

    #[test]
    fn specks_mark_their_cell_and_nothing_leaves_the_picture() {
        let mut raster = Raster::new(4, 4);
        raster.triangle([[1.1, 2.1, 0.0], [1.2, 2.1, 0.0], [1.1, 2.2, 0.0]], RED);
        assert_eq!(raster.color[2 * 4 + 1], Some(RED));
        raster.triangle([[-90.0, -90.0, 0.0], [900.0, -90.0, 0.0], [-90.0, 900.0, 0.0]], BLUE);
        assert_eq!(raster.color.iter().flatten().count(), 16);
        raster.triangle([[9.0, 9.0, 0.0]; 3], RED);
    }
}
