-- What was said of a ray file as it was sent, as JSON: how to read it where it does not say itself.
ALTER TABLE ray_sets ADD COLUMN declared TEXT NOT NULL DEFAULT '{}';
