//! Packed files: gzip, zstd, zip.

#![no_main]

lampwright_fuzz::target!(Container);
