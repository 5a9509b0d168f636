//! What serde says of a value of the wrong shape, in words of JSON.

/// What serde says, without a value: of numbers and words in a query, whose types are Rust's.
const SAID: [(&str, &str); 6] = [
    ("invalid digit found in string", "It is no whole number of 0 or more"),
    ("cannot parse integer from empty string", "It is empty; a whole number is expected"),
    ("number too large to fit in target type", "The number is too large"),
    ("invalid float literal", "It is no number"),
    ("cannot parse float from empty string", "It is empty; a number is expected"),
    ("provided string was not `true` or `false`", "It is neither true nor false"),
];

/// Kinds of values, as serde calls them and as JSON does.
const KINDS: [(&str, &str); 21] = [
    ("a map", "an object"),
    ("map", "an object"),
    ("a sequence", "a list"),
    ("sequence", "a list"),
    ("unit value", "null"),
    ("null", "null"),
    ("string or map", "a name or an object"),
    ("boolean ", "the value "),
    ("integer ", "the number "),
    ("floating point ", "the number "),
    ("string ", "the string "),
    ("a boolean", "true or false"),
    ("struct ", "an object"),
    ("u8", "a whole number of 0 or more"),
    ("u16", "a whole number of 0 or more"),
    ("u32", "a whole number of 0 or more"),
    ("u64", "a whole number of 0 or more"),
    ("usize", "a whole number of 0 or more"),
    ("i64", "a whole number"),
    ("f32", "a number"),
    ("f64", "a number"),
];

/// The sentence of serde as one that names no type of Rust; one that is of another form is told as it is.
pub(super) fn plainly(found: &str) -> String {
    if let Some((_, told)) = SAID.iter().find(|(said, _)| *said == found) {
        return format!("{told}.");
    }
    let parts = |start: &str| found.strip_prefix(start).and_then(|rest| rest.rsplit_once(", expected "));
    if let Some((kind, expected)) = parts("invalid type: ").or_else(|| parts("invalid value: ")) {
        return format!("It is {}; {} is expected.", in_json(kind), in_json(expected));
    }
    if found.starts_with("UUID parsing failed") {
        return "It is no identifier.".to_owned();
    }
    if let Some((count, expected)) = parts("invalid length ") {
        if expected.starts_with("struct ") {
            return "It is a list; an object is expected.".to_owned();
        }
        if let Some(expected) = expected.strip_prefix("an array of length ") {
            return format!("It has {count} entries; {expected} are expected.");
        }
        return format!("Its length is {count}; {} is expected.", in_json(expected));
    }
    if let Some((name, expected)) = parts("unknown variant ") {
        return format!("It is {name}; {expected} is expected.");
    }
    let mut letters = found.chars();
    let first = letters.next().map(|letter| letter.to_uppercase().to_string()).unwrap_or_default();
    format!("{first}{}.", letters.as_str())
}

/// A kind of value; what stands behind its name stays, but for the name of a type.
fn in_json(kind: &str) -> String {
    let known = |name: &str| match name.ends_with(' ') {
        true => kind.starts_with(name),
        false => kind == name,
    };
    match KINDS.iter().find(|(name, _)| known(name)) {
        Some(("struct ", told)) => (*told).to_owned(),
        Some((name, told)) => format!("{told}{}", kind.get(name.len()..).unwrap_or_default()),
        None => kind.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;
    use serde_json::{Value, json};

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "what serde says is looked at, not what it reads")]
    struct Shape {
        count: Option<u32>,
        size: Option<f64>,
        place: Option<[f64; 3]>,
        name: Option<String>,
        inner: Option<Box<Shape>>,
        list: Option<Vec<u8>>,
        is_lit: Option<bool>,
        kind: Option<Kind>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Kind {
        Round,
        Square,
    }

    /// What serde itself says of each, so that other words of a later version are noticed.
    #[test]
    fn sentences_name_no_type_of_rust() {
        let told = |value: Value| plainly(&serde_json::from_value::<Shape>(value).unwrap_err().to_string());
        for (value, expected) in [
            (json!({"count": -1}), "It is the number `-1`; a whole number of 0 or more is expected."),
            (json!({"count": 1.5}), "It is the number `1.5`; a whole number of 0 or more is expected."),
            (
                json!({"count": "1, expected u32"}),
                "It is the string \"1, expected u32\"; a whole number of 0 or more is expected.",
            ),
            (json!({"size": []}), "It is a list; a number is expected."),
            (json!({"place": [0, 0]}), "It has 2 entries; 3 are expected."),
            (json!({"name": {}}), "It is an object; a string is expected."),
            (json!([]), "It is a list; an object is expected."),
            (json!({"inner": []}), "It is a list; an object is expected."),
            (json!({"inner": 5}), "It is the number `5`; an object is expected."),
            (json!({"list": [null]}), "It is null; a whole number of 0 or more is expected."),
            (json!({"is_lit": "yes"}), "It is the string \"yes\"; true or false is expected."),
            (json!({"kind": 5}), "It is the number `5`; a name or an object is expected."),
            (json!({"kind": "oval"}), "It is `oval`; `round` or `square` is expected."),
        ] {
            assert_eq!(told(value), expected);
        }
        assert!(told(json!({"colour": 1})).starts_with("Unknown field `colour`, expected one of `count`, "));
        assert_eq!(plainly(&"-1".parse::<u32>().unwrap_err().to_string()), "It is no whole number of 0 or more.");
        assert_eq!(plainly(&"".parse::<u32>().unwrap_err().to_string()), "It is empty; a whole number is expected.");
        assert_eq!(
            plainly(&serde_json::from_value::<uuid::Uuid>(json!("abc")).unwrap_err().to_string()),
            "It is no identifier."
        );
        assert_eq!(plainly(&"x".parse::<f64>().unwrap_err().to_string()), "It is no number.");
        assert_eq!(plainly(&"maybe".parse::<bool>().unwrap_err().to_string()), "It is neither true nor false.");
        assert_eq!(plainly(&"4294967296".parse::<u32>().unwrap_err().to_string()), "The number is too large.");
    }
}
