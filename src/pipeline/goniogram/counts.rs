//! What is counted in zones while rays land: the flux into each cell of directions, and its spectrum into wider cells.

use super::images::{Groups, images_of_cells};
use super::intensity::{Grids, Measured};
use super::sphere::SphereGrid;
use crate::error::Error;
use crate::flux::tally::{self, Deposit, Kept, Quanta, Tally};
use crate::flux::{Amounts, Laid};
use crate::source::Spectral;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::space::Frame;
use glam::{DMat3, DVec3};

/// Most values of groups of vertices, 32 MB: of more, images are counted at once.
const MOST_VALUES_OF_GROUPS: usize = 1 << 22;

/// Sums over the cells of some zones, or of groups of vertices; sites are `zone × cells + cell`, over the fine and the spectral grid.
pub struct Counts {
    grids: Grids,
    frame: Frame,
    zones: usize,
    groups: Groups,
    images: Counting,
    fine: Tally,
    /// `None` where there is no spectrum.
    spectral: Option<Tally>,
}

/// How a ray that stands for its images is counted.
enum Counting {
    /// In the group that it lands in, whose counts go to the zones of all images in the end. Images of the cells of directions by the number of
    /// the image, of the fine and of the spectral grid; none where no ray has images.
    ByGroup([Vec<Vec<u32>>; 2]),
    /// At once in the zones of all images: their directions are given by these maps, and do not fall into cells that are images of each other.
    ByZone(Vec<DMat3>),
}

/// What one thread adds to [`Counts`].
pub struct Adding<'a> {
    counts: &'a Counts,
    fine: tally::Adding<'a>,
    spectral: Option<tally::Adding<'a>>,
}

impl Counts {
    /// Nothing in `zones` zones, or in the `groups` that they are of; images of directions in the source frame are those by `maps`.
    ///
    /// # Errors
    /// `flux.too_large` above [`Limits::max_tally_values`].
    pub fn new(
        quanta: &Quanta,
        grids: Grids,
        zones: usize,
        groups: Groups,
        (frame, maps): (&Frame, &[DMat3]),
        spectrum: &Spectral,
        limits: &Limits,
    ) -> Result<Counts, Error> {
        let images = Counting::new(&grids, groups.zones.len(), (frame, maps), spectrum.column_count());
        let sites = if matches!(images, Counting::ByGroup(_)) { groups.zones.len() } else { zones };
        let fine = Tally::new(quanta, sites * grids.fine.cell_count(), Kept::Fluxes, limits)?;
        let spectral = (spectrum.column_count() > 0)
            .then(|| Tally::new(quanta, sites * grids.spectral.cell_count(), Kept::Columns, limits))
            .transpose()?;
        Ok(Counts { grids, frame: *frame, zones, groups, images, fine, spectral })
    }

    /// Begins to add on this thread.
    pub fn adding(&self) -> Adding<'_> {
        Adding { counts: self, fine: self.fine.adding(), spectral: self.spectral.as_ref().map(Tally::adding) }
    }

    /// The grids, and what was counted in each zone.
    pub fn measured(self) -> (Grids, Vec<Measured>) {
        let zones = self.zones;
        let (grids, fine, spectral) = self.amounts();
        let of_zone = |amounts: &Amounts, cells: usize, zone: usize| amounts.slice(zone * cells..(zone + 1) * cells);
        let measured = |zone: usize| {
            let spectral = spectral.as_ref().map(|amounts| of_zone(amounts, grids.spectral.cell_count(), zone));
            Measured::new(of_zone(&fine, grids.fine.cell_count(), zone), spectral.unwrap_or_else(Amounts::none))
        };
        let measured = (0..zones).map(measured).collect();
        (grids, measured)
    }

    /// The grids, and the sums over their cells, `[zone][cell]`.
    fn amounts(self) -> (Grids, Amounts, Option<Amounts>) {
        let Counts { grids, zones, groups, images, mut fine, mut spectral, .. } = self;
        if let Counting::ByGroup([fine_images, spectral_images]) = images
            && !fine_images.is_empty()
        {
            let spread = |tally: Tally, grid: &SphereGrid, images: &[Vec<u32>]| {
                let cells = grid.cell_count();
                tally.spread(zones * cells, |site, add| {
                    let (group, cell) = (site / cells, site % cells);
                    let images = groups.zones[group].iter().zip(images);
                    images.for_each(|(zone, cells_of)| add(*zone as usize * cells + cells_of[cell] as usize));
                })
            };
            fine = spread(fine, &grids.fine, &fine_images);
            spectral = spectral.map(|tally| spread(tally, &grids.spectral, &spectral_images));
        }
        (grids, fine.amounts(), spectral.map(Tally::amounts))
    }
}

