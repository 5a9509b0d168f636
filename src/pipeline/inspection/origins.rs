//! Whether rays start on a plane, on the faces of a box or on a sphere: vendors move origins to such places, and
//! then they are not the emitter. Found from the sample, so shares are estimates: ±0.4 % of a share of one half (one σ).

use super::sample::{Sampled, hash};
use crate::writing::schema::WHOLE;
use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::Serialize;

/// Distance that is still "on", in largest edges of the box of the origins.
const TOLERANCE: f64 = 1e-3;
/// Share of the sample on either side that is left out of the box: stray rays.
const STRAY: f64 = 1e-3;
/// Random candidates that are tried for the plane, and as many for the sphere.
const TRIALS: u64 = 96;
/// Origins by which a candidate is scored; the best is scored again by all.
const JUDGES: usize = 1000;
/// Largest radius of a sphere, in diagonals of the box: beyond, it is a plane.
const FLATTEST: f64 = 10.0;
/// Smallest share of the origins that names a shape.
const MOST: f64 = 0.95;

/// What origins lie on; shares are of a sample of at most 20 000 rays.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Origins {
    /// Rays the shares were estimated from.
    pub sampled_rays: u64,
    /// All rays were sampled: shares are exact.
    pub exact: bool,
    /// Distance that is still "on", mm.
    pub tolerance_mm: f64,
    /// The simplest of "point", "plane", "sphere", "box" that holds 95 % of the rays; else "spread".
    #[schemars(extend("enum" = ["point", "plane", "sphere", "box", "spread"]))]
    pub shape: &'static str,
    /// The plane that holds most of them.
    pub plane: Option<Plane>,
    /// The box whose faces hold most of them; `null` where the origins are flat.
    #[serde(rename = "box")]
    pub faces: Option<Faces>,
    /// The sphere that holds most of them; `null` where they are flat.
    pub sphere: Option<Sphere>,
}

/// Points p with normal · p = offset.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Plane {
    /// Share of the rays on it, 0..=1.
    #[schemars(range(min = 0, max = WHOLE))]
    pub share: f64,
    /// Unit normal.
    pub normal: [f64; 3],
    /// Distance from the origin of the frame along the normal, mm.
    pub offset_mm: f64,
}

/// A box with faces normal to the axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Faces {
    /// Share of the rays on its faces, 0..=1.
    #[schemars(range(min = 0, max = WHOLE))]
    pub share: f64,
    /// Smallest coordinates, mm.
    pub min_mm: [f64; 3],
    /// Largest coordinates, mm.
    pub max_mm: [f64; 3],
}

/// A sphere.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Sphere {
    /// Share of the rays on it, 0..=1.
    #[schemars(range(min = 0, max = WHOLE))]
    pub share: f64,
    /// Middle, mm.
    pub center_mm: [f64; 3],
    /// Radius, mm.
    pub radius_mm: f64,
}

/// What the sampled origins lie on; `None` without any.
pub fn origins(sample: &[Sampled], rays_used: u64) -> Option<Origins> {
    let points: Vec<DVec3> = sample.iter().map(|ray| ray.origin_mm).collect();
    let columns = sorted(&points)?;
    let (low, high) = quantiles(&columns);
    let edge = (high - low).max_element();
    // f32 positions are exact to 6e-8 of their size.
    let tolerance = (TOLERANCE * edge).max(1e-6 * low.abs().max(high.abs()).max_element());
    let mut found = Origins {
        sampled_rays: points.len() as u64,
        exact: points.len() as u64 == rays_used,
        tolerance_mm: tolerance,
        shape: "point",
        plane: None,
        faces: None,
        sphere: None,
    };
    if edge <= tolerance {
        return Some(found);
    }
    found.plane = plane(&points, &columns, tolerance);
    // Flat origins lie on boxes and spheres without end.
    if found.plane.is_none_or(|plane| plane.share < 0.999) {
        found.faces = faces(&points, low, high, tolerance);
        found.sphere = sphere(&points, (high - low).length(), tolerance);
    }
    let candidates = [
        ("plane", found.plane.map(|plane| plane.share)),
        ("sphere", found.sphere.map(|sphere| sphere.share)),
        ("box", found.faces.map(|faces| faces.share)),
    ];
    found.shape = "spread";
    let mut best = MOST;
    for (shape, share) in candidates {
        if let Some(share) = share.filter(|share| *share > best) {
            (found.shape, best) = (shape, share + 0.005);
        }
    }
    Some(found)
}

/// The three coordinates of all points, each sorted; `None` without points.
fn sorted(points: &[DVec3]) -> Option<[Vec<f64>; 3]> {
    (!points.is_empty()).then(|| {
        std::array::from_fn(|k| {
            let mut column: Vec<f64> = points.iter().map(|point| point[k]).collect();
            column.sort_by(f64::total_cmp);
            column
        })
    })
}

