//! LightTools text.

#![no_main]

lampwright_fuzz::target!(LightToolsText);
