//! Who may do what: the keys, the tenants they belong to, what a tenant may use, and how often a key may ask.

/// Keys: made, found, rotated, revoked.
pub mod keys;
/// Tenants and what is different about them.
pub mod tenants;
/// What a tenant may use, and uses.
pub mod quota;
/// How often a key may ask.
pub mod rate;
/// What a request may do.
pub mod access;

use crate::storage::error::Error;
use crate::storage::records::Records;
use access::Access;
use keys::{Keyring, Refusal};
use rate::RateLimit;
use std::sync::Arc;

/// What every request passes. Cheap to clone.
#[derive(Clone)]
pub struct Authenticator {
    keys: Keyring,
    /// Without keys everybody who reaches the service may do everything; the service then listens on loopback only.
    asks_for_keys: bool,
    rate: Arc<RateLimit>,
}

impl Authenticator {
    /// Checks requests against the keys in `records`.
    pub fn new(records: Records, asks_for_keys: bool, rate: RateLimit) -> Authenticator {
        Authenticator { keys: Keyring::new(records), asks_for_keys, rate: Arc::new(rate) }
    }

    /// Whether a key is asked for.
    pub fn asks_for_keys(&self) -> bool {
        self.asks_for_keys
    }

    /// What the bearer of `token` may do.
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

    /// How often a key may ask.
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
