//! All routes in one list, and the middleware before them.

/// What handlers take from a request.
pub mod extract;
/// API keys and scopes of requests.
pub mod authorize;
/// Headers that change what a request means.
pub mod headers;
/// Limits on simultaneous requests, their time and their space.
pub mod load;
/// Errors as clients see them.
pub mod problem;
/// The address of a request and the links in its answer.
pub mod addresses;
/// Answers that are sent compressed.
mod compression;
/// Conditional and partial requests.
pub mod ranges;
/// Ray files.
pub mod ray_sets;
/// Resumable uploads.
pub mod uploads;
/// The headers of the protocol tus.
pub mod tus;
/// Fetching ray files from URLs.
pub mod fetch;
/// The query parameters of uploads.
pub mod upload_request;
/// Spectra of channels.
pub mod spectra;
/// Jobs: listing, reading and deleting them.
pub mod jobs;
/// Submitting jobs.
pub mod submission;
/// Waiting for jobs, and the stream of their progress.
pub mod events;
/// Files as answers.
mod files;
/// The artifacts of jobs.
pub mod artifacts;
/// New rays from the models of jobs.
pub mod rays;
/// Evaluations of the models of jobs.
pub mod evaluations;
/// Models of jobs combined.
mod combinations;
/// Models as renderers open them.
mod adapters;
/// Webhooks.
pub mod webhooks;
/// Deliveries of webhooks.
pub mod deliveries;
/// Health and readiness.
pub mod health;
/// The check of the stores for readiness.
pub mod readiness;
/// Metrics.
pub mod metrics;
/// Descriptions that every route shares in the OpenAPI contract.
pub mod openapi;
/// Files that do not change while this process runs.
mod fixed;
/// The contract, for programs and for people.
pub mod docs;
/// The pages for people: from a dropped file to a model one can look at.
pub mod portal;
/// A job as its clients see it.
mod job;
/// The state that every handler can use.
pub mod api;

use crate::accounts::access::Scope;
use crate::forwarded::Peer;
use crate::jobs::outbox::EndedJob;
use crate::webhooks::Message;
use api::Api;
use authorize::{RATE_LIMIT, RATE_LIMIT_POLICY, needs, needs_one_of, needs_only};
use axum::extract::Request;
use axum::http::{HeaderName, HeaderValue, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Extension, Router, middleware};
use load::{account_body, can_be_full, limit_concurrency, limit_unless_waiting, require_free_space, with_timeout};
use problem::Problem;
use std::any::Any;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Semaphore;
use tower::ServiceBuilder;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::classify::ServerErrorsFailureClass;
use tower_http::cors::{AllowHeaders, AllowOrigin, CorsLayer};
use tower_http::request_id::{MakeRequestId, PropagateRequestIdLayer, RequestId, SetRequestIdLayer};
use tower_http::set_header::SetResponseHeaderLayer;
use tower_http::trace::TraceLayer;
use utoipa::OpenApi as _;
use utoipa::openapi::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// Names a request in its response and in the log.
pub const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Uploads at once: each holds a part in memory.
const UPLOADS: usize = 16;
/// Files fetched at once.
const INGESTS: usize = 8;
/// Reads at once.
const READS: usize = 256;
/// How long a browser may remember what a page of another origin may do.
const CORS_MEMORY: Duration = Duration::from_mins(10);

#[derive(utoipa::OpenApi)]
#[openapi(
    info(
        title = "Lampwright",
        description = "Turns a light source's ray file into a continuous source model. Upload a ray file, queue a job, download its artifacts. Every error is `application/problem+json` (RFC 9457) with a stable `code`.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
    ),
    tags(
        (name = "ray sets", description = "Ray files, stored as they were uploaded"),
        (name = "uploads", description = "Resumable uploads of ray files: tus 1.0.0"),
        (name = "spectra", description = "Spectra of channels, read from spectrum files"),
        (name = "jobs", description = "Computations of source models: their progress, results and problems"),
        (name = "artifacts", description = "The files that a job produced"),
        (name = "webhooks", description = "URLs that the service notifies when a job ends"),
        (name = "health", description = "State and metrics of the service"),
    ),
    components(schemas(events::JobProgress, Message<EndedJob>)),
)]
struct Contract;

