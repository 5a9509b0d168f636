-- One schema for SQLite and PostgreSQL: ids are UUIDv7 as TEXT (sortable), times epoch milliseconds as BIGINT, JSON and
-- flags as TEXT and BIGINT. A blob is written before the row that names it, and deleted after that row is gone.

-- A ray file as it came. Its bytes are its parts, in order; nothing is ever copied together.
CREATE TABLE ray_sets (
    id          TEXT PRIMARY KEY,
    name        TEXT NOT NULL,
    byte_count  BIGINT NOT NULL,
    sha256      TEXT NOT NULL,
    header      TEXT NOT NULL,
    created_ms  BIGINT NOT NULL
);

CREATE TABLE parts (
    ray_set_id  TEXT NOT NULL REFERENCES ray_sets (id) ON DELETE CASCADE,
    number      BIGINT NOT NULL,
    byte_count  BIGINT NOT NULL,
    blob        TEXT NOT NULL,
    PRIMARY KEY (ray_set_id, number)
);

-- A job is the resource clients see and the queue entry workers lease. `fence` grows with every claim: a worker's write
-- names the fence it was given, so that one who lost its lease changes nothing.
CREATE TABLE jobs (
    id                TEXT PRIMARY KEY,
    state             TEXT NOT NULL,
    options           TEXT NOT NULL,
    attempt           BIGINT NOT NULL,
    max_attempts      BIGINT NOT NULL,
    fence             BIGINT NOT NULL,
    lease_owner       TEXT,
    lease_until_ms    BIGINT,
    cancel_requested  BIGINT NOT NULL,
    stage             TEXT,
    stage_progress    DOUBLE PRECISION NOT NULL,
    failure           TEXT,
    notices           TEXT NOT NULL,
    created_ms        BIGINT NOT NULL,
    started_ms        BIGINT,
    finished_ms       BIGINT
);

CREATE INDEX jobs_queued ON jobs (id) WHERE state = 'queued';
CREATE INDEX jobs_running ON jobs (lease_until_ms) WHERE state = 'running';

-- The ray sets of a job's source. No foreign key: a ray set may be deleted once its jobs have ended.
CREATE TABLE job_inputs (
    job_id      TEXT NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    position    BIGINT NOT NULL,
    ray_set_id  TEXT NOT NULL,
    PRIMARY KEY (job_id, position)
);

CREATE INDEX job_inputs_ray_set ON job_inputs (ray_set_id);

-- What a job gave. Written in the transaction that makes the job succeed, never before.
CREATE TABLE artifacts (
    job_id      TEXT NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    position    BIGINT NOT NULL,
    name        TEXT NOT NULL,
    media_type  TEXT NOT NULL,
    byte_count  BIGINT NOT NULL,
    sha256      TEXT NOT NULL,
    blob        TEXT NOT NULL,
    PRIMARY KEY (job_id, name)
);
