//! `/v1/webhooks`: who is told that jobs have ended.

use super::addresses::link;
use super::api::Api;
use super::extract::{Body, Page, Path, Query, cut};
use super::problem::Problem;
use crate::accounts::access::Access;
use crate::webhooks::endpoints::{Endpoint, Told};
use crate::webhooks::{Event, endpoints};
use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Longest description.
const MAX_DESCRIPTION_CHARS: usize = 255;

/// An endpoint to be.
#[derive(Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewWebhook {
    /// Where to post: `https://..`.
    #[schema(pattern = "^https?://", max_length = 2048)]
    url: String,
    /// What it hears of; everything, if nothing is said.
    #[serde(default = "all")]
    #[schema(min_items = 1, nullable)]
    events: Vec<Event>,
    /// What a person says of it.
    #[serde(default)]
    #[schema(max_length = 255, nullable)]
    description: String,
}

/// What is to change.
#[derive(Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WebhookChange {
    /// Where to post.
    #[serde(default)]
    #[schema(value_type = Option<String>, pattern = "^https?://", max_length = 2048)]
    url: Option<String>,
    /// What it hears of.
    #[serde(default)]
    #[schema(min_items = 1)]
    events: Option<Vec<Event>>,
    /// What a person says of it.
    #[serde(default)]
    #[schema(max_length = 255)]
    description: Option<String>,
    /// Only true: tell it again. Any change does.
    #[serde(default)]
    enabled: Option<bool>,
}

/// An endpoint.
#[derive(Serialize, ToSchema)]
pub struct Webhook {
    /// Its identifier.
    #[schema(format = Uuid)]
    id: String,
    /// Where is posted.
    url: String,
    /// What it hears of.
    events: Vec<Event>,
    /// What a person says of it.
    description: String,
    /// Whether it is told anything.
    enabled: bool,
    /// Why not: it answered 410, or has taken nothing for three days and not the last of ten attempts.
    #[schema(required)]
    disabled_why: Option<String>,
    /// Since when it has taken nothing, epoch ms; null while it does.
    #[schema(required)]
    failing_since_ms: Option<i64>,
    /// Until when the secret before signs too, epoch ms.
    #[schema(required)]
    old_secret_until_ms: Option<i64>,
    /// When it was made, epoch ms.
    created_ms: i64,
    /// Where things are.
    links: WebhookLinks,
}

/// Where an endpoint's things are.
#[derive(Serialize, ToSchema)]
pub struct WebhookLinks {
    /// Itself.
    #[serde(rename = "self")]
    this: String,
    /// What it was told, and how that went.
    deliveries: String,
}

/// An endpoint with its secret, which is told once.
#[derive(Serialize, ToSchema)]
pub struct WebhookWithSecret {
    /// What signs: `whsec_` and base64. Nothing tells it again.
    secret: String,
    /// The endpoint.
    #[serde(flatten)]
    webhook: Webhook,
}

/// Endpoints, newest first.
#[derive(Serialize, ToSchema)]
pub struct WebhookList {
    /// One page of them.
    webhooks: Vec<Webhook>,
    /// The `after` of the next page; null on the last.
    #[schema(required)]
    next: Option<String>,
}

fn all() -> Vec<Event> {
    Event::ALL.to_vec()
}

impl From<Endpoint> for Webhook {
    fn from(row: Endpoint) -> Webhook {
        let this = link(&format!("/v1/webhooks/{}", row.id));
        Webhook {
            id: row.id,
            url: row.url,
            events: row.events,
            description: row.description,
            enabled: row.disabled_why.is_none(),
            disabled_why: row.disabled_why,
            failing_since_ms: row.failing_since_ms,
            old_secret_until_ms: row.old_secret_until_ms,
            created_ms: row.created_ms,
            links: WebhookLinks { deliveries: format!("{this}/deliveries"), this },
        }
    }
}

/// What can be said of an endpoint.
fn judge(api: &Api, told: &Told) -> Result<(), Problem> {
    api.dispatcher.outbound().judge(&told.url).map_err(|error| Problem::webhook_url(&error))?;
    if told.events.is_empty() {
        return Err(Problem::out_of_range("events", "a list of at least one event"));
    }
    if told.description.chars().count() > MAX_DESCRIPTION_CHARS || told.description.contains('\0') {
        return Err(Problem::out_of_range("description", "at most 255 characters long"));
    }
    Ok(())
}

/// Makes a webhook
///
/// Every job that ends from now on is posted to it, signed as Standard Webhooks says: `webhook-id` (the same for every attempt: drop
/// what came before), `webhook-timestamp` and `webhook-signature`; the body is a WebhookMessage. Any 2xx within 15 s is taken for
/// an answer, 410 ends it; else it is told again, later and later: ten times in all, within four days unless it asks for more time.
#[utoipa::path(
    post, path = "/v1/webhooks", tag = "webhooks", operation_id = "create_webhook", request_body = NewWebhook,
    responses(
        (status = 201, body = WebhookWithSecret, description = "made; the secret is told here and nowhere else", headers(("Location" = String, description = "the webhook"))),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "not JSON"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "as many as may be"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "the body is too large"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "not JSON by its Content-Type"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "unknown field, wrong type; an address that is refused"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, or a store that does not answer"),
    )
)]
pub async fn create(State(api): State<Api>, access: Access, Body(new): Body<NewWebhook>) -> Result<Response, Problem> {
    let told = Told { url: new.url, events: new.events, description: new.description };
    judge(&api, &told)?;
    let made = endpoints::create(&api.storage.records, &access.tenant, told).await?;
    let (row, secret) = made.ok_or_else(Problem::too_many_webhooks)?;
    let webhook = Webhook::from(row);
    let location = [(header::LOCATION, webhook.links.this.clone())];
    Ok((StatusCode::CREATED, location, Json(WebhookWithSecret { secret, webhook })).into_response())
}

