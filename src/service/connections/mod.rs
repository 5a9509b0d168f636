//! Accepts and closes connections: limits their number, the time for the head of a request and the time for which a client may
//! read nothing, and ends them when the service stops. The only folder that names hyper; `axum::serve` has none of these bounds.

/// The places of connections, and which connection is closed for another.
pub mod places;
/// What is read and written on them.
mod stream;
/// What goes out on them.
mod answers;

pub use places::AtHand;

use crate::forwarded::{Peer, Proxies};
use crate::metrics::Metrics;
use answers::{AnswerBody, Unasked};
use axum::Router;
use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderValue, Version, header};
use axum::response::Response;
use hyper::body::Incoming;
use hyper::ext::ReasonPhrase;
use hyper::server::conn::{http1, http2};
use hyper::service::service_fn;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use places::{Connection, ConnectionPlace, Places};
use std::future::{pending, poll_fn};
use std::io;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use stream::{Received, WriteTimeoutStream};
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;
use tokio::time::{sleep, sleep_until, timeout};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tower::ServiceExt;

/// Longest head of a request, bytes: address and headers.
const MAX_HEAD_BYTES: u32 = 32 << 10;
/// Most that is kept of an HTTP/1 connection in each direction, bytes. The library's own bound, about 400 KiB, would be allocated
/// again for every piece of an upload.
const MAX_BUFFER_BYTES: usize = 128 << 10;
const _: () = assert!(MAX_BUFFER_BYTES > MAX_HEAD_BYTES as usize, "a head must fit");
/// Most headers of a request.
const MAX_HEADERS: usize = 64;
/// Rest after the system had no connection to give.
const REST: Duration = Duration::from_secs(1);
/// How often it is looked whether a connection rests, while the service closes.
const CLOSING_LOOK: Duration = Duration::from_millis(20);
/// Longest time for who sends on after an answer while the service stops.
const LAST: Duration = Duration::from_secs(1);
/// Longest time for the head of a request on a spare connection.
const SPARE_HEAD: Duration = Duration::from_secs(2);

/// What every HTTP/2 connection begins with.
const HTTP_2: &[u8] = b"PRI * HTTP/2.0";
/// How often it is looked whether the rest of that has come.
const LOOK: Duration = Duration::from_millis(10);
/// Most requests at once on one HTTP/2 connection.
const MAX_STREAMS: u32 = 32;
/// Most requests that a client may take back before they were looked at, and most that were refused: one more ends the connection.
const MAX_RESETS: usize = 32;
/// What may come of one request's body before it is asked for, and of all on a connection, bytes.
const WINDOWS: (u32, u32) = (256 << 10, 1 << 20);
/// What is kept of an answer that cannot be sent yet, bytes.
const MAX_SEND_BYTES: usize = 128 << 10;

/// Limits for connections.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Largest number of connections. For a further one, an idle connection is closed; if none is idle, the new one is answered
    /// with 503.
    pub connections: usize,
    /// Largest number of connections from one address, and of simultaneous requests that trusted proxies forward for one address.
    pub per_address: usize,
    /// Whether the limit per address holds for this machine too.
    pub bounds_loopback: bool,
    /// Longest time for the head of a request, for the pause between two requests, and for a client that goes on sending after an
    /// answer.
    pub head: Duration,
    /// Longest time that a client may read nothing of its answer.
    pub unread: Duration,
}

impl Default for Bounds {
    fn default() -> Bounds {
        Bounds {
            connections: 512,
            per_address: 256,
            bounds_loopback: false,
            head: Duration::from_secs(20),
            unread: Duration::from_secs(60),
        }
    }
}

/// How a service stops: first it drains, then it closes. Cheap to clone.
#[derive(Clone, Debug, Default)]
pub struct Stopping {
    /// Nothing new is started; connections are still accepted, so that readiness probes learn that the service is not ready.
    pub draining: CancellationToken,
    /// No connection is taken, and those without a request are closed.
    pub closing: CancellationToken,
    /// The requests that began before the draining.
    pub requests: TaskTracker,
}

