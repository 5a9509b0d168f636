//! Radiance: what illuminates, and what is seen. Its rays find light by going to each of its sources, so the surface is also written as
//! about a thousand small spheres that are not seen (`light.rad`), and as triangles that are seen, let light pass and give none (`seen.rad`).
//! Both take their distribution over angles from one data file, `lampwright.dat`, by the number of the zone.

/// The surface as small sources.
mod sources;

use super::colour::RADIANCE;
use super::surface::Surface;
use crate::writing::Artifact;
use crate::writing::number::{rounded, text as plain_text};
use glam::DVec3;
use sources::{Source, shares_of, sources};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// Lumens of a W of white light, as Radiance has it.
const RADIANCE_LM_PER_W: f64 = 179.0;
/// Light sources that are aimed at.
const SOURCES: usize = 1024;
/// Levels of a colour within a factor of e: materials differ by half a percent.
const LEVELS: f64 = 200.0;
/// Distance from which a source is as good as a point, in reaches: its light is off by a few per cent there.
const NEAR: f64 = 6.0;
/// Part of a seen triangle that glows, the rest lets light pass; its radiance is larger by as much.
const GLOWING: f64 = 1e-3;
/// Steps of the part of a triangle's light that a zone has. A glowing part of 10⁻⁶ and less would be left out by Radiance.
const STEPS: f64 = 500.0;

/// The folder's files.
pub fn files(surface: &Surface<'_>, name: &str) -> Vec<Artifact> {
    let rgb = scaled(surface);
    let light = sources(surface, &rgb, SOURCES);
    let text = |name: &str, text: String| Artifact::text(name, "text/plain", text);
    let near = plain_text(NEAR * mean_reach_mm(&light), 2);
    let readme = include_str!("README.txt").replace("{name}", name).replace("{sources}", &light.len().to_string());
    let readme = readme.replace("{near}", &near).replace("{unit}", surface.unit());
    let factor = if surface.unit() == "cd/m2" { "179 " } else { "" };
    vec![
        text("README.txt", readme.replace("{factor}", factor)),
        text("light.rad", illuminating(&light)),
        text("seen.rad", seen(surface, &rgb)),
        text("lampwright.cal", functions(surface)),
        text("lampwright.dat", data(surface)),
    ]
}

/// How far the flux of a source lies from its middle, root mean square over all flux, mm.
fn mean_reach_mm(sources: &[Source]) -> f64 {
    let of = |source: &Source| source.flux.iter().sum::<f64>();
    let sum: f64 = sources.iter().map(of).sum();
    (sources.iter().map(|source| of(source) * source.reach_mm * source.reach_mm).sum::<f64>() / sum).sqrt()
}

/// Exitance of the vertices in red, green and blue of Radiance, W/m²: it has 179 lm for each W of white light.
fn scaled(surface: &Surface<'_>) -> Vec<[f64; 3]> {
    let factor = if surface.unit() == "cd/m2" { RADIANCE_LM_PER_W.recip() } else { 1.0 };
    surface.rgb(&RADIANCE).into_iter().map(|rgb| rgb.map(|part| factor * part)).collect()
}

/// A number that every version reads.
fn number(value: f64) -> String {
    format!("{:e}", rounded(value, 7))
}

fn numbers(values: impl IntoIterator<Item = f64>) -> String {
    values.into_iter().map(number).collect::<Vec<String>>().join(" ")
}

/// A pattern that takes the distribution of a zone: `lw_even` as it is, `lw_seen` over the cosine.
fn pattern(id: &str, function: &str, zone: usize) -> String {
    format!("void brightdata {id}\n6 {function} lampwright.dat lampwright.cal lw_zone lw_plane lw_gamma\n0\n1 {zone}\n")
}

/// Spheres of radiance I / (π r²).
fn illuminating(sources: &[Source]) -> String {
    let mut text =
        String::from("# Light of a Lampwright model: small spheres that give light and are not seen. Lengths in mm.\n");
    let mut last = None;
    for (at, Source { zone, middle_mm, radius_mm, flux, .. }) in sources.iter().enumerate() {
        if last != Some(*zone) {
            text += &pattern(&format!("lw_q{zone}"), "lw_even", *zone);
            last = Some(*zone);
        }
        let section_mm2 = std::f64::consts::PI * radius_mm * radius_mm;
        let radiance = numbers(flux.map(|flux| flux / section_mm2));
        let place = numbers(middle_mm.to_array().into_iter().chain([*radius_mm]));
        let _ =
            write!(text, "lw_q{zone} illum lw_i{at}\n0\n0\n3 {radiance}\nlw_i{at} sphere lw_s{at}\n0\n0\n4 {place}\n");
    }
    text
}

/// Levels of red, green and blue of a triangle's exitance.
type Levels = [i32; 3];
/// Zones of a triangle and how many steps of its light each has, the most first.
type Parts = Vec<(usize, u32)>;

