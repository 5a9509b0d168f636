//! Logs: one JSON object a line, or text for a person at a terminal. Every line of a request carries its id, tenant and key,
//! every line of a job its id and attempt. With the feature `otlp`, the same spans go to an OpenTelemetry collector.

/// Spans to a collector.
#[cfg(feature = "otlp")]
mod traces;

use std::io::IsTerminal;
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
        LogFormat::Text => lines.boxed(),
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
