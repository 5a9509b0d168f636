//! `/metrics`, and what is counted of every request.

use super::super::jobs::query::{self, Backlog};
use super::super::metrics::MEDIA_TYPE;
use super::Api;
use super::problem::Problem;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::time::Instant;

/// Tells the numbers of this process and of the queue
///
/// In Prometheus' text format. `lampwright_oldest_queued_seconds` and `lampwright_overdue_jobs` answer whether it is stuck.
#[utoipa::path(
    get, path = "/metrics", tag = "health", operation_id = "metrics",
    responses(
        (status = 200, body = String, content_type = "application/openmetrics-text", description = "the numbers"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "a store that does not answer"),
    )
)]
pub async fn text(State(api): State<Api>) -> Result<Response, Problem> {
    let backlog = query::backlog(&api.storage.records).await?;
    let backlog = Backlog { too_large: api.queue.too_large().await?, ..backlog };
    let text = api.metrics.text(&backlog, api.space.free_bytes());
    Ok(([(header::CONTENT_TYPE, MEDIA_TYPE)], text).into_response())
}

/// Counts a request by the route that answered it.
pub async fn counted(State(api): State<Api>, request: Request, next: Next) -> Response {
    let begun = Instant::now();
    let method = known(request.method());
    let route = request.extensions().get::<MatchedPath>().cloned();
    let response = next.run(request).await;
    let route = route.as_ref().map_or("none", MatchedPath::as_str);
    api.metrics.answered(method, route, response.status().as_u16(), begun.elapsed());
    response
}

/// A method may be any word; only those that mean something here are told apart.
fn known(method: &Method) -> &'static str {
    let all = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"];
    all.into_iter().find(|known| *known == method.as_str()).unwrap_or("other")
}
