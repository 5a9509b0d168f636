-- Where a ray set came packed: the name and the SHA-256 of the gzip, zstd or zip file as it was sent. The packed bytes
-- themselves are not kept.
ALTER TABLE ray_sets ADD COLUMN packed_name TEXT;
ALTER TABLE ray_sets ADD COLUMN packed_sha256 TEXT;
