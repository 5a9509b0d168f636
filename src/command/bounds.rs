//! What an operator allows: rates, quotas, room, retention. Arguments of `serve` that most never touch.

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
    #[arg(long, env = "LAMPWRIGHT_MAX_CONNECTIONS", value_name = "N")]
    max_connections: Option<usize>,
    /// Requests a second that a key may make on and on [default: 50].
    #[arg(long, env = "LAMPWRIGHT_RATE", value_name = "N")]
    rate: Option<u32>,
    /// Requests that a key may make at once after a rest [default: 200].
    #[arg(long, env = "LAMPWRIGHT_BURST", value_name = "N")]
    burst: Option<u32>,
    /// Fewest bytes of an upload that must come in each minute [default: 61440].
    #[arg(long, env = "LAMPWRIGHT_SLOWEST_UPLOAD", value_name = "BYTES")]
    slowest_upload: Option<u64>,
    /// Days for which an upload that can be resumed is kept when nothing more comes, and what became of one that has ended
    /// [default: 7].
    #[arg(long, env = "LAMPWRIGHT_UPLOAD_EXPIRY", value_name = "DAYS")]
    upload_expiry: Option<u32>,
    /// Most bytes a tenant may keep [default: no limit]; `lampwright tenants set` says otherwise for one.
    #[arg(long, env = "LAMPWRIGHT_QUOTA_BYTES", value_name = "BYTES")]
    quota_bytes: Option<u64>,
    /// Most jobs of a tenant that may wait [default: 10000].
    #[arg(long, env = "LAMPWRIGHT_QUOTA_QUEUED", value_name = "N")]
    quota_queued: Option<u64>,
    /// Most jobs of a tenant that are computed at once [default: no limit].
    #[arg(long, env = "LAMPWRIGHT_QUOTA_RUNNING", value_name = "N")]
    quota_running: Option<u64>,
    /// Bytes kept free on local disks: with less, no upload is taken [default: 512 MiB].
    #[arg(long, env = "LAMPWRIGHT_KEEP_FREE", value_name = "BYTES")]
    keep_free: Option<u64>,
    /// Days after which an ended job and its artifacts are deleted [default: never].
    #[arg(long, env = "LAMPWRIGHT_KEEP_JOBS", value_name = "DAYS")]
    keep_jobs: Option<u32>,
    /// Days after its last use after which a ray set is deleted [default: never].
    #[arg(long, env = "LAMPWRIGHT_KEEP_RAY_SETS", value_name = "DAYS")]
    keep_ray_sets: Option<u32>,
}

impl Bounds {
    /// `config` with what was said.
    pub fn over(&self, config: Config) -> Config {
        let days = |days: u32| Duration::from_hours(24 * u64::from(days));
        let Config { quota, bounds, slowest, retention, .. } = config;
        Config {
            cors_origins: self.cors_origins.clone(),
            bounds: connections::Bounds { connections: self.max_connections.unwrap_or(bounds.connections), ..bounds },
            rate_per_second: self.rate.unwrap_or(config.rate_per_second),
            rate_burst: self.burst.unwrap_or(config.rate_burst),
            slowest: pace::Slowest { bytes: self.slowest_upload.unwrap_or(slowest.bytes), ..slowest },
            upload_expiry: self.upload_expiry.map_or(config.upload_expiry, days),
            quota: Quota {
                stored_bytes: self.quota_bytes.unwrap_or(quota.stored_bytes),
                queued_jobs: self.quota_queued.unwrap_or(quota.queued_jobs),
                running_jobs: self.quota_running.unwrap_or(quota.running_jobs),
            },
            keep_free: self.keep_free.unwrap_or(config.keep_free),
            retention: Retention {
                jobs: self.keep_jobs.map(days).or(retention.jobs),
                ray_sets: self.keep_ray_sets.map(days).or(retention.ray_sets),
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
