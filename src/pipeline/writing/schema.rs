//! JSON Schemas (2020-12) of what is written, derived from the structs that are written. Their doc comments are the
//! descriptions, so those of written fields speak to whoever reads the file: `null`, not `None`.

use schemars::generate::SchemaSettings;
use schemars::transform::RecursiveTransform;
use schemars::{JsonSchema, Schema};
use serde_json::Value;

/// Pattern of a SHA-256: lower-case hexadecimal digits.
pub const SHA256: &str = "^[0-9a-f]{64}$";
/// The largest share there can be: 1, and what rounding may add.
pub const WHOLE: f64 = 1.000_001;

/// The schema of `T` as it is written, not as it would be read: what is not left out is required, `null` or not.
pub fn of<T: JsonSchema>() -> Value {
    let settings = SchemaSettings::draft2020_12().for_serialize().with_transform(RecursiveTransform(plain));
    settings.into_generator().into_root_schema_for::<T>().to_value()
}

/// Takes out what only concerns Rust: the width of numbers, and the line ends of comments.
fn plain(schema: &mut Schema) {
    schema.remove("format");
    if let Some(Value::String(description)) = schema.get_mut("description") {
        *description = description.replace('\n', " ");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// A pair,
    /// told over two lines.
    #[derive(JsonSchema)]
    #[expect(dead_code, reason = "only its shape is looked at")]
    struct Pair {
        /// Known or not.
        first: Option<f64>,
        #[serde(skip_serializing_if = "Option::is_none")]
        #[schemars(with = "u64")]
        second: Option<u64>,
    }

    #[test]
    fn null_is_told_from_what_is_left_out() {
        let schema = of::<Pair>();
        assert_eq!(schema["description"], "A pair, told over two lines.");
        assert_eq!(schema["required"], json!(["first"]));
        assert_eq!(schema["properties"]["first"]["type"], json!(["number", "null"]));
        assert_eq!(schema["properties"]["second"], json!({"type": "integer", "minimum": 0}));
    }
}
