-- The name of this database, which the object store repeats: blobs that belong to another database are not taken for garbage.
CREATE TABLE owner (
    id      BIGINT PRIMARY KEY,
    name    TEXT NOT NULL
);
