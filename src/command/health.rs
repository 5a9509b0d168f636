//! `health`: is a running service well? Asked by the container's health check, where there is no curl.

use super::serve::reachable;
use super::terminal::failure::Failure;
use clap::Args;
use std::borrow::Cow;
use std::io;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs};
use std::time::Duration;

/// Longest wait for each of connecting, asking and answering.
const PATIENCE: Duration = Duration::from_secs(3);

/// Arguments of `health`.
#[derive(Args)]
pub struct Arguments {
    /// URL to request, plain HTTP [default: /healthz at the address that `serve` listens on].
    url: Option<String>,
    /// The address that `serve` listens on; if it listens on all addresses, loopback is used.
    #[arg(long, env = "LAMPWRIGHT_LISTEN", default_value = "127.0.0.1:8080", value_name = "ADDRESS")]
    listen: SocketAddr,
}

impl Arguments {
    fn url(&self) -> Cow<'_, str> {
        match &self.url {
            Some(url) => url.into(),
            None => format!("http://{}/healthz", reachable(self.listen)).into(),
        }
    }
}

/// Asks once. Well means 200.
///
/// # Errors
/// When nothing answers, or not with 200.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let usage = || Failure::usage("health.url", "The URL is not a plain HTTP address.", "Write http://HOST:PORT/PATH.");
    let url = arguments.url();
    let (authority, path) = split(&url).ok_or_else(|| usage().at(&*url))?;
    let unwell = |what: String| Failure::failed("health.unwell", what, "Look at the log of the service.").at(&*url);
    let status = ask(&authority, path).map_err(|error| unwell(error.to_string()))?;
    if status == 200 { Ok(()) } else { Err(unwell(format!("The service answered with status {status}."))) }
}

/// `http://host[:port][/path]` as `host:port` and `/path`.
fn split(url: &str) -> Option<(String, &str)> {
    let rest = url.strip_prefix("http://")?;
    let (host, path) = rest.find('/').map_or((rest, "/"), |at| rest.split_at(at));
    let port_given = host.rsplit_once(':').is_some_and(|(_, port)| port.parse::<u16>().is_ok());
    (!host.is_empty()).then(|| (if port_given { host.to_owned() } else { format!("{host}:80") }, path))
}

/// The status code that `path` answers.
fn ask(authority: &str, path: &str) -> io::Result<u16> {
    let address = authority.to_socket_addrs()?.next().ok_or(io::ErrorKind::AddrNotAvailable)?;
    let mut stream = TcpStream::connect_timeout(&address, PATIENCE)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    // One write: a server that answers and hangs up after the first piece would reset the connection under the others.
    let request = format!("GET {path} HTTP/1.1\r\nHost: {authority}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes())?;
    let mut start = [0; 12]; // "HTTP/1.1 200"
    stream.read_exact(&mut start)?;
    let code =
        std::str::from_utf8(&start).ok().filter(|text| text.starts_with("HTTP/1.")).and_then(|text| text.get(9..));
    code.and_then(|code| code.parse().ok()).ok_or_else(|| io::Error::other("The answer is not HTTP."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    fn answering(answer: &'static str) -> String {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let mut request = Vec::new();
            while !request.ends_with(b"\r\n\r\n") {
                let mut byte = [0];
                stream.read_exact(&mut byte).unwrap();
                request.extend(byte);
            }
            stream.write_all(answer.as_bytes()).unwrap();
        });
        format!("http://{address}/healthz")
    }

    #[test]
    fn only_200_is_well() {
        let ask = |url: String| run(&Arguments { url: Some(url), listen: ([127, 0, 0, 1], 1).into() });
        let asked = |answer| ask(answering(answer));
        assert!(asked("HTTP/1.1 200 OK\r\n\r\n").is_ok());
        assert!(asked("HTTP/1.1 503 Service Unavailable\r\n\r\n").is_err());
        assert!(asked("SSH-2.0-OpenSSH_9.2\r\n").is_err());
        assert!(ask("http://127.0.0.1:1/healthz".into()).is_err());
    }

    #[test]
    fn without_a_url_it_asks_where_serve_listens() {
        let url = |listen: &str| Arguments { url: None, listen: listen.parse().unwrap() }.url().into_owned();
        assert_eq!(url("0.0.0.0:9000"), "http://127.0.0.1:9000/healthz");
        assert_eq!(url("[::]:8080"), "http://[::1]:8080/healthz");
        assert_eq!(url("192.0.2.7:80"), "http://192.0.2.7:80/healthz");
    }

    #[test]
    fn addresses_are_taken_apart() {
        assert_eq!(split("http://host"), Some(("host:80".into(), "/")));
        assert_eq!(split("http://[::1]:8080/healthz"), Some(("[::1]:8080".into(), "/healthz")));
        assert_eq!(split("https://host"), None);
        assert_eq!(split("http:///x"), None);
    }
}
