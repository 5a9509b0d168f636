//! What a user should think of a file: one verdict per check, in reading order, each with what to do.

use super::findings::Inspection;
use super::findings::{Check, Verdict};
use super::origins::Origins;
use crate::error::Fault;
use crate::formats::record::{
    DEFAULT_UNIT, DRAWN, EQUAL_SHARES, LOW_DISCREPANCY, SPECTRUM_UNREADABLE, TOTAL_UNREADABLE,
};
use crate::formats::record::{Facts, SpectralData, TotalRule};
use crate::formats::text::rows::{MORE_ROWS, too_many_more};
use crate::rays::check::Flaw;
use crate::rays::conversion::header_lm_per_w;
use crate::rays::totals::{EFFICACY_NOTICED, LIKELY_SIZE_MM, RATIO_NOTICED};
use glam::DVec3;

/// So many times its size away from the origin of its file, a source in single precision has fewer than a hundred places along each axis.
const FAR_AWAY: f64 = 1e5;
/// Visible light, nm: spectra with nothing inside give no lumens.
const VISIBLE_NM: (f64, f64) = (380.0, 780.0);
/// Far infrared, nm: where visible wavelengths in Å are when they are taken for nm.
const FAR_NM: f64 = 2000.0;
const ANGSTROM_PER_NM: f64 = 10.0;
/// Wavelengths outside are no light source anybody sells rays of, nm: another column was read, or another unit.
const LIKELY_NM: (f64, f64) = (100.0, 20_000.0);
/// `rays.ray_flux` is a notice when one ray carries more than this share of the flux: it would show as a spot.
const LARGE_RAY: f64 = 0.01;
/// ... or when the effective rays are less than this share of the counted ones: most rays hardly matter then.
const EVEN_RAYS: f64 = 0.1;
/// Relative noise of a picture of 50 x 50 cells above which it is a notice.
const NOISY: f64 = 0.25;
/// Share of the flux against the main direction above which it is a notice, for a source that has a main direction.
const BACKWARD: f64 = 0.01;
/// Length of the mean direction above which a source has a main direction; even light into a hemisphere has 1/2.
const DIRECTED: f64 = 0.45;
/// Origins twice as far from the focus as 99 % of the ray lines pass by it lie on a receiver, not on an emitter.
const FAR: f64 = 2.0;
/// Distance of the focus from the plane of the origins, in root mean square distances of the ray lines, above which the model is
/// blurred.
const FOCUS_OFF_PLANE: f64 = 0.2;
/// ... and the same distance in standard errors of the focus: two-sided normal tail 6e-7.
const FOCUS_OFF_PLANE_SIGMA: f64 = 5.0;
/// Share of the origins on a plane above which they were moved to it.
const MOVED: f64 = 0.8;

/// Checks whose findings the reading of the rays for a model reports itself: as a refusal, or as a notice under a code of its own
/// (`rays.unlikely_size`, `rays.total_ratio`, `rays.efficacy_differs`, those of [`crate::rays::check`]).
pub const TOLD_BY_READING: [&str; 7] =
    ["rays.usable", "rays.length_unit", "rays.quantity", "rays.size", "rays.total", "rays.efficacy", "rays.directions"];

fn ok(check: &'static str, message: impl Into<String>) -> Check {
    Check { check, verdict: Verdict::Ok, message: message.into(), remedy: None }
}

fn notice(check: &'static str, message: impl Into<String>, remedy: &str) -> Check {
    Check { check, verdict: Verdict::Notice, message: message.into(), remedy: Some(remedy.into()) }
}

fn wrong(check: &'static str, message: impl Into<String>, remedy: &str) -> Check {
    Check { check, verdict: Verdict::Wrong, message: message.into(), remedy: Some(remedy.into()) }
}

/// All checks of a file, in reading order. `fault`: why a job would refuse it; `declared`: its total was.
pub fn checks(facts: &Facts, found: &Inspection, fault: Option<&Fault>, declared: bool) -> Vec<Check> {
    let mut checks = vec![rays(facts, found, fault), length_unit(facts), quantity(facts)];
    if found.rays_used > 0 {
        checks.extend([size(facts, found), total(facts, found, declared), spectrum(facts, found)]);
        checks.extend(efficacy(facts, found));
        checks.extend([directions(found), order(found), ray_flux(found), noise(found), focus(found)]);
        checks.extend([origins(found), backward(found), beam(found), job(found)]);
    }
    checks
}

