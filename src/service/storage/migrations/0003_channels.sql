-- A spectrum file, read: its points are JSON, [[nm, value], ..].
CREATE TABLE spectra (
    id           TEXT PRIMARY KEY,
    name         TEXT NOT NULL,
    sha256       TEXT NOT NULL,
    format       TEXT NOT NULL,
    point_count  BIGINT NOT NULL,
    from_nm      DOUBLE PRECISION NOT NULL,
    to_nm        DOUBLE PRECISION NOT NULL,
    lm_per_w     DOUBLE PRECISION NOT NULL,
    nm_value     TEXT NOT NULL,
    notices      TEXT NOT NULL,
    created_ms   BIGINT NOT NULL
);

-- What was declared of a channel, as sent, but for its ray set; and the spectrum it names, if it does. No foreign key: a
-- spectrum may be deleted once its jobs have ended.
ALTER TABLE job_inputs ADD COLUMN declared TEXT NOT NULL DEFAULT '{}';
ALTER TABLE job_inputs ADD COLUMN spectrum_id TEXT;
CREATE INDEX job_inputs_spectrum ON job_inputs (spectrum_id) WHERE spectrum_id IS NOT NULL;

-- The total flux of a job's source, of which its channels have shares.
ALTER TABLE jobs ADD COLUMN total TEXT;
