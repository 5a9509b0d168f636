//! The grid of directions: the one owner of the binning rule.
//!
//! Node-centred cells (`pipeline/README.md` 4): γ nodes from 0 to 180, in even steps or closer together in a narrow beam; C nodes 0, step, …
//! below 360. A node's cell reaches halfway to its neighbours; the pole cells are caps shared by all C. A counted cell's value is its mean, a
//! smoothed one's is such that what is interpolated has that mean ([`SphereGrid::sharpened`]); between nodes values are bilinear in C and γ.

use std::f64::consts::{PI, TAU};

/// Equal steps of γ in which a grid knows where to look: quarters of a degree.
const STEPS: usize = 720;

/// A node-centred polar grid, regular in C. Values over it are `[c][gamma]`, pole values repeated for every C.
#[derive(Clone, Debug, PartialEq)]
pub struct SphereGrid {
    /// γ nodes, degrees, from 0 to 180, and radians.
    gamma_deg: Vec<f64>,
    gamma: Vec<f64>,
    /// The first γ node above each of equal steps from 0 to 180°: where to begin to look.
    above: Vec<u32>,
    /// C planes: step 360/c_count degrees.
    c_count: usize,
}

impl SphereGrid {
    /// `gamma_count` intervals from nadir to zenith (at least 2), `c_count` planes (at least 1).
    pub fn new(gamma_count: usize, c_count: usize) -> SphereGrid {
        let intervals = gamma_count.max(2);
        SphereGrid::uneven((0..=intervals).map(|k| k as f64 * 180.0 / intervals as f64).collect(), c_count)
    }

    /// With γ nodes at `gamma_deg`: at least three, increasing from 0 to 180.
    pub fn uneven(gamma_deg: Vec<f64>, c_count: usize) -> SphereGrid {
        let gamma: Vec<f64> = gamma_deg.iter().map(|degrees| degrees.to_radians()).collect();
        let first_above = |step: usize| {
            let from = step as f64 * PI / STEPS as f64;
            gamma.partition_point(|node| *node <= from).clamp(1, gamma.len() - 1) as u32
        };
        SphereGrid { above: (0..=STEPS).map(first_above).collect(), gamma_deg, gamma, c_count: c_count.max(1) }
    }

    /// γ nodes, degrees, first 0, last 180.
    pub fn gamma_deg(&self) -> Vec<f64> {
        self.gamma_deg.clone()
    }

    /// A γ node, radians.
    pub fn gamma(&self, node: usize) -> f64 {
        self.gamma[node]
    }

    /// The last γ node that is not above `gamma`, radians, and has one above it.
    pub fn gamma_below(&self, gamma: f64) -> usize {
        self.gamma.partition_point(|node| *node <= gamma).clamp(1, self.gamma.len() - 1) - 1
    }

    /// Where the cells of a γ node begin and end, radians.
    pub fn gamma_borders(&self, node: usize) -> [f64; 2] {
        let (here, last) = (self.gamma[node], self.gamma.len() - 1);
        [0.5 * (here + self.gamma[node.saturating_sub(1)]), 0.5 * (here + self.gamma[(node + 1).min(last)])]
    }

    /// C nodes, degrees, first 0, last below 360.
    pub fn c_deg(&self) -> Vec<f64> {
        (0..self.c_count).map(|j| j as f64 * 360.0 / self.c_count as f64).collect()
    }

    /// Number of γ nodes.
    pub fn gamma_nodes(&self) -> usize {
        self.gamma.len()
    }

    /// Number of C planes.
    pub fn c_planes(&self) -> usize {
        self.c_count
    }

    /// Number of distinct cells: two caps and a ring of C planes for each γ node between.
    pub fn cell_count(&self) -> usize {
        2 + (self.gamma.len() - 2) * self.c_count
    }

