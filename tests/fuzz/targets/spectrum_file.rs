//! Files that hold a spectrum.

#![no_main]

lampwright_fuzz::target!(SpectrumFile);
