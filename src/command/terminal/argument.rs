//! Values that several verbs read from their arguments. The error is what clap prints after the value.

use pipeline::evaluation::Vector;
use pipeline::vocabulary::space::Axis;
use pipeline::vocabulary::spectrum::Bands;
use pipeline::{Options, Place};
use serde_json::Value;

/// What can be said of a ray file behind a comma, and how it is written: the keys of `channel_argument`, in their order.
const KEYS: [(&str, &str); 6] = [
    ("length_unit", "length_unit=mm"),
    ("quantity", "quantity=lm"),
    ("columns", "columns=x:y:z:l:m:n:flux"),
    ("spectrum", "spectrum=FILE"),
    ("flux", "flux=1.2W"),
    ("share", "share=0.636W"),
];

/// The flag of an option of the pipeline or of a field of an evaluation, without dashes: `max_edge_mm` is --max-edge, `nadir_axis` is
/// --nadir, `band_edges_nm` is --bands, `plane.center_mm` is --center.
pub fn flag(name: &str) -> String {
    let last = name.rsplit('.').next().unwrap_or(name);
    let short =
        ["_mm", "_deg", "_nm", "_axis"].into_iter().fold(last, |name, end| name.strip_suffix(end).unwrap_or(name));
    match short {
        "band_edges" => "bands".to_owned(),
        "angles" => "at".to_owned(),
        "directions" => "direction".to_owned(),
        short => short.replace('_', "-"),
    }
}

/// What the command line calls the place of a fault: a flag, or a key behind a file or a model.
pub fn place(place: &Place) -> String {
    match place {
        // How many new rays: a parameter over HTTP.
        Place::Option("count") => "--rays".to_owned(),
        Place::Option(name) => format!("--{}", flag(name)),
        Place::Channel(index, "flux") => format!("flux= or share= of file {}", index + 1),
        Place::Channel(index, field) => format!("{field}= of file {}", index + 1),
        Place::Total => "--total".to_owned(),
        Place::Asked("models") => "MODEL".to_owned(),
        Place::Model(index, field) => {
            let key = match *field {
                "turns" => "turn",
                "move_mm" => "move",
                field => field,
            };
            format!("{key}= of model {}", index + 1)
        }
        Place::Asked(field) => format!("--{}", flag(field)),
        Place::Byte(_) | Place::Ray(_) | Place::Declared(_) => place.to_string(),
    }
}

/// The pipeline's sentence in the words of the command line: `hull.emission = paper` is `--emission paper`, `c0_axis` is --c0.
pub fn in_flags(text: &str) -> String {
    let options = Options::schema().to_value();
    let names = |group: &Value| {
        let reference = group["$ref"].as_str().unwrap_or_default().trim_start_matches('#').to_owned();
        let fields = options.pointer(&reference).and_then(|group| group["properties"].as_object());
        fields.into_iter().flat_map(|fields| fields.keys().cloned()).collect::<Vec<String>>()
    };
    let mut told = text.to_owned();
    for (group, fields) in options["properties"].as_object().into_iter().flatten() {
        for name in names(fields) {
            let flag = format!("--{}", flag(&name));
            told = replaced(&told, &format!("{group}.{name}"), &flag);
            // A name without this mark is a word of the language.
            if name.contains('_') {
                told = replaced(&told, &name, &flag);
            }
        }
    }
    told
}

/// `text` with `flag` where `name` stands alone, and without the sign of equality behind it.
fn replaced(text: &str, name: &str, flag: &str) -> String {
    let (mut told, mut rest) = (String::new(), text);
    while let Some(at) = rest.find(name) {
        let (before, after) = rest.split_at(at);
        let after = &after[name.len()..];
        let is_part = |letter: char| letter.is_ascii_alphanumeric() || letter == '_' || letter == '-';
        let is_alone = !before.ends_with(|letter: char| is_part(letter) || letter == '.')
            && !after.starts_with(is_part)
            && !after.strip_prefix('.').is_some_and(|next| next.starts_with(is_part));
        told.push_str(before);
        told.push_str(if is_alone { flag } else { name });
        rest = after.strip_prefix(" = ").filter(|_| is_alone).map_or(after, |value| {
            told.push(' ');
            value
        });
    }
    told + rest
}

/// A remedy that asks for a declaration, with how the command line takes it: what its sentences name behind "declare", else the field
/// in which the fault is.
pub fn with_keys(remedy: &str, at: Option<&Place>) -> String {
    let text = remedy.replace('_', " ");
    let asked: Vec<&str> = text
        .match_indices("eclare ")
        .filter_map(|(from, word)| text.get(from + word.len()..)?.split(['.', ':', ';', ',', '(']).next())
        .collect();
    let names = |key: &str| {
        let name = key.replace('_', " ");
        asked.iter().any(|asked| asked.contains(name.trim_end_matches('s')))
    };
    let mut written: Vec<&str> = KEYS.iter().filter(|(key, _)| names(key)).map(|(_, example)| *example).collect();
    // A file has a flux of its own or a share of the total, not both.
    if names("share") {
        written.retain(|example| !example.starts_with("flux="));
    }
    let mends = !text.contains("no declaration mends");
    if let (true, true, Some(Place::Channel(_, field))) = (mends, written.is_empty(), at) {
        written.extend(KEYS.iter().filter(|(key, _)| key == field).map(|(_, example)| *example));
    }
    // The examples are in the quantity that is spoken of.
    let spoken = |example: &'static str| match example {
        "quantity=lm" if text.contains("(in W)") => "quantity=W",
        "flux=1.2W" if text.contains("(in lm)") => "flux=337lm",
        example => example,
    };
    written.iter_mut().for_each(|example| *example = spoken(example));
    let total = if text.contains("total in W") { " The total is written as --total 98lm." } else { "" };
    if written.is_empty() {
        return format!("{remedy}{total}");
    }
    format!("{remedy} Write it behind the file, as FILE,{}.{total}", written.join(","))
}