fn rays(facts: &Facts, found: &Inspection, fault: Option<&Fault>) -> Check {
    const NAME: &str = "rays.usable";
    let (used, refused, dropped) = (found.rays_used, found.rays_refused, found.rays_dropped);
    let unread = facts.notices.count_of(MORE_ROWS);
    if fault.is_none() && too_many_more(unread, facts.ray_count) {
        let told = format!(
            "The header announces {} rays, and {unread} more rows follow, which are not read.",
            facts.ray_count
        );
        return wrong(NAME, told, "Correct the number of rays in the header, or export the file again.");
    }
    match fault {
        Some(fault) => wrong(NAME, &fault.found, &fault.remedy),
        None if refused + dropped > 0 => notice(
            NAME,
            format!("{used} rays can be used; {refused} cannot be meant and were refused, {dropped} carry no flux."),
            "The notices say why, and which ray was the first. Nothing, if these are few; else export the file again.",
        ),
        None if used == 1 => ok(NAME, "Its one ray can be used."),
        None => ok(NAME, format!("All {used} rays can be used.")),
    }
}

fn length_unit(facts: &Facts) -> Check {
    const NAME: &str = "rays.length_unit";
    match facts.length_unit {
        Some(unit) if facts.notices.count_of(DEFAULT_UNIT) > 0 => notice(
            NAME,
            format!("Lengths are in {}, by a factor that programs leave as it is whatever the unit.", unit.symbol()),
            "Compare the size with the data sheet; declare length_unit as m or as mm.",
        ),
        Some(unit) => ok(NAME, format!("Lengths are in {}.", unit.symbol())),
        None => wrong(
            NAME,
            "The file does not say its unit of length; it was read as if in mm.",
            "Declare length_unit for it: nm, um, mm, cm, in, ft or m.",
        ),
    }
}

fn quantity(facts: &Facts) -> Check {
    const NAME: &str = "rays.quantity";
    if facts.quantity_unknown {
        let remedy = "Declare quantity for it: radiant (W) or luminous (lm).";
        return wrong(NAME, "The file does not say whether its flux is in W or lm.", remedy);
    }
    ok(
        NAME,
        match (facts.has_radiant, facts.has_luminous) {
            (true, true) => "Rays carry W and lm.",
            (true, false) => "Rays carry W.",
            (false, _) => "Rays carry lm.",
        },
    )
}

fn size(facts: &Facts, found: &Inspection) -> Check {
    const NAME: &str = "rays.size";
    let Some(extent) = found.origins_mm else { return ok(NAME, "There are no origins.") };
    let [x, y, z] = std::array::from_fn(|k| extent.max[k] - extent.min[k]);
    let largest = x.max(y).max(z);
    let told = format!("The origins span {x:.4} x {y:.4} x {z:.4} mm.");
    if facts.notices.count_of(DEFAULT_UNIT) > 0 {
        let [x, y, z] = [x, y, z].map(|span| span / 1000.0);
        let told = format!("{told} If the file is in mm and not in m, they span {x:.4} x {y:.4} x {z:.4} mm.");
        return notice(NAME, told, "Compare the size with the data sheet; declare length_unit as m or as mm.");
    }
    if largest > LIKELY_SIZE_MM.1 || (largest > 0.0 && largest < LIKELY_SIZE_MM.0) {
        return notice(
            NAME,
            told,
            "The unit of length looks wrong: compare with the data sheet and declare length_unit.",
        );
    }
    let away = extent.min.iter().chain(&extent.max).fold(0.0_f64, |most, place| most.max(place.abs()));
    if largest > 0.0 && away > FAR_AWAY * largest {
        let told = format!(
            "{told} They lie up to {away:.4e} mm from the file's origin, where single precision tells places {:.1e} mm apart.",
            away * f64::from(f32::EPSILON)
        );
        return notice(NAME, told, "Move the source to the origin of its file, and export it again.");
    }
    ok(NAME, told)
}