fn quantiles(columns: &[Vec<f64>; 3]) -> (DVec3, DVec3) {
    let at = |share: f64| {
        let value = |column: &Vec<f64>| {
            let place = (share * (column.len() - 1) as f64).round() as usize;
            column.get(place).copied().unwrap_or(0.0)
        };
        DVec3::new(value(&columns[0]), value(&columns[1]), value(&columns[2]))
    };
    (at(STRAY), at(1.0 - STRAY))
}

fn share(points: &[DVec3], on: impl Fn(DVec3) -> bool) -> f64 {
    points.iter().filter(|point| on(**point)).count() as f64 / points.len().max(1) as f64
}

/// A sampled origin by the `k`-th draw of trial `trial`.
fn drawn(points: &[DVec3], trial: u64, k: u64) -> DVec3 {
    let place = hash(8 * trial + k) % points.len().max(1) as u64;
    points.get(place as usize).copied().unwrap_or_default()
}

/// Every so many points, at most about [`JUDGES`]: the sample is in file order, which must not matter.
fn judges(points: &[DVec3]) -> Vec<DVec3> {
    points.iter().step_by(points.len().div_ceil(JUDGES).max(1)).copied().collect()
}

fn plane(points: &[DVec3], columns: &[Vec<f64>; 3], tolerance: f64) -> Option<Plane> {
    let upright = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().zip(columns).map(|(normal, column)| {
        let (count, middle) = densest(column, 2.0 * tolerance);
        (normal, middle, count as f64 / points.len().max(1) as f64)
    });
    let upright = upright.max_by(|a, b| a.2.total_cmp(&b.2));
    let few = judges(points);
    let on = |points: &[DVec3], normal: DVec3, offset: f64| {
        share(points, |point| (normal.dot(point) - offset).abs() <= tolerance)
    };
    let oblique = (0..TRIALS)
        .filter_map(|trial| {
            let [a, b, c] = [0, 1, 2].map(|k| drawn(points, trial, k));
            let normal = (b - a).cross(c - a).try_normalize()?;
            Some((normal, normal.dot(a), on(&few, normal, normal.dot(a))))
        })
        .max_by(|a, b| a.2.total_cmp(&b.2))
        .map(|(normal, offset, _)| (normal, offset, on(points, normal, offset)));
    // Through three points of a plane goes only nearly that plane: the upright one is preferred unless clearly worse.
    let best = match (upright, oblique) {
        (Some(upright), Some(oblique)) if oblique.2 > upright.2 + 0.01 => Some(oblique),
        (upright, oblique) => upright.or(oblique),
    };
    best.map(|(normal, offset_mm, share)| Plane { share, normal: normal.to_array(), offset_mm })
}

/// Most sorted values within `width`, and the middle of those.
fn densest(column: &[f64], width: f64) -> (usize, f64) {
    let (mut best, mut middle, mut start) = (0, 0.0, 0);
    for (end, value) in column.iter().enumerate() {
        while column.get(start).is_some_and(|first| value - first > width) {
            start += 1;
        }
        if end + 1 - start > best {
            best = end + 1 - start;
            middle = column.get(start + best / 2).copied().unwrap_or(*value);
        }
    }
    (best, middle)
}

fn faces(points: &[DVec3], low: DVec3, high: DVec3, tolerance: f64) -> Option<Faces> {
    if (high - low).min_element() <= 2.0 * tolerance {
        return None;
    }
    let on = |point: DVec3| {
        let inside = point.cmpge(low - tolerance).all() && point.cmple(high + tolerance).all();
        inside && (point - low).abs().min((point - high).abs()).min_element() <= tolerance
    };
    Some(Faces { share: share(points, on), min_mm: low.to_array(), max_mm: high.to_array() })
}

fn sphere(points: &[DVec3], diagonal: f64, tolerance: f64) -> Option<Sphere> {
    let few = judges(points);
    let on = |points: &[DVec3], center: DVec3, radius: f64| {
        share(points, |point| (point.distance(center) - radius).abs() <= tolerance)
    };
    let (center, radius, _) = (0..TRIALS)
        .filter_map(|trial| {
            let (center, radius) = sphere_through([0, 1, 2, 3].map(|k| drawn(points, trial, k)))?;
            (radius < FLATTEST * diagonal).then(|| (center, radius, on(&few, center, radius)))
        })
        .max_by(|a, b| a.2.total_cmp(&b.2))?;
    Some(Sphere { share: on(points, center, radius), center_mm: center.to_array(), radius_mm: radius })
}

