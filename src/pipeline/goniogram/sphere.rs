//! The grid of directions: the one owner of the binning rule.
//!
//! Node-centred cells (`OUTPUTS.md` 1.4): γ nodes 0, step, …, 180; C nodes 0, step, … below 360. A node's cell reaches halfway
//! to its neighbours; the pole cells are caps shared by all C.

/// A regular node-centred polar grid. Values over it are `[c][gamma]`, pole values repeated for every C.
#[derive(Clone, Debug, PartialEq)]
pub struct SphereGrid {
    /// γ intervals: nodes are 0..=gamma_count, step 180/gamma_count degrees.
    gamma_count: usize,
    /// C planes: step 360/c_count degrees.
    c_count: usize,
}

impl SphereGrid {
    /// `gamma_count` intervals from nadir to zenith (at least 2), `c_count` planes (at least 1).
    pub fn new(gamma_count: usize, c_count: usize) -> SphereGrid {
        SphereGrid { gamma_count: gamma_count.max(2), c_count: c_count.max(1) }
    }

    /// γ nodes, degrees, first 0, last 180.
    pub fn gamma_deg(&self) -> Vec<f64> {
        (0..=self.gamma_count).map(|k| k as f64 * 180.0 / self.gamma_count as f64).collect()
    }

    /// C nodes, degrees, first 0, last below 360.
    pub fn c_deg(&self) -> Vec<f64> {
        (0..self.c_count).map(|j| j as f64 * 360.0 / self.c_count as f64).collect()
    }

    /// Number of γ nodes.
    pub fn gamma_nodes(&self) -> usize {
        self.gamma_count + 1
    }

    /// Number of C planes.
    pub fn c_planes(&self) -> usize {
        self.c_count
    }

    /// Number of distinct cells: two caps and a ring of C planes for each γ node between.
    pub fn cell_count(&self) -> usize {
        2 + (self.gamma_count - 1) * self.c_count
    }

    /// The cell of `(C, γ)` radians.
    pub fn cell(&self, c: f64, gamma: f64) -> usize {
        let k = (gamma * self.gamma_count as f64 / std::f64::consts::PI).round().clamp(0.0, self.gamma_count as f64);
        let j = (c * self.c_count as f64 / std::f64::consts::TAU).round() as usize % self.c_count;
        self.cell_of_node(j, k as usize)
    }

    /// The cell of node `(C plane, γ node)`.
    pub fn cell_of_node(&self, c: usize, gamma: usize) -> usize {
        match gamma {
            0 => 0,
            k if k == self.gamma_count => self.cell_count() - 1,
            k => 1 + (k - 1) * self.c_count + c,
        }
    }

    /// Exact solid angle of each cell, sr; they sum to 4π.
    pub fn cell_solid_angles_sr(&self) -> Vec<f64> {
        let per_plane = self.plane_solid_angles_sr();
        let mut cells = vec![0.0; self.cell_count()];
        for (k, solid_angle) in per_plane.iter().enumerate() {
            let pole = k == 0 || k == self.gamma_count;
            for c in 0..if pole { 1 } else { self.c_count } {
                cells[self.cell_of_node(c, k)] = if pole { solid_angle * self.c_count as f64 } else { *solid_angle };
            }
        }
        cells
    }

    /// Solid angle of γ node k's cell for one C plane, sr: the schema's `solid_angle_sr`. Times the number of planes they sum
    /// to 4π.
    pub fn plane_solid_angles_sr(&self) -> Vec<f64> {
        let step = std::f64::consts::PI / self.gamma_count as f64;
        let edge = |k: f64| (k * step).clamp(0.0, std::f64::consts::PI).cos();
        let width = std::f64::consts::TAU / self.c_count as f64;
        (0..=self.gamma_count).map(|k| width * (edge(k as f64 - 0.5) - edge(k as f64 + 0.5))).collect()
    }

    /// `(C, γ)` radians of each cell's node; caps say C = 0.
    pub fn cell_nodes(&self) -> Vec<(f64, f64)> {
        let mut nodes = vec![(0.0, 0.0); self.cell_count()];
        for k in 1..self.gamma_count {
            for c in 0..self.c_count {
                nodes[self.cell_of_node(c, k)] = (
                    c as f64 * std::f64::consts::TAU / self.c_count as f64,
                    k as f64 * std::f64::consts::PI / self.gamma_count as f64,
                );
            }
        }
        nodes[self.cell_count() - 1] = (0.0, std::f64::consts::PI);
        nodes
    }

    /// Spreads cell values to `[c][gamma]` nodes, row-major, poles repeated.
    pub fn nodes_from_cells(&self, cells: &[f64]) -> Vec<f64> {
        let mut nodes = Vec::with_capacity(self.c_count * self.gamma_nodes());
        for c in 0..self.c_count {
            for k in 0..=self.gamma_count {
                nodes.push(cells[self.cell_of_node(c, k)]);
            }
        }
        nodes
    }
}
