//! Who may do what: the keys, the tenants they belong to, what a tenant may use, and how often a key may ask.

/// Keys: made, found, rotated, revoked.
pub mod keys;
/// Tenants and what is different about them.
pub mod tenants;
/// What a tenant may use, and uses.
pub mod quota;
/// How often a key may ask.
pub mod rate;

use super::storage::Error;
use super::storage::records::Records;
use keys::{Keyring, Refusal};
use rate::RateLimit;
use std::sync::Arc;

/// Whose everything is where no keys are asked for.
pub const DEFAULT_TENANT: &str = "default";

/// What a key may be for: a kind of thing and what may be done to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// See what was sent in.
    UploadsRead,
    /// Send in, and delete what was sent in.
    UploadsWrite,
    /// See jobs and what they gave.
    JobsRead,
    /// Queue, cancel and delete jobs.
    JobsWrite,
    /// See who is told of jobs, and how that went.
    WebhooksRead,
    /// Say who is told of jobs.
    WebhooksWrite,
    /// See the numbers of the whole service, every tenant's together.
    MetricsRead,
}

impl Scope {
    /// All.
    pub const ALL: [Scope; 7] = [
        Scope::UploadsRead,
        Scope::UploadsWrite,
        Scope::JobsRead,
        Scope::JobsWrite,
        Scope::WebhooksRead,
        Scope::WebhooksWrite,
        Scope::MetricsRead,
    ];
    /// What a tenant's own key is for when nothing is said: everything that is the tenant's.
    pub const OF_A_TENANT: [Scope; 6] = [
        Scope::UploadsRead,
        Scope::UploadsWrite,
        Scope::JobsRead,
        Scope::JobsWrite,
        Scope::WebhooksRead,
        Scope::WebhooksWrite,
    ];

    /// The word in rows, arguments and the contract.
    pub fn name(self) -> &'static str {
        match self {
            Scope::UploadsRead => "uploads:read",
            Scope::UploadsWrite => "uploads:write",
            Scope::JobsRead => "jobs:read",
            Scope::JobsWrite => "jobs:write",
            Scope::WebhooksRead => "webhooks:read",
            Scope::WebhooksWrite => "webhooks:write",
            Scope::MetricsRead => "metrics:read",
        }
    }

    /// Reads what [`Scope::name`] writes.
    pub fn parse(name: &str) -> Option<Scope> {
        Scope::ALL.into_iter().find(|scope| scope.name() == name)
    }
}

/// What a request may do, and to whose things.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Access {
    /// Whose things.
    pub tenant: String,
    /// What may be done.
    pub scopes: Vec<Scope>,
    /// The key it came with; `None` where no keys are asked for.
    pub key: Option<String>,
}

impl Access {
    /// Everybody's, where no keys are asked for.
    pub fn without_key() -> Access {
        Access { tenant: DEFAULT_TENANT.to_owned(), scopes: Scope::ALL.to_vec(), key: None }
    }

    /// Whether it may do this.
    pub fn may(&self, scope: Scope) -> bool {
        self.scopes.contains(&scope)
    }
}

/// What every request passes. Cheap to clone.
#[derive(Clone)]
pub struct Door {
    keys: Keyring,
    /// Without keys everybody who reaches the service may do everything; the service then listens on loopback only.
    asks_for_keys: bool,
    rate: Arc<RateLimit>,
}

impl Door {
    /// A door that knows the keys in `records`.
    pub fn new(records: Records, asks_for_keys: bool, rate: RateLimit) -> Door {
        Door { keys: Keyring::new(records), asks_for_keys, rate: Arc::new(rate) }
    }

    /// Whether a key is asked for.
    pub fn asks_for_keys(&self) -> bool {
        self.asks_for_keys
    }

    /// What the bearer of `token` may do.
    ///
    /// # Errors
    /// The database did not answer. Within: why the key opens nothing.
    pub async fn open(&self, token: Option<&str>) -> Result<Result<Access, Refusal>, Error> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scopes_read_what_they_write_and_nothing_else() {
        for scope in Scope::ALL {
            assert_eq!(Scope::parse(scope.name()), Some(scope));
        }
        for wrong in ["", "jobs", "jobs:", "JOBS:READ", "jobs:read ", "*"] {
            assert_eq!(Scope::parse(wrong), None, "{wrong:?}");
        }
    }
}
