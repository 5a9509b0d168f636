//! Keys: `lw_<id>_<secret>`. The id finds the row, the secret proves the bearer; only the SHA-256 of the secret is stored, which
//! needs no salt and no slow hash because the secret is 256 random bits. A key is shown once, when it is made.

use super::access::{Access, Scope};
use crate::hex::hex;
use crate::storage::error::Error;
use crate::storage::records::statement::{Row, sql};
use crate::storage::records::{Records, Transaction};
use crate::storage::together::Together;
use futures::FutureExt;
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use subtle::ConstantTimeEq;

/// What every key begins with, so that scanners of leaked secrets can find it.
const PREFIX: &str = "lw";
const ID_BYTES: usize = 8;
const SECRET_BYTES: usize = 32;

/// An API key, without its secret.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Key {
    /// Id of the key: its public part.
    pub id: String,
    /// Tenant that the key belongs to.
    pub tenant: String,
    /// Name of the key, for display only.
    pub name: String,
    /// Scopes of the key.
    pub scopes: Vec<Scope>,
    /// When the key was made, epoch ms.
    pub created_ms: i64,
    /// When the key expires, epoch ms, if it does.
    pub expires_ms: Option<i64>,
    /// When the key was revoked, epoch ms, if it was.
    pub revoked_ms: Option<i64>,
}

/// The properties of a key to make.
#[derive(Clone, Debug)]
pub struct NewKey {
    /// Tenant that the key belongs to.
    pub tenant: String,
    /// Name of the key, for display only.
    pub name: String,
    /// Scopes of the key.
    pub scopes: Vec<Scope>,
    /// Time until the key expires, ms; `None` if it does not expire.
    pub lifetime_ms: Option<i64>,
}

/// A key that was just made. Its token is nowhere else.
#[derive(Clone, Debug)]
pub struct Issued {
    /// Id of the key: its public part.
    pub id: String,
    /// The whole token: id and secret.
    pub token: String,
}

/// Why an API key is not accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The request has no key.
    Missing,
    /// The token does not have the form of a key of this service.
    Malformed,
    /// The id is not known, or the secret is wrong: clients are not told which.
    Unknown,
    /// The key has expired.
    Expired,
    /// The key was revoked.
    Revoked,
}

/// Makes a key.
///
/// # Errors
/// The database did not answer; the system has no randomness.
pub async fn create(records: &Records, new: &NewKey) -> Result<Issued, Error> {
    let mut transaction = records.begin().await?;
    let issued = insert(&mut transaction, new).await?;
    transaction.commit().await?;
    Ok(issued)
}

async fn insert(transaction: &mut Transaction, new: &NewKey) -> Result<Issued, Error> {
    let (id, secret) = (hex(&random::<ID_BYTES>()?), hex(&random::<SECRET_BYTES>()?));
    let scopes: Vec<&str> = new.scopes.iter().map(|scope| scope.name()).collect();
    let insert = "INSERT INTO api_keys (id, tenant, name, scopes, secret_sha256, created_ms, expires_ms) \
                  VALUES ($1, $2, $3, $4, $5, {now}, CASE WHEN $6 > 0 THEN {now} + $6 END)";
    let insert = sql(insert).bind(id.as_str()).bind(new.tenant.as_str()).bind(new.name.as_str());
    let insert = insert.bind(scopes.join(" ")).bind(digest(&secret)).bind(new.lifetime_ms.unwrap_or(0));
    transaction.write(insert).await?;
    Ok(Issued { token: format!("{PREFIX}_{id}_{secret}"), id })
}

/// Every key, oldest first; of one tenant if given.
///
/// # Errors
/// The database did not answer.
pub async fn list(records: &Records, tenant: Option<&str>) -> Result<Vec<Key>, Error> {
    let select = sql("SELECT * FROM api_keys WHERE ($1 IS NULL OR tenant = $1) ORDER BY created_ms, id");
    records.read(select.bind(tenant)).await?.iter().map(key).collect()
}

/// Whether there is any valid key.
///
/// # Errors
/// The database did not answer.
pub async fn any(records: &Records) -> Result<bool, Error> {
    let select =
        "SELECT id FROM api_keys WHERE revoked_ms IS NULL AND (expires_ms IS NULL OR expires_ms > {now}) LIMIT 1";
    Ok(records.read_one(sql(select)).await?.is_some())
}