/// Every route of the contract, and the scope a key needs for it.
fn routes() -> OpenApiRouter<Api> {
    use Scope::{JobsRead, JobsWrite, UploadsRead, UploadsWrite, WebhooksRead, WebhooksWrite};
    let uploads = OpenApiRouter::new()
        .routes(needs(UploadsWrite, routes!(ray_sets::upload)))
        .routes(needs(UploadsWrite, routes!(uploads::create)))
        .routes(needs(UploadsWrite, routes!(uploads::append)));
    let spectra = OpenApiRouter::new().routes(needs(UploadsWrite, routes!(spectra::upload)));
    let ingests = OpenApiRouter::new().routes(needs(UploadsWrite, routes!(fetch::ingest)));
    let reads = OpenApiRouter::new()
        .routes(needs(UploadsRead, routes!(ray_sets::list)))
        .routes(needs(UploadsRead, routes!(ray_sets::get)))
        .routes(needs(UploadsRead, routes!(ray_sets::origins)))
        .routes(needs(UploadsRead, routes!(ray_sets::far_field)))
        .routes(needs_one_of(&[UploadsRead, UploadsWrite], routes!(uploads::list)))
        .routes(needs_one_of(&[UploadsRead, UploadsWrite], routes!(uploads::get)))
        .routes(needs_one_of(&[UploadsRead, UploadsWrite], routes!(uploads::offset)))
        .routes(needs(UploadsRead, routes!(spectra::list)))
        .routes(needs(UploadsRead, routes!(spectra::get)))
        .routes(needs(JobsRead, routes!(jobs::list)))
        .routes(needs(JobsRead, routes!(artifacts::list)))
        .routes(needs(JobsRead, routes!(artifacts::download)))
        .routes(needs(JobsRead, routes!(artifacts::download_zip)))
        .routes(needs(JobsRead, routes!(rays::draw)))
        .routes(needs(JobsRead, routes!(evaluations::evaluate)))
        .routes(needs(JobsRead, routes!(combinations::combine)))
        .routes(needs(JobsRead, routes!(adapters::adapt)))
        .routes(needs(WebhooksRead, routes!(webhooks::list)))
        .routes(needs(WebhooksRead, routes!(webhooks::get)))
        .routes(needs(WebhooksRead, routes!(deliveries::list)));
    // What only writes rows; what makes room is with the relief.
    let writes = OpenApiRouter::new()
        .routes(needs(JobsWrite, routes!(submission::create)))
        .routes(needs(JobsWrite, routes!(evaluations::queue)))
        .routes(needs(WebhooksWrite, routes!(webhooks::create)))
        .routes(needs(WebhooksWrite, routes!(webhooks::change)))
        .routes(needs(WebhooksWrite, routes!(webhooks::rotate)))
        .routes(needs(WebhooksWrite, routes!(deliveries::ping)))
        .routes(needs(WebhooksWrite, routes!(deliveries::redeliver)));
    let waits = OpenApiRouter::new().routes(needs(JobsRead, routes!(jobs::get)));
    // Bounded by the watcher for as long as they last.
    let streams = OpenApiRouter::new().routes(needs(JobsRead, routes!(events::events)));
    // Always admitted: a full service must still be told to do less, and say that it lives.
    let relief = OpenApiRouter::new()
        .routes(needs_only(UploadsWrite, routes!(ray_sets::delete)))
        .routes(needs_only(UploadsWrite, routes!(uploads::delete)))
        .routes(needs_only(UploadsWrite, routes!(spectra::delete)))
        .routes(needs_only(WebhooksWrite, routes!(webhooks::delete)))
        .routes(needs_only(JobsWrite, routes!(job::cancel)))
        .routes(needs_only(JobsWrite, routes!(jobs::delete)));
    let places = |at_once| Arc::new(Semaphore::new(at_once));
    let reading = places(READS);
    OpenApiRouter::with_openapi(Contract::openapi())
        .merge(limit_concurrency(account_body(uploads), &places(UPLOADS)))
        .merge(limit_concurrency(require_free_space(ingests), &places(INGESTS)))
        .merge(limit_concurrency(with_timeout(account_body(spectra)), &places(UPLOADS)))
        .merge(limit_concurrency(with_timeout(reads), &reading))
        .merge(limit_concurrency(with_timeout(require_free_space(writes)), &reading))
        .merge(limit_unless_waiting(waits, &reading))
        .merge(with_timeout(streams))
        .merge(with_timeout(watch().merge(can_be_full(relief))))
}

/// Routes for monitoring, which every process has.
fn watch() -> OpenApiRouter<Api> {
    OpenApiRouter::new()
        .routes(headers::honoured(routes!(health::live)))
        .routes(headers::honoured(routes!(health::ready)))
        .routes(needs_only(Scope::MetricsRead, routes!(metrics::text)))
}

/// The router of a process that answers clients.
pub fn router(api: Api) -> Router {
    let (router, _) = routes().split_for_parts();
    let router = router
        .route("/openapi.json", get(docs::contract))
        .route("/", get(portal::page))
        .route("/portal/sample.tm25ray", get(portal::sample))
        .route("/portal/{version}/{name}", get(portal::file))
        .route("/docs", get(docs::index))
        .route("/docs/", get(docs::first_page))
        .route("/docs/{*path}", get(docs::file));
    dressed(router, api)
}

/// The router of a process that only computes jobs: health checks and metrics.
pub fn health_router(api: Api) -> Router {
    dressed(with_timeout(watch()).split_for_parts().0, api)
}

