//! Outbound HTTP requests: the only folder that names reqwest. A URL of a tenant could point to this machine, its network or its
//! cloud. So the host name is resolved here, every address it has is checked, and the connection goes to those very addresses: a
//! later change of the DNS answer has no effect. Redirects are checked like the first URL, or not followed. Proxy settings of the
//! environment are ignored.

/// Which addresses are whose.
mod addresses;

pub use addresses::Exception;

use crate::tls;
use addresses::is_global;
use bytes::Bytes;
use futures::StreamExt;
use futures::future::BoxFuture;
use futures::stream::BoxStream;
use reqwest::dns::{Addrs, Name, Resolve, Resolving};
use reqwest::{Client, Response, Url, header, redirect};
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use tokio::net::lookup_host;
use tokio::time::{Instant, timeout, timeout_at};

/// Longest time until a connection stands.
const CONNECT: Duration = Duration::from_secs(10);
/// Longest time until an answer begins.
const ANSWER: Duration = Duration::from_secs(30);
/// Redirects followed where any are.
const MAX_REDIRECTS: usize = 3;
/// What is read of an answer that is only kept to be looked at, bytes.
const KEPT_BYTES: usize = 2048;
/// Longest address, characters.
const MAX_URL_CHARS: usize = 2048;

/// Why an outbound request was not sent, or failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// The URL is not valid for a request.
    #[error("{0}")]
    Url(String),
    /// The address is not the internet's.
    // Where it leads is the operator's business: names of an inner network are not to be looked up through us.
    #[error("the host {host} has no public internet address")]
    Refused {
        /// Host name of the URL.
        host: String,
        /// Address that the host name resolves to.
        address: IpAddr,
    },
    /// There was no connection, or no answer in time.
    #[error("{0}")]
    Unreachable(String),
    /// There were too many redirects.
    #[error("the server sent more than {MAX_REDIRECTS} redirects")]
    Redirects,
}

/// An answer, with the beginning of its body.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// HTTP status of the answer.
    pub status: u16,
    /// Value of `Retry-After`, if it is in seconds.
    pub retry_after: Option<Duration>,
    /// Beginning of the body of the answer.
    pub beginning: String,
}

/// A file that is being downloaded.
pub struct Download {
    /// HTTP status of the answer.
    pub status: u16,
    /// Length of the file, bytes, where known.
    pub byte_count: Option<u64>,
    /// Stream of the bytes of the file.
    pub body: BoxStream<'static, Result<Bytes, String>>,
}

/// Sends outbound HTTP requests. Cheap to clone.
#[derive(Clone)]
pub struct Outbound {
    /// Made when it is first needed, because a machine without certificates that sends no requests needs none.
    client: Arc<OnceLock<Result<Client, Error>>>,
    guard: Guard,
}

impl Outbound {
    /// Allows requests to public internet addresses and to `exceptions`.
    pub fn new(exceptions: Vec<Exception>) -> Outbound {
        Outbound::with(Guard { exceptions: exceptions.into(), lookup: Arc::new(system_lookup) })
    }

    fn with(guard: Guard) -> Outbound {
        Outbound { client: Arc::default(), guard }
    }

    fn client(&self) -> Result<&Client, Error> {
        let made = self.client.get_or_init(|| {
            tls::install();
            let client =
                Client::builder().dns_resolver(self.guard.clone()).no_proxy().redirect(redirect::Policy::none());
            let client = client.connect_timeout(CONNECT).referer(false).pool_idle_timeout(CONNECT);
            client.user_agent(concat!("lampwright/", env!("CARGO_PKG_VERSION"))).build().map_err(unreachable)
        });
        made.as_ref().map_err(Error::clone)
    }

    /// Checks `url` itself; the addresses of its host are checked when the request is sent.
    ///
    /// # Errors
    /// [`Error::Url`], [`Error::Refused`].
    pub fn judge(&self, url: &str) -> Result<(), Error> {
        self.judged(url).map(drop)
    }

    fn judged(&self, url: &str) -> Result<Url, Error> {
        let wrong = |found: &str| Err(Error::Url(found.to_owned()));
        if url.len() > MAX_URL_CHARS {
            return wrong("the URL is longer than 2048 characters");
        }
        if url.contains(char::is_control) {
            return wrong("the URL contains control characters");
        }
        let parsed = Url::parse(url).map_err(|error| Error::Url(format!("not a valid URL: {error}")))?;
        if !parsed.username().is_empty() || parsed.password().is_some() {
            return wrong("the URL contains a user name or a password");
        }
        let Some((name, literal)) = host(&parsed) else { return wrong("the URL names no host") };
        // The resolver is not asked about what is an address already.
        if let Some(address) = literal {
            self.guard.check(&name, address)?;
        }
        let known = |exception: &Exception| match literal {
            Some(address) => exception.has_address(address),
            None => exception.has_host(&name),
        };
        match parsed.scheme() {
            "https" => Ok(parsed),
            // Who listens in there is the operator's business.
            "http" if self.guard.exceptions.iter().any(known) => Ok(parsed),
            "http" => wrong("http is allowed only for hosts that the operator has named; use https"),
            other => wrong(&format!("the scheme is {other}, not https")),
        }
    }

