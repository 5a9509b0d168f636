//! Access control: API keys, the tenants they belong to, the quotas of tenants and the rate limits of keys.

/// API keys: making, finding, rotating and revoking them.
pub mod keys;
/// Tenants and their own quotas.
pub mod tenants;
/// Quotas and usage of tenants.
pub mod quota;
/// The rate limit of a key.
pub mod rate;
/// Scopes, and the access that a request has.
pub mod access;

use crate::storage::error::Error;
use crate::storage::records::Records;
use access::Access;
use keys::{Keyring, Refusal};
use rate::RateLimit;
use std::sync::Arc;

/// Authenticates requests: finds the API key of a request, its tenant and scopes, and counts its requests. Cheap to clone.
#[derive(Clone)]
pub struct Authenticator {
    keys: Keyring,
    /// Without keys everybody who reaches the service may do everything; the service then listens on loopback only.
    asks_for_keys: bool,
    rate: Arc<RateLimit>,
}

impl Authenticator {
    /// An authenticator for the API keys in `records`.
    pub fn new(records: Records, asks_for_keys: bool, rate: RateLimit) -> Authenticator {
        Authenticator { keys: Keyring::new(records), asks_for_keys, rate: Arc::new(rate) }
    }

    /// Whether requests need an API key.
    pub fn asks_for_keys(&self) -> bool {
        self.asks_for_keys
    }

    /// The access that the API key `token` gives; full access where no keys are required.
    ///
    /// # Errors
    /// The database did not answer. Within: why the key opens nothing.
    pub async fn authenticate(&self, token: Option<&str>) -> Result<Result<Access, Refusal>, Error> {
        match token {
            _ if !self.asks_for_keys => Ok(Ok(Access::without_key())),
            None => Ok(Err(Refusal::Missing)),
            Some(token) => self.keys.open(token).await,
        }
    }

    /// The rate limit of a key.
    pub fn policy(&self) -> rate::Policy {
        self.rate.policy()
    }

    /// Counts one request of a key; how many more it may make now, or `None` where no keys are asked for.
    ///
    /// # Errors
    /// How long to wait before the next, if that was one too many.
    pub fn count(&self, access: &Access) -> Result<Option<u32>, std::time::Duration> {
        access.key.as_deref().map(|key| self.rate.count(key)).transpose()
    }
}