/// Marks a request on a connection without a place: it is answered with 503, except on the health routes.
#[derive(Clone, Copy, Debug)]
pub struct NoPlace;

/// A server of connections.
pub struct Server {
    /// The router that answers the requests.
    pub router: Router,
    /// Limits for connections.
    pub bounds: Bounds,
    /// The proxies between the service and its clients.
    pub proxies: Arc<Proxies>,
    /// The metrics of this process.
    pub metrics: Metrics,
    /// How the service stops.
    pub stopping: Stopping,
}

/// Answers every connection until the service closes; resolves when those at hand have had their answers. Dropped, it cuts them.
pub async fn serve(listener: TcpListener, server: Server) {
    let bounds = server.bounds;
    let places = Places::new(bounds.connections, bounds.per_address);
    let server = Arc::new(server);
    let mut connections = JoinSet::new();
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = server.stopping.closing.cancelled() => break,
        };
        match accepted {
            Ok((stream, peer)) => {
                let is_exempt = server.proxies.trusts(peer.ip())
                    || (peer.ip().to_canonical().is_loopback() && !bounds.bounds_loopback);
                let place = places.take(peer.ip(), !is_exempt);
                connections.spawn(answer(Arc::clone(&server), places.clone(), place, stream, peer));
            }
            Err(error) => {
                tokio::select! {
                    () = rest_after(&error) => {}
                    () = server.stopping.closing.cancelled() => break,
                }
            }
        }
        while connections.try_join_next().is_some() {}
    }
    drop(listener);
    while connections.join_next().await.is_some() {}
}

/// One connection, from its first byte to its last.
async fn answer(server: Arc<Server>, places: Places, place: ConnectionPlace, stream: TcpStream, peer: SocketAddr) {
    let _counted = server.metrics.connection();
    // Answers are small or streamed in large pieces: waiting to fill a packet only delays them.
    let _ = stream.set_nodelay(true);
    let connection = place.connection();
    let head = if connection.is_spare() { server.bounds.head.min(SPARE_HEAD) } else { server.bounds.head };
    let asker = Asker { server: Arc::clone(&server), places, connection: Arc::clone(connection), peer: peer.into() };
    let ended = tokio::select! {
        ended = asker.session(stream, head) => ended,
        () = connection.given_up() => Err("the connection was closed in favour of another one".into()),
        () = rested(connection, head) => Ok(()),
        () = unused_when_closing(&server.stopping, connection) => Ok(()),
    };
    if let Err(error) = ended {
        tracing::debug!(%peer, %error, "a connection ended early");
    }
}

/// Resolves when a connection has had no request for the `longest` time.
async fn rested(connection: &Connection, longest: Duration) {
    loop {
        match connection.resting_since() {
            Some(since) if since.elapsed() >= longest => return,
            Some(since) => sleep_until(since + longest).await,
            None => sleep(longest).await,
        }
    }
}

/// Resolves when the service drains, on a connection that had a request. One that had none would be closed by hyper before its
/// first is read; it is answered, and that answer is its last.
async fn draining_after_a_request(draining: &CancellationToken, connection: &Connection) {
    draining.cancelled().await;
    if !connection.has_asked() {
        pending::<()>().await;
    }
}

/// Resolves when the service closes, on a connection that never had a request, where no client waits for an answer.
async fn unused_when_closing(stopping: &Stopping, connection: &Connection) {
    stopping.closing.cancelled().await;
    if connection.has_asked() {
        pending::<()>().await;
    }
}

/// Resolves when the service closes and a connection has no request at hand. HTTP/2 closes when its client answers; one that is
/// suspended, or gone, never does.
async fn resting_when_closing(stopping: &Stopping, connection: &Connection) {
    stopping.closing.cancelled().await;
    while connection.resting_since().is_none() {
        sleep(CLOSING_LOOK).await;
    }
}

