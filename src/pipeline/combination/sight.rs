//! How the directions of a model are told, and goniograms on another grid than their own.

use crate::goniogram::SphereGrid;
use crate::vocabulary::space::{Axis, Frame};
use glam::{DMat3, DVec3};

/// Which way a component looks within the combination.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    /// The frame of its goniograms.
    pub frame: Frame,
    /// Takes directions of the frame's axes to those of the combination; 1 where the frame itself could be turned.
    pub turn: DMat3,
}

impl Sight {
    /// Of a model with `frame`, turned. By quarters the frame is turned itself, and the goniograms stay as they are.
    pub fn turned(frame: Frame, turn: DMat3) -> Sight {
        let is_quarter = turn.to_cols_array().iter().all(|entry| entry.fract() == 0.0);
        if !is_quarter {
            return Sight { frame, turn };
        }
        let along = |axis: Axis| Axis::nearest(turn * axis.vector());
        Sight { frame: Frame { nadir: along(frame.nadir), c0: along(frame.c0) }, turn: DMat3::IDENTITY }
    }

    /// The frame of axes nearest to it.
    pub fn nearest_frame(&self) -> Frame {
        let nadir = Axis::nearest(self.turn * self.frame.nadir.vector());
        let along = self.turn * self.frame.c0.vector();
        Frame { nadir, c0: Axis::nearest(along - along.dot(nadir.vector()) * nadir.vector()) }
    }

    /// Whether its goniograms are told in `frame`.
    pub fn is(&self, frame: &Frame) -> bool {
        self.turn == DMat3::IDENTITY && self.frame == *frame
    }

    /// Its γ runs along that of `frame`, or against it.
    pub fn is_along(&self, frame: &Frame) -> bool {
        self.turn == DMat3::IDENTITY && self.frame.nadir.component() == frame.nadir.component()
    }

    /// C and γ, radians, of a direction of the combination.
    fn angles(&self, direction: DVec3) -> (f64, f64) {
        self.frame.angles(self.turn.transpose() * direction)
    }

    /// The direction in the combination of C and γ, radians.
    fn direction(&self, c: f64, gamma: f64) -> DVec3 {
        self.turn * self.frame.direction(c, gamma)
    }
}

/// Takes values on the nodes of one grid to the nodes of another: between nodes they are bilinear.
pub struct Resampling<'a> {
    from: &'a SphereGrid,
    to: &'a SphereGrid,
    sight: Sight,
    frame: Frame,
    /// Nodes round each cell's node of `to`.
    around: Vec<[(usize, f64); 4]>,
}

impl<'a> Resampling<'a> {
    /// From the grid of what `sight` sees to one in `frame`.
    pub fn new(from: &'a SphereGrid, sight: Sight, to: &'a SphereGrid, frame: Frame) -> Resampling<'a> {
        let around = |(c, gamma): (f64, f64)| {
            let (c, gamma) = sight.angles(frame.direction(c, gamma));
            from.surroundings(c, gamma)
        };
        let around = to.cell_nodes().into_iter().map(around).collect();
        Resampling { from, to, sight, frame, around }
    }

    /// Values `[c][gamma]`.
    pub fn values(&self, nodes: &[f64]) -> Vec<f64> {
        self.to.nodes_from_cells(&self.cells(|node| nodes[node]))
    }

    /// Values `[c][gamma][band]`.
    pub fn bands(&self, nodes: &[f64], bands: usize) -> Vec<f64> {
        let planes = self.to.c_planes() * self.to.gamma_nodes();
        let mut values = vec![0.0; planes * bands];
        for band in 0..bands {
            let own = self.to.nodes_from_cells(&self.cells(|node| nodes[node * bands + band]));
            values.iter_mut().skip(band).step_by(bands).zip(own).for_each(|(value, own)| *value = own);
        }
        values
    }

    fn cells(&self, value: impl Fn(usize) -> f64) -> Vec<f64> {
        self.around.iter().map(|around| around.iter().map(|(node, share)| share * value(*node)).sum()).collect()
    }

    /// How much of what `nodes` send goes elsewhere in `values`, and how much they send: flux.
    pub fn astray(&self, nodes: &[f64], values: &[f64]) -> [f64; 2] {
        let scale = ratio(self.from.integral(nodes), self.to.integral(values));
        let own = self.from.cell_nodes().into_iter().zip(self.from.cell_solid_angles_sr()).enumerate();
        let mut sums = [0.0; 2];
        for (cell, ((c, gamma), sr)) in own {
            let at = self.from.node_of_cell(cell);
            let (c, gamma) = self.frame.angles(self.sight.direction(c, gamma));
            sums[0] += 0.5 * sr * (scale * self.to.interpolate(values, c, gamma) - nodes[at]).abs();
            sums[1] += sr * nodes[at];
        }
        sums
    }
}

/// `a / b`; 0 where `b` is not positive.
pub fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}