    /// The cell of `(C, γ)` radians; C from 0 to 2π.
    pub fn cell(&self, c: f64, gamma: f64) -> usize {
        let step = (gamma * (STEPS as f64 / PI)) as usize;
        let mut above = self.above[step.min(STEPS)] as usize;
        // Rounding may have led to the step after.
        while above > 1 && self.gamma[above - 1] > gamma {
            above -= 1;
        }
        while above + 1 < self.gamma.len() && self.gamma[above] <= gamma {
            above += 1;
        }
        let k = if gamma < 0.5 * (self.gamma[above - 1] + self.gamma[above]) { above - 1 } else { above };
        // The nearest plane: `round` is a call, and `%` a division, on most processors' common instructions.
        let j = (c * (self.c_count as f64 / TAU) + 0.5) as usize;
        self.cell_of_node(if j < self.c_count { j } else { 0 }, k)
    }

    /// The cell of node `(C plane, γ node)`.
    pub fn cell_of_node(&self, c: usize, gamma: usize) -> usize {
        match gamma {
            0 => 0,
            k if k + 1 == self.gamma.len() => self.cell_count() - 1,
            k => 1 + (k - 1) * self.c_count + c,
        }
    }

    /// A node of a cell, index into `[c][gamma]` values: that of C = 0 of a cap.
    pub fn node_of_cell(&self, cell: usize) -> usize {
        let last = self.gamma.len() - 1;
        match cell {
            0 => 0,
            cell if cell + 1 == self.cell_count() => last,
            cell => (cell - 1) % self.c_count * self.gamma.len() + 1 + (cell - 1) / self.c_count,
        }
    }

    /// Exact solid angle of each cell, sr; they sum to 4π.
    pub fn cell_solid_angles_sr(&self) -> Vec<f64> {
        let per_plane = self.plane_solid_angles_sr();
        let mut cells = vec![0.0; self.cell_count()];
        for (k, solid_angle) in per_plane.iter().enumerate() {
            let pole = k == 0 || k + 1 == self.gamma.len();
            for c in 0..if pole { 1 } else { self.c_count } {
                cells[self.cell_of_node(c, k)] = if pole { solid_angle * self.c_count as f64 } else { *solid_angle };
            }
        }
        cells
    }

    /// Solid angle of γ node k's cell for one C plane, sr: the schema's `solid_angle_sr`. Times the number of planes they sum
    /// to 4π.
    pub fn plane_solid_angles_sr(&self) -> Vec<f64> {
        let width = TAU / self.c_count as f64;
        let solid_angle = |node: usize| {
            // cos a − cos b, exact for borders that are close.
            let [from, to] = self.gamma_borders(node);
            width * 2.0 * (0.5 * (from + to)).sin() * (0.5 * (to - from)).sin()
        };
        (0..self.gamma.len()).map(solid_angle).collect()
    }

    /// `(C, γ)` radians of each cell's node; caps say C = 0.
    pub fn cell_nodes(&self) -> Vec<(f64, f64)> {
        let mut nodes = vec![(0.0, 0.0); self.cell_count()];
        for k in 1..self.gamma.len() - 1 {
            for c in 0..self.c_count {
                nodes[self.cell_of_node(c, k)] = (c as f64 * TAU / self.c_count as f64, self.gamma[k]);
            }
        }
        nodes[self.cell_count() - 1] = (0.0, PI);
        nodes
    }

    /// Spreads cell values to `[c][gamma]` nodes, row-major, poles repeated.
    pub fn nodes_from_cells(&self, cells: &[f64]) -> Vec<f64> {
        let mut nodes = Vec::with_capacity(self.c_count * self.gamma_nodes());
        for c in 0..self.c_count {
            for k in 0..self.gamma.len() {
                nodes.push(cells[self.cell_of_node(c, k)]);
            }
        }
        nodes
    }
}

