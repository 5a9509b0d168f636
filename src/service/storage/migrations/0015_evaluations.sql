-- What an evaluation computes, as JSON: the job whose model it is, and the request. NULL is a job that makes a model. No foreign key: the
-- model's job may be deleted, and an evaluation that begins afterwards fails.
ALTER TABLE jobs ADD COLUMN evaluation TEXT;