/// Lists webhooks, newest first
#[utoipa::path(
    get, path = "/v1/webhooks", tag = "webhooks", operation_id = "list_webhooks", params(Page),
    responses(
        (status = 200, body = WebhookList, description = "one page"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "an unusable query"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, or a store that does not answer"),
    )
)]
pub async fn list(
    State(api): State<Api>,
    access: Access,
    Query(page): Query<Page>,
) -> Result<Json<WebhookList>, Problem> {
    let limit = Page::limit(page.limit)?;
    let after = page.after.as_deref();
    let rows = endpoints::list(&api.storage.records, &access.tenant, after, limit as i64 + 1).await?;
    let (rows, next) = cut(rows, limit, |row| &row.id);
    Ok(Json(WebhookList { webhooks: rows.into_iter().map(Webhook::from).collect(), next }))
}

/// Tells of a webhook
#[utoipa::path(
    get, path = "/v1/webhooks/{id}", tag = "webhooks", operation_id = "get_webhook",
    params(("id" = String, Path, description = "the webhook")),
    responses(
        (status = 200, body = Webhook, description = "what is known of it"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is none"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, or a store that does not answer"),
    )
)]
pub async fn get(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<Json<Webhook>, Problem> {
    Ok(Json(find(&api, &access, &id).await?.into()))
}

/// The endpoint `id` of whoever asks, or 404.
pub(super) async fn find(api: &Api, access: &Access, id: &str) -> Result<Endpoint, Problem> {
    endpoints::get(&api.storage.records, &access.tenant, id).await?.ok_or_else(|| Problem::no_webhook(id))
}

/// Changes a webhook
///
/// What is not said stays. One that was disabled is told again, from the next job on.
#[utoipa::path(
    patch, path = "/v1/webhooks/{id}", tag = "webhooks", operation_id = "change_webhook", request_body = WebhookChange,
    params(("id" = String, Path, description = "the webhook")),
    responses(
        (status = 200, body = Webhook, description = "what it is now"),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "not JSON"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is none"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "the body is too large"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "not JSON by its Content-Type"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "unknown field, wrong type; an address that is refused"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, or a store that does not answer"),
    )
)]
pub async fn change(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
    Body(change): Body<WebhookChange>,
) -> Result<Json<Webhook>, Problem> {
    if change.enabled == Some(false) {
        return Err(Problem::out_of_range("enabled", "true; who wants to hear nothing deletes the webhook"));
    }
    let now = find(&api, &access, &id).await?;
    let told = Told {
        url: change.url.unwrap_or(now.url),
        events: change.events.unwrap_or(now.events),
        description: change.description.unwrap_or(now.description),
    };
    judge(&api, &told)?;
    endpoints::change(&api.storage.records, &access.tenant, &id, told).await?;
    Ok(Json(find(&api, &access, &id).await?.into()))
}

/// Makes a new secret for a webhook
///
/// For a day the one before signs too: `webhook-signature` then has two, and either is good. Asked again within that day, the one
/// that the receiver has goes on signing.
#[utoipa::path(
    post, path = "/v1/webhooks/{id}/secret", tag = "webhooks", operation_id = "rotate_webhook_secret",
    params(("id" = String, Path, description = "the webhook")),
    responses(
        (status = 200, body = WebhookWithSecret, description = "the new secret, told here and nowhere else"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is none"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, or a store that does not answer"),
    )
)]
pub async fn rotate(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
) -> Result<Json<WebhookWithSecret>, Problem> {
    let overlap = api.dispatcher.policy().overlap;
    let secret = endpoints::rotate(&api.storage.records, &access.tenant, &id, overlap).await?;
    let secret = secret.ok_or_else(|| Problem::no_webhook(&id))?;
    Ok(Json(WebhookWithSecret { secret, webhook: find(&api, &access, &id).await?.into() }))
}

/// Deletes a webhook
///
/// What was not yet told to it is not told.
#[utoipa::path(
    delete, path = "/v1/webhooks/{id}", tag = "webhooks", operation_id = "delete_webhook",
    params(("id" = String, Path, description = "the webhook")),
    responses(
        (status = 204, description = "gone"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is none"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "a store that does not answer"),
    )
)]
pub async fn delete(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    match endpoints::delete(&api.storage.records, &access.tenant, &id).await? {
        true => Ok(StatusCode::NO_CONTENT),
        false => Err(Problem::no_webhook(&id)),
    }
}
