//! ASAP distribution.

#![no_main]

lampwright_fuzz::target!(Asap);
