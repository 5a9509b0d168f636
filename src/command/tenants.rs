//! `tenants`: who uses the service, how much, and how much they may.

use super::stores::Stores;
use super::terminal::failure::Failure;
use super::terminal::table::{Table, count};
use super::terminal::{measure, output};
use clap::{Args, Subcommand};
use service::accounts::quota::Usage;
use service::accounts::tenants::Tenant;
use service::accounts::{quota, tenants};
use service::storage::error::Error;
use service::storage::records::Records;

/// Arguments of `tenants`.
#[derive(Args)]
pub struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// List tenants with their usage and quotas.
    List {
        #[command(flatten)]
        stores: Stores,
    },
    /// Set the quotas of a tenant. Quotas that are left out stay; `default` means the quota of the service.
    Set {
        /// Name of the tenant: a-z, 0-9 and -.
        tenant: String,
        /// Largest storage of the tenant, as 10GiB; 0 accepts no more files.
        #[arg(long, value_name = "SIZE", value_parser = size)]
        stored_bytes: Option<Limit>,
        /// Largest number of queued jobs; 0 accepts no jobs.
        #[arg(long, value_name = "N", value_parser = limit)]
        queued_jobs: Option<Limit>,
        /// Largest number of jobs computed at the same time; 0 leaves all of them queued.
        #[arg(long, value_name = "N", value_parser = limit)]
        running_jobs: Option<Limit>,
        #[command(flatten)]
        stores: Stores,
    },
}

/// A number, or whatever the service's default is.
#[derive(Clone, Copy)]
struct Limit(Option<u64>);

fn limit(text: &str) -> Result<Limit, String> {
    match text {
        "default" => Ok(Limit(None)),
        text => text.parse().map(|limit| Limit(Some(limit))).map_err(|_| "write a whole number, or default".to_owned()),
    }
}

fn size(text: &str) -> Result<Limit, String> {
    match text {
        "default" => Ok(Limit(None)),
        text => measure::bytes(text).map(|size| Limit(Some(size))).map_err(|wrong| format!("{wrong}, or default")),
    }
}

/// Lists tenants, or sets a quota.
///
/// # Errors
/// The name is not valid, or the database cannot be opened.
pub fn run(arguments: Arguments) -> Result<(), Failure> {
    match arguments.what {
        What::List { stores } => output::print(table(&stores.with_records(used)?))?,
        What::Set { tenant, stored_bytes, queued_jobs, running_jobs, stores } => {
            if !tenants::is_name(&tenant) {
                let found = "This is not a valid name of a tenant.";
                return Err(Failure::usage("tenants.name", found, "Write 1 to 64 of a-z, 0-9 and -.").at(tenant));
            }
            let said = |now: Option<u64>, said: Option<Limit>| said.map_or(now, |Limit(limit)| limit);
            stores.with_records(async |records| {
                let now = tenants::get(records, &tenant).await?;
                let set = Tenant {
                    stored_bytes: said(now.stored_bytes, stored_bytes),
                    queued_jobs: said(now.queued_jobs, queued_jobs),
                    running_jobs: said(now.running_jobs, running_jobs),
                    id: now.id,
                };
                tenants::set(records, &set).await
            })?;
        }
    }
    Ok(())
}

async fn used(records: &Records) -> Result<Vec<(Tenant, Usage)>, Error> {
    let mut used = Vec::new();
    for tenant in tenants::list(records).await? {
        let usage = quota::usage(records, &tenant.id).await?;
        used.push((tenant, usage));
    }
    Ok(used)
}

fn table(tenants: &[(Tenant, Usage)]) -> Table {
    let of = |limit: Option<u64>| limit.map_or("default".to_owned(), count);
    let mut table = Table::default();
    for (tenant, usage) in tenants {
        table.row(
            &tenant.id,
            [
                format!("{} of {} bytes", count(usage.stored_bytes), of(tenant.stored_bytes)),
                format!("{} of {} jobs waiting", count(usage.queued_jobs), of(tenant.queued_jobs)),
                format!("{} of {} running", count(usage.running_jobs), of(tenant.running_jobs)),
            ],
        );
    }
    table
}
