//! From the bytes of an upload to artifacts.

#![no_main]

lampwright_fuzz::target!(Upload);
