-- Whose things are, and who may ask for them. Where no keys are asked for, everything is the tenant `default`'s.

ALTER TABLE ray_sets ADD COLUMN tenant TEXT NOT NULL DEFAULT 'default';
ALTER TABLE spectra ADD COLUMN tenant TEXT NOT NULL DEFAULT 'default';
ALTER TABLE jobs ADD COLUMN tenant TEXT NOT NULL DEFAULT 'default';
CREATE INDEX ray_sets_tenant ON ray_sets (tenant, id);
CREATE INDEX spectra_tenant ON spectra (tenant, id);
CREATE INDEX jobs_tenant ON jobs (tenant, id);
CREATE INDEX jobs_unfinished ON jobs (tenant, state) WHERE state IN ('queued', 'running');

-- What a tenant may use; NULL is the service's default. A tenant without a row has all defaults. The row is also what two
-- requests of one tenant wait for when they count against its quota.
CREATE TABLE tenants (
    id            TEXT PRIMARY KEY,
    stored_bytes  BIGINT,
    queued_jobs   BIGINT,
    running_jobs  BIGINT
);

-- A key is `lw_<id>_<secret>`; of the secret only its SHA-256 is kept. Scopes are separated by spaces.
CREATE TABLE api_keys (
    id             TEXT PRIMARY KEY,
    tenant         TEXT NOT NULL,
    name           TEXT NOT NULL,
    scopes         TEXT NOT NULL,
    secret_sha256  TEXT NOT NULL,
    created_ms     BIGINT NOT NULL,
    expires_ms     BIGINT,
    revoked_ms     BIGINT
);

CREATE INDEX api_keys_tenant ON api_keys (tenant, id);

-- Retention asks for what ended before a moment.
CREATE INDEX jobs_finished ON jobs (finished_ms) WHERE finished_ms IS NOT NULL;