fn total(facts: &Facts, found: &Inspection, declared: bool) -> Check {
    const NAME: &str = "rays.total";
    let primary = format!("{:.6} {}", found.flux.primary(), found.flux.primary_unit());
    if facts.notices.count_of(TOTAL_UNREADABLE) > 0 {
        let told = format!("The header's total cannot be read, and rays are relative to it; their sum is {primary}.");
        return wrong(NAME, told, "Declare flux for it, or correct the number in its header.");
    }
    if facts.notices.count_of(EQUAL_SHARES) > 0 && facts.quantity_unknown {
        return wrong(NAME, "No column holds flux, as declared.", "Declare flux for it: every ray has an equal share.");
    }
    if declared {
        return ok(NAME, format!("The total is {primary}, as declared."));
    }
    let Some(ratio) = found.sum_over_header else {
        return ok(NAME, format!("The total is {primary}; there is no other to compare it with."));
    };
    if (ratio - 1.0).abs() <= RATIO_NOTICED {
        return ok(NAME, format!("The total is {primary}; header and rays agree."));
    }
    let told = format!("The rays sum to {ratio:.6} times the header's total; {primary} was taken.");
    match facts.total_rule {
        TotalRule::Header => notice(
            NAME,
            format!("{told} In this format rays are relative to the header's total."),
            "Compare the total with the data sheet; declare flux if it is another.",
        ),
        TotalRule::RaySum => notice(
            NAME,
            format!("{told} In this format the rays hold; the file may be part of a longer one."),
            "Compare the total with the data sheet; declare flux if it is another.",
        ),
    }
}

fn spectrum(facts: &Facts, found: &Inspection) -> Check {
    const NAME: &str = "rays.spectrum";
    if facts.notices.count_of(SPECTRUM_UNREADABLE) > 0 {
        let told = "The spectrum of the file cannot be meant; the notices say why.";
        return wrong(NAME, told, "Declare the spectrum of its light, or export the file again.");
    }
    if let Some((low, high)) = found.wavelength_nm {
        let told = format!("A wavelength per ray, {low:.1} to {high:.1} nm.");
        let strays =
            found.notices.iter().find(|notice| notice.code == Flaw::NotLight.code()).map_or(0, |notice| notice.count);
        if strays > 0 {
            let told =
                format!("{told} {strays} rays more have wavelengths that are no light's in nm: units are mixed.");
            return wrong(NAME, told, "Export the file again with all wavelengths in one unit.");
        }
        return range(NAME, told, low, high);
    }
    match (&facts.spectral, found.header.table_range_nm) {
        (SpectralData::Tristimulus, _) => ok(NAME, "Tristimulus values per ray."),
        (_, Some((low, high))) => {
            let told = format!("{} in tables, {low:.1} to {high:.1} nm.", plural(facts.spectral.tables().len()));
            range(NAME, told, low, high)
        }
        _ => notice(
            NAME,
            format!("There is no spectrum: only {} can be modelled.", found.flux.primary_unit()),
            "Declare the spectrum of its light if you need W and lm, or colour.",
        ),
    }
}

/// Light from `low` to `high` nm, in tables or in rays.
fn range(name: &'static str, told: String, low: f64, high: f64) -> Check {
    if high < LIKELY_NM.0 || low > LIKELY_NM.1 {
        return wrong(name, told, "Columns are swapped or wavelengths are in another unit: export the file again.");
    }
    if low > FAR_NM && low < ANGSTROM_PER_NM * VISIBLE_NM.1 && high > ANGSTROM_PER_NM * VISIBLE_NM.0 {
        let told =
            format!("{told} Nothing of it is visible; in \u{c5} it were {:.1} to {:.1} nm.", low / 10.0, high / 10.0);
        return notice(
            name,
            told,
            "If wavelengths are in \u{c5}, declare the spectrum of its light, or export the file again.",
        );
    }
    if high < VISIBLE_NM.0 || low > VISIBLE_NM.1 {
        return notice(name, told, "Nothing of it is visible: expect no lumens, or export the file again if you do.");
    }
    ok(name, told)
}

fn plural(tables: usize) -> String {
    if tables == 1 { "One spectrum".to_owned() } else { format!("{tables} spectra") }
}

fn efficacy(facts: &Facts, found: &Inspection) -> Option<Check> {
    const NAME: &str = "rays.efficacy";
    let header = header_lm_per_w(facts)?;
    let spectrum = found.spectrum_lm_per_w?;
    let told = format!("The header's totals give {header:.1} lm/W, the spectrum gives {spectrum:.1} lm/W.");
    if (header - spectrum).abs() > EFFICACY_NOTICED * header.max(spectrum) {
        return Some(notice(
            NAME,
            told,
            "One of W, lm and spectrum is wrong: compare with the data sheet, declare flux.",
        ));
    }
    Some(ok(NAME, told))
}