/// Makes a new key with the properties and the lifetime of the key `id`, which then expires `overlap_ms` from now, or earlier if
/// it would have. `None` if there is no such key, or it is not valid any more.
///
/// # Errors
/// As [`create`].
pub async fn rotate(records: &Records, id: &str, overlap_ms: i64) -> Result<Option<Issued>, Error> {
    let before = records.read_one(sql("SELECT * FROM api_keys WHERE id = $1").bind(id)).await?;
    let lifetime_ms = match before.as_ref().map(key).transpose()? {
        Some(Key { created_ms, expires_ms: Some(expires_ms), .. }) => Some(expires_ms - created_ms),
        _ => None,
    };
    let mut transaction = records.begin().await?;
    let end = "UPDATE api_keys SET expires_ms = CASE WHEN expires_ms < {now} + $1 THEN expires_ms ELSE {now} + $1 END \
               WHERE id = $2 AND revoked_ms IS NULL AND (expires_ms IS NULL OR expires_ms > {now}) RETURNING *";
    let rows = transaction.read(sql(end).bind(overlap_ms).bind(id)).await?;
    let Some(old) = rows.first().map(key).transpose()? else {
        transaction.rollback().await?;
        return Ok(None);
    };
    let new = NewKey { tenant: old.tenant, name: old.name, scopes: old.scopes, lifetime_ms };
    let issued = insert(&mut transaction, &new).await?;
    transaction.commit().await?;
    Ok(Some(issued))
}

/// Revokes a key at once. False if there is no such key, or it was revoked before.
///
/// # Errors
/// The database did not answer.
pub async fn revoke(records: &Records, id: &str) -> Result<bool, Error> {
    let revoke = sql("UPDATE api_keys SET revoked_ms = {now} WHERE id = $1 AND revoked_ms IS NULL");
    Ok(records.write(revoke.bind(id)).await? > 0)
}

/// A key with the digest of its secret, read from its row.
#[derive(Clone)]
struct StoredKey {
    key: Key,
    secret_sha256: String,
    /// The database's time when it was read, epoch ms.
    now_ms: i64,
}

/// Looks keys up in the database, for every request anew: a key that was revoked, by whichever process, opens nothing from the next
/// request on. Those who ask at the same time are answered with one statement. Cheap to clone.
#[derive(Clone)]
pub struct Keyring(Together<StoredKey>);

impl Keyring {
    /// The keys in `records`.
    pub fn new(records: Records) -> Keyring {
        let read = move |ids: Vec<String>| {
            let records = records.clone();
            async move { stored_keys(&records, &ids).await }.boxed()
        };
        Keyring(Together::new(read))
    }

    /// The access that the key `token` gives.
    ///
    /// # Errors
    /// The database did not answer. Within: why the key opens nothing.
    pub async fn open(&self, token: &str) -> Result<Result<Access, Refusal>, Error> {
        let Some((id, secret)) = split(token) else { return Ok(Err(Refusal::Malformed)) };
        let Some(StoredKey { key, secret_sha256, now_ms }) = self.0.ask(id).await? else {
            return Ok(Err(Refusal::Unknown));
        };
        if !bool::from(digest(secret).as_bytes().ct_eq(secret_sha256.as_bytes())) {
            return Ok(Err(Refusal::Unknown));
        }
        if key.revoked_ms.is_some() {
            return Ok(Err(Refusal::Revoked));
        }
        if key.expires_ms.is_some_and(|end| end <= now_ms) {
            return Ok(Err(Refusal::Expired));
        }
        Ok(Ok(Access { tenant: key.tenant, scopes: key.scopes, key: Some(key.id) }))
    }
}

async fn stored_keys(records: &Records, ids: &[String]) -> Result<HashMap<String, StoredKey>, Error> {
    let list = serde_json::to_string(ids).map_err(Error::fault)?;
    let select = sql("SELECT *, {now} AS now_ms FROM api_keys WHERE id IN ({texts of $1 texts})").bind(list);
    let stored = |row: &Row| {
        let (key, secret_sha256) = (key(row)?, row.text("secret_sha256")?);
        Ok((key.id.clone(), StoredKey { key, secret_sha256, now_ms: row.number("now_ms")? }))
    };
    records.read(select).await?.iter().map(stored).collect()
}

/// Id and secret of a token that is written as ours are.
fn split(token: &str) -> Option<(&str, &str)> {
    let (id, secret) = token.strip_prefix(PREFIX)?.strip_prefix('_')?.split_once('_')?;
    let hex = |text: &str, bytes: usize| {
        text.len() == 2 * bytes && text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
    };
    (hex(id, ID_BYTES) && hex(secret, SECRET_BYTES)).then_some((id, secret))
}

fn digest(secret: &str) -> String {
    hex(&Sha256::digest(secret.as_bytes()))
}

