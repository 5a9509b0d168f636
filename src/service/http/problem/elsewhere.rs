//! Problems of what this service asks elsewhere: endpoints of webhooks, files to fetch.

use super::Problem;
use crate::ray_sets::fetch;
use crate::{outbound, webhooks};
use axum::http::StatusCode;

impl Problem {
    /// No such endpoint.
    pub fn no_webhook(id: &str) -> Problem {
        let detail = format!("There is no webhook {id:?}.");
        Problem::new(StatusCode::NOT_FOUND, "webhook.not_found", "No such webhook", detail)
    }

    /// No such delivery.
    pub fn no_delivery(id: &str) -> Problem {
        let detail = format!("There is no delivery {id:?} to this webhook.");
        Problem::new(StatusCode::NOT_FOUND, "delivery.not_found", "No such delivery", detail)
            .remedy("Deliveries are known for 30 days.")
    }

    /// As many endpoints as a tenant may have.
    pub fn too_many_webhooks() -> Problem {
        let detail = format!("There are {} webhooks, which is as many as may be.", webhooks::endpoints::MOST);
        Problem::new(StatusCode::CONFLICT, "webhook.too_many", "Too many webhooks", detail)
            .remedy("Delete one that nobody needs.")
    }

    /// An endpoint that is told nothing.
    pub fn webhook_disabled(why: &str) -> Problem {
        let detail = format!("The webhook is disabled: {why}.");
        Problem::new(StatusCode::CONFLICT, "webhook.disabled", "The webhook is disabled", detail)
            .remedy("Enable it: PATCH it with {\"enabled\": true}.")
    }

    /// An address that cannot be an endpoint.
    pub fn webhook_url(error: &outbound::Error) -> Problem {
        of_address("webhook", error)
    }
}

/// An address that is not asked, or does not answer, in the words of what it was for.
fn of_address(what: &str, error: &outbound::Error) -> Problem {
    use outbound::Error;
    let (status, code, title, remedy) = match error {
        Error::Url(_) => (
            StatusCode::UNPROCESSABLE_ENTITY,
            "url",
            "The address cannot be asked",
            "Write https://host/path, without name and password.",
        ),
        Error::Refused { .. } => (
            StatusCode::UNPROCESSABLE_ENTITY,
            "address_refused",
            "The address is refused",
            "Name one on the internet; the operator can make an exception: serve --outbound-allow.",
        ),
        Error::Unreachable(_) => (
            StatusCode::BAD_GATEWAY,
            "unreachable",
            "The address does not answer",
            "Try again, or send the file itself.",
        ),
        Error::Redirects => {
            (StatusCode::BAD_GATEWAY, "redirects", "Too many redirects", "Name the address that they lead to.")
        }
    };
    Problem::new(status, format!("{what}.{code}"), title, format!("{error}.")).at("url").remedy(remedy)
}

impl From<fetch::Error> for Problem {
    fn from(error: fetch::Error) -> Problem {
        use crate::ray_sets::fetch::Error;
        let detail = format!("{error}.");
        let of = |status, code: &'static str, title: &'static str| Problem::new(status, code, title, detail).at("url");
        match error {
            Error::Off => of(StatusCode::FORBIDDEN, "ingest.off", "Nothing is fetched")
                .remedy("Send the file itself; the operator can allow it: serve --ingest on."),
            Error::Bucket(_) => of(StatusCode::UNPROCESSABLE_ENTITY, "ingest.bucket_refused", "The bucket is refused")
                .remedy("The operator can allow it: serve --ingest-bucket s3://BUCKET/PREFIX."),
            Error::Missing(_) => of(StatusCode::UNPROCESSABLE_ENTITY, "ingest.missing", "There is no such object"),
            Error::Status(_) => of(StatusCode::BAD_GATEWAY, "ingest.status", "The address gave no file")
                .remedy("Name an address that gives the file to anybody who asks, or send the file itself."),
            Error::Broken(_) => {
                of(StatusCode::BAD_GATEWAY, "ingest.broken", "The file broke off").remedy("Ask for it again.")
            }
            Error::Slow(_) => of(StatusCode::GATEWAY_TIMEOUT, "ingest.slow", "The file came too slowly")
                .remedy("Send the file itself, or put it nearer."),
            Error::Outbound(error) => of_address("ingest", &error),
            Error::Upload(error) => error.into(),
            Error::Storage(error) => error.into(),
        }
    }
}
