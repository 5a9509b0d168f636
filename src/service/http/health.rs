//! `/healthz`: the process lives. `/readyz`: it can do its work.

use super::api::Api;
use super::problem::Problem;
use super::readiness::STORES;
use axum::Json;
use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

/// The state of the service.
#[derive(Serialize, ToSchema)]
pub struct Health {
    /// Always "ok".
    status: &'static str,
    /// Version of the service.
    version: &'static str,
}

const WELL: Health = Health { status: "ok", version: env!("CARGO_PKG_VERSION") };

/// Reports that the process is alive
#[utoipa::path(
    get, path = "/healthz", tag = "health", operation_id = "health",
    responses((status = 200, body = Health, description = "the process is alive"))
)]
pub async fn live() -> Json<Health> {
    Json(WELL)
}

/// Reports whether the service is ready for requests
///
/// The service is ready when the database accepts rows, the object store accepts bytes, the local disks have the free space that
/// the operator reserved, and the service is not stopping.
#[utoipa::path(
    get, path = "/readyz", tag = "health", operation_id = "ready",
    responses(
        (status = 200, body = Health, description = "the service is ready"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is not ready; `code` and `detail` say why"),
    )
)]
pub async fn ready(State(api): State<Api>) -> Result<Json<Health>, Problem> {
    if api.draining.is_cancelled() {
        return Err(Problem::draining());
    }
    if !api.space.has_room_for(0) {
        return Err(Problem::low_space().not_ready());
    }
    let checked = api.readiness.ask(STORES).await.map_err(|error| Problem::from(error).not_ready())?;
    checked.unwrap_or(Ok(()))?;
    Ok(Json(WELL))
}
