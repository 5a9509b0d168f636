//! Zemax text.

#![no_main]

lampwright_fuzz::target!(ZemaxText);
