//! What the tests of several folders share: ray files, a service in this process, a receiver of webhooks, the engines that were
//! chosen, requests to a process.

#![expect(clippy::unwrap_used, clippy::panic, reason = "what a test stumbles over is its finding")]

/// The engines a test runs on: files in its folder, or PostgreSQL and S3 when `tests/engines/with` runs the tests.
pub mod engines;
/// A ray file in every format and form that is read, of as many rays as a test asks for.
pub mod formats;
/// The smallest HTTP/1.1 client that can talk to our server: one request per connection, blocking, no crate.
pub mod http;
/// Packs files the way users do, with the libraries' writers: gzip, zstd, zip.
pub mod packing;
/// Ray files for tests that care about bytes, not about light.
pub mod rays;
/// Somebody else's endpoint on loopback: hears what is posted, and answers as it is told.
pub mod receiver;
/// Runners that stand in for the pipeline: prompt, held, uncancellable, panicking, failing.
pub mod runners;
/// A service on a folder of its own, and a client that checks every response.
pub mod site;
/// Random estimates are judged by their own statistics, with a stated false-alarm rate.
pub mod statistics;
