//! What an operator allows: rates, quotas, room, retention. Arguments of `serve` that most never touch.

use crate::command::terminal::measure;
use clap::Args;
use ipnet::IpNet;
use service::accounts::quota::Quota;
use service::config::Retention;
use service::forwarded::{Prefix, Proxies};
use service::ray_sets::pace;
use service::{Config, connections};
use std::net::IpAddr;
use std::time::Duration;

/// Arguments that limit clients of the service.
#[derive(Args)]
#[command(next_help_heading = "Limits for clients")]
pub struct Bounds {
    /// Allow web pages of this origin to use the service, as https://portal.example; may be given more than once.
    #[arg(long = "cors-origin", env = "LAMPWRIGHT_CORS_ORIGINS", value_name = "ORIGIN", value_delimiter = ',', value_parser = cors_origin)]
    cors_origins: Vec<String>,
    /// Largest number of connections; a further one replaces an idle connection [default: 512].
    #[arg(long, env = "LAMPWRIGHT_MAX_CONNECTIONS", value_name = "N", value_parser = measure::at_least_one::<usize>)]
    max_connections: Option<usize>,
    /// Largest number of connections from one address, and of simultaneous requests that trusted proxies forward for one address;
    /// this machine and the trusted proxies themselves are not limited [default: half of --max-connections].
    #[arg(long, env = "LAMPWRIGHT_MAX_CONNECTIONS_PER_ADDRESS", value_name = "N", value_parser = measure::at_least_one::<usize>)]
    max_connections_per_address: Option<usize>,
    /// Address of a proxy in front of the service, or network of several, as 10.1.2.3 or 10.1.0.0/16: the service trusts its
    /// headers Forwarded, X-Forwarded-For and X-Forwarded-Prefix; may be given more than once.
    #[arg(long = "trusted-proxy", env = "LAMPWRIGHT_TRUSTED_PROXIES", value_name = "NETWORK", value_delimiter = ',', value_parser = network)]
    trusted_proxies: Vec<IpNet>,
    /// Public URL of the service, as https://lab.example/lampwright: links in its answers begin with this path.
    #[arg(long, env = "LAMPWRIGHT_PUBLIC_URL", value_name = "URL", value_parser = public_path)]
    public_url: Option<Prefix>,
    /// Sustained rate of one API key, requests per second [default: 50].
    #[arg(long, env = "LAMPWRIGHT_RATE", value_name = "N", value_parser = measure::at_least_one::<u32>)]
    rate: Option<u32>,
    /// Largest burst of requests of one API key after a pause [default: 200].
    #[arg(long, env = "LAMPWRIGHT_BURST", value_name = "N", value_parser = measure::at_least_one::<u32>)]
    burst: Option<u32>,
    /// Least data that an upload must send in each minute, as 60KiB; with 0 there is no limit, and a stalled client is never
    /// disconnected [default: 60KiB].
    #[arg(long, env = "LAMPWRIGHT_SLOWEST_UPLOAD", value_name = "SIZE", value_parser = measure::bytes)]
    slowest_upload: Option<u64>,
    /// Time after which an unfinished resumable upload expires when no more bytes arrive, and the result of an ended one, as 36h
    /// or in days [default: 7d].
    #[arg(long, env = "LAMPWRIGHT_UPLOAD_EXPIRY", value_name = "TIME", value_parser = measure::some_days)]
    upload_expiry: Option<Duration>,
    /// Largest storage of one tenant, as 10GiB [default: no limit]; `lampwright tenants set` overrides it for one tenant.
    #[arg(long, env = "LAMPWRIGHT_QUOTA_BYTES", value_name = "SIZE", value_parser = measure::some_bytes)]
    quota_bytes: Option<u64>,
    /// Largest number of queued jobs of one tenant [default: 10000].
    #[arg(long, env = "LAMPWRIGHT_QUOTA_QUEUED", value_name = "N", value_parser = measure::at_least_one::<u64>)]
    quota_queued: Option<u64>,
    /// Largest number of jobs of one tenant that are computed at the same time [default: no limit].
    #[arg(long, env = "LAMPWRIGHT_QUOTA_RUNNING", value_name = "N", value_parser = measure::at_least_one::<u64>)]
    quota_running: Option<u64>,
    /// Space to keep free on local disks, as 2GiB: below it, new files and jobs are refused and /readyz is 503; 0 turns this off
    /// [default: 512MiB].
    #[arg(long, env = "LAMPWRIGHT_KEEP_FREE", value_name = "SIZE", value_parser = measure::bytes)]
    keep_free: Option<u64>,
    /// Time after its end after which a job and its artifacts are deleted, as 36h or in days [default: never].
    #[arg(long, env = "LAMPWRIGHT_KEEP_JOBS", value_name = "TIME", value_parser = measure::some_days)]
    keep_jobs: Option<Duration>,
    /// Time after its last use after which a ray set is deleted, as 36h or in days [default: never].
    #[arg(long, env = "LAMPWRIGHT_KEEP_RAY_SETS", value_name = "TIME", value_parser = measure::some_days)]
    keep_ray_sets: Option<Duration>,
}

