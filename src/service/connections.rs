//! Takes connections and gives them up: how many at once, how long a request's head may take, how long an answer may go unread.
//! The only file that names hyper; `axum::serve` has none of these bounds.

use super::metrics::Metrics;
use axum::Router;
use axum::body::Body;
use axum::extract::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use std::future::poll_fn;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::task::JoinSet;
use tokio::time::{Sleep, sleep, timeout};
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

/// Longest head of a request, bytes: address and headers.
const MAX_HEAD_BYTES: usize = 32 << 10;
/// Most headers of a request.
const MAX_HEADERS: usize = 64;
/// Rest after the system had no connection to give.
const REST: Duration = Duration::from_secs(1);

/// Longest time for who sends on after an answer while the service stops.
const LAST: Duration = Duration::from_secs(1);

/// What connections may ask of this process.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Connections at once; more wait in the system's queue.
    pub connections: usize,
    /// Longest time for the head of a request, for the rest between two, and for who sends on after an answer.
    pub head: Duration,
    /// Longest time that a client may read nothing of its answer.
    pub unread: Duration,
}

/// Who asks.
#[derive(Clone, Copy, Debug)]
pub struct Peer(pub SocketAddr);

/// Answers every connection with `router` until `draining`; then takes no more, and resolves when those at hand have had
/// their answers. Dropped, it cuts them.
pub async fn serve(
    listener: TcpListener,
    router: Router,
    bounds: Bounds,
    metrics: Metrics,
    draining: CancellationToken,
) {
    let places = Arc::new(Semaphore::new(bounds.connections.max(1)));
    let mut connections = JoinSet::new();
    loop {
        let next = async {
            let place = Arc::clone(&places).acquire_owned().await.ok()?;
            Some((place, listener.accept().await))
        };
        let next = tokio::select! {
            next = next => next,
            () = draining.cancelled() => None,
        };
        match next {
            None => break,
            Some((place, Ok((stream, peer)))) => {
                let (router, draining, metrics) = (router.clone(), draining.clone(), metrics.clone());
                connections.spawn(async move {
                    let _counted = metrics.connection();
                    answer(stream, peer, router, bounds, draining, place).await;
                });
            }
            Some((_, Err(error))) => rest_after(&error).await,
        }
        while connections.try_join_next().is_some() {}
    }
    drop(listener);
    while connections.join_next().await.is_some() {}
}

/// One connection, from its first byte to its last.
async fn answer(
    stream: TcpStream,
    peer: SocketAddr,
    router: Router,
    bounds: Bounds,
    draining: CancellationToken,
    _place: OwnedSemaphorePermit,
) {
    // Answers are small or streamed in large pieces: waiting to fill a packet only delays them.
    let _ = stream.set_nodelay(true);
    let service = service_fn(move |request: Request<Incoming>| {
        let mut request = request.map(Body::new);
        request.extensions_mut().insert(Peer(peer));
        Box::pin(router.clone().oneshot(request))
    });
    let mut builder = http1::Builder::new();
    builder.timer(TokioTimer::new()).header_read_timeout(bounds.head);
    builder.max_headers(MAX_HEADERS).max_header_size(MAX_HEAD_BYTES);
    let stream = TokioIo::new(Unread { stream, longest: bounds.unread, waiting: None });
    let mut connection = builder.serve_connection(stream, service);
    let answered = async {
        let ended = tokio::select! {
            ended = poll_fn(|cx| connection.poll_without_shutdown(cx)) => ended,
            () = draining.cancelled() => {
                Pin::new(&mut connection).graceful_shutdown();
                poll_fn(|cx| connection.poll_without_shutdown(cx)).await
            }
        };
        if ended.as_ref().map_or_else(hyper::Error::is_parse, |()| true) {
            tokio::select! {
                _ = timeout(bounds.head, linger(connection.into_parts().io.into_inner())) => {}
                () = async { draining.cancelled().await; sleep(LAST).await } => {}
            }
        }
        ended
    };
    if let Err(error) = answered.await {
        tracing::debug!(%peer, %error, "a connection ended early");
    }
}

/// Reads on until the other end has closed too. A connection closed with bytes unread, those of a refused body, is reset, and
/// the client sees that instead of why it was refused.
async fn linger(mut stream: Unread) -> io::Result<()> {
    stream.shutdown().await?;
    tokio::io::copy(&mut stream, &mut tokio::io::sink()).await?;
    Ok(())
}

/// A client that went away before it was taken is nothing; a system without files or memory is given time.
async fn rest_after(error: &io::Error) {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    if !matches!(error.kind(), ConnectionAborted | ConnectionRefused | ConnectionReset) {
        tracing::error!(%error, "cannot take a connection");
        sleep(REST).await;
    }
}

/// A connection whose other end must read: nothing read for too long is an error.
struct Unread {
    stream: TcpStream,
    longest: Duration,
    /// Runs while bytes wait to be taken.
    waiting: Option<Pin<Box<Sleep>>>,
}

impl Unread {
    /// What a write came to, unless it has waited too long.
    fn judge<T>(&mut self, cx: &mut Context<'_>, written: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        if written.is_ready() {
            self.waiting = None;
            return written;
        }
        let longest = self.longest;
        let waiting = self.waiting.get_or_insert_with(|| Box::pin(sleep(longest)));
        ready!(waiting.as_mut().poll(cx));
        Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
    }
}

impl AsyncRead for Unread {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, into: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, into)
    }
}

impl AsyncWrite for Unread {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(cx, bytes);
        self.judge(cx, written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(cx, slices);
        self.judge(cx, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}