/// `+Z`.
pub fn axis(text: &str) -> Result<Axis, String> {
    Axis::parse(text).ok_or_else(|| "write one of +X -X +Y -Y +Z -Z".to_owned())
}

/// `380:780:10`: first and last edge and step, nm.
pub fn bands(text: &str) -> Result<Bands, String> {
    let numbers: Option<Vec<f64>> = text.split(':').map(|part| part.parse().ok()).collect();
    let bands = match numbers.as_deref() {
        Some(&[min_nm, max_nm, step_nm]) => Bands::regular(min_nm, max_nm, step_nm),
        _ => None,
    };
    bands.ok_or_else(|| "write first:last:step in nm, as 380:780:10".to_owned())
}

/// `0,0,1.5`: three numbers.
pub fn vector(text: &str) -> Result<Vector, String> {
    numbers::<3>(text).map(Vector::from_array).ok_or_else(|| "write three numbers, as 0,0,1.5".to_owned())
}

/// A direction: `+Z`, or three numbers.
pub fn direction(text: &str) -> Result<Vector, String> {
    match Axis::parse(text.trim()) {
        Some(axis) => Ok(axis.vector()),
        None => vector(text).map_err(|_| "write an axis, as +Z, or three numbers, as 0,0,1".to_owned()),
    }
}

/// `90,45`: two numbers.
pub fn pair(text: &str) -> Result<[f64; 2], String> {
    numbers::<2>(text).ok_or_else(|| "write two numbers, as 90,45".to_owned())
}

fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_called_by_what_the_command_line_has() {
        for (found, expected) in [
            (Place::Option("hull.max_edge_mm"), "--max-edge"),
            (Place::Option("rays.band_edges_nm"), "--bands"),
            (Place::Asked("view.plane.center_mm"), "--center"),
            (Place::Asked("view.angles"), "--at"),
            (Place::Asked("view.grid.c_step_deg"), "--c-step"),
            (Place::Model(0, "move_mm"), "move= of model 1"),
            (Place::Channel(1, "length_unit"), "length_unit= of file 2"),
            (Place::Total, "--total"),
            (Place::Byte(7), "byte 7"),
        ] {
            assert_eq!(place(&found), expected);
        }
    }

    #[test]
    fn directions_are_axes_or_numbers() {
        for (text, expected) in [("+Z", Vector::Z), ("-X", Vector::NEG_X), ("0, 1,-0.5", Vector::new(0.0, 1.0, -0.5))] {
            assert_eq!(direction(text), Ok(expected), "{text}");
        }
        assert!(
            ["", "Q", "+Z,1", "1,2"]
                .iter()
                .all(|text| direction(text).is_err_and(|told| told.contains("three numbers")))
        );
        assert!(vector("+Z").is_err(), "a place is no direction");
    }

    #[test]
    fn options_are_told_as_flags() {
        for (text, told) in [
            ("Choose a c0_axis at right angles to nadir_axis.", "Choose a --c0 at right angles to --nadir."),
            ("predicts rays better (hull.emission = auto).", "predicts rays better (--emission auto)."),
            ("Build with a lower hull.resolution or wider bands.", "Build with a lower --resolution or wider bands."),
            ("Choose a larger hull.max_edge_mm, or leave it out.", "Choose a larger --max-edge, or leave it out."),
            ("The file my_max_edge_mm.txt and the zones.", "The file my_max_edge_mm.txt and the zones."),
        ] {
            assert_eq!(in_flags(text), told);
        }
    }

    #[test]
    fn a_declaration_that_is_asked_for_is_told_as_it_is_written() {
        for (remedy, at, expected) in [
            ("Declare its length unit: mm or m.", None, "FILE,length_unit=mm."),
            ("Compare the size; declare length_unit as m.", None, "FILE,length_unit=mm."),
            ("Declare its quantity, radiant or luminous, or its flux.", None, "FILE,quantity=lm."),
            ("Declare what each column holds: x, flux.", None, "FILE,columns=x:y:z:l:m:n:flux."),
            (
                "Declare its flux: equal shares. Or declare the column.",
                None,
                "FILE,columns=x:y:z:l:m:n:flux,flux=1.2W.",
            ),
            ("Declare the quantity and the flux (in lm).", None, "FILE,quantity=lm,flux=337lm."),
            ("Declare the quantity and the flux (in W).", None, "FILE,quantity=W,flux=1.2W."),
            // Both behind one file are refused.
            ("Declare the share of every channel, or declare fluxes.", None, "FILE,share=0.636W."),
            ("Declare a positive number.", Some(Place::Channel(0, "flux")), "FILE,flux=1.2W."),
            (
                "Give the total in W.",
                Some(Place::Channel(0, "flux")),
                "FILE,flux=1.2W. The total is written as --total 98lm.",
            ),
        ] {
            let told = with_keys(remedy, at.as_ref());
            assert_eq!(told, format!("{remedy} Write it behind the file, as {expected}"));
        }
        let none = "Export the file with direction cosines; no declaration mends it.";
        assert_eq!(with_keys(none, Some(&Place::Channel(0, "columns"))), none);
        for other in ["Export the file again, with its spectrum.", "Declare a positive number."] {
            assert_eq!(with_keys(other, Some(&Place::Total)), other);
        }
    }
}