impl Bounds {
    fn connections(&self, bounds: connections::Bounds) -> connections::Bounds {
        let connections = self.max_connections.unwrap_or(bounds.connections);
        let per_address = self.max_connections_per_address.unwrap_or(connections.div_ceil(2));
        connections::Bounds { connections, per_address, ..bounds }
    }

    /// `config` with the values of these arguments.
    pub fn over(&self, config: Config) -> Config {
        let Config { quota, bounds, slowest, retention, .. } = config;
        Config {
            cors_origins: self.cors_origins.clone(),
            bounds: self.connections(bounds),
            proxies: Proxies { trusted: self.trusted_proxies.clone(), public: self.public_url.clone() },
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

/// `10.1.2.3` or `10.1.0.0/16`.
fn network(text: &str) -> Result<IpNet, String> {
    let address = text.parse::<IpAddr>().map(IpNet::from);
    let network = address.or_else(|_| text.parse::<IpNet>());
    network.map_err(|_| "write an address or a network, as 10.1.2.3, 10.1.0.0/16 or fd00::/8".to_owned())
}

/// The path of `https://lab.example/lampwright`.
fn public_path(text: &str) -> Result<Prefix, String> {
    let place = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    let place = place.filter(|place| !place.is_empty() && !place.starts_with('/'));
    let path = place.map(|place| place.find('/').map_or("", |slash| place.get(slash..).unwrap_or_default()));
    let wrong = || "write scheme, host and path, as https://lab.example/lampwright".to_owned();
    path.and_then(Prefix::parse).ok_or_else(wrong)
}

/// `https://portal.example`, as a browser sends it: no path, no slash at the end.
fn cors_origin(text: &str) -> Result<String, String> {
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
    use super::{cors_origin, network, public_path};

    #[test]
    fn an_origin_is_what_a_browser_sends() {
        assert_eq!(cors_origin("https://Portal.example:8443").as_deref(), Ok("https://portal.example:8443"));
        for wrong in ["*", "portal.example", "https://", "https://portal.example/", "https://*.example", "null"] {
            assert!(cors_origin(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_proxy_is_an_address_or_a_network_and_a_public_url_has_a_path() {
        assert_eq!(network("10.1.2.3").map(|network| network.to_string()).as_deref(), Ok("10.1.2.3/32"));
        assert!(network("fd00::/8").is_ok() && network("proxy.lab").is_err() && network("10.0.0.0/33").is_err());
        let path = |url: &str| public_path(url).map(|prefix| prefix.as_str().to_owned());
        assert_eq!(path("https://lab.example/lamps/").as_deref(), Ok("/lamps"));
        assert_eq!(path("http://lab.example:8080").as_deref(), Ok(""));
        for wrong in
            ["/lamps", "lab.example/lamps", "https:///lamps", "https://lab.example/a?b", "https://lab.example//x"]
        {
            assert!(path(wrong).is_err(), "{wrong}");
        }
    }
}
