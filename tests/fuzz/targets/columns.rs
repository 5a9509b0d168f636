//! Text in columns.

#![no_main]

lampwright_fuzz::target!(Columns);
