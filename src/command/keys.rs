//! `keys`: who may use the service. Works next to a running one, on the same database.

use super::stores::Stores;
use super::terminal::failure::Failure;
use super::terminal::table::{Table, moment};
use super::terminal::{measure, output};
use clap::{Args, Subcommand};
use service::accounts::access::DEFAULT_TENANT;
use service::accounts::access::Scope;
use service::accounts::keys::{Issued, Key, NewKey};
use service::accounts::{keys, tenants};
use std::time::Duration;

/// Arguments of `keys`.
#[derive(Args)]
pub struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Make an API key and print it; it is shown only once.
    Create {
        /// Tenant that the key belongs to: a-z, 0-9 and -.
        #[arg(long, value_name = "NAME", default_value = DEFAULT_TENANT, value_parser = tenant)]
        tenant: String,
        /// Scope of the key; may be given more than once [default: every scope of a tenant].
        #[arg(long = "scope", value_name = "SCOPE", value_parser = scope)]
        scopes: Vec<Scope>,
        /// Name of the key, for display only.
        #[arg(long, default_value = "", value_name = "TEXT")]
        name: String,
        /// Time until the key expires, as 36h or in days [default: it does not expire].
        #[arg(long, value_name = "TIME", value_parser = measure::some_days)]
        expires: Option<Duration>,
        #[command(flatten)]
        stores: Stores,
    },
    /// List API keys, without their secrets, which are not stored.
    List {
        /// List only the keys of this tenant.
        #[arg(long, value_name = "NAME")]
        tenant: Option<String>,
        #[command(flatten)]
        stores: Stores,
    },
    /// Replace an API key by a new one with the same tenant and scopes.
    Rotate {
        /// Id of the key to replace.
        id: String,
        /// Time for which both keys are valid, as 30m or in hours; 0 revokes the old key at once.
        #[arg(long, value_name = "TIME", default_value = "24h", value_parser = measure::hours)]
        overlap: Duration,
        #[command(flatten)]
        stores: Stores,
    },
    /// Revoke an API key at once.
    Revoke {
        /// Id of the key to revoke.
        id: String,
        #[command(flatten)]
        stores: Stores,
    },
}

fn milliseconds(time: Duration) -> i64 {
    i64::try_from(time.as_millis()).unwrap_or(i64::MAX)
}

fn tenant(text: &str) -> Result<String, String> {
    let said = tenants::is_name(text).then(|| text.to_owned());
    said.ok_or_else(|| "write 1 to 64 of a-z, 0-9 and -".to_owned())
}

fn scope(text: &str) -> Result<Scope, String> {
    Scope::parse(text).ok_or_else(|| format!("write one of {}", Scope::ALL.map(Scope::name).join(", ")))
}

/// Makes, lists, rotates or revokes API keys.
///
/// # Errors
/// There is no such key, or the database cannot be opened.
pub fn run(arguments: Arguments) -> Result<(), Failure> {
    match arguments.what {
        What::Create { tenant, scopes, name, expires, stores } => {
            let scopes = if scopes.is_empty() { Scope::OF_A_TENANT.to_vec() } else { scopes };
            let new = NewKey { tenant, name, scopes, lifetime_ms: expires.map(milliseconds) };
            tell(&stores.with_records(async |records| keys::create(records, &new).await)?)?;
        }
        What::List { tenant, stores } => {
            let listed = stores.with_records(async |records| keys::list(records, tenant.as_deref()).await)?;
            output::print(table(&listed))?;
        }
        What::Rotate { id, overlap, stores } => {
            let overlap_ms = milliseconds(overlap);
            let issued = stores.with_records(async |records| keys::rotate(records, &id, overlap_ms).await)?;
            tell(&issued.ok_or_else(|| none(&id))?)?;
        }
        What::Revoke { id, stores } => {
            let revoked = stores.with_records(async |records| keys::revoke(records, &id).await)?;
            revoked.then_some(()).ok_or_else(|| none(&id))?;
        }
    }
    Ok(())
}

/// The key alone on standard output, so that it can be piped into a secret store.
fn tell(issued: &Issued) -> Result<(), Failure> {
    eprintln!("Key {}, shown only this once:", issued.id);
    output::print(format_args!("{}\n", issued.token))
}

fn none(id: &str) -> Failure {
    Failure::failed("keys.missing", "There is no valid key with this id.", "lampwright keys list shows all keys.")
        .at(id)
}

fn table(keys: &[Key]) -> Table {
    let mut table = Table::default();
    for key in keys {
        let state = match (key.revoked_ms, key.expires_ms) {
            (Some(revoked_ms), _) => format!("revoked {}", moment(revoked_ms)),
            (None, Some(expires_ms)) => format!("until {}", moment(expires_ms)),
            (None, None) => "until revoked".to_owned(),
        };
        let scopes: Vec<&str> = key.scopes.iter().map(|scope| scope.name()).collect();
        let cells = [key.id.clone(), scopes.join(" "), moment(key.created_ms), state, key.name.clone()];
        table.row(&key.tenant, cells);
    }
    table
}
