-- What was found in a ray set's rays, as JSON, and drawings of it. Tables of their own: lists of ray sets never read them.

CREATE TABLE inspections (
    ray_set_id  TEXT PRIMARY KEY REFERENCES ray_sets (id) ON DELETE CASCADE,
    inspection  TEXT NOT NULL
);

-- At most two of at most 60 kB each: small enough to live and die with the row they belong to.
CREATE TABLE drawings (
    ray_set_id  TEXT NOT NULL REFERENCES ray_sets (id) ON DELETE CASCADE,
    name        TEXT NOT NULL,
    sha256      TEXT NOT NULL,
    svg         TEXT NOT NULL,
    PRIMARY KEY (ray_set_id, name)
);
