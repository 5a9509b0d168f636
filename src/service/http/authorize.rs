//! Authorizes requests: checks the API key, its scope and its rate limit, or, where no keys are required, that the client is on
//! this machine.

use super::api::Api;
use super::headers::honoured;
use super::openapi::{can_fail, operations};
use super::problem::Problem;
use crate::accounts::access::{Access, Scope};
use crate::accounts::keys::Refusal;
use crate::accounts::rate::Policy;
use crate::connections::AtHand;
use axum::extract::{FromRequestParts, Request};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Uri, header};
use axum::middleware::{Next, from_fn};
use axum::response::IntoResponse;
use std::net::IpAddr;
use std::sync::Arc;
use tracing::Span;
use utoipa::openapi::path::Operation;
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{HeaderBuilder, OpenApi, RefOr};
use utoipa_axum::router::UtoipaMethodRouter;

/// The header with the rate limit of the key.
pub const RATE_LIMIT_POLICY: HeaderName = HeaderName::from_static("ratelimit-policy");
/// The header with the requests that are left.
pub const RATE_LIMIT: HeaderName = HeaderName::from_static("ratelimit");

/// What the contract calls the way in.
const SCHEME: &str = "key";

/// Whether a route's requests count against the key's rate.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Counted {
    Yes,
    /// Requests are not counted.
    No,
}

/// Routes that a key needs `scope` for.
pub fn needs(scope: Scope, routes: UtoipaMethodRouter<Api>) -> UtoipaMethodRouter<Api> {
    guarded(vec![scope], Counted::Yes, routes)
}

/// Routes that a key needs one of `scopes` for.
pub fn needs_one_of(scopes: &[Scope], routes: UtoipaMethodRouter<Api>) -> UtoipaMethodRouter<Api> {
    guarded(scopes.to_vec(), Counted::Yes, routes)
}

/// Routes that a key needs `scope` for, without a rate limit.
pub fn needs_only(scope: Scope, routes: UtoipaMethodRouter<Api>) -> UtoipaMethodRouter<Api> {
    guarded(vec![scope], Counted::No, routes)
}

fn guarded(scopes: Vec<Scope>, counted: Counted, routes: UtoipaMethodRouter<Api>) -> UtoipaMethodRouter<Api> {
    let (schemas, mut paths, handlers) = honoured(routes);
    for operation in operations(&mut paths) {
        document(operation, &scopes, counted);
    }
    let scopes: Arc<[Scope]> = scopes.into();
    let guard = from_fn(move |request: Request, next: Next| {
        let scopes = Arc::clone(&scopes);
        async move {
            let mut limit = None;
            let mut response = match authorized(request, &scopes, counted, &mut limit).await {
                Ok(request) => next.run(request).await,
                Err(problem) => problem.into_response(),
            };
            if let Some(limit) = limit {
                limit.tell(response.headers_mut());
            }
            response
        }
    });
    (schemas, paths, handlers.route_layer(guard))
}

/// What a key may still ask for.
struct Limit {
    policy: Policy,
    left: u32,
    /// When it may ask again, s, if it may not now.
    wait_s: Option<u64>,
}

impl Limit {
    /// As draft-ietf-httpapi-ratelimit-headers-09 has it.
    fn tell(&self, headers: &mut HeaderMap) {
        let Policy { burst, window_s } = self.policy;
        // A bucket is refilled steadily: that many seconds from now it is full, if nothing is asked meanwhile.
        let missing = u64::from(burst.saturating_sub(self.left)) * u64::from(window_s);
        let reset_s = self.wait_s.unwrap_or_else(|| missing.div_ceil(u64::from(burst.max(1))));
        let values = [
            (RATE_LIMIT_POLICY, format!("\"requests\";q={burst};w={window_s}")),
            (RATE_LIMIT, format!("\"requests\";r={};t={reset_s}", self.left)),
        ];
        for (name, value) in values {
            if let Ok(value) = HeaderValue::try_from(value) {
                headers.insert(name, value);
            }
        }
    }
}

