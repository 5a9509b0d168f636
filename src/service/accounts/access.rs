//! What a request may do.

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