/// What a triangle looks like.
fn look(surface: &Surface<'_>, rgb: &[[f64; 3]], triangle: usize) -> (Levels, Parts) {
    let shares = shares_of(surface, rgb, triangle);
    let all: f64 = shares.iter().flat_map(|(_, flux)| flux).sum();
    let area_mm2 = surface.light.mesh.area_mm2(triangle);
    let mut parts: Parts = Vec::new();
    let mut sums = [0.0; 3];
    for (zone, flux) in shares {
        sums.iter_mut().zip(flux).for_each(|(sum, part)| *sum += part / area_mm2);
        let steps = (STEPS * flux.iter().sum::<f64>() / all).round() as u32;
        parts.extend((steps > 0).then_some((zone, steps)));
    }
    parts.sort_by_key(|(zone, steps)| (Reverse(*steps), *zone));
    let level = |part: f64| if part > 0.0 { (part.ln() * LEVELS).round() as i32 } else { i32::MIN };
    (sums.map(level), parts)
}

/// Triangles with their materials; those that differ by less than half a percent are one. A material is a chain of mixtures: a part glows as the first
/// zone says, the rest is a part that glows as the second says, and so on; what is left lets light pass.
fn seen(surface: &Surface<'_>, rgb: &[[f64; 3]]) -> String {
    let mesh = surface.light.mesh;
    let looks: Vec<(Levels, Parts)> = (0..mesh.triangles.len()).map(|triangle| look(surface, rgb, triangle)).collect();
    let glows = looks.iter().flat_map(|(levels, parts)| parts.iter().map(|(zone, _)| (*zone, *levels)));
    let glows: BTreeSet<(usize, Levels)> = glows.collect();
    let mut text =
        String::from("# Surface of a Lampwright model: it is seen, lets light pass and gives none. Lengths in mm.\n");
    let mut last = None;
    for (at, (zone, levels)) in glows.iter().enumerate() {
        if last != Some(*zone) {
            text += &pattern(&format!("lw_v{zone}"), "lw_seen", *zone);
            last = Some(*zone);
        }
        let value = |level: i32| if level > i32::MIN { (f64::from(level) / LEVELS).exp() } else { 0.0 };
        let radiance = numbers(levels.map(|level| value(level) / GLOWING));
        let _ = write!(text, "lw_v{zone} glow lw_g{at}\n0\n0\n4 {radiance} -1\n");
    }
    let glows: BTreeMap<(usize, Levels), usize> = glows.into_iter().zip(0..).collect();
    let materials: BTreeSet<&(Levels, Parts)> = looks.iter().filter(|(_, parts)| !parts.is_empty()).collect();
    for (at, (levels, parts)) in materials.iter().enumerate() {
        let glow = |zone: usize| glows.get(&(zone, *levels)).copied().unwrap_or_default();
        text += &chain(at, &parts.iter().map(|(zone, steps)| (glow(*zone), *steps)).collect::<Vec<_>>());
    }
    let materials: BTreeMap<&(Levels, Parts), usize> = materials.into_iter().zip(0..).collect();
    for (triangle, look) in looks.iter().enumerate() {
        if let Some(material) = materials.get(look) {
            let corners = numbers(mesh.corners_mm(triangle).iter().flat_map(|corner| corner.to_array()));
            let _ = write!(text, "lw_m{material}_0 polygon lw_t\n0\n0\n9 {corners}\n");
        }
    }
    text
}

/// The mixtures of a material, the last first: `lw_mAT_0` is what a triangle names.
fn chain(at: usize, parts: &[(usize, u32)]) -> String {
    let whole = f64::from(parts.iter().map(|(_, steps)| steps).sum::<u32>());
    let mut left = 1.0;
    let mut mixtures = Vec::new();
    for (place, (glow, steps)) in parts.iter().enumerate() {
        let part = GLOWING * f64::from(*steps) / whole;
        let rest = if place + 1 < parts.len() { format!("lw_m{at}_{}", place + 1) } else { "void".to_owned() };
        mixtures.push(format!(
            "void mixfunc lw_m{at}_{place}\n4 lw_g{glow} {rest} lw_part lampwright.cal\n0\n1 {}\n",
            number(part / left)
        ));
        left -= part;
    }
    mixtures.into_iter().rev().collect()
}

/// The functions, with the axes of the photometric frame. D is the direction from the eye to the light, so the light goes along -D.
fn functions(surface: &Surface<'_>) -> String {
    let frame = surface.light.frame;
    let along = |axis: DVec3| format!("(Dx*{} + Dy*{} + Dz*{})", axis.x, axis.y, axis.z);
    let text = include_str!("lampwright.cal").replace("{x}", &along(frame.x())).replace("{y}", &along(frame.y()));
    text.replace("{z}", &along(frame.z()))
}

/// Values by zone, C and γ: C from 0 to 360 with the first plane again at its end. One zone is written twice, as a data file has at least two
/// places along each axis.
fn data(surface: &Surface<'_>) -> String {
    let grid = surface.light.grid;
    let (planes, nodes) = (grid.c_planes(), grid.gamma_nodes());
    let zones = surface.distributions.len().max(2);
    let gamma: Vec<String> = grid.gamma_deg().into_iter().map(number).collect();
    let mut text = format!("3\n0 {} {zones}\n0 360 {}\n0 0 {nodes} {}\n", zones - 1, planes + 1, gamma.join(" "));
    for distribution in surface.distributions.iter().cycle().take(zones) {
        for plane in (0..planes).chain([0]) {
            text += &numbers(distribution[plane * nodes..][..nodes].iter().copied());
            text.push('\n');
        }
    }
    text
}