/// Why a connection ended early.
type Ended = Result<(), Box<dyn std::error::Error + Send + Sync>>;

/// The client of a connection, and the server that answers it. Cheap to clone.
#[derive(Clone)]
struct Asker {
    server: Arc<Server>,
    places: Places,
    connection: Arc<Connection>,
    peer: Peer,
}

impl Asker {
    async fn session(self, stream: TcpStream, head: Duration) -> Ended {
        let is_http_2 = begins_http_2(&stream).await?;
        let stream = WriteTimeoutStream::new(stream, self.server.bounds.unread, Arc::clone(&self.connection));
        match is_http_2 {
            true => self.http_2(stream).await,
            false => self.http_1(stream, head).await,
        }
    }

    async fn http_1(self, stream: WriteTimeoutStream, head: Duration) -> Ended {
        let (draining, place) = (self.server.stopping.draining.clone(), Arc::clone(&self.connection));
        let is_partly_read = Arc::new(AtomicBool::new(false));
        let partly_read = Arc::clone(&is_partly_read);
        let service = service_fn(move |request: Request<Incoming>| {
            let received = request.map(|body| Body::new(Received::new(body, Arc::clone(&partly_read))));
            Box::pin(self.clone().respond(received, None))
        });
        let mut builder = http1::Builder::new();
        builder.timer(TokioTimer::new()).header_read_timeout(head);
        builder.max_headers(MAX_HEADERS).max_header_size(MAX_HEAD_BYTES as usize).max_buf_size(MAX_BUFFER_BYTES);
        builder.keep_alive(!place.is_spare());
        let mut connection = builder.serve_connection(TokioIo::new(stream), service);
        let ended = tokio::select! {
            ended = poll_fn(|cx| connection.poll_without_shutdown(cx)) => ended,
            () = draining_after_a_request(&draining, &place) => {
                Pin::new(&mut connection).graceful_shutdown();
                poll_fn(|cx| connection.poll_without_shutdown(cx)).await
            }
        };
        let is_refused = ended.as_ref().is_err_and(hyper::Error::is_parse);
        if is_refused || (ended.is_ok() && is_partly_read.load(Ordering::Relaxed)) {
            tokio::select! {
                _ = timeout(head, linger(connection.into_parts().io.into_inner())) => {}
                () = async { draining.cancelled().await; sleep(LAST).await } => {}
            }
        } else if ended.is_ok() {
            connection.into_parts().io.into_inner().shutdown().await?;
        }
        Ok(ended?)
    }

    async fn http_2(self, stream: WriteTimeoutStream) -> Ended {
        let (server, place) = (Arc::clone(&self.server), Arc::clone(&self.connection));
        let (draining, bounds) = (&server.stopping.draining, server.bounds);
        let unasked = Arc::new(Unasked::default());
        let waiting = Arc::clone(&unasked);
        let service = service_fn(move |request: Request<Incoming>| {
            Box::pin(self.clone().respond(request.map(Body::new), Some(Arc::clone(&waiting))))
        });
        let mut builder = http2::Builder::new(TokioExecutor::new());
        builder.timer(TokioTimer::new()).keep_alive_interval(bounds.head).keep_alive_timeout(bounds.head);
        builder.max_concurrent_streams(MAX_STREAMS).max_header_list_size(MAX_HEAD_BYTES);
        builder.max_pending_accept_reset_streams(MAX_RESETS).max_local_error_reset_streams(MAX_RESETS);
        builder.initial_stream_window_size(WINDOWS.0).initial_connection_window_size(WINDOWS.1);
        builder.max_send_buf_size(MAX_SEND_BYTES);
        let mut connection = pin!(builder.serve_connection(TokioIo::new(stream), service));
        tokio::select! {
            ended = connection.as_mut() => return Ok(ended?),
            () = unasked.too_long(bounds.unread) => return Err("the client did not read its answer".into()),
            () = draining.cancelled() => connection.as_mut().graceful_shutdown(),
        }
        tokio::select! {
            ended = connection => Ok(ended?),
            () = unasked.too_long(bounds.unread) => Err("the client did not read its answer".into()),
            () = resting_when_closing(&server.stopping, &place) => Ok(()),
        }
    }