fn directions(found: &Inspection) -> Check {
    const NAME: &str = "rays.directions";
    let worst = found.directions.worst_length_error;
    let repaired = found.directions.repaired;
    if repaired > 0 {
        let told = format!(
            "{repaired} directions were not of unit length and were normalised; the worst is off by {worst:.1e}."
        );
        return notice(NAME, told, "Nothing, unless it is many of few rays: then export the file with more digits.");
    }
    ok(NAME, format!("Directions are unit vectors; the worst is off by {worst:.1e}."))
}

fn order(found: &Inspection) -> Check {
    const NAME: &str = "rays.order";
    let Some(order) = &found.order else { return ok(NAME, "There are no rays.") };
    if !order.sorted {
        return ok(NAME, "Rays are in random order.");
    }
    let near = order.neighbors.as_ref().map(|s| format!("neighbours correlate by {:.2} in {}", s.value, s.quantity));
    let head =
        order.first_tenth.as_ref().map(|s| format!("the first tenth is off by {:.2} σ in {}", s.value, s.quantity));
    let told = [near, head].into_iter().flatten().collect::<Vec<_>>().join("; ");
    notice(
        NAME,
        format!("Rays are not in random order: {told}."),
        "Nothing here, where all rays are used. Programs that take only the first rays see another source: shuffle it for them.",
    )
}

fn ray_flux(found: &Inspection) -> Check {
    const NAME: &str = "rays.ray_flux";
    let Some(flux) = &found.ray_flux else { return ok(NAME, "There are no rays.") };
    let told = format!(
        "The brightest ray has {:.2e} of the flux; the file is as good as {:.0} rays of equal flux.",
        flux.largest_share, flux.effective_rays
    );
    let few = found.rays_used >= 1000 && flux.largest_share > LARGE_RAY;
    if few || flux.effective_rays < EVEN_RAYS * found.rays_used as f64 {
        return notice(
            NAME,
            told,
            "A few rays carry most of the light and will show as spots: ask for rays of equal flux.",
        );
    }
    ok(NAME, if flux.equal { "All rays carry the same flux.".to_owned() } else { told })
}

fn noise(found: &Inspection) -> Check {
    const NAME: &str = "rays.noise";
    let Some(noise) = &found.noise else { return ok(NAME, "There are no rays.") };
    let even = found.header.texts.iter().any(|text| text.value.contains(LOW_DISCREPANCY));
    let cells = noise.cells_at_5_percent.round();
    let is_drawn = found.header.texts.iter().any(|text| text.value.contains(DRAWN));
    let few = if cells < 1.0 {
        String::new()
    } else {
        format!("; one of {cells:.0} cell{} has 5 %", if cells > 1.0 { "s" } else { "" })
    };
    let told = format!(
        "A picture of 50 x 50 cells made of so many random rays has {:.1} % noise{few}.{}",
        100.0 * noise.of_2500_cells,
        if even { " These are of low discrepancy, as the header says, and have less." } else { "" }
    );
    if noise.of_2500_cells > NOISY {
        let remedy = match even {
            true => "Compare with rays of another seed, which tell how much less; or draw more.",
            false if is_drawn => "Draw more rays of the model (lampwright rays), or expect a coarse picture.",
            false => "Ask the vendor for more rays, or expect a coarse model.",
        };
        return notice(NAME, told, remedy);
    }
    ok(NAME, told)
}

fn focus(found: &Inspection) -> Check {
    const NAME: &str = "rays.focus";
    let Some(focus) = &found.focus else {
        let told = "The rays are collimated: they have no virtual focus.";
        return notice(NAME, told, "Nothing, if it is a beam; else the directions are wrong: export the file again.");
    };
    let [x, y, z] = focus.point_mm;
    ok(
        NAME,
        format!(
            "Virtual focus at ({x:.4}, {y:.4}, {z:.4}) mm ± {:.4}; 99 % of the flux passes within {:.4} mm of it.",
            focus.standard_error_mm, focus.distance_99_mm
        ),
    )
}

