//! `README.txt` of the zip: frame, units, counts, what each file is.

use super::provenance::{generator, source_name};
use crate::model::Model;
use crate::model::ancestor::Ancestor;
use crate::model::study::Study;
use crate::vocabulary::notice::Notice;
use crate::vocabulary::space::Axis;
use crate::writing::Artifact;
use crate::writing::number::{sum, text};
use glam::{DMat3, DQuat, DVec3};

/// What each file is, by the beginning of its name.
const MEANINGS: [(&str, &str); 12] = [
    (
        "emitter.glb",
        "the surface, and the volume where there is one: glTF 2.0 binary, metres, Y up; flux, spectra and zones of every vertex",
    ),
    ("goniograms.json", "the angles: intensity of every zone and of the whole source, with spectra"),
    (
        "ies/",
        "the same luminous intensities as IES LM-63 and EULUMDAT: of the whole, and of each zone, of many zones the brightest",
    ),
    ("total.tm33.xml", "the whole source by ANSI/IES TM-33-23: luminous, radiant and spectral intensities"),
    ("source.gldf", "for DIALux and Relux: the surface as a body (L3D), its zones as light-emitting objects"),
    ("spectra.csv", "spectral flux of the whole source and of each zone, W/nm"),
    ("plots/polar", "polar curves"),
    ("plots/zones", "where the zones lie"),
    ("plots/hull", "the surface, coloured by how its triangles came to be and by exitance"),
    ("plots/volume", "the volume, by how much light leaves along each line of sight"),
    ("plots/quality", "the errors of the model and of the rays themselves in several views"),
    ("report.json", "what was read, what was done, where every ray went, what to be careful about"),
];

/// Longest line of a notice, in characters, unless a single word is longer.
const LINE_CHARS: usize = 100;
/// Most characters of a notice: a channel's name and foreign texts are part of it.
const NOTICE_CHARS: usize = 2000;

/// Where the light was put, and how good the model is.
fn proof(study: &Study) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(surface) = study.surface() {
        let tried = match study.candidates.len() {
            1 => String::new(),
            count => format!("; it predicts rays best of {count} places"),
        };
        lines.push(format!("The light is put {surface}{tried}."));
        lines.push(String::new());
    }
    if !study.figures.is_empty() {
        lines.push(format!("A model like this one, made of {} of the rays, was compared with", study.training_rays));
        lines.push(format!("{} other rays. Its root mean square error, and that of its own rays:", study.judging_rays));
        lines.extend(study.figures.iter().map(|figure| format!("    {:<20} {figure}", figure.view.to_string())));
        lines.push(String::new());
    }
    lines
}

/// The models of a combination, and what was changed of each.
fn models(model: &Model) -> Vec<String> {
    let triple = |vector: DVec3| vector.to_array().map(|part| text(sum(part), 6)).join(", ");
    let change = |(at, ancestor): (usize, &Ancestor)| {
        let mut words = vec![format!("flux times {}", text(ancestor.factor, 6))];
        if ancestor.spectrum.is_some() {
            words.insert(0, "given a spectrum".to_owned());
        }
        let (axis, angle) = DQuat::from_mat3(&ancestor.turn).to_axis_angle();
        if ancestor.turn != DMat3::IDENTITY {
            words.push(format!("turned by {} degrees about ({})", text(angle.to_degrees(), 6), triple(axis)));
        }
        if ancestor.move_mm != DVec3::ZERO {
            words.push(format!("moved by ({}) mm", triple(ancestor.move_mm)));
        }
        let heading = if at == 0 { "Models   " } else { "         " };
        format!("{heading}{}: {}", crate::writing::svg::one_line(&ancestor.name, 100), words.join(", "))
    };
    model.ancestors.iter().enumerate().map(change).collect()
}

