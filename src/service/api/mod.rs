//! Every route, in one list, and what stands before them.

/// What handlers take from a request.
pub mod extract;
/// Errors as clients see them.
pub mod problem;
/// Conditional and partial requests.
pub mod ranges;
/// Ray files.
pub mod ray_sets;
/// Spectra of channels.
pub mod spectra;
/// What is to be computed.
pub mod jobs;
/// What a job gave.
pub mod artifacts;
/// Whether the service lives and works.
pub mod health;
/// The contract, for programs and for people.
pub mod docs;

use super::jobs::queue::Queue;
use super::storage::Storage;
use super::upload::Intake;
use axum::error_handling::HandleErrorLayer;
use axum::extract::Request;
use axum::http::{HeaderName, HeaderValue, Method, Uri, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{BoxError, Router};
use problem::Problem;
use std::any::Any;
use std::time::Duration;
use tokio_util::sync::CancellationToken;
use tower::ServiceBuilder;
use tower::limit::GlobalConcurrencyLimitLayer;
use tower::load_shed::{LoadShedLayer, error::Overloaded};
use tower::timeout::{TimeoutLayer, error::Elapsed};
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::request_id::{MakeRequestId, PropagateRequestIdLayer, RequestId, SetRequestIdLayer};
use tower_http::set_header::SetResponseHeaderLayer;
use tower_http::trace::TraceLayer;
use utoipa::openapi::OpenApi;
use utoipa::{OpenApi as _, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// Names a request in its response and in the log.
pub const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Uploads at once: each holds a part in memory.
const UPLOADS: usize = 16;
/// Reads at once.
const READS: usize = 256;
/// Longest time until a response begins; an upload's is bounded by its silence, not its length.
const PATIENCE: Duration = Duration::from_secs(30);

/// What handlers work with. Cheap to clone.
#[derive(Clone)]
pub struct Api {
    /// Rows and blobs.
    pub storage: Storage,
    /// Jobs.
    pub queue: Queue,
    /// Takes ray files in.
    pub intake: Intake,
    /// The service is stopping.
    pub draining: CancellationToken,
}

/// The bytes of a file.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
pub struct Binary(#[expect(dead_code, reason = "a schema, never a value")] Vec<u8>);

#[derive(utoipa::OpenApi)]
#[openapi(
    info(
        title = "Lampwright",
        description = "Turns a light source's ray file into a continuous source model. Upload a ray file, queue a job, download what it gives. Every error is `application/problem+json` (RFC 9457) with a stable `code`.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
    ),
    tags(
        (name = "ray sets", description = "Ray files, as they came"),
        (name = "spectra", description = "Spectra of channels, from files of their own"),
        (name = "jobs", description = "What is to be computed, how far it is, and why it failed"),
        (name = "artifacts", description = "What a job gave"),
        (name = "health", description = "Whether the service lives and works"),
    )
)]
struct Contract;

/// Every route of the contract.
fn routes() -> OpenApiRouter<Api> {
    let uploads = OpenApiRouter::new().routes(routes!(ray_sets::upload));
    let reads = OpenApiRouter::new()
        .routes(routes!(ray_sets::list))
        .routes(routes!(ray_sets::get))
        .routes(routes!(ray_sets::origins))
        .routes(routes!(ray_sets::far_field))
        .routes(routes!(spectra::upload))
        .routes(routes!(spectra::list))
        .routes(routes!(spectra::get))
        .routes(routes!(jobs::create))
        .routes(routes!(jobs::list))
        .routes(routes!(jobs::get))
        .routes(routes!(artifacts::list))
        .routes(routes!(artifacts::download))
        .routes(routes!(artifacts::download_zip));
    // Always admitted: a full service must still be told to do less, and say that it lives.
    let relief = OpenApiRouter::new()
        .routes(routes!(ray_sets::delete))
        .routes(routes!(spectra::delete))
        .routes(routes!(jobs::cancel))
        .routes(routes!(jobs::delete))
        .routes(routes!(health::live))
        .routes(routes!(health::ready));
    OpenApiRouter::with_openapi(Contract::openapi())
        .merge(admit(uploads, UPLOADS))
        .merge(admit(patient(reads), READS))
        .merge(patient(relief))
}

/// The service's face.
pub fn router(api: Api) -> Router {
    let (router, _) = routes().split_for_parts();
    let router = router
        .route("/openapi.json", get(docs::contract))
        .route("/", get(docs::front))
        .route("/docs", get(docs::index))
        .route("/docs/", get(docs::first_page))
        .route("/docs/{*path}", get(docs::file));
    dressed(router, api)
}

/// The face of a process that only computes: whether it is well.
pub fn health_router(api: Api) -> Router {
    dressed(Router::new().route("/healthz", get(health::live)).route("/readyz", get(health::ready)), api)
}

/// What stands before every route.
fn dressed(router: Router<Api>, api: Api) -> Router {
    let layers = ServiceBuilder::new()
        .layer(SetRequestIdLayer::new(REQUEST_ID, NewRequestId))
        .layer(TraceLayer::new_for_http().make_span_with(span))
        .layer(PropagateRequestIdLayer::new(REQUEST_ID))
        .layer(default_header(header::X_CONTENT_TYPE_OPTIONS, "nosniff"))
        .layer(default_header(header::CONTENT_SECURITY_POLICY, "default-src 'none'; frame-ancestors 'none'; sandbox"))
        .layer(default_header(header::REFERRER_POLICY, "no-referrer"))
        .layer(default_header(HeaderName::from_static("cross-origin-resource-policy"), "same-origin"))
        .layer(default_header(header::CACHE_CONTROL, "no-store"))
        .layer(CatchPanicLayer::custom(panicked));
    router
        .fallback(async |uri: Uri| Problem::no_route(uri.path()))
        .method_not_allowed_fallback(async |method: Method| Problem::method_not_allowed(method.as_str()))
        .layer(layers)
        .with_state(api)
}

/// The contract as it is committed: `openapi/openapi.json`.
pub fn openapi() -> String {
    let mut contract: OpenApi = routes().split_for_parts().1;
    // The router's wildcard is no placeholder in OpenAPI.
    let paths = std::mem::take(&mut contract.paths.paths);
    contract.paths.paths = paths.into_iter().map(|(path, item)| (path.replace("{*", "{"), item)).collect();
    let mut text = contract.to_pretty_json().unwrap_or_default();
    text.push('\n');
    text
}

/// At most `at_once` requests to these routes together; one more is told to come back.
fn admit(routes: OpenApiRouter<Api>, at_once: usize) -> OpenApiRouter<Api> {
    let layers = ServiceBuilder::new()
        .layer(HandleErrorLayer::new(refused))
        .layer(LoadShedLayer::new())
        .layer(GlobalConcurrencyLimitLayer::new(at_once));
    routes.layer(layers)
}

/// No request to these routes takes longer than [`PATIENCE`] to begin its response.
fn patient(routes: OpenApiRouter<Api>) -> OpenApiRouter<Api> {
    routes.layer(ServiceBuilder::new().layer(HandleErrorLayer::new(refused)).layer(TimeoutLayer::new(PATIENCE)))
}

async fn refused(error: BoxError) -> Problem {
    if error.is::<Overloaded>() {
        Problem::busy()
    } else if error.is::<Elapsed>() {
        Problem::timeout()
    } else {
        tracing::error!(%error, "a layer failed");
        Problem::internal()
    }
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

fn span(request: &Request) -> tracing::Span {
    let id = request.headers().get(REQUEST_ID).and_then(|id| id.to_str().ok()).unwrap_or_default();
    tracing::info_span!("request", method = %request.method(), path = request.uri().path(), id)
}

/// A fresh name for every request that comes without one.
#[derive(Clone, Copy)]
struct NewRequestId;

impl MakeRequestId for NewRequestId {
    fn make_request_id<B>(&mut self, _request: &axum::http::Request<B>) -> Option<RequestId> {
        HeaderValue::try_from(super::storage::new_id()).ok().map(RequestId::new)
    }
}
