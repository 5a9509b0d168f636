//! `/metrics`, and what is counted of every request.

use super::api::Api;
use super::problem::Problem;
use crate::jobs::query;
use crate::metrics::{Backlog, Exposition};
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::time::Instant;

/// Returns the metrics of this process and of the job queue
///
/// The format is Prometheus' text format, or OpenMetrics where `Accept` asks for it, as Prometheus does. The metrics
/// `lampwright_oldest_queued_seconds` and `lampwright_overdue_jobs` show whether the queue is stuck.
#[utoipa::path(
    get, path = "/metrics", tag = "health", operation_id = "metrics",
    responses(
        (status = 200, description = "the metrics",
            content((String = "text/plain"), (String = "application/openmetrics-text"))),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the database or the object store does not answer"),
    )
)]
pub async fn text(State(api): State<Api>, headers: HeaderMap) -> Result<Response, Problem> {
    let exposition = wanted(&headers);
    let backlog = query::backlog(&api.storage.records).await?;
    let backlog = Backlog { too_large: api.queue.too_large().await?, ..backlog };
    let text = api.metrics.text(exposition, &backlog, api.space.free_bytes());
    let about = [(header::CONTENT_TYPE, exposition.media_type()), (header::VARY, header::ACCEPT.as_str())];
    Ok((about, text).into_response())
}

/// OpenMetrics only for who names it: what takes anything may read nothing but the older format.
fn wanted(headers: &HeaderMap) -> Exposition {
    let accepted = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let named = accepted.flat_map(|value| value.split(',')).any(|range| {
        let mut words = range.split(';').map(str::trim);
        let is_named = words.next().is_some_and(|name| name.eq_ignore_ascii_case("application/openmetrics-text"));
        is_named && !words.any(|word| matches!(word, "q=0" | "q=0.0" | "q=0.00" | "q=0.000"))
    });
    if named { Exposition::OpenMetrics } else { Exposition::Text }
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

/// A method may be any word; only the methods that HTTP defines get a label of their own.
fn known(method: &Method) -> &'static str {
    let all = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"];
    all.into_iter().find(|known| *known == method.as_str()).unwrap_or("other")
}
