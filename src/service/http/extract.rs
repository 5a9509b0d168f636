//! Extractors of handlers: JSON body, path and query. The extractors of the libraries are not used, because they refuse in plain
//! text.

use super::problem::Problem;
use axum::body::to_bytes;
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::header::CONTENT_TYPE;
use axum::http::request::Parts;
use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use uuid::Uuid;

/// Largest JSON body, bytes.
const MAX_JSON_BYTES: usize = 64 << 10;
/// The mark that some programs put before UTF-8 text; RFC 8259, section 8.1, lets a reader ignore it.
const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";

/// A JSON body. A field that is null counts as left out: it takes its default, or is missing where it must be given. A null in a
/// list is a value of the wrong type.
pub struct Body<T>(pub T);

impl<T: DeserializeOwned + Serialize, S: Send + Sync> FromRequest<S> for Body<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, _state: &S) -> Result<Body<T>, Problem> {
        let media_type = request.headers().get(CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
        let essence = media_type.split(';').next().unwrap_or_default().trim();
        if !essence.eq_ignore_ascii_case("application/json") {
            return Err(Problem::media_type(
                format!("The body is {media_type:?}."),
                "Send JSON with Content-Type: application/json.",
            ));
        }
        let bytes = bytes_up_to(request.into_body(), MAX_JSON_BYTES).await?;
        read(bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&bytes)).map(Body)
    }
}

/// Reads a JSON text as [`Body`] says.
fn read<T: DeserializeOwned + Serialize>(text: &[u8]) -> Result<T, Problem> {
    if text.trim_ascii().is_empty() {
        return Err(Problem::malformed_json("The body is empty."));
    }
    let mut json: Value = serde_json::from_slice(text).map_err(|error| Problem::malformed_json(format!("{error}.")))?;
    if let Some(path) = unwritable(&mut json, String::new()) {
        return Err(Problem::null_character(&path));
    }
    let mut nulls = Nulls::new();
    drop_nulls(&mut json, "", "", &mut nulls);
    let value: T = of_shape(&json)?;
    unknown_null::<T>(&json, &nulls)?;
    let parsed = serde_json::to_value(&value).unwrap_or_default();
    match list_for_object(&json, &parsed, String::new()) {
        Some(path) => Err(Problem::wrong_shape(&path, "invalid type: sequence, expected an object")),
        None => Ok(value),
    }
}

fn of_shape<T: DeserializeOwned>(json: &Value) -> Result<T, Problem> {
    serde_path_to_error::deserialize(json)
        .map_err(|error| Problem::wrong_shape(&error.path().to_string(), &error.inner().to_string()))
}

/// Fields that were null: one address (a JSON pointer to its object, and its name) for each place in the shape, all entries of
/// a list being one place.
type Nulls = BTreeMap<String, (String, String)>;

/// Removes the fields that are null from every object; a null in a list stays. `pointer` leads to `value`, `place` is the same
/// without the numbers of entries.
fn drop_nulls(value: &mut Value, pointer: &str, place: &str, nulls: &mut Nulls) {
    match value {
        Value::Object(fields) => {
            fields.retain(|name, field| {
                if field.is_null() {
                    nulls.insert(format!("{place}/{name}"), (pointer.to_owned(), name.clone()));
                }
                !field.is_null()
            });
            for (name, field) in fields {
                let step = name.replace('~', "~0").replace('/', "~1");
                drop_nulls(field, &format!("{pointer}/{step}"), &format!("{place}/{name}"), nulls);
            }
        }
        Value::Array(items) => {
            for (index, item) in items.iter_mut().enumerate() {
                drop_nulls(item, &format!("{pointer}/{index}"), &format!("{place}/"), nulls);
            }
        }
        _ => {}
    }
}

/// Refuses an unknown field that was null: a misspelt name is a mistake whatever its value. Each place is put back alone and read
/// once more, so that a body costs as many readings as its shape has optional fields, not as it has nulls.
fn unknown_null<T: DeserializeOwned>(json: &Value, nulls: &Nulls) -> Result<(), Problem> {
    for (pointer, name) in nulls.values() {
        let mut with_one = json.clone();
        if let Some(Value::Object(fields)) = with_one.pointer_mut(pointer) {
            fields.insert(name.clone(), Value::Null);
        }
        let unknown = of_shape::<T>(&with_one).err().filter(|problem| problem.code == "request.unknown_field");
        if let Some(problem) = unknown {
            return Err(problem);
        }
    }
    Ok(())
}

/// Writes 16.0 as 16: to JSON they are one number, to serde they are not. The path of a text that PostgreSQL could not keep, if any.
fn unwritable(value: &mut Value, path: String) -> Option<String> {
    match value {
        Value::Number(number) => {
            let whole = number.as_f64().filter(|float| number.is_f64() && float.fract() == 0.0 && float.abs() < 9e15);
            if let Some(whole) = whole {
                *number = (whole as i64).into();
            }
            None
        }
        Value::Array(items) => {
            items.iter_mut().enumerate().find_map(|(k, item)| unwritable(item, format!("{path}[{k}]")))
        }
        Value::Object(fields) => fields.iter_mut().find_map(|(name, field)| {
            let dot = if path.is_empty() { "" } else { "." };
            unwritable(field, format!("{path}{dot}{name}"))
        }),
        Value::String(text) => text.contains('\0').then_some(path),
        Value::Null | Value::Bool(_) => None,
    }
}

/// U+0000 in an address: no name and no id has it, and PostgreSQL could not even look.
fn has_nul(part: Option<&str>) -> bool {
    part.is_some_and(|part| part.contains("%00"))
}

