//! The address of a request and the links in its answer: `Host`, slashes at the end, and the path that a proxy puts before the
//! paths of the service.

use super::api::Api;
use super::problem::Problem;
use crate::connections::NoPlace;
use crate::forwarded::{Peer, Prefix};
use axum::extract::{Request, State};
use axum::http::uri::{Authority, PathAndQuery};
use axum::http::{HeaderMap, Uri, Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

tokio::task_local! {
    /// The path before the paths of the service, for the current request.
    static PREFIX: Prefix;
}

/// The routes that are answered although there is no place for more connections.
const HEALTH: [&str; 3] = ["/healthz", "/readyz", "/metrics"];

/// A link to `path` of this service, for the client of the current request.
pub fn link(path: &str) -> String {
    format!("{}{path}", prefix().as_str())
}

/// The path before the paths of the service, for the current request.
pub fn prefix() -> Prefix {
    PREFIX.try_with(Prefix::clone).unwrap_or_default()
}

/// What comes of `answer` when its links begin with `prefix`: for what is made after its handler has returned.
pub async fn within<T>(prefix: Prefix, answer: impl Future<Output = T>) -> T {
    PREFIX.scope(prefix, answer).await
}

/// A request whose path has no slash at its end: `/v1/jobs/` is `/v1/jobs`. The pages below `/docs/` have relative links and need
/// theirs. Before a route is chosen.
pub async fn without_slash(mut request: Request) -> Request {
    let path = request.uri().path();
    let short = path.trim_end_matches('/');
    if short.is_empty() || short.len() == path.len() || short == "/docs" || short.starts_with("/docs/") {
        return request;
    }
    let text = request.uri().query().map_or_else(|| short.to_owned(), |query| format!("{short}?{query}"));
    let mut parts = request.uri().clone().into_parts();
    if let Ok(path) = PathAndQuery::try_from(text) {
        parts.path_and_query = Some(path);
        if let Ok(uri) = Uri::from_parts(parts) {
            *request.uri_mut() = uri;
        }
    }
    request
}

/// Refuses requests without a place for their connection and requests without exactly one valid Host; answers all others with
/// links that begin with the right path.
pub async fn known(State(api): State<Api>, request: Request, next: Next) -> Response {
    let extensions = request.extensions();
    if extensions.get::<NoPlace>().is_some() && !HEALTH.contains(&request.uri().path()) {
        return Problem::busy().into_response();
    }
    // What comes from within has no peer and needs no host.
    if extensions.get::<Peer>().is_some()
        && let Err(problem) = one_host(request.version(), request.headers())
    {
        return problem.into_response();
    }
    let prefix = extensions.get::<Prefix>().cloned().unwrap_or_else(|| api.prefix.clone());
    within(prefix, next.run(request)).await
}

/// Exactly one `Host` that can be one (RFC 9112, section 3.2); HTTP/1.0 need not have any.
fn one_host(version: Version, headers: &HeaderMap) -> Result<(), Problem> {
    let mut hosts = headers.get_all(header::HOST).iter();
    let (first, second) = (hosts.next(), hosts.next());
    let is_host = |text: &str| {
        text.is_empty() || text.parse::<Authority>().is_ok_and(|host| !text.contains('@') && !host.host().is_empty())
    };
    match (first, second) {
        (None, None) if version < Version::HTTP_11 => Ok(()),
        (None, _) => Err(Problem::malformed_header("Host", "The request has no Host header.")),
        (Some(_), Some(_)) => Err(Problem::malformed_header("Host", "The request has more than one Host header.")),
        (Some(host), None) if host.to_str().is_ok_and(is_host) => Ok(()),
        (Some(_), None) => Err(Problem::malformed_header("Host", "The value is not a host, with or without a port.")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Body;

    #[test]
    fn a_request_has_one_host() {
        let judged = |version: Version, hosts: &[&str]| {
            let mut map = HeaderMap::new();
            for host in hosts {
                map.append(header::HOST, host.parse().unwrap());
            }
            one_host(version, &map).map_err(|problem| problem.status)
        };
        for right in ["lab.example", "lab.example:8080", "127.0.0.1:1", "[::1]:8080", ""] {
            assert_eq!(judged(Version::HTTP_11, &[right]), Ok(()), "{right}");
        }
        // RFC 9112, section 3.2: 400 for a request without Host, with more than one, or with an invalid one.
        for wrong in [&[][..], &["a", "a"], &["a", "b"], &["a b"], &["a/b"], &["user@a"], &["a:b:c"]] {
            assert_eq!(judged(Version::HTTP_11, wrong), Err(400), "{wrong:?}");
        }
        assert_eq!(judged(Version::HTTP_10, &[]), Ok(()));
    }

    #[tokio::test]
    async fn a_slash_at_the_end_is_as_if_it_were_not_there() {
        for (from, to) in [
            ("/v1/jobs/", "/v1/jobs"),
            ("/v1/jobs//", "/v1/jobs"),
            ("/v1/jobs/?limit=1", "/v1/jobs?limit=1"),
            ("/v1/jobs", "/v1/jobs"),
            ("/", "/"),
            ("/docs/", "/docs/"),
            ("/docs/x/", "/docs/x/"),
            ("http://lab.example/healthz/", "http://lab.example/healthz"),
        ] {
            let request = Request::get(from).body(Body::empty()).unwrap();
            assert_eq!(without_slash(request).await.uri().to_string(), to);
        }
    }

    #[tokio::test]
    async fn links_begin_with_the_path_of_the_request() {
        assert_eq!(link("/v1/jobs"), "/v1/jobs");
        let prefix = Prefix::parse("/lamps").unwrap();
        assert_eq!(within(prefix, async { link("/v1/jobs") }).await, "/lamps/v1/jobs");
    }
}
