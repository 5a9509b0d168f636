//! IES TM-25.

#![no_main]

lampwright_fuzz::target!(Tm25);