impl SphereGrid {
    /// Intensity between the nodes: bilinear in C and γ over `[c][gamma]` values.
    pub fn interpolate(&self, nodes: &[f64], c: f64, gamma: f64) -> f64 {
        let ([a, b, d, e], [u, v]) = self.around(c, gamma);
        let lerp = |a: f64, b: f64, share: f64| a + share * (b - a);
        lerp(lerp(nodes[a], nodes[b], u), lerp(nodes[d], nodes[e], u), v)
    }

    /// The four nodes round a direction, indices into `[c][gamma]` values, and the share of each in what is bilinear between them.
    pub fn surroundings(&self, c: f64, gamma: f64) -> [(usize, f64); 4] {
        let ([a, b, d, e], [u, v]) = self.around(c, gamma);
        [(a, (1.0 - u) * (1.0 - v)), (b, u * (1.0 - v)), (d, (1.0 - u) * v), (e, u * v)]
    }

    /// Those nodes, C running faster, and where the direction lies between them, 0 to 1 along C and along γ.
    fn around(&self, c: f64, gamma: f64) -> ([usize; 4], [f64; 2]) {
        let along_c = (c / TAU * self.c_count as f64).rem_euclid(self.c_count as f64);
        let k = self.gamma_below(gamma);
        let j = along_c as usize % self.c_count;
        let u = along_c - along_c.floor();
        let v = ((gamma - self.gamma[k]) / (self.gamma[k + 1] - self.gamma[k])).clamp(0.0, 1.0);
        let at = |j: usize, k: usize| (j % self.c_count) * self.gamma_nodes() + k;
        ([at(j, k), at(j + 1, k), at(j, k + 1), at(j + 1, k + 1)], [u, v])
    }

    /// Weights W_k with `Σ_c Σ_k W_k value[c][k] = ∫ interpolate dΩ` exactly, sr, one per γ node: the hat function of a node times
    /// sin γ, integrated. They sum to 4π over all C and differ from the cells' solid angles by less than step²/12.
    pub fn interpolation_weights_sr(&self) -> Vec<f64> {
        let width = TAU / self.c_count as f64;
        let sides = |k: usize| self.hat_side(k, -1.0) + self.hat_side(k, 1.0);
        (0..self.gamma.len()).map(|k| width * sides(k)).collect()
    }

    /// ∫ (1 − s/h) sin(γ ± s) ds over 0..h: half of a node's hat function, towards the next node (`sign` +1) or the one before (−1),
    /// which is at the distance h; 0 where there is none.
    pub fn hat_side(&self, node: usize, sign: f64) -> f64 {
        let neighbour = if sign > 0.0 { Some(node + 1) } else { node.checked_sub(1) };
        let Some(next) = neighbour.and_then(|node| self.gamma.get(node)) else { return 0.0 };
        let (here, h) = (self.gamma[node], (next - self.gamma[node]).abs());
        // sin γ (1 − cos h)/h ± cos γ (1 − sin h / h), in forms that keep their digits where h is small.
        let sinc = if h < 1e-3 { h * h / 6.0 * (1.0 - h * h / 20.0) } else { 1.0 - h.sin() / h };
        let versed = 2.0 * (0.5 * h).sin().powi(2) / h;
        here.sin() * versed + sign * here.cos() * sinc
    }

    /// Flux per cell such that what is interpolated between the nodes has in each cell the mean that `flux` has there; the sum stays, and
    /// nothing becomes negative. Interpolated as they are, means of cells round off peaks and spread edges: by step²/8 of the second
    /// derivative. To the same order each cell passes on an eighth of its difference to the neighbour, times the solid angle that they share.
    pub fn sharpened(&self, flux: &[f64]) -> Vec<f64> {
        let solid_angles_sr = self.cell_solid_angles_sr();
        let gain = |&(a, b, shared_sr): &(usize, usize, f64)| {
            let difference = flux[a] / solid_angles_sr[a] - flux[b] / solid_angles_sr[b];
            let (to, from) = if difference > 0.0 { (a, b) } else { (b, a) };
            (to, from, 0.125 * shared_sr * difference.abs())
        };
        let gains: Vec<(usize, usize, f64)> = self.neighbours_sr().iter().map(gain).collect();
        let mut given = vec![0.0; flux.len()];
        gains.iter().for_each(|(_, from, gain)| given[*from] += gain);
        let mut sharpened = flux.to_vec();
        for (to, from, gain) in gains {
            let possible = if given[from] > flux[from] { gain * flux[from] / given[from] } else { gain };
            sharpened[to] += possible;
            sharpened[from] -= possible;
        }
        sharpened.into_iter().map(|flux| flux.max(0.0)).collect()
    }

