//! `/v1/combinations`: models of jobs changed, and several as one, without their rays.

use super::api::Api;
use super::extract::Body;
use super::files::whole;
use super::problem::Problem;
use super::rays::model_files;
use super::upload_request::MAX_NAME_CHARS;
use crate::accounts::access::Access;
use crate::jobs::evaluation::NumberTriple;
use crate::jobs::request::{SpectrumChoice, TotalFlux};
use crate::models::combination::{Made, Wanted};
use crate::spectra;
use axum::extract::State;
use axum::response::Response;
use pipeline::{Change, Error, Place, Strength, Table, Turn, Vector};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Most models in one request.
const MOST_MODELS: usize = 8;
/// Most turns of a model.
const MOST_TURNS: usize = 16;
/// Name of the answer.
const NAME: &str = "model.zip";

/// Models that are to be one.
#[derive(Clone, Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewCombination {
    /// The models, in one common coordinate frame, with what is changed of each.
    #[schema(min_items = 1, max_items = 8)]
    pub models: Vec<ChangedModel>,
}

/// The model of a job, and what is changed of it: first its spectrum, then its flux, then it is turned, then moved. Fields that are left out change nothing.
#[derive(Clone, Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ChangedModel {
    /// Identifier of the job. A job may be named more than once.
    #[schema(format = Uuid)]
    pub job: String,
    /// What it is called in the report. Default: as its files say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_length = 1, max_length = 255, example = "left")]
    pub name: Option<String>,
    /// The spectrum that all of its light gets: its W stay, and its lm follow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spectrum: Option<SpectrumChoice>,
    /// What its flux is multiplied by; not beside flux.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(exclusive_minimum = 0.0)]
    pub scale: Option<f64>,
    /// What its flux is to be, W or lm; the other goes along.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flux: Option<TotalFlux>,
    /// Turns about axes through the origin, in their order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(max_items = 16)]
    pub turns: Option<Vec<ModelTurn>>,
    /// How far it is moved, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<NumberTriple>)]
    pub move_mm: Option<[f64; 3]>,
}

/// A turn about an axis through the origin, counter-clockwise as seen from where the axis points to.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelTurn {
    /// The axis in the source frame, of any length but 0.
    #[schema(value_type = NumberTriple)]
    pub axis: [f64; 3],
    /// By how much.
    pub degrees: f64,
}

impl ChangedModel {
    /// In the pipeline's words; `index` is its place among the models, `spectrum` what it names.
    fn change(&self, index: usize, spectrum: Option<Table>) -> Result<Change, Problem> {
        let strength = match (self.scale, self.flux) {
            (Some(_), Some(_)) => {
                let found = "A model has a scale and a flux.";
                let (place, remedy) = (Place::Model(index, "scale"), "Give one of the two.");
                return Err(Error::invalid_declaration("combination.change", place, found, remedy).into());
            }
            (scale, flux) => scale.map(Strength::Factor).or(flux.map(|flux| Strength::Flux(flux.total()))),
        };
        let turn = |turn: &ModelTurn| Turn { axis: Vector::from_array(turn.axis), degrees: turn.degrees };
        let turns = self.turns.iter().flatten().map(turn).collect();
        Ok(Change { spectrum, strength, turns, move_mm: Vector::from_array(self.move_mm.unwrap_or_default()) })
    }
}

/// Combines models of jobs
///
/// Changes the models of jobs and makes them one, without their rays: their fluxes are scaled, they are turned and moved, and their light adds
/// up. The answer is a model.zip with every file of the whole; `report.json` says what it was made of. Nothing is stored, so the request can be
/// repeated. The files of all models together may have 64 MiB, and an answer takes about 20 s at most; `lampwright combine` makes what is larger.
#[utoipa::path(
    post, path = "/v1/combinations", tag = "artifacts", operation_id = "combine_models", request_body = NewCombination,
    responses(
        (status = 200, content((inline(super::api::Binary) = "application/zip"), (inline(super::api::Binary) = "application/octet-stream")), description = "the files of the whole"),
        (status = 400, body = Problem, content_type = "application/problem+json", description = "the body is not JSON"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "there is no such job, or it has not succeeded"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "the body is too large"),
        (status = 415, body = Problem, content_type = "application/problem+json", description = "the Content-Type is not application/json"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "a field is unknown, of the wrong type or out of range; the models cannot be one; the answer would be too large or take too long"),
        (status = 503, body = Problem, content_type = "application/problem+json", description = "the service is busy or stopping, or the database or the object store does not answer"),
    )
)]
pub async fn combine(
    State(api): State<Api>,
    access: Access,
    Body(new): Body<NewCombination>,
) -> Result<Response, Problem> {
    if !(1..=MOST_MODELS).contains(&new.models.len()) {
        return Err(Problem::out_of_range("models", "from 1 to 8 models"));
    }
    in_range(&new)?;
    let mut wanted = Vec::with_capacity(new.models.len());
    for (index, model) in new.models.into_iter().enumerate() {
        let change = model.change(index, spectrum(&api, &access, index, model.spectrum.as_ref()).await?)?;
        let files = model_files(&api, &access, &model.job).await?;
        wanted.push(Wanted { files, name: model.name, change });
    }
    match api.models.combine(&access.tenant, &api.storage.blobs, wanted).await? {
        Made::Done(bytes) => Ok(whole(NAME, "application/zip", bytes)),
        Made::Busy => Err(Problem::busy()),
        Made::TooLong => Err(Problem::combination_too_long()),
        Made::Stopping => Err(Problem::draining()),
    }
}

fn in_range(new: &NewCombination) -> Result<(), Problem> {
    for (index, model) in new.models.iter().enumerate() {
        if model.name.as_ref().is_some_and(|name| name.is_empty() || name.chars().count() > MAX_NAME_CHARS) {
            return Err(Problem::out_of_range(&format!("models[{index}].name"), "1 to 255 characters long"));
        }
        if model.turns.as_ref().is_some_and(|turns| turns.len() > MOST_TURNS) {
            return Err(Problem::out_of_range(&format!("models[{index}].turns"), "a list of at most 16 turns"));
        }
    }
    Ok(())
}

/// The spectrum that model `index` is to get.
async fn spectrum(
    api: &Api,
    access: &Access,
    index: usize,
    choice: Option<&SpectrumChoice>,
) -> Result<Option<Table>, Problem> {
    let points = match choice {
        None => return Ok(None),
        Some(SpectrumChoice::NmValue(points)) => points.clone(),
        Some(SpectrumChoice::Id(id)) => {
            let found = spectra::get(&api.storage.records, &access.tenant, id).await?;
            found.ok_or_else(|| Problem::no_spectrum(id))?.points()?
        }
    };
    let table = Table::new(&points).ok_or_else(|| {
        let found = "The points do not form a valid spectrum.";
        let remedy = "Give wavelengths in nm, positive and increasing, with values of 0 or more, one of them above 0.";
        Error::invalid_declaration("combination.change", Place::Model(index, "spectrum"), found, remedy)
    })?;
    Ok(Some(table))
}