    /// Posts JSON and returns the answer, whatever its status; redirects are not followed.
    ///
    /// # Errors
    /// [`Error`].
    pub async fn post(
        &self,
        url: &str,
        headers: &[(&str, String)],
        body: String,
        longest: Duration,
    ) -> Result<Answer, Error> {
        let mut request = self.client()?.post(self.judged(url)?).header(header::CONTENT_TYPE, "application/json");
        for (name, value) in headers {
            request = request.header(*name, value);
        }
        let deadline = Instant::now() + longest;
        let silent = |_| Error::Unreachable(format!("the server did not answer within {} s", longest.as_secs_f64()));
        let asked = timeout_at(deadline, request.body(body).send()).await.map_err(silent)?;
        let mut response = asked.map_err(unreachable)?;
        let mut beginning = Vec::new();
        // The status is what counts; a body that breaks off or lingers is as good as one that ends.
        while let Ok(Ok(Some(piece))) = timeout_at(deadline, response.chunk()).await
            && beginning.len() < KEPT_BYTES
        {
            beginning.extend_from_slice(&piece);
        }
        beginning.truncate(KEPT_BYTES);
        Ok(Answer {
            status: response.status().as_u16(),
            retry_after: seconds(&response),
            beginning: String::from_utf8_lossy(&beginning).replace('\0', "\u{fffd}"),
        })
    }

    /// Downloads a file, following a few redirects; returns the last answer, whatever its status.
    ///
    /// # Errors
    /// [`Error`].
    pub async fn get(&self, url: &str) -> Result<Download, Error> {
        let mut at = self.judged(url)?;
        for _ in 0..=MAX_REDIRECTS {
            let silent = |_| Error::Unreachable(format!("the server did not answer within {} s", ANSWER.as_secs()));
            let response = timeout(ANSWER, self.client()?.get(at.clone()).send()).await.map_err(silent)?;
            let response = response.map_err(unreachable)?;
            match next(&response) {
                Some(next) => at = self.judged(&next?)?,
                None => return Ok(download(response)),
            }
        }
        Err(Error::Redirects)
    }
}

/// Where a redirect leads, against the address it was got from.
fn next(response: &Response) -> Option<Result<String, Error>> {
    if !matches!(response.status().as_u16(), 301 | 302 | 303 | 307 | 308) {
        return None;
    }
    let to = response.headers().get(header::LOCATION)?;
    let joined = to.to_str().ok().and_then(|to| response.url().join(to).ok());
    Some(joined.map(Into::into).ok_or_else(|| Error::Url("a redirect leads to an invalid URL".to_owned())))
}

fn download(response: Response) -> Download {
    let (status, byte_count) = (response.status().as_u16(), response.content_length());
    let body = response.bytes_stream().map(|piece| piece.map_err(|error| sentence(&error)));
    Download { status, byte_count, body: body.boxed() }
}

fn seconds(response: &Response) -> Option<Duration> {
    let value = response.headers().get(header::RETRY_AFTER)?.to_str().ok()?;
    value.trim().parse().ok().map(Duration::from_secs)
}

/// Why nothing came: a refusal of ours, if it was one.
fn unreachable(error: reqwest::Error) -> Error {
    let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(&error);
    while let Some(inner) = cause {
        if let Some(refused) = inner.downcast_ref::<Error>() {
            return refused.clone();
        }
        cause = inner.source();
    }
    Error::Unreachable(sentence(&error))
}

/// Why nothing came, in words of ours: what libraries and the system say may tell of this machine. That is in the log.
fn sentence(error: &reqwest::Error) -> String {
    tracing::debug!(?error, "an outbound request failed");
    let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(error);
    let mut words = None;
    // The last and most particular reason counts.
    while let Some(inner) = cause {
        words = particular(inner).or(words);
        cause = inner.source();
    }
    let unknown = match (error.is_timeout(), error.is_connect()) {
        (true, _) => "there was no answer in time",
        (false, true) => "no connection could be made",
        (false, false) => "the connection was interrupted",
    };
    words.unwrap_or(unknown).to_owned()
}

