//! LightTools binary.

#![no_main]

lampwright_fuzz::target!(LightToolsBinary);
