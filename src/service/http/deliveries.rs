//! `/v1/webhooks/{id}/deliveries`: what an endpoint was told, and how that went.

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

/// One event for one endpoint.
#[derive(Serialize, ToSchema)]
pub struct Delivery {
    /// Its identifier: the `webhook-id` of every attempt.
    #[schema(format = Uuid)]
    id: String,
    /// What is told: an event, or `ping`.
    event: String,
    /// Of which job; null for a ping.
    #[schema(required)]
    job: Option<String>,
    /// Where it is.
    state: DeliveryState,
    /// Attempts so far.
    attempt: i64,
    /// When the next is due, epoch ms; null unless it waits.
    #[schema(required)]
    due_ms: Option<i64>,
    /// When the last was made, epoch ms.
    #[schema(required)]
    attempted_ms: Option<i64>,
    /// The HTTP status that it was answered with; null when nothing was.
    #[schema(required)]
    status: Option<i64>,
    /// The beginning of what came with it.
    #[schema(required)]
    answer: Option<String>,
    /// Why nothing was answered.
    #[schema(required)]
    error: Option<String>,
    /// When it was announced, epoch ms.
    created_ms: i64,
}

/// Deliveries, newest first.
#[derive(Serialize, ToSchema)]
pub struct DeliveryList {
    /// One page of them.
    deliveries: Vec<Delivery>,
    /// The `after` of the next page; null on the last.
    #[schema(required)]
    next: Option<String>,
}

impl From<Row> for Delivery {
    fn from(row: Row) -> Delivery {
        let Row { id, event, job, state, attempt, due_ms, attempted_ms, status, answer, error, created_ms } = row;
        Delivery { id, event, job, state, attempt, due_ms, attempted_ms, status, answer, error, created_ms }
    }
}

/// Lists what a webhook was told, newest first
///
/// Known for 30 days.
#[utoipa::path(
    get, path = "/v1/webhooks/{id}/deliveries", tag = "webhooks", operation_id = "list_deliveries",
    params(("id" = String, Path, description = "the webhook"), Page),
    responses(
        (status = 200, body = DeliveryList, description = "one page"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such webhook"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "an unusable query"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, or a store that does not answer"),
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

/// Tells it again
///
/// At once, with the same `webhook-id`, whatever came of it before.
#[utoipa::path(
    post, path = "/v1/webhooks/{id}/deliveries/{delivery}/redeliver", tag = "webhooks", operation_id = "redeliver",
    params(("id" = String, Path, description = "the webhook"), ("delivery" = String, Path, description = "the delivery")),
    responses(
        (status = 202, body = Delivery, description = "it will be"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such webhook or delivery"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "the webhook is disabled"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, or a store that does not answer"),
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

/// Tells a webhook that there is nothing to tell
///
/// A `ping` without data, once: its delivery says how that went.
#[utoipa::path(
    post, path = "/v1/webhooks/{id}/ping", tag = "webhooks", operation_id = "ping_webhook",
    params(("id" = String, Path, description = "the webhook")),
    responses(
        (status = 202, body = Delivery, description = "it will be told"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is none"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "it is disabled"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "busy, or a store that does not answer"),
    )
)]
pub async fn ping(
    State(api): State<Api>,
    access: Access,
    Path(id): Path<String>,
) -> Result<(StatusCode, Json<Delivery>), Problem> {
    let webhook = find(&api, &access, &id).await?;
    let told = deliveries::ping(&api.storage.records, &access.tenant, &id).await?;
    let told = told.ok_or_else(|| Problem::webhook_disabled(webhook.disabled_why.as_deref().unwrap_or("just now")))?;
    api.dispatcher.wake();
    Ok((StatusCode::ACCEPTED, Json(told.into())))
}
