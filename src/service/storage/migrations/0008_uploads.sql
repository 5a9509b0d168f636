-- An upload that can be resumed. It becomes the ray set of the same id, unless it is packed. `offset_bytes` is what is
-- stored and named by `upload_parts`; `sha256_state` is the digest's state after those bytes. `session` names the request
-- that may add to it: the last that began. `fence` names the process that may finish it, `attempt` counts how often one
-- began to, and `result` is, as JSON, what it became or why it was refused.
CREATE TABLE uploads (
    id               TEXT PRIMARY KEY,
    tenant           TEXT NOT NULL,
    state            TEXT NOT NULL,
    name             TEXT NOT NULL,
    metadata         TEXT NOT NULL,
    declared         TEXT NOT NULL,
    announced        TEXT NOT NULL,
    byte_count       BIGINT,
    offset_bytes     BIGINT NOT NULL,
    sha256_state     TEXT NOT NULL,
    session          TEXT,
    fence            BIGINT NOT NULL,
    attempt          BIGINT NOT NULL,
    lease_until_ms   BIGINT,
    result           TEXT,
    created_ms       BIGINT NOT NULL,
    expires_ms       BIGINT NOT NULL
);

CREATE INDEX uploads_tenant ON uploads (tenant, id);
CREATE INDEX uploads_unfinished ON uploads (tenant, state) WHERE state IN ('receiving', 'finishing');
CREATE INDEX uploads_finishing ON uploads (lease_until_ms) WHERE state = 'finishing';
CREATE INDEX uploads_expires ON uploads (expires_ms);

-- What is stored of it; in the transaction that ends it, these become the parts of a ray set.
CREATE TABLE upload_parts (
    upload_id   TEXT NOT NULL REFERENCES uploads (id) ON DELETE CASCADE,
    number      BIGINT NOT NULL,
    byte_count  BIGINT NOT NULL,
    blob        TEXT NOT NULL,
    PRIMARY KEY (upload_id, number)
);
