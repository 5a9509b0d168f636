//! scratch
/// knob
pub fn knob(name: &'static str, default: f64) -> f64 {
    use std::collections::HashMap;
    use std::sync::{Mutex, OnceLock};
    static ALL: OnceLock<Mutex<HashMap<&'static str, f64>>> = OnceLock::new();
    let mut all = ALL.get_or_init(Default::default).lock().unwrap();
    *all.entry(name).or_insert_with(|| std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default))
}