/// Middle and radius of the sphere through four points: 2 (pₖ − p₀) · c = pₖ² − p₀².
fn sphere_through([p, q, r, s]: [DVec3; 4]) -> Option<(DVec3, f64)> {
    let rows = [q - p, r - p, s - p];
    let matrix = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
    let size: f64 = rows.iter().map(|row| row.length()).product();
    // Four points nearly in a plane give any sphere.
    if matrix.determinant().abs() <= 1e-3 * size {
        return None;
    }
    let to_center = matrix.inverse() * DVec3::from_array(rows.map(|row| 0.5 * row.length_squared()));
    Some((p + to_center, to_center.length()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A number in 0..1 by index.
    fn uniform(index: u64) -> f64 {
        (hash(index) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn found(count: u64, point: impl Fn([f64; 3]) -> DVec3) -> Origins {
        let draw = |k: u64| [3 * k, 3 * k + 1, 3 * k + 2].map(|index| uniform(index + 1_000_000));
        let ray = |k| Sampled { origin_mm: point(draw(k)), direction: DVec3::Z, weight: 1.0 };
        origins(&(0..count).map(ray).collect::<Vec<_>>(), 10 * count).unwrap()
    }

    fn on_sphere([a, b, _]: [f64; 3]) -> DVec3 {
        let (z, c) = (2.0 * a - 1.0, std::f64::consts::TAU * b);
        DVec3::new((1.0 - z * z).sqrt() * c.cos(), (1.0 - z * z).sqrt() * c.sin(), z)
    }

    #[test]
    fn a_plane_is_found_upright_and_oblique_with_its_share() {
        // 70 % on z = 0.02, the rest in a volume above.
        let upright = found(10_000, |[a, b, c]| DVec3::new(4.0 * a, 3.0 * b, 0.02 + ((c - 0.7) * 5.0).max(0.0)));
        let plane = upright.plane.unwrap();
        assert_eq!((plane.normal, upright.shape), ([0.0, 0.0, 1.0], "spread"));
        // Binomial: 0.5 % at one σ; and 0.1 % of the volume within tolerance.
        assert!((plane.share - 0.7).abs() < 0.02 && (plane.offset_mm - 0.02).abs() < 1e-9, "{plane:?}");
        let normal = DVec3::new(1.0, 2.0, -2.0) / 3.0;
        let (u, v) = normal.any_orthonormal_pair();
        let oblique = found(10_000, |[a, b, _]| 5.0 * normal + 2.0 * a * u + 3.0 * b * v);
        let plane = oblique.plane.unwrap();
        assert!(DVec3::from_array(plane.normal).dot(normal).abs() > 1.0 - 1e-6 && plane.share > 0.999, "{plane:?}");
        assert!((plane.offset_mm.abs() - 5.0).abs() < 1e-6 && oblique.shape == "plane" && oblique.sphere.is_none());
    }

    #[test]
    fn a_sphere_is_found_with_its_middle_and_radius() {
        let center = DVec3::new(0.0, 0.0, 10.0);
        let round = found(10_000, |draw| center + 10.0 * on_sphere(draw));
        let sphere = round.sphere.unwrap();
        assert_eq!(round.shape, "sphere");
        assert!(sphere.share > 0.999 && (sphere.radius_mm - 10.0).abs() < 1e-9, "{sphere:?}");
        assert!((DVec3::from_array(sphere.center_mm) - center).length() < 1e-9);
    }

    #[test]
    fn a_box_is_found_by_its_faces() {
        // A unit box: one coordinate of three is sent to a face.
        let boxed = found(12_000, |[a, b, c]| {
            let face = (6.0 * c) as usize % 6;
            let mut point = DVec3::new(a, b, 6.0 * c % 1.0);
            point[face / 2] = (face % 2) as f64;
            point
        });
        let faces = boxed.faces.unwrap();
        assert_eq!((boxed.shape, faces.min_mm, faces.max_mm), ("box", [0.0; 3], [1.0; 3]));
        assert_eq!(faces.share, 1.0);
        assert!((boxed.plane.unwrap().share - 1.0 / 6.0).abs() < 0.02);
    }

    #[test]
    fn a_volume_lies_on_nothing_and_a_point_is_a_point() {
        let volume = found(10_000, DVec3::from_array);
        assert_eq!(volume.shape, "spread");
        // Within 1e-3 of a face of the unit box: 6 × 1e-3 of the volume, of a sphere less than that.
        let [plane, faces, sphere] =
            [volume.plane.unwrap().share, volume.faces.unwrap().share, volume.sphere.unwrap().share];
        assert!(plane < 0.01 && faces < 0.02 && sphere < 0.02, "{plane} {faces} {sphere}");
        assert_eq!(found(100, |_| DVec3::new(1.0, 2.0, 3.0)).shape, "point");
        assert_eq!(origins(&[], 0), None);
    }
}
