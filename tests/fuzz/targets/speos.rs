//! Speos.

#![no_main]

lampwright_fuzz::target!(Speos);
