-- Each tenant has a line of its own, and lines take turns. `priority`: 0 high, 1 normal, 2 low; then age.
ALTER TABLE jobs ADD COLUMN priority BIGINT NOT NULL DEFAULT 1;
-- Longest attempt; NULL is the service's.
ALTER TABLE jobs ADD COLUMN timeout_ms BIGINT;
-- Most memory that computing it is expected to need, on how many threads, and how much more on each further one; 0 for jobs
-- queued before anybody asked.
ALTER TABLE jobs ADD COLUMN memory_bytes BIGINT NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN memory_threads BIGINT NOT NULL DEFAULT 1;
ALTER TABLE jobs ADD COLUMN thread_bytes BIGINT NOT NULL DEFAULT 0;
-- Rays of its files, as their headers tell.
ALTER TABLE jobs ADD COLUMN ray_count BIGINT NOT NULL DEFAULT 0;
-- SHA-256 of everything that its artifacts follow from, and when somebody last asked for the same again.
ALTER TABLE jobs ADD COLUMN content_sha256 TEXT;
ALTER TABLE jobs ADD COLUMN used_ms BIGINT;

DROP INDEX jobs_queued;
DROP INDEX jobs_unfinished;
CREATE INDEX jobs_line ON jobs (tenant, priority, id) WHERE state = 'queued';
CREATE INDEX jobs_state ON jobs (tenant, state, id);
CREATE INDEX jobs_content ON jobs (tenant, content_sha256, id) WHERE content_sha256 IS NOT NULL;

-- When a job of the tenant was last begun. Who has jobs has a row: the claim looks for them there.
ALTER TABLE tenants ADD COLUMN served_ms BIGINT NOT NULL DEFAULT 0;
INSERT INTO tenants (id) SELECT DISTINCT tenant FROM jobs WHERE true ON CONFLICT (id) DO NOTHING;

-- The job that a request under a client's key made. No foreign key: a key whose job is gone makes no other.
CREATE TABLE idempotency_keys (
    tenant          TEXT NOT NULL,
    key             TEXT NOT NULL,
    request_sha256  TEXT NOT NULL,
    job_id          TEXT NOT NULL,
    reused          BIGINT NOT NULL,
    created_ms      BIGINT NOT NULL,
    PRIMARY KEY (tenant, key)
);
CREATE INDEX idempotency_keys_created ON idempotency_keys (created_ms);

-- "Do you have this file?"
CREATE INDEX ray_sets_sha256 ON ray_sets (tenant, sha256, id);
CREATE INDEX ray_sets_name ON ray_sets (tenant, name, id);
