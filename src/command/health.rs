//! `health`: is a running service well? Asked by the container's health check, where there is no curl.

use super::Failure;
use clap::Args;
use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

/// Longest wait for each of connecting, asking and answering.
const PATIENCE: Duration = Duration::from_secs(3);

/// Arguments of `health`.
#[derive(Args)]
pub struct Arguments {
    /// What to ask; plain HTTP.
    #[arg(default_value = "http://127.0.0.1:8080/healthz")]
    url: String,
}

/// Asks once. Well means 200.
///
/// # Errors
/// When nothing answers, or not with 200.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let usage = || Failure::usage("health.url", "This is no plain HTTP address.", "Write http://HOST:PORT/PATH.");
    let (authority, path) = split(&arguments.url).ok_or_else(|| usage().at(&arguments.url))?;
    let unwell = |what: String| Failure::failed("health.unwell", what, "Look at the service's log.").at(&arguments.url);
    let status = ask(&authority, path).map_err(|error| unwell(error.to_string()))?;
    if status == 200 { Ok(()) } else { Err(unwell(format!("It answered {status}."))) }
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
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {authority}\r\nConnection: close\r\n\r\n")?;
    let mut start = [0; 12]; // "HTTP/1.1 200"
    stream.read_exact(&mut start)?;
    let code =
        std::str::from_utf8(&start).ok().filter(|text| text.starts_with("HTTP/1.")).and_then(|text| text.get(9..));
    code.and_then(|code| code.parse().ok()).ok_or_else(|| io::Error::other("What answered does not speak HTTP."))
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
            let mut request = [0; 512];
            let _ = stream.read(&mut request).unwrap();
            stream.write_all(answer.as_bytes()).unwrap();
        });
        format!("http://{address}/healthz")
    }

    #[test]
    fn only_200_is_well() {
        let asked = |answer| run(&Arguments { url: answering(answer) });
        assert!(asked("HTTP/1.1 200 OK\r\n\r\n").is_ok());
        assert!(asked("HTTP/1.1 503 Service Unavailable\r\n\r\n").is_err());
        assert!(asked("SSH-2.0-OpenSSH_9.2\r\n").is_err());
        assert!(run(&Arguments { url: "http://127.0.0.1:1/healthz".into() }).is_err());
    }

    #[test]
    fn addresses_are_taken_apart() {
        assert_eq!(split("http://host"), Some(("host:80".into(), "/")));
        assert_eq!(split("http://[::1]:8080/healthz"), Some(("[::1]:8080".into(), "/healthz")));
        assert_eq!(split("https://host"), None);
        assert_eq!(split("http:///x"), None);
    }
}