/// Adds the middleware that every route has.
fn dressed(router: Router<Api>, api: Api) -> Router {
    let layers = ServiceBuilder::new()
        .layer(SetRequestIdLayer::new(REQUEST_ID, NewRequestId))
        .layer(TraceLayer::new_for_http().make_span_with(span).on_failure(failed))
        .layer(PropagateRequestIdLayer::new(REQUEST_ID))
        .layer(middleware::from_fn(compression::tagged))
        .layer(compression::layer())
        .layer(default_header(header::X_CONTENT_TYPE_OPTIONS, "nosniff"))
        .layer(default_header(header::CONTENT_SECURITY_POLICY, "default-src 'none'; frame-ancestors 'none'; sandbox"))
        .layer(default_header(header::REFERRER_POLICY, "no-referrer"))
        .layer(default_header(HeaderName::from_static("cross-origin-resource-policy"), "same-origin"))
        .layer(default_header(header::CACHE_CONTROL, "no-store"))
        .layer(middleware::from_fn_with_state(api.clone(), addresses::known))
        .layer(middleware::from_fn_with_state(api.clone(), tus::speak))
        .option_layer(pages_from(&api.origins))
        .layer(Extension(api.clone()))
        .layer(middleware::from_fn_with_state(api.clone(), metrics::counted))
        .layer(CatchPanicLayer::custom(panicked));
    let routes = router
        .fallback(async |uri: Uri| Problem::no_route(uri.path()))
        .method_not_allowed_fallback(async |method: Method| Problem::method_not_allowed(method.as_str()))
        .layer(layers)
        .with_state(api);
    // What stands around a router stands before it has chosen a route.
    let before = ServiceBuilder::new()
        .layer(middleware::map_request(addresses::without_slash))
        .layer(middleware::map_request(tus::override_method));
    Router::new().fallback_service(routes).layer(before)
}

/// The contract as it is committed: `openapi/openapi.json`.
pub fn openapi() -> String {
    let mut contract: OpenApi = routes().split_for_parts().1;
    authorize::document_scheme(&mut contract);
    openapi::complete(&mut contract);
    let mut text = contract.to_pretty_json().unwrap_or_default();
    text.push('\n');
    text
}

fn panicked(payload: Box<dyn Any + Send>) -> Response {
    let text = payload.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or("no message");
    tracing::error!(panic = text, "a handler panicked");
    Problem::internal().into_response()
}

fn default_header(name: HeaderName, value: &'static str) -> SetResponseHeaderLayer<HeaderValue> {
    SetResponseHeaderLayer::if_not_present(name, HeaderValue::from_static(value))
}

/// What every log line of a request carries; tenant and key once they are known.
fn span(request: &Request) -> tracing::Span {
    let id = request.headers().get(REQUEST_ID).and_then(|id| id.to_str().ok()).unwrap_or_default();
    let peer = request.extensions().get::<Peer>().map(|peer| tracing::field::display(*peer));
    let (method, path) = (request.method(), request.uri().path());
    let (tenant, key) = (tracing::field::Empty, tracing::field::Empty);
    tracing::info_span!("request", %method, path, id, peer, tenant, key)
}

/// Logs an answer with a status of 5xx. 503 and 507 refuse what may succeed later: the service stops, is busy or has no room, or a store
/// does not answer, which is logged as an error where it is found.
fn failed(failure: ServerErrorsFailureClass, took: Duration, _: &tracing::Span) {
    match failure {
        ServerErrorsFailureClass::StatusCode(
            status @ (StatusCode::SERVICE_UNAVAILABLE | StatusCode::INSUFFICIENT_STORAGE),
        ) => tracing::warn!(%status, ?took, "a request was refused; it may succeed later"),
        failure => tracing::error!(%failure, ?took, "a request failed"),
    }
}

/// What pages of other origins may do, if any may.
fn pages_from(origins: &[String]) -> Option<CorsLayer> {
    let known: Vec<HeaderValue> = origins.iter().filter_map(|origin| HeaderValue::from_str(origin).ok()).collect();
    let methods = [Method::GET, Method::HEAD, Method::POST, Method::PATCH, Method::PUT, Method::DELETE];
    let seen = [
        header::LOCATION,
        header::ETAG,
        header::RETRY_AFTER,
        header::CONTENT_RANGE,
        header::CONTENT_DISPOSITION,
        RATE_LIMIT,
        RATE_LIMIT_POLICY,
        REQUEST_ID,
    ];
    let layer = CorsLayer::new().allow_origin(AllowOrigin::list(known)).allow_methods(methods);
    let seen: Vec<HeaderName> = seen.into_iter().chain(tus::SEEN).collect();
    let layer = layer.allow_headers(AllowHeaders::mirror_request()).expose_headers(seen).max_age(CORS_MEMORY);
    (!origins.is_empty()).then_some(layer)
}

/// A fresh name for every request that comes without one.
#[derive(Clone, Copy)]
struct NewRequestId;

impl MakeRequestId for NewRequestId {
    fn make_request_id<B>(&mut self, _request: &axum::http::Request<B>) -> Option<RequestId> {
        HeaderValue::try_from(crate::storage::keys::new_id()).ok().map(RequestId::new)
    }
}
