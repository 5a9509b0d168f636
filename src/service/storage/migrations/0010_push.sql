-- Who hears that a job has ended. The job's row itself is the outbox: `announced` is set in the transaction that writes a
-- delivery for every endpoint of its tenant, so that no death of a process loses or doubles one. What ended before there were
-- endpoints is announced already.
ALTER TABLE jobs ADD COLUMN announced BIGINT NOT NULL DEFAULT 0;
UPDATE jobs SET announced = 1 WHERE finished_ms IS NOT NULL;
CREATE INDEX jobs_unannounced ON jobs (finished_ms) WHERE announced = 0 AND finished_ms IS NOT NULL;

-- An endpoint. Its secret signs, so it is kept as it is; while a new one takes over, the one before signs too. Events are
-- separated by spaces. `disabled_why` is NULL while it is told.
CREATE TABLE webhooks (
    id                   TEXT PRIMARY KEY,
    tenant               TEXT NOT NULL,
    url                  TEXT NOT NULL,
    events               TEXT NOT NULL,
    description          TEXT NOT NULL,
    secret               TEXT NOT NULL,
    old_secret           TEXT,
    old_secret_until_ms  BIGINT,
    failing_since_ms     BIGINT,
    disabled_why         TEXT,
    created_ms           BIGINT NOT NULL
);

CREATE INDEX webhooks_tenant ON webhooks (tenant, id);

-- One event for one endpoint, and how its last attempt went; its id is the `webhook-id` of every attempt. `fence` grows with every
-- claim, as a job's does. No foreign key to the job: it may be deleted, and is announced all the same.
CREATE TABLE deliveries (
    id              TEXT PRIMARY KEY,
    webhook_id      TEXT NOT NULL REFERENCES webhooks (id) ON DELETE CASCADE,
    event           TEXT NOT NULL,
    job_id          TEXT,
    body            TEXT NOT NULL,
    state           TEXT NOT NULL,
    attempt         BIGINT NOT NULL,
    fence           BIGINT NOT NULL,
    due_ms          BIGINT NOT NULL,
    lease_until_ms  BIGINT,
    attempted_ms    BIGINT,
    status          BIGINT,
    answer          TEXT,
    error           TEXT,
    created_ms      BIGINT NOT NULL
);

CREATE INDEX deliveries_due ON deliveries (due_ms) WHERE state = 'waiting';
CREATE INDEX deliveries_sent ON deliveries (lease_until_ms) WHERE lease_until_ms IS NOT NULL;
CREATE INDEX deliveries_webhook ON deliveries (webhook_id, id);
CREATE INDEX deliveries_created ON deliveries (created_ms);