/// Random bytes.
///
/// # Errors
/// The system has no randomness.
pub fn random<const N: usize>() -> Result<[u8; N], Error> {
    let mut bytes = [0; N];
    getrandom::fill(&mut bytes).map_err(|error| Error::fault(error.to_string()))?;
    Ok(bytes)
}

fn key(row: &Row) -> Result<Key, Error> {
    Ok(Key {
        id: row.text("id")?,
        tenant: row.text("tenant")?,
        name: row.text("name")?,
        // A scope of a newer version opens nothing here.
        scopes: row.text("scopes")?.split(' ').filter_map(Scope::parse).collect(),
        created_ms: row.number("created_ms")?,
        expires_ms: row.optional_number("expires_ms")?,
        revoked_ms: row.optional_number("revoked_ms")?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_split_only_if_it_is_written_as_ours_are() {
        let (id, secret) = ("0123456789abcdef", "0".repeat(64));
        assert_eq!(split(&format!("lw_{id}_{secret}")), Some((id, secret.as_str())));
        for wrong in [
            String::new(),
            "lw".into(),
            "lw__".into(),
            format!("lw_{id}"),
            format!("lw_{id}_{secret}0"),
            format!("lw_{id}_{}", &secret[1..]),
            format!("lw_{}_{secret}", id.to_uppercase()),
            format!("LW_{id}_{secret}"),
            format!("lw_{id}_{secret}_x"),
            format!("lw_{id}_{}é", &secret[2..]),
        ] {
            assert_eq!(split(&wrong), None, "{wrong}");
        }
    }

    async fn open(records: &Records, token: &str) -> Result<Result<Access, Refusal>, Error> {
        Keyring::new(records.clone()).open(token).await
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn a_key_opens_until_it_is_rotated_out_or_revoked_and_its_secret_is_not_kept() {
        let folder = tempfile::tempdir().unwrap();
        let url = format!("sqlite:{}?mode=rwc", folder.path().join("service.db").display());
        let records = Records::open(&url).await.unwrap();
        assert!(!any(&records).await.unwrap());
        let scopes = vec![Scope::JobsRead, Scope::UploadsWrite];
        let new = NewKey { tenant: "lab".into(), name: "robot".into(), scopes: scopes.clone(), lifetime_ms: None };
        let first = create(&records, &new).await.unwrap();
        let access = open(&records, &first.token).await.unwrap().unwrap();
        assert_eq!(access, Access { tenant: "lab".into(), scopes, key: Some(first.id.clone()) });
        assert!(access.may(Scope::JobsRead) && !access.may(Scope::JobsWrite));

        // Another's secret, and the id of nobody.
        let second = create(&records, &new).await.unwrap();
        let secret = second.token.rsplit('_').next().unwrap();
        for wrong in [format!("lw_{}_{secret}", first.id), format!("lw_{}_{secret}", "0".repeat(16))] {
            assert_eq!(open(&records, &wrong).await.unwrap(), Err(Refusal::Unknown), "{wrong}");
        }

        // Rotated with an overlap both open, without one only the new one does.
        let third = rotate(&records, &first.id, 3_600_000).await.unwrap().unwrap();
        let fourth = rotate(&records, &second.id, 0).await.unwrap().unwrap();
        for token in [&first.token, &third.token, &fourth.token] {
            assert!(open(&records, token).await.unwrap().is_ok());
        }
        assert_eq!(open(&records, &second.token).await.unwrap(), Err(Refusal::Expired));
        assert!(rotate(&records, &second.id, 0).await.unwrap().is_none());
        assert!(revoke(&records, &third.id).await.unwrap() && !revoke(&records, &third.id).await.unwrap());
        assert_eq!(open(&records, &third.token).await.unwrap(), Err(Refusal::Revoked));

        let listed = list(&records, Some("lab")).await.unwrap();
        assert_eq!((listed.len(), list(&records, Some("shop")).await.unwrap().len()), (4, 0));
        // What succeeds a key that ends lives as long as that was made to.
        let day = 86_400_000;
        let brief = create(&records, &NewKey { lifetime_ms: Some(day), ..new }).await.unwrap();
        let next = rotate(&records, &brief.id, 0).await.unwrap().unwrap();
        let listed = list(&records, Some("lab")).await.unwrap();
        let next = listed.iter().find(|key| key.id == next.id).unwrap();
        assert_eq!(next.expires_ms.unwrap() - next.created_ms, day);

        records.close().await;
        let stored = std::fs::read(folder.path().join("service.db")).unwrap();
        assert!(!stored.windows(secret.len()).any(|bytes| bytes == secret.as_bytes()), "the secret is in the database");
    }
}
