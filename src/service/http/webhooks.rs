//! `/v1/webhooks`: URLs that receive an event when a job ends.

use super::addresses::link;
use super::api::Api;
use super::extract::{Body, Page, Path, Query, cut};
use super::problem::Problem;
use crate::accounts::access::Access;
use crate::webhooks::endpoints::{Endpoint, EndpointSettings};
use crate::webhooks::{Event, endpoints};
use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Longest description.
const MAX_DESCRIPTION_CHARS: usize = 255;

/// A request for a webhook.
#[derive(Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewWebhook {
    /// URL that events are posted to: `https://..`.
    #[schema(pattern = "^https?://", max_length = 2048)]
    url: String,
    /// The events that the webhook receives. Default: all.
    #[serde(default = "all")]
    #[schema(min_items = 1, nullable)]
    events: Vec<Event>,
    /// A note for people.
    #[serde(default)]
    #[schema(max_length = 255, nullable)]
    description: String,
}

/// The fields of a webhook to change.
#[derive(Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WebhookChange {
    /// URL that events are posted to.
    #[serde(default)]
    #[schema(value_type = Option<String>, pattern = "^https?://", max_length = 2048)]
    url: Option<String>,
    /// The events that the webhook receives.
    #[serde(default)]
    #[schema(min_items = 1)]
    events: Option<Vec<Event>>,
    /// A note for people.
    #[serde(default)]
    #[schema(max_length = 255)]
    description: Option<String>,
    /// Enables a disabled webhook again; only true is allowed. Any other change does the same.
    #[serde(default)]
    enabled: Option<bool>,
}

/// A webhook: a URL that the service posts events to.
#[derive(Serialize, ToSchema)]
pub struct Webhook {
    /// Identifier of this object.
    #[schema(format = Uuid)]
    id: String,
    /// URL that events are posted to.
    url: String,
    /// The events that the webhook receives.
    events: Vec<Event>,
    /// A note for people.
    description: String,
    /// Whether the webhook receives events.
    enabled: bool,
    /// Why the webhook is disabled: its URL answered 410, or accepted nothing for three days and refused the last of ten
    /// attempts; null if it is enabled.
    #[schema(required)]
    disabled_why: Option<String>,
    /// Since when the URL has accepted nothing, epoch ms; null while it accepts events.
    #[schema(required)]
    failing_since_ms: Option<i64>,
    /// Until when the secret before the present one signs too, epoch ms.
    #[schema(required)]
    old_secret_until_ms: Option<i64>,
    /// When the webhook was created, epoch ms.
    created_ms: i64,
    /// Addresses of related objects.
    links: WebhookLinks,
}

/// Addresses that belong to a webhook.
#[derive(Serialize, ToSchema)]
pub struct WebhookLinks {
    /// Address of this object.
    #[serde(rename = "self")]
    this: String,
    /// List of the deliveries and their results.
    deliveries: String,
}

/// A webhook with its signing secret, which is shown only once.
#[derive(Serialize, ToSchema)]
pub struct WebhookWithSecret {
    /// The signing secret: `whsec_` and base64. It is never shown again.
    secret: String,
    /// The webhook.
    #[serde(flatten)]
    webhook: Webhook,
}

