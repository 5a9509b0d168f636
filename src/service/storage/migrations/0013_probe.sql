-- One row that /readyz counts on in, and reads through another connection: what is written is there for others.
CREATE TABLE probe (
    id      BIGINT PRIMARY KEY,
    number  BIGINT NOT NULL
);