    /// Pairs of neighbouring cells and the solid angle that spans from node to node, as wide as a cell.
    fn neighbours_sr(&self) -> Vec<(usize, usize, f64)> {
        let width = TAU / self.c_count as f64;
        let per_plane_sr = self.plane_solid_angles_sr();
        let mut pairs = Vec::new();
        for k in 1..self.gamma.len() {
            let (from, to) = (self.gamma[k - 1], self.gamma[k]);
            let across_sr = width * (to - from) * (0.5 * (from + to)).sin();
            pairs.extend((0..self.c_count).map(|c| (self.cell_of_node(c, k - 1), self.cell_of_node(c, k), across_sr)));
        }
        for k in (1..self.gamma.len() - 1).filter(|_| self.c_count > 1) {
            let next =
                |c: usize| (self.cell_of_node(c, k), self.cell_of_node((c + 1) % self.c_count, k), per_plane_sr[k]);
            pairs.extend((0..self.c_count).map(next));
        }
        pairs
    }

    /// `∫ interpolate dΩ` of `[c][gamma]` values.
    pub fn integral(&self, nodes: &[f64]) -> f64 {
        let weights = self.interpolation_weights_sr();
        nodes
            .chunks_exact(self.gamma_nodes())
            .map(|plane| plane.iter().zip(&weights).map(|(v, w)| v * w).sum::<f64>())
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solid_angles_and_weights_sum_to_the_sphere() {
        for (gamma_count, c_count) in [(2, 1), (36, 36), (180, 24), (12, 12)] {
            let grid = SphereGrid::new(gamma_count, c_count);
            let close = |sum: f64| (sum - 4.0 * PI).abs() < 1e-12;
            assert!(close(grid.cell_solid_angles_sr().iter().sum()));
            assert!(close(grid.plane_solid_angles_sr().iter().sum::<f64>() * c_count as f64));
            assert!(close(grid.interpolation_weights_sr().iter().sum::<f64>() * c_count as f64));
        }
    }

    /// Flux of an intensity in each cell, by the middles of 20 x 20 parts of it.
    fn flux_in_cells(grid: &SphereGrid, intensity: impl Fn(f64, f64) -> f64) -> Vec<f64> {
        const PARTS: usize = 20;
        let mut flux = vec![0.0; grid.cell_count()];
        let part_c = TAU / (grid.c_planes() * PARTS) as f64;
        for node in 0..grid.gamma_nodes() {
            let [from, to] = grid.gamma_borders(node);
            let part_gamma = (to - from) / PARTS as f64;
            for (c, k, j) in
                (0..grid.c_planes()).flat_map(|c| (0..PARTS * PARTS).map(move |k| (c, k / PARTS, k % PARTS)))
            {
                let gamma = from + (k as f64 + 0.5) * part_gamma;
                let turn = (c as f64 - 0.5) * TAU / grid.c_planes() as f64 + (j as f64 + 0.5) * part_c;
                let sr = gamma.sin() * part_gamma * part_c;
                flux[grid.cell_of_node(c, node)] += intensity(turn.rem_euclid(TAU), gamma) * sr;
            }
        }
        flux
    }

    /// The means of a beam's cells, interpolated as they are, round off its peak; sharpened, what is interpolated has these means again.
    #[test]
    fn what_is_interpolated_has_the_means_of_the_cells() {
        let grid = SphereGrid::new(36, 24);
        let beam = |c: f64, gamma: f64| (gamma.sin() * c.cos() * 0.5 + gamma.cos()).max(0.0).powi(12);
        let flux = flux_in_cells(&grid, beam);
        let off = |flux_at_nodes: &[f64]| {
            let cells: Vec<f64> =
                flux_at_nodes.iter().zip(grid.cell_solid_angles_sr()).map(|(flux, sr)| flux / sr).collect();
            let nodes = grid.nodes_from_cells(&cells);
            let found = flux_in_cells(&grid, |c, gamma| grid.interpolate(&nodes, c, gamma));
            found.iter().zip(&flux).map(|(found, flux)| (found - flux).abs()).sum::<f64>() / flux.iter().sum::<f64>()
        };
        let sharpened = grid.sharpened(&flux);
        let (before, after) = (off(&flux), off(&sharpened));
        println!("{before:.4} of the flux lies elsewhere as it is, {after:.4} sharpened");
        assert!(before > 0.01 && after < 0.3 * before, "{before:.4}, {after:.4}");
        let [sum, kept]: [f64; 2] = [&flux, &sharpened].map(|flux| flux.iter().sum());
        assert!((kept / sum - 1.0).abs() < 1e-12 && sharpened.iter().all(|flux| *flux >= 0.0), "{kept} of {sum}");
    }

    #[test]
    fn every_cell_has_its_node() {
        let grid = SphereGrid::new(5, 4);
        let cells: Vec<f64> = (0..grid.cell_count()).map(|cell| cell as f64).collect();
        let nodes = grid.nodes_from_cells(&cells);
        assert!((0..grid.cell_count()).all(|cell| nodes[grid.node_of_cell(cell)] == cells[cell]));
    }

    #[test]
    fn a_direction_belongs_to_the_cell_of_its_nearest_node() {
        let grid = SphereGrid::new(36, 24);
        for (cell, (c, gamma)) in grid.cell_nodes().into_iter().enumerate() {
            assert_eq!(grid.cell(c, gamma), cell);
            if cell > 0 && cell + 1 < grid.cell_count() {
                // Just inside the cell's four edges: half a step is 7.5° in C and 2.5° in γ.
                for (dc, dg) in [(-7.4, 0.0), (7.4, 0.0), (0.0, -2.4), (0.0, 2.4)] {
                    let turned = (c + f64::to_radians(dc)).rem_euclid(TAU);
                    assert_eq!(grid.cell(turned, gamma + f64::to_radians(dg)), cell);
                }
            }
        }
        assert_eq!(grid.cell(TAU - 1e-9, PI / 2.0), grid.cell(0.0, PI / 2.0));
    }

    #[test]
    fn interpolation_integrates_as_its_weights_say() {
        // A lobe on the nodes, integrated by a fine midpoint rule.
        let grid = SphereGrid::new(18, 12);
        let value = |c: f64, gamma: f64| (1.0 + gamma.cos()) * (2.0 + (c - 0.3).cos() * gamma.sin());
        let cells: Vec<f64> = grid.cell_nodes().into_iter().map(|(c, gamma)| value(c, gamma)).collect();
        let nodes = grid.nodes_from_cells(&cells);
        let (n, m) = (1440, 720);
        let (dc, dg) = (TAU / n as f64, PI / m as f64);
        let mut sum = 0.0;
        for i in 0..n {
            for j in 0..m {
                let (c, gamma) = ((i as f64 + 0.5) * dc, (j as f64 + 0.5) * dg);
                sum += grid.interpolate(&nodes, c, gamma) * gamma.sin() * dc * dg;
            }
        }
        assert!((grid.integral(&nodes) / sum - 1.0).abs() < 1e-5, "{} {sum}", grid.integral(&nodes));
    }
}
