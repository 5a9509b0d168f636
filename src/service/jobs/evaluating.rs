//! A claimed evaluation: what it needs from the stores, and its computation.

use super::estimate::planned;
use super::evaluation::JobEvaluation;
use super::query;
use super::queue::Claim;
use crate::storage;
use crate::storage::Storage;
use pipeline::{Artifact, Error, EvaluationForm, EvaluationRequest, Limits, MODEL_FILES, Watch};
use std::io;

/// The files of a model, and what is asked of it.
pub struct Evaluation {
    files: [Vec<u8>; 2],
    request: EvaluationRequest,
    form: EvaluationForm,
}

impl Evaluation {
    /// What `claim` asks for, as its row has it in `stored`.
    ///
    /// # Errors
    /// The model is gone; a store does not answer; the row is damaged.
    pub async fn load(storage: &Storage, claim: &Claim, stored: &str) -> Result<Evaluation, Error> {
        let JobEvaluation { job, evaluation } =
            serde_json::from_str(stored).map_err(|error| Error::Internal(format!("a stored evaluation: {error}")))?;
        let (form, request) = (evaluation.format.form(), planned(&evaluation)?);
        let gone = || {
            let found =
                format!("The job {job}, whose model is to be evaluated, was deleted before the evaluation began.");
            Error::refused("evaluation.model_gone", found, "Build the model again, and evaluate that.")
        };
        query::get(&storage.records, &claim.tenant, &job).await.map_err(away)?.ok_or_else(gone)?;
        let mut files = [Vec::new(), Vec::new()];
        for (file, name) in files.iter_mut().zip(MODEL_FILES) {
            let known = query::artifact_named(&storage.records, &job, name).await.map_err(away)?.ok_or_else(gone)?;
            pipeline::check_model_size(name, known.byte_count)?;
            *file = match storage.blobs.read(&known.blob, 0..known.byte_count).await {
                Ok(bytes) => bytes.to_vec(),
                // Deleted since: its rows go before its blobs.
                Err(storage::Error::MissingBlob(_))
                    if query::get(&storage.records, &claim.tenant, &job).await.map_err(away)?.is_none() =>
                {
                    return Err(gone());
                }
                Err(error) => return Err(away(error)),
            };
        }
        Ok(Evaluation { files, request, form })
    }

    /// Computes it. Blocks.
    ///
    /// # Errors
    /// The model cannot be read, or cannot answer the request.
    pub fn run(&self, limits: &Limits, watch: &dyn Watch) -> Result<Artifact, Error> {
        let [emitter, goniograms] = &self.files;
        let model = pipeline::read_model(emitter, goniograms, limits).map_err(of_stored)?;
        pipeline::evaluate(&model, &self.request, self.form, watch)
    }
}

/// A file that this service wrote and cannot read is its own fault.
pub fn of_stored(error: Error) -> Error {
    match error {
        Error::Malformed(found) => Error::Internal(format!("a stored model cannot be read: {found:?}")),
        other => other,
    }
}

fn away(error: storage::Error) -> Error {
    Error::Unreadable(io::Error::other(error))
}