/// Webhooks, newest first.
#[derive(Serialize, ToSchema)]
pub struct WebhookList {
    /// The entries of this page.
    webhooks: Vec<Webhook>,
    /// The value of `after` for the next page; null on the last page.
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
fn judge(api: &Api, settings: &EndpointSettings) -> Result<(), Problem> {
    api.dispatcher.outbound().judge(&settings.url).map_err(|error| Problem::webhook_url(&error))?;
    if settings.events.is_empty() {
        return Err(Problem::out_of_range("events", "a list of at least one event"));
    }
    if settings.description.chars().count() > MAX_DESCRIPTION_CHARS || settings.description.contains('\0') {
        return Err(Problem::out_of_range("description", "at most 255 characters long"));
    }
    Ok(())
}

/// Creates a webhook
///
/// The service posts an event to the URL for every job that ends from now on. Each request is signed as Standard Webhooks
/// describes: `webhook-id` (the same for every attempt, so that the receiver can drop repeats), `webhook-timestamp` and
/// `webhook-signature`; the body is a WebhookMessage. A 2xx answer within 15 s confirms the delivery; 410 disables the webhook.
/// After any other answer the service tries again at growing intervals: ten attempts in all, within four days unless
/// `Retry-After` asks for more time.
#[utoipa::path(
    post, path = "/v1/webhooks", tag = "webhooks", operation_id = "create_webhook", request_body = NewWebhook,
    responses(
        (status = 201, body = WebhookWithSecret, description = "the webhook is created; only this answer contains the secret", headers(("Location" = String, description = "the webhook"))),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "the body is not JSON"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "the tenant has the largest number of webhooks already"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "the body is too large"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "the Content-Type is not application/json"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "a field is unknown or of the wrong type; the URL is refused"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn create(State(api): State<Api>, access: Access, Body(new): Body<NewWebhook>) -> Result<Response, Problem> {
    let settings = EndpointSettings { url: new.url, events: new.events, description: new.description };
    judge(&api, &settings)?;
    let made = endpoints::create(&api.storage.records, &access.tenant, settings).await?;
    let (row, secret) = made.ok_or_else(Problem::too_many_webhooks)?;
    let webhook = Webhook::from(row);
    let location = [(header::LOCATION, webhook.links.this.clone())];
    Ok((StatusCode::CREATED, location, Json(WebhookWithSecret { secret, webhook })).into_response())
}

/// Lists webhooks, newest first
#[utoipa::path(
    get, path = "/v1/webhooks", tag = "webhooks", operation_id = "list_webhooks", params(Page),
    responses(
        (status = 200, body = WebhookList, description = "one page of the list"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "the query is not valid"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
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

/// Returns a webhook
#[utoipa::path(
    get, path = "/v1/webhooks/{id}", tag = "webhooks", operation_id = "get_webhook",
    params(("id" = String, Path, description = "the webhook")),
    responses(
        (status = 200, body = Webhook, description = "the webhook"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such webhook"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn get(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<Json<Webhook>, Problem> {
    Ok(Json(find(&api, &access, &id).await?.into()))
}

/// The webhook `id` of the tenant of the request, or 404.
pub(super) async fn find(api: &Api, access: &Access, id: &str) -> Result<Endpoint, Problem> {
    endpoints::get(&api.storage.records, &access.tenant, id).await?.ok_or_else(|| Problem::no_webhook(id))
}

/// Changes a webhook
///
/// Fields that are left out keep their values. Any change enables a disabled webhook again, from the next job on.
#[utoipa::path(
    patch, path = "/v1/webhooks/{id}", tag = "webhooks", operation_id = "change_webhook", request_body = WebhookChange,
    params(("id" = String, Path, description = "the webhook")),
    responses(
        (status = 200, body = Webhook, description = "the webhook after the change"),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "the body is not JSON"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such webhook"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "the body is too large"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "the Content-Type is not application/json"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "a field is unknown or of the wrong type; the URL is refused"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn change(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
    Body(change): Body<WebhookChange>,
) -> Result<Json<Webhook>, Problem> {
    if change.enabled == Some(false) {
        return Err(Problem::out_of_range("enabled", "true; to stop the events, delete the webhook"));
    }
    let now = find(&api, &access, &id).await?;
    let settings = EndpointSettings {
        url: change.url.unwrap_or(now.url),
        events: change.events.unwrap_or(now.events),
        description: change.description.unwrap_or(now.description),
    };
    judge(&api, &settings)?;
    endpoints::change(&api.storage.records, &access.tenant, &id, settings).await?;
    Ok(Json(find(&api, &access, &id).await?.into()))
}

/// Makes a new signing secret for a webhook
///
/// The secret before it signs too for one day: `webhook-signature` then has two signatures, and either is valid. If the request
/// is repeated within that day, the secret that signed before the first of these requests goes on signing.
#[utoipa::path(
    post, path = "/v1/webhooks/{id}/secret", tag = "webhooks", operation_id = "rotate_webhook_secret",
    params(("id" = String, Path, description = "the webhook")),
    responses(
        (status = 200, body = WebhookWithSecret, description = "the webhook with its new secret; only this answer contains the secret"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such webhook"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
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
/// Events that were not delivered yet are dropped.
#[utoipa::path(
    delete, path = "/v1/webhooks/{id}", tag = "webhooks", operation_id = "delete_webhook",
    params(("id" = String, Path, description = "the webhook")),
    responses(
        (status = 204, description = "the webhook is deleted"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such webhook"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the database or the object store does not answer"),
    )
)]
pub async fn delete(State(api): State<Api>, access: Access, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    match endpoints::delete(&api.storage.records, &access.tenant, &id).await? {
        true => Ok(StatusCode::NO_CONTENT),
        false => Err(Problem::no_webhook(&id)),
    }
}
