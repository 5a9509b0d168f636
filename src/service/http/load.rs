//! Limits on requests: how many are processed at the same time, how long they may take, and whether there is storage space for
//! their bodies.

use super::api::Api;
use super::events::Waiting;
use super::openapi::{can_fail, operations};
use super::problem::Problem;
use crate::ray_sets;
use axum::BoxError;
use axum::body::Body;
use axum::error_handling::HandleErrorLayer;
use axum::extract::{Query, Request};
use axum::http::{Uri, header};
use axum::middleware::{Next, from_fn};
use axum::response::IntoResponse;
use bytes::Bytes;
use futures::StreamExt;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Semaphore;
use tokio::task::yield_now;
use tokio::time::timeout;
use tower::ServiceBuilder;
use tower::limit::GlobalConcurrencyLimitLayer;
use tower::load_shed::LoadShedLayer;
use tower::load_shed::error::Overloaded;
use tower::timeout::TimeoutLayer;
use tower::timeout::error::Elapsed;
use utoipa_axum::router::OpenApiRouter;

/// Longest time until a response begins; an upload's is bounded by its pace, not its length.
const PATIENCE: Duration = Duration::from_secs(30);

/// After so many bytes of a body, other requests get their turn. A sender on a fast network is never waited for: what is done with
/// its bytes would keep a thread, and all who wait for it, for as long as the system has more of them.
const TURN_BYTES: usize = 128 << 10;

/// Limits the number of simultaneous requests to these routes together to the number of `places`; a further request is refused
/// with 503.
pub fn limit_concurrency(routes: OpenApiRouter<Api>, places: &Arc<Semaphore>) -> OpenApiRouter<Api> {
    let layers = ServiceBuilder::new()
        .layer(HandleErrorLayer::new(refused))
        .layer(LoadShedLayer::new())
        .layer(GlobalConcurrencyLimitLayer::with_semaphore(Arc::clone(places)));
    routes.layer(layers)
}

/// Whether a request asks to wait; what cannot be read waits for nothing.
fn waits(uri: &Uri) -> bool {
    Query::<Waiting>::try_from_uri(uri).is_ok_and(|Query(waiting)| !waiting.is_none())
}

/// As [`limit_concurrency`] and [`with_timeout`], except for requests that wait for a change (`?wait=`): the watcher of jobs
/// limits these, so that they do not take the places of other requests.
pub fn limit_unless_waiting(routes: OpenApiRouter<Api>, places: &Arc<Semaphore>) -> OpenApiRouter<Api> {
    let places = Arc::clone(places);
    routes.layer(from_fn(move |request: Request, next: Next| {
        let places = Arc::clone(&places);
        async move {
            if waits(request.uri()) {
                return next.run(request).await;
            }
            let Ok(_place) = places.try_acquire() else { return Problem::busy().into_response() };
            match timeout(PATIENCE, next.run(request)).await {
                Ok(response) => response,
                Err(_) => Problem::timeout().into_response(),
            }
        }
    }))
}

/// Refuses requests to these routes with 504 when their response has not begun after [`PATIENCE`].
pub fn with_timeout(mut routes: OpenApiRouter<Api>) -> OpenApiRouter<Api> {
    for operation in operations(&mut routes.get_openapi_mut().paths) {
        can_fail(operation, "504", "the service did not answer in time");
    }
    routes.layer(ServiceBuilder::new().layer(HandleErrorLayer::new(refused)).layer(TimeoutLayer::new(PATIENCE)))
}

/// Adds the response 507 to the contract of these routes, which write data.
pub fn can_be_full(mut routes: OpenApiRouter<Api>) -> OpenApiRouter<Api> {
    for operation in operations(&mut routes.get_openapi_mut().paths) {
        can_fail(operation, "507", "the service has no storage space for this");
    }
    routes
}

/// Refuses requests to these routes, which write rows, while the free storage space is below the reserved limit.
pub fn require_free_space(routes: OpenApiRouter<Api>) -> OpenApiRouter<Api> {
    can_be_full(routes).layer(from_fn(|request: Request, next: Next| async move {
        match request.extensions().get::<Api>().map(|api| api.space.has_room_for(0)) {
            Some(true) => next.run(request).await,
            Some(false) => Problem::low_space().into_response(),
            None => Problem::internal().into_response(),
        }
    }))
}

/// Checks that there is storage space for the bodies of these routes, and counts their bytes in the metrics as they arrive.
pub fn account_body(routes: OpenApiRouter<Api>) -> OpenApiRouter<Api> {
    can_be_full(routes).layer(from_fn(|request: Request, next: Next| async move {
        match room(request) {
            Ok(request) => next.run(request).await,
            Err(problem) => problem.into_response(),
        }
    }))
}

fn room(request: Request) -> Result<Request, Problem> {
    let Some(api) = request.extensions().get::<Api>().cloned() else { return Err(Problem::internal()) };
    let announced = request.headers().get(header::CONTENT_LENGTH).and_then(|bytes| bytes.to_str().ok()?.parse().ok());
    // More space would not make such a body welcome.
    if announced.is_some_and(|bytes| bytes > api.intake.max_bytes) {
        return Err(ray_sets::Error::TooLarge(api.intake.max_bytes).into());
    }
    if !api.space.has_room_for(announced.unwrap_or(0)) {
        return Err(Problem::low_space());
    }
    let (at_hand, metrics) = (api.metrics.upload(), api.metrics.clone());
    Ok(request.map(|body| {
        let mut since_turn = 0;
        let counted = body.into_data_stream().then(move |piece| {
            // The upload is at hand as long as its body is.
            let _at_hand = &at_hand;
            let count = piece.as_ref().map_or(0, |bytes: &Bytes| bytes.len());
            metrics.upload_bytes(count as u64);
            since_turn += count;
            let is_over = since_turn >= TURN_BYTES;
            if is_over {
                since_turn = 0;
            }
            async move {
                if is_over {
                    yield_now().await;
                }
                piece
            }
        });
        Body::from_stream(counted)
    }))
}

async fn refused(error: BoxError) -> Problem {
    if error.is::<Overloaded>() {
        Problem::busy()
    } else if error.is::<Elapsed>() {
        Problem::timeout()
    } else {
        tracing::error!(%error, "a middleware layer failed");
        Problem::internal()
    }
}
