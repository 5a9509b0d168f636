//! The spatial index: the only file that names the BVH library, and the only one here that speaks f32.
//!
//! The library prunes boxes in f32; distances are computed in f64 from the f64 corners. Coordinates are centred on the indexed
//! things and scaled to their size, boxes padded by more than the rounding, so that pruning never loses a hit.

use crate::vocabulary::space::Bounds;
use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::{Ray, RayHit};

/// Padding of boxes in units of the indexed things' size: 2⁻¹⁷, some hundred f32 roundings.
const PADDING: f64 = 1.0 / 131_072.0;

/// An index over axis-parallel boxes.
pub struct Bvh {
    tree: Bvh2,
    center_mm: DVec3,
    /// Half the diagonal of everything.
    radius_mm: f64,
}

impl Bvh {
    /// Indexes `boxes`; item numbers are their positions in the list.
    pub fn new(boxes: &[Bounds]) -> Bvh {
        let all = boxes.iter().fold(Bounds::EMPTY, |all, next| all.union(*next));
        let center_mm = if boxes.is_empty() { DVec3::ZERO } else { all.center() };
        let radius_mm = (0.5 * all.size().length()).max(f64::MIN_POSITIVE.sqrt());
        let local = |point: DVec3| ((point - center_mm) / radius_mm).as_vec3a();
        let padded = |bounds: &Bounds| Aabb {
            min: local(bounds.min) - Vec3A::splat(PADDING as f32),
            max: local(bounds.max) + Vec3A::splat(PADDING as f32),
        };
        let aabbs: Vec<Aabb> = boxes.iter().map(padded).collect();
        // The builder wants somewhere to report its own build time; nobody here asks.
        let tree = build_bvh2(&aabbs, BvhBuildParams::medium_build(), &mut Default::default());
        Bvh { tree, center_mm, radius_mm }
    }

    /// The item met first on the half-line from `origin_mm` along unit `direction`, not farther than `limit_mm`. `distance(item)`
    /// answers how far along it an item is met (mm, may be slightly negative), `None` where it is not.
    pub fn first_along(
        &self,
        origin_mm: DVec3,
        direction: DVec3,
        limit_mm: f64,
        mut distance: impl FnMut(usize) -> Option<f64>,
    ) -> Option<(usize, f64)> {
        // Start just before the ball around everything: far origins would lose the f32 its digits.
        let nearest = (self.center_mm - origin_mm).dot(direction);
        let reach = self.radius_mm * (1.0 + 4.0 * PADDING);
        let start = (nearest - reach).max(-8.0 * PADDING * self.radius_mm);
        if nearest + reach < start || start > limit_mm {
            return None;
        }
        let from = (origin_mm + start * direction - self.center_mm) / self.radius_mm;
        let to_local = |t: f64| ((t - start) / self.radius_mm) as f32;
        // One f32 rounding beyond the limit, so that a hit at the limit is not pruned.
        let far = to_local(limit_mm) * (1.0 + 4.0 * f32::EPSILON) + PADDING as f32;
        let ray = Ray::new(from.as_vec3a(), direction.as_vec3a(), 0.0, far);
        let mut best: Option<(usize, f64)> = None;
        self.tree.ray_traverse(ray, &mut RayHit::none(), |_, slot| {
            let item = self.tree.primitive_indices[slot] as usize;
            match distance(item) {
                // Ties go to the smaller item, so that the answer does not depend on the tree.
                Some(t)
                    if t <= limit_mm && best.is_none_or(|(other, least)| t < least || (t == least && item < other)) =>
                {
                    best = Some((item, t));
                    to_local(t).max(0.0) * (1.0 + 4.0 * f32::EPSILON) + PADDING as f32
                }
                _ => f32::INFINITY,
            }
        });
        best
    }

    /// Calls `visit` for every item whose box the line through `point_mm` along unit `direction` meets; in no particular order.
    pub fn along_line(&self, point_mm: DVec3, direction: DVec3, mut visit: impl FnMut(usize)) {
        // As in `first_along`: from just before the ball around everything to just behind it.
        let nearest = (self.center_mm - point_mm).dot(direction);
        let reach = self.radius_mm * (1.0 + 4.0 * PADDING);
        let from = (point_mm + (nearest - reach) * direction - self.center_mm) / self.radius_mm;
        let ray = Ray::new(from.as_vec3a(), direction.as_vec3a(), 0.0, (2.0 * reach / self.radius_mm) as f32);
        self.tree.ray_traverse(ray, &mut RayHit::none(), |_, slot| {
            visit(self.tree.primitive_indices[slot] as usize);
            f32::INFINITY
        });
    }

    /// Calls `visit` for every item whose box comes within `radius_mm` (in each axis) of `point_mm`; in no particular order.
    pub fn near(&self, point_mm: DVec3, radius_mm: f64, mut visit: impl FnMut(usize)) {
        let at = ((point_mm - self.center_mm) / self.radius_mm).as_vec3a();
        let half = Vec3A::splat((radius_mm / self.radius_mm * (1.0 + PADDING) + PADDING) as f32);
        self.tree.aabb_traverse(Aabb { min: at - half, max: at + half }, |tree, index| {
            let node = &tree.nodes[index as usize];
            let slots = node.first_index as usize..(node.first_index + node.prim_count) as usize;
            tree.primitive_indices[slots].iter().for_each(|item| visit(*item as usize));
            true
        });
    }
}
