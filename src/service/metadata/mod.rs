//! The client's own metadata of its ray sets and jobs: the number of an order, a project, a part. The service stores it, returns
//! it in every answer and webhook message, and searches by it, but never acts on it.

/// Rows by which objects are found by their metadata.
pub mod rows;

use serde::{Deserialize, Deserializer, Serialize, de};
use std::collections::BTreeMap;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{AdditionalProperties, ObjectBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// Most keys of one thing.
pub const MOST_KEYS: usize = 16;
/// Longest key, characters, each of `A-Z a-z 0-9 _ . -`.
pub const MAX_KEY_CHARS: usize = 64;
/// Longest value, characters.
pub const MAX_VALUE_CHARS: usize = 512;
/// What a value is made of, as the contract has it: no control character of Unicode.
const NO_CONTROLS: &str = r"^[^\u0000-\u001f\u007f-\u009f]*$";
/// Most of all keys and values together, bytes.
pub const MOST_BYTES: usize = 4 << 10;

/// Keys and values of one ray set or job; within the bounds above, in the order of the keys.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "BTreeMap<String, String>")]
pub struct Metadata(BTreeMap<String, String>);

impl TryFrom<BTreeMap<String, String>> for Metadata {
    type Error = String;

    /// An exceeded limit is reported as one sentence about the whole metadata.
    fn try_from(pairs: BTreeMap<String, String>) -> Result<Metadata, String> {
        if pairs.len() > MOST_KEYS {
            return Err(format!("the metadata has {} keys, expected at most {MOST_KEYS}", pairs.len()));
        }
        for (key, value) in &pairs {
            let plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'.' | b'-');
            if key.is_empty() || key.len() > MAX_KEY_CHARS || !key.bytes().all(plain) {
                let shown: String = key.chars().take(MAX_KEY_CHARS).collect();
                return Err(format!("the key {shown:?}, expected 1 to {MAX_KEY_CHARS} of A-Z, a-z, 0-9, _, . and -"));
            }
            if value.chars().count() > MAX_VALUE_CHARS || value.chars().any(char::is_control) {
                return Err(format!(
                    "the value of {key:?}, expected at most {MAX_VALUE_CHARS} characters, none of them a control character"
                ));
            }
        }
        let byte_count: usize = pairs.iter().map(|(key, value)| key.len() + value.len()).sum();
        if byte_count > MOST_BYTES {
            return Err(format!("the metadata has {byte_count} bytes, expected at most {MOST_BYTES}"));
        }
        Ok(Metadata(pairs))
    }
}

impl Metadata {
    /// Nothing is said.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// As it is stored: a JSON object, of which equal metadata have the same text.
    ///
    /// # Errors
    /// Never in practice: texts can be written.
    pub fn json(&self) -> serde_json::Result<String> {
        serde_json::to_string(self)
    }

    /// Each key with its value as one text, which no other key and value have: a key holds no `=`.
    pub fn pairs(&self) -> impl Iterator<Item = String> {
        self.0.iter().map(|(key, value)| format!("{key}={value}"))
    }

    /// Reads the JSON object that stands as a text in a query or in `Upload-Metadata`.
    ///
    /// # Errors
    /// No JSON object of texts, or one that breaks a bound.
    pub fn from_text<'de, D: Deserializer<'de>>(text: D) -> Result<Metadata, D::Error> {
        let text = String::deserialize(text)?;
        let wrong = |error: serde_json::Error| {
            let found = error.to_string();
            let found = found.split(" at line ").next().unwrap_or_default();
            de::Error::custom(format!("{found}; expected a JSON object of strings, as {{\"order\":\"4711\"}}"))
        };
        serde_json::from_str(&text).map_err(wrong)
    }
}

impl PartialSchema for Metadata {
    fn schema() -> RefOr<Schema> {
        let text = |object: ObjectBuilder| object.schema_type(Type::String);
        let key = text(ObjectBuilder::new()).pattern(Some(format!("^[A-Za-z0-9_.-]{{1,{MAX_KEY_CHARS}}}$"))).build();
        let value = text(ObjectBuilder::new()).max_length(Some(MAX_VALUE_CHARS)).pattern(Some(NO_CONTROLS)).build();
        let object = ObjectBuilder::new()
            .schema_type(Type::Object)
            .description(Some(format!(
                "The client's own metadata: at most {MOST_KEYS} keys and {MOST_BYTES} bytes in all. The service stores it, returns it and searches by it, but never acts on it."
            )))
            .max_properties(Some(MOST_KEYS))
            .property_names(Some(key))
            .additional_properties(Some(AdditionalProperties::RefOr(RefOr::T(value.into()))))
            .examples([serde_json::json!({"order": "4711"})]);
        RefOr::T(Schema::Object(object.build()))
    }
}

impl ToSchema for Metadata {}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Metadata, String> {
        Metadata::from_text(serde_json::Value::String(text.to_owned())).map_err(|error| error.to_string())
    }

    #[test]
    fn metadata_is_a_bounded_object_of_texts() {
        let order = read(r#"{"order":"4711","a.b_c-D9":"Grün, \"50\" %"}"#).unwrap();
        assert_eq!(order.json().unwrap(), r#"{"a.b_c-D9":"Grün, \"50\" %","order":"4711"}"#);
        assert_eq!(order.pairs().collect::<Vec<_>>(), ["a.b_c-D9=Grün, \"50\" %", "order=4711"]);
        assert!(read("{}").unwrap().is_empty());
        let object = |keys: usize, key: usize, value: usize| {
            let pair = |k: usize| format!("\"{k:0>key$}\":\"{}\"", "é".repeat(value));
            format!("{{{}}}", (0..keys).map(pair).collect::<Vec<_>>().join(","))
        };
        assert!(read(&object(16, 64, 96)).is_ok());
        assert!(read(&object(1, 1, 512)).is_ok());
        for wrong in [
            object(17, 2, 1),
            object(1, 65, 1),
            object(1, 1, 513),
            object(16, 64, 97),
            r#"{"":"a"}"#.into(),
            r#"{"a b":"a"}"#.into(),
            r#"{"ä":"a"}"#.into(),
            r#"{"a":1}"#.into(),
            r#"{"a":null}"#.into(),
            r#"{"a":"\u0000"}"#.into(),
            r#"{"a":"\u001b"}"#.into(),
            "[]".into(),
            "order".into(),
            String::new(),
        ] {
            assert!(read(&wrong).is_err(), "{wrong}");
        }
    }
}
