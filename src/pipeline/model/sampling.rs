//! New rays from a model: places and directions drawn from exactly the radiance that the evaluation gives, all of the same flux.

use super::chance::Numbers;
use super::directions::Directions;
use super::evaluation::Evaluator;
use super::places::{Places, Start};
use glam::DVec3;

/// Draws rays of equal flux.
pub struct Sampler<'a> {
    places: Places<'a>,
    directions: Directions,
}

/// A ray that was drawn.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    /// Where it starts, mm.
    pub point_mm: DVec3,
    /// Its unit direction.
    pub direction: DVec3,
    /// The vertex, of a volume the node, whose light it is a part of: of all rays at a point, each corner has its share of the exitance.
    pub site: usize,
    /// The zone whose goniogram gave its direction; 0 of a volume, whose total goniogram did.
    pub zone: usize,
    /// C and γ of its direction, radians; C may be beyond a turn.
    pub angles: (f64, f64),
}

/// Rays that are drawn together. Each step is taken for all of them before the next: what a ray reads from memory is on its way while others
/// are computed. A single ray after another takes twice as long.
#[derive(Default)]
pub struct Batch {
    /// The numbers of each.
    pub numbers: Vec<Numbers>,
    /// Each, once it is drawn.
    pub drawn: Vec<Drawn>,
    /// The wavelength of each, nm, once it is drawn.
    pub wavelengths_nm: Vec<f64>,
    /// The band of each.
    pub bands: Vec<usize>,
    /// Memory for the weights of the bands of one.
    pub weights: Vec<f32>,
    places: Vec<usize>,
    corners: Vec<usize>,
    starts: Vec<Start>,
    nodes: Vec<usize>,
}

impl<'a> Sampler<'a> {
    /// Of the quantity that `evaluator` evaluates; `None` of a dark model.
    pub fn new(evaluator: &Evaluator<'a>) -> Option<Sampler<'a>> {
        Some(Sampler { places: Places::new(evaluator)?, directions: Directions::new(evaluator) })
    }

    /// Ray number `ray` of the rays of `seed`; `None` where its zone is dark.
    pub fn ray(&self, seed: u64, ray: u64) -> Option<Drawn> {
        self.draw(&mut Numbers::of(seed, ray))
    }

    /// A ray of these numbers; `None` where its zone is dark.
    pub fn draw(&self, numbers: &mut Numbers) -> Option<Drawn> {
        let place = self.places.find(numbers);
        let start = self.places.start(place, self.places.corner(place, numbers), numbers);
        let node = self.directions.find(start.zone as usize, numbers)?;
        Some(self.drawn(start, node, numbers))
    }

    /// Rays of the numbers of a batch, each as [`Sampler::draw`] draws it; `None` where a zone is dark.
    pub fn draw_all(&self, batch: &mut Batch) -> Option<()> {
        let Batch { numbers, drawn, places, corners, starts, nodes, .. } = batch;
        places.clear();
        places.extend(numbers.iter().map(|numbers| self.places.find(numbers)));
        corners.clear();
        corners.extend(places.iter().zip(&*numbers).map(|(place, numbers)| self.places.corner(*place, numbers)));
        starts.clear();
        let at = places.iter().zip(&*corners).zip(&*numbers);
        starts.extend(at.map(|((place, corner), numbers)| self.places.start(*place, *corner, numbers)));
        nodes.clear();
        for (start, numbers) in starts.iter().zip(&*numbers) {
            nodes.push(self.directions.find(start.zone as usize, numbers)?);
        }
        drawn.clear();
        let found = starts.iter().zip(&*nodes).zip(numbers);
        drawn.extend(found.map(|((start, node), numbers)| self.drawn(*start, *node, numbers)));
        Some(())
    }

    fn drawn(&self, start: Start, node: usize, numbers: &mut Numbers) -> Drawn {
        let Start { point_mm, site, zone } = start;
        let (direction, angles) = self.directions.around(node, numbers);
        Drawn { point_mm, direction, site: site as usize, zone: zone as usize, angles }
    }
}
