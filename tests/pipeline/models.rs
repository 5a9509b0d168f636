//! Models of known sources that several tests look at: each is made once, by the first test that asks for it, whichever that is.

use super::known_sources::built;
use pipeline::known_sources::by_name;
use pipeline::{Options, Outcome};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock};

/// How rays become a model.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Way {
    /// With the options that are the default.
    Default,
    /// Without smoothing.
    Unsmoothed,
    /// With the default options, on two threads whatever the machine has.
    OnTwoThreads,
}

type Key = (String, u64, Way);
static MADE: Mutex<BTreeMap<Key, Arc<OnceLock<Arc<Outcome>>>>> = Mutex::new(BTreeMap::new());

/// What `rays` rays of a known source become.
pub fn made(name: &str, rays: u64, way: Way) -> Arc<Outcome> {
    let place = MADE.lock().unwrap().entry((name.to_owned(), rays, way)).or_default().clone();
    place.get_or_init(|| Arc::new(make(name, rays, way))).clone()
}

fn make(name: &str, rays: u64, way: Way) -> Outcome {
    let source = by_name(name).unwrap();
    let with = |options: &Options| built(&source, rays, options).unwrap();
    match way {
        Way::Default => with(&Options::default()),
        Way::Unsmoothed => with(&unsmoothed()),
        Way::OnTwoThreads => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
            pool.install(|| with(&Options::default()))
        }
    }
}

/// Neither places nor directions are smoothed: neighbouring cells share no noise.
pub fn unsmoothed() -> Options {
    let mut options = Options::default();
    options.flux.smoothing = Some(false);
    options.goniogram.smoothing = Some(false);
    options
}