/// The request with what it may do; its `limit` is what the key may ask for after it.
async fn authorized(
    mut request: Request,
    scopes: &[Scope],
    counted: Counted,
    limit: &mut Option<Limit>,
) -> Result<Request, Problem> {
    let Some(api) = request.extensions().get::<Api>().cloned() else { return Err(Problem::internal()) };
    let authenticator = &api.authenticator;
    if !authenticator.asks_for_keys() {
        from_this_machine(request.headers(), &api.origins)?;
    }
    let token = bearer(request.headers())?.map(str::to_owned);
    let access = authenticator.authenticate(token.as_deref()).await?.map_err(Problem::from)?;
    Span::current().record("tenant", &access.tenant).record("key", access.key.as_deref());
    if !scopes.iter().any(|scope| access.may(*scope)) {
        let names: Vec<&str> = scopes.iter().map(|scope| scope.name()).collect();
        return Err(Problem::scope_missing(&names.join(" or ")));
    }
    if counted == Counted::Yes {
        let (policy, count) = (authenticator.policy(), authenticator.count(&access));
        *limit = match count {
            Ok(left) => left.map(|left| Limit { policy, left, wait_s: None }),
            Err(wait) => Some(Limit { policy, left: 0, wait_s: Some(wait.as_secs() + 1) }),
        };
        count.map_err(Problem::too_often)?;
    }
    if let Some(at_hand) = request.extensions().get::<AtHand>() {
        at_hand.mark_with_key();
    }
    request.extensions_mut().insert(access);
    Ok(request)
}

/// The token in `Authorization: Bearer`. Never read from the address: addresses are logged, kept and passed on.
fn bearer(headers: &HeaderMap) -> Result<Option<&str>, Refusal> {
    let mut values = headers.get_all(header::AUTHORIZATION).iter();
    let Some(value) = values.next() else { return Ok(None) };
    let (scheme, token) = value.to_str().ok().and_then(|value| value.split_once(' ')).ok_or(Refusal::Malformed)?;
    match scheme.eq_ignore_ascii_case("bearer") && values.next().is_none() {
        true => Ok(Some(token.trim())),
        false => Err(Refusal::Malformed),
    }
}

/// Without API keys, every program that reaches the address may use the service, and so may a web page in a browser on this
/// machine. Refuses requests that a browser sends for a page of another origin, and host names that foreign DNS has pointed at
/// this machine.
fn from_this_machine(headers: &HeaderMap, origins: &[String]) -> Result<(), Problem> {
    let text = |name: HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
    let host = text(header::HOST);
    if let Some(host) = host.filter(|host| !is_loopback(host)) {
        return Err(Problem::foreign_host(host));
    }
    let Some(origin) = text(header::ORIGIN) else { return Ok(()) };
    let ours = origin.strip_prefix("http://").is_some_and(|place| Some(place) == host);
    if ours || origins.iter().any(|known| known == origin) {
        return Ok(());
    }
    Err(Problem::foreign_origin(origin))
}

/// Whether a `Host` names this machine: `localhost` or a loopback address, with any port.
fn is_loopback(host: &str) -> bool {
    let Ok(uri) = host.parse::<Uri>() else { return false };
    let name = uri.host().unwrap_or_default();
    let address = name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
    address.map_or_else(|_| name.eq_ignore_ascii_case("localhost"), |address| address.is_loopback())
}

impl<S: Send + Sync> FromRequestParts<S> for Access {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Access, Problem> {
        // Only a route without a guard gets here: better no answer than everybody's.
        parts.extensions.get::<Access>().cloned().ok_or_else(Problem::internal)
    }
}

