//! TracePro / ProSource text.

#![no_main]

lampwright_fuzz::target!(ProSourceText);