fn origins(found: &Inspection) -> Check {
    const NAME: &str = "rays.origins";
    let Some(origins) = &found.origins else { return ok(NAME, "There are no origins.") };
    let told = told(origins);
    let means = "Where the light comes from, the virtual focus tells. A surface made of these origins is right far away \
                 and blurred near the source; a job puts the light where it is sharper, if that predicts rays better \
                 (hull.emission = auto).";
    let Some(focus) = &found.focus else { return ok(NAME, told) };
    if found.median_origin_distance_mm > FAR * focus.distance_99_mm {
        let far = format!(
            "{told} They are {:.3} mm from the virtual focus (median), but the light passes it within {:.3} mm: they \
             lie on a distant receiver and are not the emitter.",
            found.median_origin_distance_mm, focus.distance_99_mm
        );
        return notice(NAME, far, means);
    }
    let depth = origins.plane.filter(|plane| plane.share >= MOVED).map_or(0.0, |plane| {
        (DVec3::from_array(plane.normal).dot(DVec3::from_array(focus.point_mm)) - plane.offset_mm).abs()
    });
    if depth > FOCUS_OFF_PLANE * focus.rms_distance_mm && depth > FOCUS_OFF_PLANE_SIGMA * focus.standard_error_mm {
        let sunk =
            format!("{told} The virtual focus is {depth:.4} mm off that plane: the origins are not the emitter.");
        return notice(NAME, sunk, means);
    }
    ok(NAME, told)
}

fn told(origins: &Origins) -> String {
    let about = if origins.exact { "" } else { "About " };
    let mut told = match origins.shape {
        "point" => "All rays start in one point.".to_owned(),
        "spread" => "Origins lie neither on a plane nor on a sphere nor on the faces of a box.".to_owned(),
        shape => format!("Origins lie on {}.", if shape == "box" { "the faces of a box" } else { shape_name(shape) }),
    };
    if let Some(plane) = origins.plane.filter(|plane| plane.share > 0.5) {
        told += &format!(" {about}{:.1} % are on one plane.", 100.0 * plane.share);
    }
    if let (Some(sphere), "sphere") = (origins.sphere, origins.shape) {
        let [x, y, z] = sphere.center_mm;
        told += &format!(" Its radius is {:.4} mm, its middle ({x:.4}, {y:.4}, {z:.4}) mm.", sphere.radius_mm);
    }
    told
}

fn shape_name(shape: &str) -> &'static str {
    if shape == "plane" { "a plane" } else { "a sphere" }
}

fn backward(found: &Inspection) -> Check {
    const NAME: &str = "rays.backward";
    let Some(main) = &found.main_direction else { return ok(NAME, "There is no light.") };
    let (axis, share) = (main.axis.name(), main.backward_share);
    if main.mean_cosine < DIRECTED {
        return ok(NAME, "The source shines into all directions or several: none of them is backward.");
    }
    let told = format!("The source shines along {axis}; {:.3} % of the flux go backward.", 100.0 * share);
    if share > BACKWARD {
        return notice(
            NAME,
            told,
            "Check that nothing is in the way there: a housing would block that light, a model does not.",
        );
    }
    ok(NAME, told)
}

fn beam(found: &Inspection) -> Check {
    const NAME: &str = "rays.beam";
    let Some(beam) = &found.beam else {
        return ok(NAME, "The light is in no one beam, or the rays are too few to tell.");
    };
    let round = beam.greatest_deg < 1.2 * beam.least_deg;
    let wide = if round { String::new() } else { format!(" by {:.3}", beam.greatest_deg) };
    let told = format!(
        "One beam holds {:.1} % of the flux, its faint sides included; where it has half of its greatest intensity, it is \
         {:.3}{wide}\u{b0} wide. A goniogram needs steps of {:.4}\u{b0} to show it.",
        100.0 * beam.share,
        beam.least_deg,
        beam.goniogram_step_deg
    );
    ok(NAME, told)
}

fn job(found: &Inspection) -> Check {
    let estimate = &found.job;
    let mb = |bytes: u64| (bytes as f64 / 1e6).round();
    let told = format!(
        "A job takes about {:.0} to {:.0} s of one core and {} to {} MB.",
        estimate.core_seconds.0.ceil(),
        estimate.core_seconds.1.ceil(),
        mb(estimate.memory_bytes.0),
        mb(estimate.memory_bytes.1)
    );
    ok("rays.job", told)
}
