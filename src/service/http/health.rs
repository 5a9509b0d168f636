//! `/healthz`: the process lives. `/readyz`: it can do its work.

use super::api::Api;
use super::problem::Problem;
use super::readiness::STORES;
use axum::Json;
use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

/// That the service is well.
#[derive(Serialize, ToSchema)]
pub struct Health {
    /// "ok".
    status: &'static str,
    /// Of the service.
    version: &'static str,
}

const WELL: Health = Health { status: "ok", version: env!("CARGO_PKG_VERSION") };

/// Tells that the process lives
#[utoipa::path(
    get, path = "/healthz", tag = "health", operation_id = "health",
    responses((status = 200, body = Health, description = "it does"))
)]
pub async fn live() -> Json<Health> {
    Json(WELL)
}

/// Tells whether the service can do its work
///
/// What is written to the database is there for others, the object store takes bytes, local disks have the room that is kept
/// free, and it is not stopping.
#[utoipa::path(
    get, path = "/readyz", tag = "health", operation_id = "ready",
    responses(
        (status = 200, body = Health, description = "it can"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "it cannot"),
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
