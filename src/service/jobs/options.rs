//! What a client may choose, in the contract: the schema is the pipeline's own, its parts are components.

use pipeline::Options;
use serde_json::{Map, Value, json};
use std::borrow::Cow;
use utoipa::openapi::{RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

/// The options of a job as the contract calls them: [`Options`], of which every field may be null or left out.
pub struct JobOptions;

impl PartialSchema for JobOptions {
    fn schema() -> RefOr<Schema> {
        let mut schema = Options::schema().to_value();
        for_the_contract(&mut schema);
        component(schema)
    }
}

impl ToSchema for JobOptions {
    fn name() -> Cow<'static, str> {
        "JobOptions".into()
    }

    fn schemas(components: &mut Vec<(String, RefOr<Schema>)>) {
        let mut parts = Options::schema().to_value()["$defs"].take();
        for (name, part) in parts.as_object_mut().into_iter().flatten() {
            for_the_contract(part);
            components.push((name.clone(), component(part.take())));
        }
    }
}

fn component(schema: Value) -> RefOr<Schema> {
    serde_json::from_value(schema).unwrap_or_else(|_| RefOr::T(Schema::default()))
}

/// Words of JSON Schema as the contract has them: references to components, `oneOf` for a choice, `enum` for constants, and null
/// for what may be left out.
fn for_the_contract(schema: &mut Value) {
    match schema {
        Value::Object(words) => {
            for word in ["$schema", "$defs", "title", "default"] {
                words.remove(word);
            }
            if let Some(Value::String(reference)) = words.get_mut("$ref") {
                *reference = reference.replace("#/$defs/", "#/components/schemas/");
            }
            if let Some(choices) = words.remove("anyOf") {
                words.insert("oneOf".to_owned(), choices);
            }
            constants(words);
            words.values_mut().for_each(for_the_contract);
            let required = words.get("required").cloned().unwrap_or_default();
            for (name, property) in words.get_mut("properties").and_then(Value::as_object_mut).into_iter().flatten() {
                let is_required = required.as_array().is_some_and(|names| names.contains(&json!(name)));
                if !is_required && property.get("$ref").is_some() {
                    *property = json!({ "oneOf": [property.take(), { "type": "null" }] });
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(for_the_contract),
        _ => {}
    }
}

/// A choice between constants is a list of them; what each means stands in the description.
fn constants(words: &mut Map<String, Value>) {
    let Some(choices) = words.get("oneOf").and_then(Value::as_array) else { return };
    let Some(values) = choices.iter().map(|choice| choice["const"].as_str()).collect::<Option<Vec<_>>>() else {
        return;
    };
    let meanings = choices.iter().zip(&values).filter_map(|(choice, value)| {
        let meaning = choice["description"].as_str()?;
        Some(format!("{value}: {meaning}"))
    });
    let description = words.get("description").and_then(Value::as_str).map(str::to_owned);
    let description = description.into_iter().chain(meanings).collect::<Vec<_>>().join("\n\n");
    let values = json!(values);
    words.remove("oneOf");
    words.insert("type".to_owned(), json!("string"));
    words.insert("enum".to_owned(), values);
    words.insert("description".to_owned(), json!(description));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_contract_has_every_option_and_what_it_may_be() {
        let schema = serde_json::to_value(JobOptions::schema()).unwrap();
        assert_eq!(schema["additionalProperties"], json!(false));
        let mut parts = Vec::new();
        JobOptions::schemas(&mut parts);
        let part = |name: &str| {
            let (_, part) = parts.iter().find(|(known, _)| known == name).unwrap();
            serde_json::to_value(part).unwrap()
        };
        let hull = part("HullOptions");
        assert_eq!(hull["properties"]["resolution"]["type"], json!(["integer", "null"]));
        assert_eq!(hull["properties"]["resolution"]["maximum"], json!(256));
        assert_eq!(part("IesEdition")["enum"], json!(["LM-63-2002", "LM-63-2019"]));
        for group in ["rays", "hull", "flux", "goniogram", "artifacts"] {
            assert!(schema["properties"][group]["oneOf"][0]["$ref"].is_string(), "{group}: {schema}");
        }
    }
}
