//! `/v1/webhooks/{id}/deliveries`: the deliveries of a webhook and their results.

use super::api::Api;
use super::extract::{Page, Path, Query, cut};
use super::problem::Problem;
use super::webhooks::find;
use crate::accounts::access::Access;
use crate::webhooks::deliveries;
use crate::webhooks::deliveries::{Delivery as Row, State as DeliveryState};
use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use serde::Serialize;
use utoipa::ToSchema;

/// The delivery of one event to one webhook.
#[derive(Serialize, ToSchema)]
pub struct Delivery {
    /// Identifier of the delivery: the `webhook-id` of every attempt.
    #[schema(format = Uuid)]
    id: String,
    /// Name of the event, or `ping`.
    event: String,
    /// Identifier of the job that ended; null for a ping.
    #[schema(required)]
    job: Option<String>,
    /// State of the delivery.
    state: DeliveryState,
    /// Number of attempts made.
    attempt: i64,
    /// When the next attempt is due, epoch ms; null if there is none.
    #[schema(required)]
    due_ms: Option<i64>,
    /// When the last attempt was made, epoch ms.
    #[schema(required)]
    attempted_ms: Option<i64>,
    /// HTTP status of the last answer; null if the last attempt got none.
    #[schema(required)]
    status: Option<i64>,
    /// The beginning of the body of the last answer.
    #[schema(required)]
    answer: Option<String>,
    /// Why the last attempt got no answer; null if it got one.
    #[schema(required)]
    error: Option<String>,
    /// When the event happened, epoch ms.
    created_ms: i64,
}

/// Deliveries, newest first.
#[derive(Serialize, ToSchema)]
pub struct DeliveryList {
    /// The entries of this page.
    deliveries: Vec<Delivery>,
    /// The value of `after` for the next page; null on the last page.
    #[schema(required)]
    next: Option<String>,
}

impl From<Row> for Delivery {
    fn from(row: Row) -> Delivery {
        let Row { id, event, job, state, attempt, due_ms, attempted_ms, status, answer, error, created_ms } = row;
        Delivery { id, event, job, state, attempt, due_ms, attempted_ms, status, answer, error, created_ms }
    }
}

/// Lists the deliveries of a webhook, newest first
///
/// Deliveries are listed for 30 days.
#[utoipa::path(
    get, path = "/v1/webhooks/{id}/deliveries", tag = "webhooks", operation_id = "list_deliveries",
    params(("id" = String, Path, description = "the webhook"), Page),
    responses(
        (status = 200, body = DeliveryList, description = "one page of the list"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such webhook"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "the query is not valid"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn list(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
    Query(page): Query<Page>,
) -> Result<Json<DeliveryList>, Problem> {
    let limit = Page::limit(page.limit)?;
    find(&api, &access, &id).await?;
    let rows = deliveries::list(&api.storage.records, &id, page.after.as_deref(), limit as i64 + 1).await?;
    let (rows, next) = cut(rows, limit, |row| &row.id);
    Ok(Json(DeliveryList { deliveries: rows.into_iter().map(Delivery::from).collect(), next }))
}

/// Sends a delivery again
///
/// The event is sent at once, with the same `webhook-id`, whether or not it was delivered before.
#[utoipa::path(
    post, path = "/v1/webhooks/{id}/deliveries/{delivery}/redeliver", tag = "webhooks", operation_id = "redeliver",
    params(("id" = String, Path, description = "the webhook"), ("delivery" = String, Path, description = "the delivery")),
    responses(
        (status = 202, body = Delivery, description = "the event will be delivered again"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such webhook or delivery"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "the webhook is disabled"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn redeliver(
    State(api): State<Api>,
    access: Access,
    Path((id, delivery)): Path<(String, String)>,
) -> Result<(StatusCode, Json<Delivery>), Problem> {
    let webhook = find(&api, &access, &id).await?;
    let records = &api.storage.records;
    let known = deliveries::get(records, &id, &delivery).await?.ok_or_else(|| Problem::no_delivery(&delivery))?;
    if !deliveries::redeliver(records, &access.tenant, &id, &delivery).await? {
        // Gone just now, or it is told nothing.
        deliveries::get(records, &id, &delivery).await?.ok_or_else(|| Problem::no_delivery(&delivery))?;
        return Err(Problem::webhook_disabled(webhook.disabled_why.as_deref().unwrap_or("just now")));
    }
    api.dispatcher.wake();
    let now = deliveries::get(records, &id, &delivery).await?.unwrap_or(known);
    Ok((StatusCode::ACCEPTED, Json(now.into())))
}

/// Sends a test event to a webhook
///
/// The event is a `ping` without data, sent once. The list of deliveries shows the result.
#[utoipa::path(
    post, path = "/v1/webhooks/{id}/ping", tag = "webhooks", operation_id = "ping_webhook",
    params(("id" = String, Path, description = "the webhook")),
    responses(
        (status = 202, body = Delivery, description = "the test event will be sent"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such webhook"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "the webhook is disabled"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy, or the database or the object store does not answer"),
    )
)]
pub async fn ping(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
) -> Result<(StatusCode, Json<Delivery>), Problem> {
    let webhook = find(&api, &access, &id).await?;
    let ping = deliveries::ping(&api.storage.records, &access.tenant, &id).await?;
    let ping = ping.ok_or_else(|| Problem::webhook_disabled(webhook.disabled_why.as_deref().unwrap_or("just now")))?;
    api.dispatcher.wake();
    Ok((StatusCode::ACCEPTED, Json(ping.into())))
}