/// What one error of a chain says, or what it wraps: an `io::Error` does not name what is in it as its source.
fn particular(error: &(dyn std::error::Error + 'static)) -> Option<&'static str> {
    let io = error.downcast_ref::<io::Error>();
    let wrapped = io.and_then(io::Error::get_ref).and_then(|inner| particular(inner));
    wrapped.or_else(|| tls::describe(error)).or_else(|| spoken(io?.kind()))
}

/// What became of a connection.
fn spoken(kind: io::ErrorKind) -> Option<&'static str> {
    use io::ErrorKind::{
        BrokenPipe, ConnectionAborted, ConnectionRefused, ConnectionReset, HostUnreachable, NetworkDown,
        NetworkUnreachable, TimedOut, UnexpectedEof,
    };
    match kind {
        ConnectionRefused => Some("the connection was refused"),
        BrokenPipe | ConnectionAborted | ConnectionReset | UnexpectedEof => Some("the connection was interrupted"),
        HostUnreachable | NetworkDown | NetworkUnreachable => Some("its network cannot be reached"),
        TimedOut => Some("there was no answer in time"),
        _ => None,
    }
}

/// The host of an address as it is written, and as an address where it is one.
fn host(url: &Url) -> Option<(String, Option<IpAddr>)> {
    let name = url.host_str()?;
    let literal = name.trim_start_matches('[').trim_end_matches(']').parse().ok();
    Some((name.to_owned(), literal))
}

/// How a name is looked up.
type Lookup = Arc<dyn Fn(String) -> BoxFuture<'static, io::Result<Vec<IpAddr>>> + Send + Sync>;

fn system_lookup(name: String) -> BoxFuture<'static, io::Result<Vec<IpAddr>>> {
    Box::pin(async move { Ok(lookup_host((name, 0)).await?.map(|found| found.ip()).collect()) })
}

/// Looks names up, and judges what they lead to.
#[derive(Clone)]
struct Guard {
    exceptions: Arc<[Exception]>,
    lookup: Lookup,
}

impl Guard {
    fn check(&self, host: &str, address: IpAddr) -> Result<(), Error> {
        let known = |exception: &Exception| exception.has_address(address) || exception.has_host(host);
        match is_global(address) || self.exceptions.iter().any(known) {
            true => Ok(()),
            false => {
                tracing::info!(host, %address, "an outbound request was refused: the host has no public internet address");
                Err(Error::Refused { host: host.to_owned(), address })
            }
        }
    }
}