/// Says in the contract what the guard does.
fn document(operation: &mut Operation, scopes: &[Scope], counted: Counted) {
    let each = scopes.iter().map(|scope| SecurityRequirement::new(SCHEME, [scope.name()]));
    operation.security = Some(each.collect());
    let mut refusals = vec![
        ("401", "the request has no API key, or the key is malformed, unknown, expired or revoked"),
        ("403", "the API key lacks the scope that this request needs"),
    ];
    if counted == Counted::Yes {
        refusals.push(("429", "this API key made too many requests; the header `RateLimit` says how many it may make"));
    }
    for (status, description) in refusals {
        can_fail(operation, status, description);
    }
    if counted == Counted::Yes
        && let Some(RefOr::T(refusal)) = operation.responses.responses.get_mut("429")
    {
        for (name, description) in [
            ("Retry-After", "the seconds to wait before the next request"),
            (
                "RateLimit",
                "how many requests are left, and the seconds until the full allowance is back (draft-ietf-httpapi-ratelimit-headers-09); every answer has this header",
            ),
            (
                "RateLimit-Policy",
                "the full allowance of requests, and the seconds in which a used-up allowance becomes full again (same draft)",
            ),
        ] {
            let header = HeaderBuilder::new().description(Some(description)).build();
            refusal.headers.insert(name.to_owned(), header.into());
        }
    }
}

/// Says in the contract how a key is sent.
pub fn document_scheme(contract: &mut OpenApi) {
    let scopes = Scope::ALL.map(Scope::name).join(", ");
    let description = format!(
        "An API key of a tenant, made with `lampwright keys create`. Possible scopes: {scopes}. A service that listens on loopback only requires no key unless it is started with `--auth on`."
    );
    let scheme = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).bearer_format("lw_<id>_<secret>");
    let scheme = SecurityScheme::Http(scheme.description(Some(description)).build());
    contract.components.get_or_insert_default().add_security_scheme(SCHEME, scheme);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(HeaderName, &'static str)]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for (name, value) in pairs {
            headers.append(name, HeaderValue::from_static(value));
        }
        headers
    }

    #[test]
    fn a_token_is_read_from_one_bearer_header() {
        let read = |values: &[&'static str]| {
            let pairs: Vec<_> = values.iter().map(|value| (header::AUTHORIZATION, *value)).collect();
            bearer(&headers(&pairs)).map(|token| token.map(str::to_owned))
        };
        assert_eq!(read(&[]), Ok(None));
        for right in ["Bearer abc", "bearer abc", "BEARER  abc "] {
            assert_eq!(read(&[right]), Ok(Some("abc".to_owned())), "{right}");
        }
        for wrong in [vec!["Basic YTpi"], vec!["abc"], vec![""], vec!["Bearer a", "Bearer b"], vec!["Bearer\tabc"]] {
            assert_eq!(read(&wrong), Err(Refusal::Malformed), "{wrong:?}");
        }
    }

    #[test]
    fn without_keys_only_this_machine_and_known_pages_are_let_in() {
        let known = ["https://portal.example".to_owned()];
        let judged = |pairs: &[(HeaderName, &'static str)]| {
            from_this_machine(&headers(pairs), &known).map_err(|problem| problem.code.into_owned())
        };
        for host in ["localhost", "localhost:8080", "127.0.0.1:8080", "127.9.9.9", "[::1]:8080", "LOCALHOST:1"] {
            assert_eq!(judged(&[(header::HOST, host)]), Ok(()), "{host}");
        }
        // What DNS rebinding looks like from here.
        for host in
            ["evil.example:8080", "127.0.0.1.evil.example", "localhost.evil.example", "192.168.0.7", "", "[::2]"]
        {
            assert_eq!(judged(&[(header::HOST, host)]), Err("access.foreign_host".to_owned()), "{host}");
        }
        let from = |origin: &'static str| judged(&[(header::HOST, "localhost:8080"), (header::ORIGIN, origin)]);
        assert_eq!((from("http://localhost:8080"), from("https://portal.example")), (Ok(()), Ok(())));
        for origin in ["null", "https://evil.example", "http://localhost:3000", "http://portal.example"] {
            assert_eq!(from(origin), Err("access.foreign_origin".to_owned()), "{origin}");
        }
    }
}