impl Counting {
    fn new(grids: &Grids, groups: usize, (frame, maps): (&Frame, &[DMat3]), columns: usize) -> Counting {
        if maps.len() < 2 {
            return Counting::ByGroup([Vec::new(), Vec::new()]);
        }
        let values = groups * (grids.fine.cell_count() * tally::FIXED + grids.spectral.cell_count() * columns);
        let images = |grid: &SphereGrid| images_of_cells(grid, frame, maps).filter(|_| values <= MOST_VALUES_OF_GROUPS);
        match (images(&grids.fine), images(&grids.spectral)) {
            (Some(fine), Some(spectral)) => Counting::ByGroup([fine, spectral]),
            _ => Counting::ByZone(maps.to_vec()),
        }
    }
}

impl Adding<'_> {
    /// Adds the `deposit` of a ray that was laid between `corners`; `(C, γ)` of its `direction` in radians.
    pub fn add(
        &mut self,
        corners: [u32; 3],
        Laid { landing, parts }: &Laid<'_>,
        direction: DVec3,
        angles: (f64, f64),
        deposit: &Deposit,
    ) {
        let Counts { grids, frame, groups, images, .. } = self.counts;
        let has_spectrum = self.spectral.is_some();
        let cells = |(c, gamma): (f64, f64)| {
            [grids.fine.cell(c, gamma), if has_spectrum { grids.spectral.cell(c, gamma) } else { 0 }]
        };
        let own = corners.map(|vertex| groups.of_vertex[vertex as usize]);
        let zones = |number: usize| own.map(|group| groups.zones[group as usize][number]);
        match (images, landing.image) {
            (Counting::ByGroup([fine, spectral]), Some(number)) => {
                let [cell, wide] = cells(angles);
                let at = [fine[number][cell] as usize, spectral[number][wide] as usize];
                self.put(own, at, (deposit, parts));
            }
            (Counting::ByGroup(_), None) => self.put(own, cells(angles), (deposit, parts)),
            (Counting::ByZone(_), None) => self.put(zones(0), cells(angles), (deposit, parts)),
            (Counting::ByZone(maps), Some(number)) => {
                let landed = maps[number] * direction;
                for (image, map) in maps.iter().enumerate() {
                    self.put(zones(image), cells(frame.angles(*map * landed)), (deposit, parts));
                }
            }
        }
    }

    /// Adds the whole of a deposit to a site that all corners share, else its parts to their sites.
    fn put(&mut self, sites: [u32; 3], [cell, wide]: [usize; 2], (deposit, parts): (&Deposit, &[Deposit; 3])) {
        let Grids { fine, spectral } = &self.counts.grids;
        let mut put = |site: u32, part: &Deposit| {
            self.fine.add(site as usize * fine.cell_count() + cell, part);
            if let Some(columns) = &mut self.spectral {
                columns.add(site as usize * spectral.cell_count() + wide, part);
            }
        };
        if sites[0] == sites[1] && sites[1] == sites[2] {
            put(sites[0], deposit);
        } else {
            sites.iter().zip(parts).for_each(|(site, part)| put(*site, part));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flux::project::{Landing, Projector};
    use crate::hull::focal::{FocalGrid, FocalPatch, FocalSurface};
    use crate::hull::images::Images;
    use crate::hull::sheet;
    use crate::hull::symmetry::Symmetry;
    use crate::source::{Columns, Ray};
    use crate::vocabulary::space::Axis;
    use crate::vocabulary::spectrum::Bands;
    use crate::vocabulary::units::Flux;
    use glam::DVec2;

    /// A part of a ball whose light has four mirror planes, turned about its axis.
    fn patch(turn: f64) -> FocalPatch {
        let surface = FocalSurface { apex_mm: DVec3::ZERO, axes: DMat3::from_rotation_z(turn), curvature_per_mm: -0.7 };
        let (min_mm, max_mm) = (DVec2::splat(-0.6), DVec2::splat(0.6));
        FocalPatch { surface, min_mm, max_mm, lit_mm2: 1.0, symmetry: Symmetry::None }.with(Symmetry::FourMirrors)
    }

    fn grids() -> Grids {
        Grids { fine: SphereGrid::new(36, 48), spectral: SphereGrid::new(12, 12) }
    }

    /// Rays counted once for all of their images leave the same in every zone as their images counted one by one, whether directions of
    /// images fall into the same cells or not.
    #[test]
    fn counted_once_or_image_by_image() {
        let frame = Frame::looking(Axis::PosZ);
        let spectrum = Spectral { bands: Bands::regular(400.0, 700.0, 100.0).unwrap(), columns: Columns::Bands };
        let quanta = Quanta::new(spectrum.clone(), Flux { radiant_w: Some(1.6e4), luminous_lm: None });
        for (turn, by_group) in [(0.0, true), (0.1, false)] {
            let patch = patch(turn);
            let hull = sheet::of_grid(patch, [10, 10], &[true; 100]);
            let (images, projector) = (Images::of(&hull).unwrap().unwrap(), Projector::new(&hull));
            // Zones that know nothing of the symmetry.
            let zone = |vertex: &DVec3| if vertex.x < 0.1 { 2 } else { u32::from(vertex.y > 0.2) };
            let zone_of_vertex: Vec<u32> = hull.vertices_mm.iter().map(zone).collect();
            let counts = |groups: Groups, maps: &[DMat3]| {
                Counts::new(&quanta, grids(), 3, groups, (&frame, maps), &spectrum, &Limits::default()).unwrap()
            };
            let maps = hull.focal.as_ref().map_or(&[][..], FocalGrid::maps);
            let once = counts(Groups::new(&zone_of_vertex, Some(&images)), maps);
            assert_eq!(matches!(once.images, Counting::ByGroup(_)), by_group);
            let each = counts(Groups::new(&zone_of_vertex, None), &[]);
            for k in 1..2000 {
                let [x, y, z, w] = [2f64, 3.0, 5.0, 7.0].map(|prime| (f64::from(k) * prime.sqrt()).fract() - 0.5);
                let direction = DVec3::new(z, w, 0.8).normalize();
                let origin_mm = DVec3::new(0.8 * x, 0.8 * y, 0.0) - direction;
                let ray =
                    Ray { origin_mm, direction, radiant_w: 1.0, luminous_lm: 0.0, column: k % 3, xz_lm: [0.0; 2] };
                let deposit = quanta.deposit(&ray);
                let add = |counts: &Counts, ray: &Ray, landing: &Landing| {
                    let corners = hull.triangles[landing.triangle];
                    let angles = frame.angles(ray.direction);
                    let parts = deposit.split(landing.shares);
                    counts.adding().add(corners, &Laid { landing, parts: &parts }, ray.direction, angles, &deposit);
                };
                projector.land_images(&ray, |ray, landing| add(&once, ray, &landing.unwrap()));
                for number in 0..patch.symmetry.images() {
                    let image = hull.focal.as_ref().unwrap().image(number, &ray);
                    add(&each, &image, &projector.land(&image).unwrap());
                }
            }
            let ((_, fine, wide), (_, each_fine, each_wide)) = (once.amounts(), each.amounts());
            assert!((each_fine.total().primary() - 8.0 * 1999.0).abs() < 1e-6);
            let same = |a: &[f64], b: &[f64], within: f64| {
                a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < within)
            };
            assert!(same(fine.primary(), each_fine.primary(), 1e-9), "turned by {turn}");
            // The share of a ray is counted to a millionth.
            assert!(same(&fine.rays, &each_fine.rays, 1e-3), "turned by {turn}");
            assert!(same(&wide.unwrap().columns, &each_wide.unwrap().columns, 1e-9), "turned by {turn}");
        }
    }
}
