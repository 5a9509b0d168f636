//! How fast ray files are read: one measurement per call, so that `run` can alternate it with other programs.
//!
//! `make RAYS TM25 ZEMAX` writes the same rays in both formats. `decode FILE THREADS` turns every record into numbers;
//! `survey FILE THREADS` checks them too, as every job and inspection does. Both print seconds, taken inside.

use pipeline::convert::{Target, Wanted, convert};
use pipeline::formats::record::{Bytes, RaySet};
use pipeline::inspection::observed;
use pipeline::known_sources::{by_name, write_tm25};
use pipeline::rays::declared::open;
use pipeline::vocabulary::spectrum::Bands;
use pipeline::vocabulary::watch::StageWatch;
use pipeline::{Declared, Input, Limits, NoProgress, Stage};
use rayon::prelude::*;
use std::error::Error;
use std::fs::File;
use std::io;
use std::io::BufWriter;
use std::os::unix::fs::FileExt;
use std::sync::Arc;
use std::time::Instant;

/// Records per block, as the pipeline reads them.
const CHUNK_RAYS: u64 = 1 << 14;

/// A file, as the command line reads it.
struct OnDisk(File, u64);

impl Bytes for OnDisk {
    fn len(&self) -> u64 {
        self.1
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        self.0.read_exact_at(into, offset)
    }
}

fn on_disk(path: &str) -> io::Result<Arc<OnDisk>> {
    let file = File::open(path)?;
    let byte_count = file.metadata()?.len();
    Ok(Arc::new(OnDisk(file, byte_count)))
}

fn make(rays: u64, tm25: &str, zemax: &str) -> Result<(), Box<dyn Error>> {
    let source = by_name("flat-chip").ok_or("no such source")?;
    write_tm25(&source, rays, 1, &mut BufWriter::new(File::create(tm25)?))?;
    let bytes = on_disk(tm25)?;
    let input =
        Input { name: tm25.into(), sha256: String::new(), bytes, declared: Declared::default(), notices: Vec::new() };
    let mut out = File::create(zemax)?;
    let watch = StageWatch::enter(&NoProgress, Stage::Rays)?;
    convert(&[input], &Wanted::all(Target::ZemaxBinary), &Limits::default(), &mut out, watch)
        .map_err(|failed| format!("{failed:?}"))?;
    Ok(())
}

/// The sum of the flux, so that nothing is left out as unused.
fn decode(set: &RaySet) -> Result<f64, pipeline::Error> {
    let count = set.facts.ray_count;
    (0..count.div_ceil(CHUNK_RAYS))
        .into_par_iter()
        .map_init(Vec::new, |rays, chunk| {
            let first = chunk * CHUNK_RAYS;
            rays.clear();
            set.records.read(first, CHUNK_RAYS.min(count - first) as usize, rays)?;
            Ok(rays.iter().map(|ray| ray.radiant).sum::<f64>())
        })
        .sum()
}

fn measured(what: &str, path: &str) -> Result<f64, Box<dyn Error>> {
    let limits = Limits::default();
    let started = Instant::now();
    let set = open(on_disk(path)?, &Declared::default(), &limits)?;
    let watt = if what == "decode" {
        decode(&set)?
    } else {
        let bands = Bands::regular(380.0, 780.0, 10.0).ok_or("no bands")?;
        let (reading, _) = observed(&set, true, &bands, StageWatch::enter(&NoProgress, Stage::Rays)?)?;
        reading.sums.radiant
    };
    let seconds = started.elapsed().as_secs_f64();
    if (watt - 1.0).abs() > 1e-6 { Err(format!("read {watt} W of 1 W").into()) } else { Ok(seconds) }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["make", rays, tm25, zemax] => make(rays.parse()?, tm25, zemax),
        [what @ ("decode" | "survey"), path, threads] => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.parse()?).build()?;
            println!("{}", pool.install(|| measured(what, path).map_err(|error| error.to_string()))?);
            Ok(())
        }
        _ => Err("see tests/bench/reading/run".into()),
    }
}
