//! What the contract says of every route, and what no derive can say.

use utoipa::openapi::path::{Operation, Paths};
use utoipa::openapi::path::{Parameter, ParameterIn};
use utoipa::openapi::schema::{AdditionalProperties, Object, SchemaType, Type};
use utoipa::openapi::{ContentBuilder, OpenApi, Ref, RefOr, ResponseBuilder, Schema};

/// Completes what was collected from the routes.
pub fn complete(contract: &mut OpenApi) {
    for operation in operations(&mut contract.paths) {
        let mut in_path = false;
        for parameter in operation.parameters.iter_mut().flatten() {
            let RefOr::T(parameter) = parameter else { continue };
            in_path |= parameter.parameter_in == ParameterIn::Path;
            without_null(parameter);
        }
        if in_path {
            can_fail(operation, "400", "the path is not valid UTF-8, or the request does not have exactly one Host");
        }
        can_fail(operation, "400", "the request does not have exactly one Host");
        can_fail(operation, "500", "the service failed because of an error in the service itself");
    }
    for (name, schema) in contract.components.iter_mut().flat_map(|components| components.schemas.iter_mut()) {
        match schema {
            RefOr::T(Schema::OneOf(choice)) => choice.items.iter_mut().for_each(|kind| one_key(name, kind)),
            RefOr::T(Schema::Object(object)) => object.properties.values_mut().for_each(without_empty_default),
            _ => {}
        }
    }
    // What the router marks as a wildcard is a path parameter like any other in OpenAPI.
    let paths = std::mem::take(&mut contract.paths.paths);
    contract.paths.paths = paths.into_iter().map(|(path, item)| (path.replace("{*", "{"), item)).collect();
}

/// Says that an operation may answer `status` with a problem, unless it has said when itself.
pub fn can_fail(operation: &mut Operation, status: &str, when: &str) {
    let problem = ContentBuilder::new().schema(Some(Ref::from_schema_name("Problem"))).build();
    let response = ResponseBuilder::new().description(when).content("application/problem+json", problem);
    operation.responses.responses.entry(status.to_owned()).or_insert_with(|| response.build().into());
}

/// What may be left out of an address or a head cannot be null there.
fn without_null(parameter: &mut Parameter) {
    let Some(RefOr::T(schema)) = &mut parameter.schema else { return };
    match schema {
        Schema::Object(Object { schema_type: SchemaType::Array(types), .. }) => {
            types.retain(|kind| *kind != Type::Null);
            if let [only] = types.as_slice() {
                let only = SchemaType::Type(only.clone());
                if let Schema::Object(object) = schema {
                    object.schema_type = only;
                }
            }
        }
        Schema::OneOf(choice) => {
            choice.items.retain(|item| !is_null(item));
            if let [only] = choice.items.as_slice() {
                parameter.schema = Some(only.clone());
            }
        }
        _ => {}
    }
}

fn is_null(schema: &RefOr<Schema>) -> bool {
    matches!(schema, RefOr::T(Schema::Object(object)) if object.schema_type == SchemaType::Type(Type::Null))
}

/// That nothing is the default goes without saying; said, generated types ask for what may be left out.
fn without_empty_default(property: &mut RefOr<Schema>) {
    let default = match property {
        RefOr::Ref(reference) => &mut reference.default,
        RefOr::T(Schema::Object(object)) => &mut object.default,
        RefOr::T(Schema::OneOf(choice)) => &mut choice.default,
        RefOr::T(Schema::Array(list)) => &mut list.default,
        RefOr::T(_) => return,
    };
    default.take_if(|value| value.is_null() || value.is_object());
}

/// A kind of a choice is written as an object whose only key names it; generated clients call it by the names of both.
fn one_key(choice: &str, kind: &mut RefOr<Schema>) {
    if let RefOr::T(Schema::Object(object)) = kind
        && let ([key], 1) = (object.required.as_slice(), object.properties.len())
    {
        object.title = Some(key.split('_').fold(choice.to_owned(), |name, word| name + &capital(word)));
        object.additional_properties = Some(Box::new(AdditionalProperties::FreeForm(false)));
    }
}

fn capital(word: &str) -> String {
    let mut letters = word.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// The operations of these paths.
pub fn operations(paths: &mut Paths) -> impl Iterator<Item = &mut Operation> {
    paths.paths.values_mut().flat_map(|item| {
        let all = [&mut item.get, &mut item.put, &mut item.post, &mut item.delete, &mut item.patch, &mut item.head];
        all.into_iter().flatten()
    })
}
