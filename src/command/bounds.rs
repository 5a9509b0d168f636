//! What an operator allows: rates, quotas, room, retention. Arguments of `serve` that most never touch.

use super::measure;
use crate::service::access::quota::Quota;
use crate::service::config::Retention;
use crate::service::{Config, connections, pace};
use clap::Args;
use std::time::Duration;

/// Arguments that bound what clients may ask of the service.
#[derive(Args)]
#[command(next_help_heading = "What clients may ask of it")]
pub struct Bounds {
    /// Web pages of this origin may use the service, as https://portal.example; may be given more than once.
    #[arg(long = "cors-origin", env = "LAMPWRIGHT_CORS_ORIGINS", value_name = "ORIGIN", value_delimiter = ',', value_parser = origin)]
    cors_origins: Vec<String>,
    /// Connections at once [default: 512].
    #[arg(long, env = "LAMPWRIGHT_MAX_CONNECTIONS", value_name = "N", value_parser = measure::at_least_one::<usize>)]
    max_connections: Option<usize>,
    /// Requests a second that a key may make on and on [default: 50].
    #[arg(long, env = "LAMPWRIGHT_RATE", value_name = "N", value_parser = measure::at_least_one::<u32>)]
    rate: Option<u32>,
    /// Requests that a key may make at once after a rest [default: 200].
    #[arg(long, env = "LAMPWRIGHT_BURST", value_name = "N", value_parser = measure::at_least_one::<u32>)]
    burst: Option<u32>,
    /// What must come of an upload in each minute, as 60KiB; 0 is no bound, so that a silent client keeps its place
    /// [default: 60KiB].
    #[arg(long, env = "LAMPWRIGHT_SLOWEST_UPLOAD", value_name = "SIZE", value_parser = measure::bytes)]
    slowest_upload: Option<u64>,
    /// Time for which an upload that can be resumed is kept when nothing more comes, and what became of one that has ended, as
    /// 36h or in days [default: 7d].
    #[arg(long, env = "LAMPWRIGHT_UPLOAD_EXPIRY", value_name = "TIME", value_parser = measure::some_days)]
    upload_expiry: Option<Duration>,
    /// Most that a tenant may keep, as 10GiB [default: no limit]; `lampwright tenants set` says otherwise for one.
    #[arg(long, env = "LAMPWRIGHT_QUOTA_BYTES", value_name = "SIZE", value_parser = measure::some_bytes)]
    quota_bytes: Option<u64>,
    /// Most jobs of a tenant that may wait [default: 10000].
    #[arg(long, env = "LAMPWRIGHT_QUOTA_QUEUED", value_name = "N", value_parser = measure::at_least_one::<u64>)]
    quota_queued: Option<u64>,
    /// Most jobs of a tenant that are computed at once [default: no limit].
    #[arg(long, env = "LAMPWRIGHT_QUOTA_RUNNING", value_name = "N", value_parser = measure::at_least_one::<u64>)]
    quota_running: Option<u64>,
    /// What is kept free on local disks, as 2GiB: with less, nothing new is taken and /readyz is 503; 0 is nothing [default: 512MiB].
    #[arg(long, env = "LAMPWRIGHT_KEEP_FREE", value_name = "SIZE", value_parser = measure::bytes)]
    keep_free: Option<u64>,
    /// Time after which an ended job and its artifacts are deleted, as 36h or in days [default: never].
    #[arg(long, env = "LAMPWRIGHT_KEEP_JOBS", value_name = "TIME", value_parser = measure::some_days)]
    keep_jobs: Option<Duration>,
    /// Time after its last use after which a ray set is deleted, as 36h or in days [default: never].
    #[arg(long, env = "LAMPWRIGHT_KEEP_RAY_SETS", value_name = "TIME", value_parser = measure::some_days)]
    keep_ray_sets: Option<Duration>,
}

impl Bounds {
    /// `config` with what was said.
    pub fn over(&self, config: Config) -> Config {
        let Config { quota, bounds, slowest, retention, .. } = config;
        Config {
            cors_origins: self.cors_origins.clone(),
            bounds: connections::Bounds { connections: self.max_connections.unwrap_or(bounds.connections), ..bounds },
            rate_per_second: self.rate.unwrap_or(config.rate_per_second),
            rate_burst: self.burst.unwrap_or(config.rate_burst),
            slowest: pace::Slowest { bytes: self.slowest_upload.unwrap_or(slowest.bytes), ..slowest },
            upload_expiry: self.upload_expiry.unwrap_or(config.upload_expiry),
            quota: Quota {
                stored_bytes: self.quota_bytes.unwrap_or(quota.stored_bytes),
                queued_jobs: self.quota_queued.unwrap_or(quota.queued_jobs),
                running_jobs: self.quota_running.unwrap_or(quota.running_jobs),
            },
            keep_free: self.keep_free.unwrap_or(config.keep_free),
            retention: Retention {
                jobs: self.keep_jobs.or(retention.jobs),
                ray_sets: self.keep_ray_sets.or(retention.ray_sets),
                ..retention
            },
            ..config
        }
    }
}

/// `https://portal.example`, as a browser sends it: no path, no slash at the end.
fn origin(text: &str) -> Result<String, String> {
    let place = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    let plain =
        |place: &str| !place.is_empty() && place.bytes().all(|b| b.is_ascii_graphic() && b != b'/' && b != b'*');
    match place.is_some_and(plain) {
        true => Ok(text.to_ascii_lowercase()),
        false => Err("write scheme, name and port only, as https://portal.example".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::origin;

    #[test]
    fn an_origin_is_what_a_browser_sends() {
        assert_eq!(origin("https://Portal.example:8443").as_deref(), Ok("https://portal.example:8443"));
        for wrong in ["*", "portal.example", "https://", "https://portal.example/", "https://*.example", "null"] {
            assert!(origin(wrong).is_err(), "{wrong}");
        }
    }
}
