//! Zemax binary.

#![no_main]

lampwright_fuzz::target!(ZemaxBinary);
