//! Spans to an OpenTelemetry collector, over HTTP: the only file that names it. Where to is said by the usual variables,
//! `OTEL_EXPORTER_OTLP_ENDPOINT` or `OTEL_EXPORTER_OTLP_TRACES_ENDPOINT`; without them nothing is sent.

use crate::tls;
use opentelemetry::KeyValue;
use opentelemetry::trace::TracerProvider;
use opentelemetry_otlp::SpanExporter;
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::{SdkTracerProvider, Tracer};
use tracing::Subscriber;
use tracing_opentelemetry::OpenTelemetryLayer;
use tracing_subscriber::registry::LookupSpan;

const PLACES: [&str; 2] = ["OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT"];

/// Sends spans in batches, the last of them when dropped.
pub struct Traces(SdkTracerProvider);

impl Traces {
    /// Begins, if there is a collector; with the layer that gives it spans.
    pub fn begin<S: Subscriber + for<'a> LookupSpan<'a>>() -> Option<(Traces, OpenTelemetryLayer<S, Tracer>)> {
        PLACES.iter().filter_map(std::env::var_os).find(|place| !place.is_empty())?;
        // A collector may be asked over TLS.
        tls::install();
        let exporter = match SpanExporter::builder().with_http().build() {
            Ok(exporter) => exporter,
            Err(error) => {
                // There are no logs yet to say it in.
                eprintln!("cannot send traces: {error}");
                return None;
            }
        };
        let version = KeyValue::new("service.version", env!("CARGO_PKG_VERSION"));
        let resource = Resource::builder().with_service_name("lampwright").with_attribute(version).build();
        let provider = SdkTracerProvider::builder().with_batch_exporter(exporter).with_resource(resource).build();
        let layer = tracing_opentelemetry::layer().with_tracer(provider.tracer("lampwright"));
        Some((Traces(provider), layer))
    }
}

impl Drop for Traces {
    fn drop(&mut self) {
        if let Err(error) = self.0.shutdown() {
            eprintln!("cannot send the last traces: {error}");
        }
    }
}
