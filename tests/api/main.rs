//! The service through its front door: every test is a client, then looks at everything that can be seen: the response, the
//! stored files, the rows, the queue.

#![expect(clippy::unwrap_used, clippy::panic, reason = "what a test stumbles over is its finding")]

/// From a ray file to a zip, and every step between.
mod walk;
/// What is taken in, and what is not.
mod uploads;
/// What is inspected while it comes.
mod arrivals;
/// Uploads that are resumed.
mod resume;
/// Several requests for one of them.
mod sessions;
/// How those end.
mod endings;
/// Files that come in several uploads at once.
mod concatenation;
/// What comes packed.
mod packed;
/// New rays from the models of jobs.
mod rays;
/// Evaluations of the models of jobs.
mod evaluations;
mod evaluation_jobs;
/// Models of jobs combined.
mod combinations;
mod adapters;
/// Keys, tenants, quotas and rates.
mod access;
/// What connections may ask of the process.
mod connections;
/// Many connections at once.
mod crowds;
/// How answers are sent, and under which addresses.
mod answers;
/// The portal's files.
mod portal;
/// HTTP/2.
mod http2;
/// Numbers, room, retention, backup.
mod upkeep;
/// Every way to ask wrongly.
mod requests;
/// Fields that are null.
mod nulls;
/// Headers that change what a request means.
mod headers;
/// What an upload answers of its rays.
mod inspections;
/// Spectra, and what is said of channels.
mod channels;
/// What is said of a file as it is sent.
mod declared;
/// What a backup of shared engines is worth.
mod restore;
/// Queue, cancellation, deletion, pages.
mod jobs;
/// How clients hear of their jobs.
mod watching;
/// Who asks again and again.
mod polling;
/// Who is next: turns, priorities, memory, time.
mod lines;
/// Keys, reuse, estimates, filters.
mod submission;
/// Webhooks: events about ended jobs.
mod webhooks;
/// Metadata: the client's own keys and values.
mod metadata;
/// What was noticed before a job began.
mod told;
/// What problems tell their clients to do.
mod remedies;
/// Files that are fetched.
mod ingest;
/// Random changes of jobs beside a model of them.
mod model;
/// What a disk is trusted with.
mod keeping;
/// What processes and stores do to jobs.
mod faults;
/// A database without room.
mod full;
/// Connections and transactions of the database.
mod transactions;
/// Entity tags and ranges.
mod downloads;
/// Health under load, stopping, starting.
mod operation;
/// The committed contract.
mod contract;
