-- A file may come in several uploads at once (tus' Concatenation). `concat` is Upload-Concat as it was sent: NULL for an upload by
-- itself, 'partial' for a piece of a file, 'final;<addresses>' for the upload that puts pieces together. A piece whose bytes are all
-- there is 'complete' and waits; then it is 'joined', its parts are the final upload's, and `part_of` names that. `partials` is, on a
-- final upload, the list of the pieces' ids in order, as JSON.
ALTER TABLE uploads ADD COLUMN concat TEXT;
ALTER TABLE uploads ADD COLUMN partials TEXT;
ALTER TABLE uploads ADD COLUMN part_of TEXT;

DROP INDEX uploads_unfinished;
CREATE INDEX uploads_unfinished ON uploads (tenant, state) WHERE state IN ('receiving', 'finishing', 'complete');
