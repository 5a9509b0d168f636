//! What a service may ask elsewhere. Arguments of `serve` that most never touch.

use clap::{Args, ValueEnum};
use service::Config;
use service::outbound::Exception;

/// Arguments that bound what the service asks elsewhere.
#[derive(Args)]
#[command(next_help_heading = "What it may ask elsewhere, for webhooks and to fetch files")]
pub struct Elsewhere {
    /// A network, address or name that may be asked although it is not the internet's, also without TLS: 10.20.0.0/16, fd00::/8 or
    /// receiver.lab; may be given more than once. Whoever has a key can then ask it.
    #[arg(
        long = "outbound-allow",
        env = "LAMPWRIGHT_OUTBOUND_ALLOW",
        value_name = "NETWORK|NAME",
        value_delimiter = ','
    )]
    outbound_allow: Vec<Exception>,
    /// Fetch ray files from addresses that clients name.
    #[arg(long, env = "LAMPWRIGHT_INGEST", value_enum, default_value_t)]
    ingest: Ingest,
    /// Fetch ray files from this bucket too, with AWS_* as usual; may be given more than once. Whoever has a key can then read
    /// what is in it.
    #[arg(long = "ingest-bucket", env = "LAMPWRIGHT_INGEST_BUCKETS", value_name = "s3://BUCKET/PREFIX", value_delimiter = ',', value_parser = bucket)]
    ingest_buckets: Vec<String>,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum Ingest {
    /// Where keys are asked for.
    #[default]
    Auto,
    /// Always.
    On,
    /// Never.
    Off,
}

impl Elsewhere {
    /// `config` with what was said.
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