impl Resolve for Guard {
    fn resolve(&self, name: Name) -> Resolving {
        let guard = self.clone();
        Box::pin(async move {
            let host = name.as_str().to_owned();
            let found = (guard.lookup)(host.clone()).await.map_err(|error| {
                tracing::debug!(host, %error, "cannot resolve a host name");
                Error::Unreachable(format!("the host name {host} cannot be resolved"))
            })?;
            // One bad address among good ones is no accident.
            for address in &found {
                guard.check(&host, *address)?;
            }
            let addresses: Addrs = Box::new(found.into_iter().map(|address| SocketAddr::new(address, 0)));
            Ok(addresses)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::TcpListener;

    /// Looks up from a list, one answer after the other, and remembers what it was asked.
    fn scripted(answers: &[&[&str]], exceptions: &[&str]) -> (Outbound, Arc<Mutex<Vec<String>>>) {
        let asked: Arc<Mutex<Vec<String>>> = Arc::default();
        let heard = Arc::clone(&asked);
        let answers: Vec<Vec<IpAddr>> =
            answers.iter().map(|list| list.iter().map(|text| text.parse().unwrap()).collect()).collect();
        let lookup: Lookup = Arc::new(move |name| {
            let mut asked = heard.lock().unwrap();
            asked.push(name);
            let answer = answers[(asked.len() - 1).min(answers.len() - 1)].clone();
            Box::pin(async move { Ok(answer) })
        });
        let exceptions = exceptions.iter().map(|text| text.parse().unwrap()).collect();
        (Outbound::with(Guard { exceptions, lookup }), asked)
    }

    #[test]
    fn an_address_that_cannot_be_meant_is_refused_before_anybody_is_asked() {
        let outbound = Outbound::new(vec!["127.0.0.2".parse().unwrap(), "receiver.lab".parse().unwrap()]);
        for right in [
            "https://example.org/a?b=c",
            "https://[2606:4700::1111]:8443/",
            "http://127.0.0.2:1/",
            "http://receiver.lab/",
        ] {
            assert_eq!(outbound.judge(right), Ok(()), "{right}");
        }
        for (wrong, found) in [
            ("", "not a valid URL"),
            ("example.org", "not a valid URL"),
            ("http://example.org/", "use https"),
            ("ftp://example.org/", "the scheme is ftp, not https"),
            ("file:///etc/passwd", "names no host"),
            ("https://user@example.org/", "a user name or a password"),
            ("https://:secret@example.org/", "a user name or a password"),
            ("https://127.0.0.1/", "has no public internet address"),
            // Loopback, as browsers read it.
            ("https://127.1/", "has no public internet address"),
            ("https://2130706433/", "has no public internet address"),
            ("https://0x7f.0.0.1/", "has no public internet address"),
            ("https://0177.0.0.1/", "has no public internet address"),
            ("https://１２７.0.0.1/", "has no public internet address"),
            ("https://[::ffff:7f00:1]/", "has no public internet address"),
            ("https://[::1]/", "has no public internet address"),
            ("https://169.254.169.254/latest/meta-data", "has no public internet address"),
        ] {
            let error = outbound.judge(wrong).unwrap_err().to_string();
            assert!(error.contains(found), "{wrong}: {error}");
        }
        assert!(outbound.judge(&format!("https://example.org/{}", "x".repeat(2048))).is_err());
    }

    #[tokio::test]
    async fn one_bad_address_among_good_ones_refuses_the_name() {
        for answer in [&["10.0.0.1"][..], &["93.184.216.34", "192.168.0.1"], &["2606:4700::1111", "::1"]] {
            let (outbound, _) = scripted(&[answer], &[]);
            let error = outbound.get("https://rays.example/").await.err().unwrap();
            let bad: IpAddr = answer.last().unwrap().parse().unwrap();
            assert_eq!(error, Error::Refused { host: "rays.example".into(), address: bad });
        }
    }

    #[tokio::test]
    async fn the_connection_goes_to_the_address_that_was_judged() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        // Rebound after the first look: whoever looks twice gets a machine that nobody judged.
        let (outbound, asked) = scripted(&[&["127.0.0.1"], &["10.0.0.1"]], &["127.0.0.0/8", "rays.example"]);
        let served = async {
            let (mut stream, _) = listener.accept().await.unwrap();
            let mut request = vec![0; 1024];
            let count = stream.read(&mut request).await.unwrap();
            let answer = b"HTTP/1.1 200 OK\r\nContent-Length: 4\r\nConnection: close\r\n\r\nrays";
            stream.write_all(answer).await.unwrap();
            String::from_utf8(request[..count].to_vec()).unwrap()
        };
        let url = format!("http://rays.example:{port}/led");
        let (download, request) = tokio::join!(outbound.get(&url), served);
        let pieces: Vec<_> = download.unwrap().body.collect().await;
        assert_eq!(pieces, [Ok(Bytes::from_static(b"rays"))]);
        assert!(request.to_ascii_lowercase().contains(&format!("host: rays.example:{port}")), "{request}");
        assert_eq!(*asked.lock().unwrap(), ["rays.example"]);
    }

    #[tokio::test]
    async fn why_nothing_came_is_said_in_our_words_and_not_in_the_systems() {
        let said = async |outbound: &Outbound, url: String| outbound.get(&url).await.err().unwrap().to_string();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        let (outbound, _) = scripted(&[&["127.0.0.1"]], &["127.0.0.0/8", "rays.example"]);
        // Plain HTTP where TLS is expected, and a connection that ends before it says anything.
        for (scheme, answer, words) in [
            ("https", b"HTTP/1.1 400 Bad Request\r\n\r\n".as_slice(), "no TLS connection could be made"),
            ("http", b"", "the connection was interrupted"),
        ] {
            let served = async {
                let (mut stream, _) = listener.accept().await.unwrap();
                let mut request = vec![0; 1 << 16];
                let _ = stream.read(&mut request).await;
                let _ = stream.write_all(answer).await;
            };
            let (found, ()) = tokio::join!(said(&outbound, format!("{scheme}://rays.example:{port}/")), served);
            assert_eq!(found, words, "{scheme}");
        }
        drop(listener);
        assert_eq!(said(&outbound, format!("http://rays.example:{port}/")).await, "the connection was refused");
        let unknown: Lookup =
            Arc::new(|_| Box::pin(async { Err(io::Error::other("resolver 10.1.2.3 in /etc/resolv.conf failed")) }));
        let outbound = Outbound::with(Guard { exceptions: Arc::new([]), lookup: unknown });
        let found = said(&outbound, "https://rays.example/".into()).await;
        assert_eq!(found, "the host name rays.example cannot be resolved");
    }
}
