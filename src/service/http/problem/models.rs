//! Problems of what is made of a model while a client waits.

use super::Problem;
use axum::http::StatusCode;
use pipeline::Renderer;

impl Problem {
    /// An evaluation takes longer than an answer may.
    pub fn evaluation_too_long() -> Problem {
        let (status, title) = (StatusCode::UNPROCESSABLE_ENTITY, "The evaluation takes too long");
        let detail = "The evaluation was not done after 20 s, which is as long as an answer may take.";
        Problem::new(status, "evaluation.too_long", title, detail).remedy(
            "Ask for fewer cells, fewer samples or a larger tolerance, or for a job (POST /v1/evaluations); or use the command lampwright evaluate.",
        )
    }

    /// A combination takes longer than an answer may.
    pub fn combination_too_long() -> Problem {
        let (status, title) = (StatusCode::UNPROCESSABLE_ENTITY, "The combination takes too long");
        let detail = "The models were not combined after 20 s, which is as long as an answer may take.";
        Problem::new(status, "combination.too_long", title, detail)
            .remedy("Combine fewer models, or use the command lampwright combine.")
    }

    /// What only models have is asked of `job`, which is an evaluation of the model of job `of`.
    pub fn of_evaluation(job: &str, of: &str) -> Problem {
        let detail = format!(
            "The job {job} is an evaluation of the model of job {of}: it makes one file of numbers, and no model."
        );
        Problem::new(StatusCode::NOT_FOUND, "evaluation.no_model", "An evaluation is no model", detail)
            .remedy(format!("Ask for this of job {of}. The file of the evaluation is at /v1/jobs/{job}/artifacts."))
    }

    /// No files are made for this renderer.
    pub fn no_renderer(name: &str) -> Problem {
        let detail = format!("No files are made for {name:?}.");
        Problem::new(StatusCode::NOT_FOUND, "adapter.not_found", "No such renderer", detail)
            .remedy(format!("Name one of {}.", Renderer::ALL.map(Renderer::name).join(", ")))
    }
}
