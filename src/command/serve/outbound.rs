//! Arguments of `serve` about outbound requests.

use clap::{Args, ValueEnum};
use service::Config;
use service::outbound::Exception;

/// Arguments about outbound requests.
#[derive(Args)]
#[command(next_help_heading = "Outbound requests, for webhooks and to fetch files")]
pub struct OutboundArguments {
    /// Allow outbound requests to this network, address or host name although it is not on the public internet, also without TLS:
    /// 10.20.0.0/16, fd00::/8 or receiver.lab; may be given more than once. Every client with a key can then reach it.
    #[arg(
        long = "outbound-allow",
        env = "LAMPWRIGHT_OUTBOUND_ALLOW",
        value_name = "NETWORK|NAME",
        value_delimiter = ','
    )]
    outbound_allow: Vec<Exception>,
    /// When to fetch ray files from URLs that clients name.
    #[arg(long, env = "LAMPWRIGHT_INGEST", value_enum, default_value_t)]
    ingest: Ingest,
    /// Allow fetching ray files from this bucket, with credentials from the AWS_* variables; may be given more than once. Every
    /// client with a key can then read its objects.
    #[arg(long = "ingest-bucket", env = "LAMPWRIGHT_INGEST_BUCKETS", value_name = "s3://BUCKET/PREFIX", value_delimiter = ',', value_parser = bucket)]
    ingest_buckets: Vec<String>,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum Ingest {
    /// Only if API keys are required.
    #[default]
    Auto,
    /// Always.
    On,
    /// Never.
    Off,
}

impl OutboundArguments {
    /// `config` with the values of these arguments.
    pub fn over(&self, config: Config) -> Config {
        Config {
            outbound_exceptions: self.outbound_allow.clone(),
            ingest: match self.ingest {
                Ingest::Auto => None,
                Ingest::On => Some(true),
                Ingest::Off => Some(false),
            },
            ingest_buckets: self.ingest_buckets.clone(),
            ..config
        }
    }
}

fn bucket(text: &str) -> Result<String, String> {
    match text.strip_prefix("s3://").is_some_and(|place| !place.is_empty() && !place.starts_with('/')) {
        true => Ok(text.to_owned()),
        false => Err("write s3://BUCKET or s3://BUCKET/PREFIX".to_owned()),
    }
}
