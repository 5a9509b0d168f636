//! The published schemas are those of the structs that are written.
//! `LAMPWRIGHT_WRITE_SCHEMAS=1 cargo test --test pipeline schemas` writes them anew.

use std::path::Path;

#[test]
fn the_schemas_are_those_of_the_structs_that_are_written() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("openapi");
    for (name, schema) in
        pipeline::artifacts::schemas().into_iter().chain([("evaluation", pipeline::evaluation::schema())])
    {
        let file = folder.join(format!("{name}.schema.json"));
        let text = serde_json::to_string_pretty(&schema).unwrap() + "\n";
        if std::env::var_os("LAMPWRIGHT_WRITE_SCHEMAS").is_some() {
            std::fs::write(&file, &text).unwrap();
        }
        let published = std::fs::read_to_string(&file).unwrap();
        assert!(published == text, "{name} has changed: LAMPWRIGHT_WRITE_SCHEMAS=1 cargo test --test pipeline schemas");
        assert!(jsonschema::meta::is_valid(&schema), "{name} is no schema");
    }
}