/// Reads a whole body of at most `limit` bytes.
///
/// # Errors
/// [`Problem`]: more than `limit` bytes, or cut short.
pub async fn bytes_up_to(body: axum::body::Body, limit: usize) -> Result<bytes::Bytes, Problem> {
    to_bytes(body, limit).await.map_err(|error| match is_length_limit(&error) {
        true => Problem::body_too_large(limit as u64),
        false => {
            tracing::debug!(%error, "the transfer of a body was interrupted");
            Problem::body_truncated()
        }
    })
}

/// The path of a list that was `sent` where an object is `parsed`: serde would read it as the object's fields in order.
fn list_for_object(sent: &Value, parsed: &Value, path: String) -> Option<String> {
    match (sent, parsed) {
        (Value::Array(_), Value::Object(_)) => Some(if path.is_empty() { "body".to_owned() } else { path }),
        (Value::Array(sent), Value::Array(parsed)) => {
            let both = sent.iter().zip(parsed).enumerate();
            both.into_iter().find_map(|(k, (sent, parsed))| list_for_object(sent, parsed, format!("{path}[{k}]")))
        }
        (Value::Object(sent), Value::Object(parsed)) => sent.iter().find_map(|(name, value)| {
            let dot = if path.is_empty() { "" } else { "." };
            list_for_object(value, parsed.get(name)?, format!("{path}{dot}{name}"))
        }),
        _ => None,
    }
}

fn is_length_limit(error: &axum::Error) -> bool {
    let mut cause = std::error::Error::source(error);
    while let Some(inner) = cause {
        if inner.is::<http_body_util::LengthLimitError>() {
            return true;
        }
        cause = inner.source();
    }
    false
}

/// The parameters of a path.
pub struct Path<T>(pub T);

impl<T: DeserializeOwned + Send, S: Send + Sync> FromRequestParts<S> for Path<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Path<T>, Problem> {
        if has_nul(Some(parts.uri.path())) {
            return Err(Problem::malformed_path("The path contains the character U+0000."));
        }
        match axum::extract::Path::<T>::from_request_parts(parts, state).await {
            Ok(axum::extract::Path(path)) => Ok(Path(path)),
            Err(rejection) => Err(Problem::malformed_path(rejection.body_text())),
        }
    }
}

/// The query.
pub struct Query<T>(pub T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for Query<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Query<T>, Problem> {
        if has_nul(parts.uri.query()) {
            return Err(Problem::null_character("query"));
        }
        match axum::extract::Query::<T>::try_from_uri(&parts.uri) {
            Ok(axum::extract::Query(query)) => Ok(Query(query)),
            Err(rejection) => {
                let sentence = std::error::Error::source(&rejection).map_or_else(String::new, ToString::to_string);
                let (path, found) = sentence.split_once(": ").unwrap_or(("", &sentence));
                // Without a path the sentence is all there is: "unknown field `x`, expected ..".
                match path.contains(' ') {
                    true => Err(Problem::wrong_shape("query", &sentence)),
                    false => Err(Problem::wrong_shape(path, found)),
                }
            }
        }
    }
}

/// A page of a list, newest first.
#[derive(Debug, serde::Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Page {
    /// The largest number of entries in the answer.
    #[param(minimum = 1, maximum = 100, default = 20)]
    #[serde(default = "Page::default_limit")]
    pub limit: u32,
    /// The value of `next` in the page before this one.
    #[param(value_type = Option<String>, pattern = "^([0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12})?$")]
    #[serde(default, deserialize_with = "Page::cursor")]
    pub after: Option<String>,
}

impl Page {
    /// Number of entries where the client gives no limit.
    pub fn default_limit() -> u32 {
        20
    }

    /// The entry after which a page begins. What is no id would begin the list anew each time, and who follows `next` would never end. An
    /// empty one is that of the first page.
    pub fn cursor<'a, D: Deserializer<'a>>(text: D) -> Result<Option<String>, D::Error> {
        let text = String::deserialize(text)?;
        if text.is_empty() {
            return Ok(None);
        }
        let told = |_| D::Error::custom(format!("{text:?} is no `next` of a page before"));
        Uuid::parse_str(&text).map(|id| Some(id.to_string())).map_err(told)
    }

    /// Checks the limit of a page.
    ///
    /// # Errors
    /// [`Problem`]: out of range.
    pub fn limit(limit: u32) -> Result<usize, Problem> {
        match limit {
            1..=100 => Ok(limit as usize),
            _ => Err(Problem::out_of_range("limit", "a whole number from 1 to 100")),
        }
    }
}

/// Cuts a list that was asked for one entry more than `limit`: the entries, and the id that the next page comes after.
pub fn cut<T>(mut entries: Vec<T>, limit: usize, id: impl Fn(&T) -> &str) -> (Vec<T>, Option<String>) {
    let more = entries.len() > limit;
    entries.truncate(limit);
    let next = entries.last().filter(|_| more).map(|last| id(last).to_owned());
    (entries, next)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::request::NewJob;
    use serde_json::json;

    #[test]
    fn a_thousand_nulls_cost_as_many_readings_as_there_are_fields() {
        let channel = json!({"ray_set": "x", "name": null, "flux": null, "spectrum": null});
        let body = json!({"channels": vec![channel; 900], "total": null, "options": {"hull": null}});
        let mut json = body.clone();
        let mut nulls = Nulls::new();
        drop_nulls(&mut json, "", "", &mut nulls);
        let places: Vec<&str> = nulls.keys().map(String::as_str).collect();
        assert_eq!(places, ["/channels//flux", "/channels//name", "/channels//spectrum", "/options/hull", "/total"]);
        assert!(read::<NewJob>(body.to_string().as_bytes()).is_ok());
    }
}