/// The page; `notices` are those of writing the other artifacts, `names` are all other files of the zip.
pub fn artifact(model: &Model, notices: &[Notice], names: &[&str]) -> Artifact {
    let goniograms = &model.goniograms;
    let frame = &goniograms.frame;
    let flux = |value: Option<f64>, unit: &str| value.map(|value| format!("{} {unit}", text(value, 6)));
    let fluxes: Vec<String> =
        [flux(model.flux.luminous_lm, "lm"), flux(model.flux.radiant_w, "W")].into_iter().flatten().collect();
    let used: u64 = model.origins.iter().map(|origin| origin.rays_used).sum();
    let size = model.hull.bounds_mm().size().to_array().map(|edge| text(edge, 4));
    let mut lines = vec![
        format!("Light source model of {}", crate::writing::svg::one_line(&source_name(model), 200)),
        format!("made by {}; report.json has inputs, options and checks", generator()),
        String::new(),
        format!("Flux     {}", fluxes.join(", ")),
        format!("Rays     {used}"),
        format!("Surface  {} vertices, {} triangles", model.hull.vertices_mm.len(), model.hull.triangles.len()),
        format!("         box {} mm", size.join(" x ")),
        match &goniograms.lattice {
            Some(lattice) => {
                format!("Zones    {} of a {} x {} lattice", goniograms.zones.len(), lattice.columns, lattice.rows)
            }
            None => format!("Zones    {} along the surface", goniograms.zones.len()),
        },
        String::new(),
        "Frame    the ray file's own axes, right-handed, mm".to_owned(),
        format!(
            "         gamma 0 = {}, C0 = {}, C90 = {}",
            frame.nadir.name(),
            frame.c0.name(),
            Axis::nearest(frame.y()).name()
        ),
        "         C = 0..360 counter-clockwise seen from gamma 180 (IES type C)".to_owned(),
        "         emitter.glb: (x, z, -y)/1000 of it, metres, Y up".to_owned(),
        "Units    in every key and column name; lm = 683 V(lambda) W, CIE 1924".to_owned(),
        String::new(),
    ];
    lines.splice(3..3, models(model));
    if let Some(volume) = &model.volume {
        lines.extend([
            format!(
                "The light is put in a volume ({} nodes, the points of emitter.glb), and that is the model:",
                volume.nodes.len()
            ),
            "    L = q(w; lambda) times the integral of j(s, lambda) ds along the line".to_owned(),
            "j is a node's flux over its volume, trilinear between nodes; q the normalised total goniogram.".to_owned(),
            "For programs that know only surfaces the same light is on the surface, nearly as it is seen from afar."
                .to_owned(),
        ]);
    }
    lines.extend([
        "Radiance of a surface point x in direction w at wavelength lambda:".to_owned(),
        "    L = M(x, lambda) q(w; x, lambda) / |cos theta|".to_owned(),
        "M is the interpolated exitance (emitter.glb), q the zone's normalised goniogram (goniograms.json).".to_owned(),
    ]);
    lines.push(String::new());
    if let Some(study) = &model.study {
        lines.extend(proof(study));
    }
    for (beginning, meaning) in MEANINGS {
        let count = names.iter().filter(|name| name.starts_with(beginning)).count();
        if count > 0 {
            let files = if count > 1 { format!("{beginning}* ({count})") } else { beginning.to_owned() };
            lines.push(format!("{files:<22} {meaning}"));
        }
    }
    lines.extend(careful(model, notices));
    lines.push(String::new());
    Artifact {
        name: "README.txt".to_owned(),
        media_type: "text/plain; charset=utf-8",
        bytes: lines.join("\r\n").into_bytes(),
    }
}

/// Everything noticed, a paragraph each, under a heading; nothing where nothing was.
fn careful(model: &Model, notices: &[Notice]) -> Vec<String> {
    let mut lines = Vec::new();
    for notice in model.notices.iter().chain(notices) {
        if lines.is_empty() {
            lines.extend([String::new(), "Be careful (notices in report.json):".to_owned()]);
        }
        let channel = notice.channel.as_ref().filter(|_| model.origins.len() > 1);
        let of = channel.map_or(String::new(), |name| format!(", {name}"));
        let times = if notice.count > 1 { format!(" ({} times)", notice.count) } else { String::new() };
        let told = format!("{}{of}{times}: {}", notice.code, notice.message);
        lines.extend(wrapped(&crate::writing::svg::one_line(&told, NOTICE_CHARS)));
    }
    lines
}

/// A paragraph of lines of at most [`LINE_CHARS`] characters, indented, the first with a dash.
fn wrapped(text: &str) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= LINE_CHARS => {
                line.push(' ');
                line.push_str(word);
            }
            Some(_) => lines.push(format!("  {word}")),
            None => lines.push(format!("- {word}")),
        }
    }
    lines
}
