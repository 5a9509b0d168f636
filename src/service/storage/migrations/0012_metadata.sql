-- What clients say of their own things, as a JSON object of texts; and a row for each key and value (`key=value`), which ray sets
-- and jobs are found by. Of a packed file, what else was in it, as a JSON list.
ALTER TABLE ray_sets ADD COLUMN metadata TEXT NOT NULL DEFAULT '{}';
ALTER TABLE ray_sets ADD COLUMN packed_left_out TEXT NOT NULL DEFAULT '[]';
ALTER TABLE jobs ADD COLUMN metadata TEXT NOT NULL DEFAULT '{}';
ALTER TABLE uploads ADD COLUMN client_metadata TEXT NOT NULL DEFAULT '{}';

CREATE TABLE ray_set_metadata (
    tenant      TEXT NOT NULL,
    pair        TEXT NOT NULL,
    ray_set_id  TEXT NOT NULL REFERENCES ray_sets (id) ON DELETE CASCADE,
    PRIMARY KEY (tenant, pair, ray_set_id)
);
CREATE INDEX ray_set_metadata_owner ON ray_set_metadata (ray_set_id);

CREATE TABLE job_metadata (
    tenant  TEXT NOT NULL,
    pair    TEXT NOT NULL,
    job_id  TEXT NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    PRIMARY KEY (tenant, pair, job_id)
);
CREATE INDEX job_metadata_owner ON job_metadata (job_id);