    /// One request, and what it holds until its answer is sent.
    async fn respond(self, mut request: Request, unasked: Option<Arc<Unasked>>) -> io::Result<Response> {
        let Stopping { draining, requests, .. } = &self.server.stopping;
        let version = request.version();
        let token = (!draining.is_cancelled()).then(|| requests.token());
        let at_hand = self.connection.begin(token).ok_or(io::ErrorKind::ConnectionAborted)?;
        let proxies = &self.server.proxies;
        let client = proxies.client(self.peer, request.headers());
        let prefix = proxies.prefix(self.peer, request.headers());
        let is_forwarded = client.ip != self.peer.ip;
        let forwarded = if is_forwarded { self.places.forwarded(client.ip) } else { None };
        if at_hand.is_spare() || (is_forwarded && forwarded.is_none()) {
            request.extensions_mut().insert(NoPlace);
        }
        name_host(&mut request);
        let extensions = request.extensions_mut();
        extensions.insert(client);
        extensions.insert(prefix);
        extensions.insert(at_hand.clone());
        let Ok(mut response) = self.server.router.clone().oneshot(request).await;
        if version <= Version::HTTP_11 && draining.is_cancelled() {
            response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
        }
        let status = response.status();
        if status.canonical_reason().is_none() {
            response.extensions_mut().insert(reason(status.as_u16()));
        }
        Ok(response.map(|body| Body::new(AnswerBody::new(body, at_hand, forwarded, unasked.as_ref()))))
    }
}

/// The host of a request is in its address in HTTP/2, and in requests as proxies get them; what stands there holds.
fn name_host(request: &mut Request) {
    let is_one = request.headers().get_all(header::HOST).iter().count() == 1;
    if !is_one && request.version() <= Version::HTTP_11 {
        return;
    }
    let authority = request.uri().authority().and_then(|host| HeaderValue::from_str(host.as_str()).ok());
    if let Some(authority) = authority {
        request.headers_mut().insert(header::HOST, authority);
    }
}

/// What a status line says for a status that HTTP itself does not know.
fn reason(status: u16) -> ReasonPhrase {
    match status {
        // tus 1.0.0, the extension on checksums.
        460 => ReasonPhrase::from_static(b"Checksum Mismatch"),
        _ => ReasonPhrase::from_static(b"Unknown"),
    }
}

/// Whether the client begins as HTTP/2 does. Nothing is taken from the stream.
async fn begins_http_2(stream: &TcpStream) -> io::Result<bool> {
    let mut seen = [0; HTTP_2.len()];
    loop {
        let count = stream.peek(&mut seen).await?;
        let (seen, expected) = (seen.get(..count), HTTP_2.get(..count));
        if count == 0 || seen != expected {
            return Ok(false);
        }
        if count == HTTP_2.len() {
            return Ok(true);
        }
        sleep(LOOK).await;
    }
}

/// Reads on until the other end has closed too. A connection closed with bytes unread, those of a refused body, is reset, and
/// the client sees that instead of why it was refused.
async fn linger(mut stream: WriteTimeoutStream) -> io::Result<()> {
    stream.shutdown().await?;
    tokio::io::copy(&mut stream, &mut tokio::io::sink()).await?;
    Ok(())
}

/// A client that went away before it was taken is nothing; a system without files or memory is given time.
async fn rest_after(error: &io::Error) {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    if !matches!(error.kind(), ConnectionAborted | ConnectionRefused | ConnectionReset) {
        tracing::error!(%error, "cannot accept a connection");
        sleep(REST).await;
    }
}
