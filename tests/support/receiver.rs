//! Somebody else's endpoint on loopback: hears what is posted, and answers as it is told.

use axum::Router;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use serde_json::Value;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::net::TcpListener;

/// One message.
#[derive(Clone, Debug)]
pub struct Heard {
    pub headers: HeaderMap,
    pub body: Vec<u8>,
}

impl Heard {
    pub fn header(&self, name: &str) -> &str {
        self.headers[name].to_str().unwrap()
    }

    /// The same for every attempt.
    pub fn id(&self) -> String {
        self.header("webhook-id").to_owned()
    }

    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap()
    }
}

/// How long messages are waited for: a busy machine may take its time.
const PATIENCE: Duration = Duration::from_mins(2);

/// What it answers next: status, a header, a body.
pub type Answer = (u16, Option<(&'static str, String)>, String);

#[derive(Clone, Default)]
pub struct Receiver {
    pub url: String,
    heard: Arc<Mutex<Vec<Heard>>>,
    /// The next answers; after them, 204.
    answers: Arc<Mutex<VecDeque<Answer>>>,
}

impl Receiver {
    /// Listens until the runtime ends.
    pub async fn start() -> Receiver {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}/hook", listener.local_addr().unwrap());
        let receiver = Receiver { url, ..Receiver::default() };
        let router = Router::new().fallback(Receiver::hear).with_state(receiver.clone());
        tokio::spawn(async move { axum::serve(listener, router).await });
        receiver
    }

    async fn hear(State(receiver): State<Receiver>, headers: HeaderMap, body: Bytes) -> Response {
        receiver.heard.lock().unwrap().push(Heard { headers, body: body.to_vec() });
        let next = receiver.answers.lock().unwrap().pop_front();
        let (status, header, body) = next.unwrap_or((204, None, String::new()));
        let mut response = Response::builder().status(StatusCode::from_u16(status).unwrap());
        if let Some((name, value)) = header {
            response = response.header(name, value);
        }
        response.body(body.into()).unwrap()
    }

    pub fn heard(&self) -> Vec<Heard> {
        self.heard.lock().unwrap().clone()
    }
}

impl Receiver {
    /// The next answers; after them, 204.
    pub fn answer(&self, answers: impl IntoIterator<Item = Answer>) {
        self.answers.lock().unwrap().extend(answers);
    }

    /// Waits until `count` messages came.
    pub async fn until(&self, count: usize) -> Vec<Heard> {
        let start = Instant::now();
        loop {
            let heard = self.heard();
            if heard.len() >= count {
                return heard;
            }
            assert!(start.elapsed() < PATIENCE, "only {} of {count} came", heard.len());
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }
}
