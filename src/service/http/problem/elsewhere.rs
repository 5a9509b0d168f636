//! Problems of outbound requests: webhooks, and files to fetch.

use super::Problem;
use crate::ray_sets::fetch;
use crate::{outbound, webhooks};
use axum::http::StatusCode;

impl Problem {
    /// The problem of a webhook that does not exist.
    pub fn no_webhook(id: &str) -> Problem {
        let detail = format!("There is no webhook {id:?}.");
        Problem::new(StatusCode::NOT_FOUND, "webhook.not_found", "No such webhook", detail)
    }

    /// The problem of a delivery that does not exist.
    pub fn no_delivery(id: &str) -> Problem {
        let detail = format!("There is no delivery {id:?} to this webhook.");
        Problem::new(StatusCode::NOT_FOUND, "delivery.not_found", "No such delivery", detail)
            .remedy("Deliveries are listed for 30 days.")
    }

    /// The problem of a tenant that has the largest number of webhooks already.
    pub fn too_many_webhooks() -> Problem {
        let detail = format!("The tenant has {} webhooks, which is the limit.", webhooks::endpoints::MOST);
        Problem::new(StatusCode::CONFLICT, "webhook.too_many", "Too many webhooks", detail)
            .remedy("Delete a webhook that you do not need.")
    }

    /// The problem of a webhook that is disabled.
    pub fn webhook_disabled(why: &str) -> Problem {
        let detail = format!("The webhook is disabled: {why}.");
        Problem::new(StatusCode::CONFLICT, "webhook.disabled", "The webhook is disabled", detail)
            .remedy("Enable the webhook: PATCH it with {\"enabled\": true}.")
    }

    /// The problem of a URL that cannot be a webhook.
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
            "The URL is not valid",
            "Write the URL as https://host/path, without user name and password.",
        ),
        Error::Refused { .. } => (
            StatusCode::UNPROCESSABLE_ENTITY,
            "address_refused",
            "The URL is refused",
            "Use a host with a public internet address; the operator can allow others: serve --outbound-allow.",
        ),
        Error::Unreachable(_) => (
            StatusCode::BAD_GATEWAY,
            "unreachable",
            "The server does not answer",
            "Try again, or upload the file yourself.",
        ),
        Error::Redirects => {
            (StatusCode::BAD_GATEWAY, "redirects", "Too many redirects", "Use the URL that the redirects lead to.")
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
            Error::Off => of(StatusCode::FORBIDDEN, "ingest.off", "Fetching files is disabled")
                .remedy("Upload the file yourself; the operator can enable fetching: serve --ingest on."),
            Error::Bucket(_) => of(StatusCode::UNPROCESSABLE_ENTITY, "ingest.bucket_refused", "The bucket is refused")
                .remedy("The operator can allow the bucket: serve --ingest-bucket s3://BUCKET/PREFIX."),
            Error::Missing(_) => of(StatusCode::UNPROCESSABLE_ENTITY, "ingest.missing", "There is no such object"),
            Error::Status(_) => of(StatusCode::BAD_GATEWAY, "ingest.status", "The server did not send the file")
                .remedy("Use a URL that needs no login, or upload the file yourself."),
            Error::Broken(_) => of(StatusCode::BAD_GATEWAY, "ingest.broken", "The download was interrupted")
                .remedy("Send the request again."),
            Error::Slow(_) => of(StatusCode::GATEWAY_TIMEOUT, "ingest.slow", "The download is too slow")
                .remedy("Upload the file yourself, or put it on a faster server."),
            Error::Outbound(error) => of_address("ingest", &error),
            Error::Upload(error) => error.into(),
            Error::Storage(error) => error.into(),
        }
    }
}
