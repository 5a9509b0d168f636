//! What a request may do.

/// The tenant of all requests where no API keys are required.
pub const DEFAULT_TENANT: &str = "default";

/// A scope of an API key: what its requests may do with one kind of resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// Read ray sets, spectra and uploads.
    UploadsRead,
    /// Upload and delete ray sets, spectra and uploads.
    UploadsWrite,
    /// Read jobs and their artifacts.
    JobsRead,
    /// Queue, cancel and delete jobs.
    JobsWrite,
    /// Read webhooks and their deliveries.
    WebhooksRead,
    /// Create, change and delete webhooks.
    WebhooksWrite,
    /// Read the metrics of the whole service, all tenants together.
    MetricsRead,
}

impl Scope {
    /// All scopes.
    pub const ALL: [Scope; 7] = [
        Scope::UploadsRead,
        Scope::UploadsWrite,
        Scope::JobsRead,
        Scope::JobsWrite,
        Scope::WebhooksRead,
        Scope::WebhooksWrite,
        Scope::MetricsRead,
    ];
    /// The default scopes of a new key: everything that belongs to its tenant.
    pub const OF_A_TENANT: [Scope; 6] = [
        Scope::UploadsRead,
        Scope::UploadsWrite,
        Scope::JobsRead,
        Scope::JobsWrite,
        Scope::WebhooksRead,
        Scope::WebhooksWrite,
    ];

    /// Name of the scope in the database, in arguments and in the API.
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

/// What a request may do, and for which tenant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Access {
    /// The tenant whose resources the request may use.
    pub tenant: String,
    /// The scopes of the key.
    pub scopes: Vec<Scope>,
    /// Id of the API key of the request; `None` where no keys are required.
    pub key: Option<String>,
}

impl Access {
    /// The access of every request where no API keys are required.
    pub fn without_key() -> Access {
        Access { tenant: DEFAULT_TENANT.to_owned(), scopes: Scope::ALL.to_vec(), key: None }
    }

    /// Whether the request has this scope.
    pub fn may(&self, scope: Scope) -> bool {
        self.scopes.contains(&scope)
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
