//! Answers on their way: what is held until they are sent, and how long a client may not ask for more of them.

use super::places::{AtHand, Forwarded};
use axum::body::Body as Answer;
use bytes::Bytes;
use hyper::body::{Body, Frame, SizeHint};
use std::collections::HashMap;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::time::{Instant, sleep};

/// The answers of one HTTP/2 connection that wait until their client has room for more. There, a client that reads nothing of one
/// answer may go on reading the connection.
#[derive(Default)]
pub struct Unasked(Mutex<Waiting>);

#[derive(Default)]
struct Waiting {
    next: u64,
    since: HashMap<u64, Instant>,
}

impl Unasked {
    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        // Nothing is left half done in there.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn note(&self, number: u64) {
        self.waiting().since.insert(number, Instant::now());
    }

    fn remove(&self, number: u64) {
        self.waiting().since.remove(&number);
    }

    fn enter(&self) -> u64 {
        let mut waiting = self.waiting();
        waiting.next += 1;
        let number = waiting.next;
        waiting.since.insert(number, Instant::now());
        number
    }

    /// Resolves when an answer has waited for its client for the `longest` time.
    pub async fn too_long(&self, longest: Duration) {
        while !self.waiting().since.values().any(|since| since.elapsed() >= longest) {
            sleep(longest / 4).await;
        }
    }
}

/// Longest piece of an answer that HTTP/2 is given at once, bytes: what it was given does not wait for its client here.
const PIECE: usize = 16 << 10;

/// The body of an answer. Until it is sent, it keeps the place and the counters of its request.
pub struct AnswerBody {
    body: Answer,
    unasked: Option<(Arc<Unasked>, u64)>,
    /// What is left of the piece that was taken last.
    rest: Bytes,
    _at_hand: AtHand,
    _forwarded: Option<Forwarded>,
}

impl AnswerBody {
    /// The answer `body` of a request that is `at_hand`.
    pub fn new(
        body: Answer,
        at_hand: AtHand,
        forwarded: Option<Forwarded>,
        unasked: Option<&Arc<Unasked>>,
    ) -> AnswerBody {
        let unasked = unasked.map(|unasked| (Arc::clone(unasked), unasked.enter()));
        AnswerBody { body, unasked, rest: Bytes::new(), _at_hand: at_hand, _forwarded: forwarded }
    }
}

impl AnswerBody {
    /// The beginning of a frame; the rest is kept.
    fn piece(&mut self, frame: Frame<Bytes>) -> Frame<Bytes> {
        match frame.into_data() {
            Ok(mut data) => {
                self.rest = data.split_off(data.len().min(PIECE));
                Frame::data(data)
            }
            Err(trailers) => trailers,
        }
    }
}

impl Body for AnswerBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = match self.rest.is_empty() {
            true => Pin::new(&mut self.body).poll_frame(cx),
            false => Poll::Ready(Some(Ok(Frame::data(std::mem::take(&mut self.rest))))),
        };
        let Some((unasked, number)) = self.unasked.clone() else { return frame };
        match frame {
            Poll::Ready(Some(Ok(frame))) => {
                unasked.note(number);
                Poll::Ready(Some(Ok(self.piece(frame))))
            }
            other => {
                unasked.remove(number);
                other
            }
        }
    }

    fn is_end_stream(&self) -> bool {
        self.rest.is_empty() && self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        let (body, rest) = (self.body.size_hint(), self.rest.len() as u64);
        let mut all = SizeHint::new();
        all.set_lower(body.lower().saturating_add(rest));
        if let Some(upper) = body.upper() {
            all.set_upper(upper.saturating_add(rest));
        }
        all
    }
}

impl Drop for AnswerBody {
    fn drop(&mut self) {
        if let Some((unasked, number)) = &self.unasked {
            unasked.remove(*number);
        }
    }
}
