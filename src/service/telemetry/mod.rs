//! Logs: one JSON object a line, or text for a person at a terminal. Every line of a request carries its id, tenant and key,
//! every line of a job its id and attempt. With the feature `otlp`, the same spans go to an OpenTelemetry collector.

/// Spans to a collector.
#[cfg(feature = "otlp")]
mod traces;
/// Text from others, for a person.
mod visible;

pub use visible::visible;

use std::io::IsTerminal;
use tracing::field::Field;
use tracing_subscriber::field::MakeExt;
use tracing_subscriber::fmt::format;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer, fmt, registry};

/// How log lines look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LogFormat {
    /// For a person.
    #[default]
    Text,
    /// For a collector.
    Json,
}

/// What is still to be sent is sent when this is dropped.
#[must_use = "spans that are not yet sent are lost"]
pub struct Telemetry {
    #[cfg(feature = "otlp")]
    _traces: Option<traces::Traces>,
}

/// Sends logs to standard error. `filter` is a `tracing` filter, `info` or `lampwright=debug,info`; an unusable one means
/// `info`. Only the first call in a process has an effect. To be called outside an async runtime, and dropped there.
pub fn init(format: LogFormat, filter: &str) -> Telemetry {
    let filter = EnvFilter::try_new(filter).unwrap_or_else(|_| EnvFilter::new("info"));
    // Colours are for eyes; in a file or a collector they are noise.
    let lines = fmt::layer().with_writer(std::io::stderr).with_ansi(std::io::stderr().is_terminal());
    let lines = match format {
        LogFormat::Text => lines.fmt_fields(format::debug_fn(write_field).delimited(" ")).boxed(),
        LogFormat::Json => lines.json().flatten_event(true).boxed(),
    };
    let all = registry().with(filter).with(lines);
    #[cfg(feature = "otlp")]
    let (traces, layer) = traces::Traces::begin().unzip();
    #[cfg(feature = "otlp")]
    let all = all.with(layer);
    if let Err(error) = all.try_init() {
        tracing::debug!(%error, "logs were set up before");
    }
    Telemetry {
        #[cfg(feature = "otlp")]
        _traces: traces,
    }
}

/// A field of a log line for a person: the message as it is, anything else after its name. What others wrote cannot act on the
/// terminal, nor look like another line.
fn write_field(writer: &mut format::Writer<'_>, field: &Field, value: &dyn std::fmt::Debug) -> std::fmt::Result {
    let text = format!("{value:?}");
    match field.name() {
        "message" => write!(writer, "{}", visible(&text)),
        name => write!(writer, "{}={}", name.trim_start_matches("r#"), visible(&text)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{self, Write};
    use std::sync::{Arc, Mutex};

    #[derive(Clone, Default)]
    struct Written(Arc<Mutex<Vec<u8>>>);

    impl Write for Written {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_name_cannot_act_on_the_terminal_nor_forge_a_line() {
        let (written, name) = (Written::default(), "a\x1b[2J\u{202e}yar\n2026 ERROR forged");
        let writer = written.clone();
        let lines = fmt::layer().with_writer(move || writer.clone()).with_ansi(false);
        let subscriber = registry().with(lines.fmt_fields(format::debug_fn(write_field).delimited(" ")));
        tracing::subscriber::with_default(subscriber, || {
            let span = tracing::info_span!("job", %name);
            span.in_scope(|| tracing::info!(%name, count = 3, quoted = name, "left out {name}"));
        });
        let text = String::from_utf8(written.0.lock().unwrap().clone()).unwrap();
        let shown = r"a\u{1b}[2J\u{202e}yar\u{a}2026 ERROR forged";
        assert_eq!((text.matches('\n').count(), text.contains(['\x1b', '\u{202e}'])), (1, false), "{text}");
        assert!(text.contains(&format!("job{{name={shown}}}")), "{text}");
        assert!(text.contains(&format!("left out {shown} name={shown} count=3 quoted=\"a")), "{text}");
    }
}
