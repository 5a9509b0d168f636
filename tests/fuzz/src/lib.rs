//! What every target does: bytes to the front door of the pipeline, and what must hold whatever the bytes are.

/// Mutations that keep what a reader proves first: magic, counts and lengths, directions.
pub mod repair;
/// Files to begin with.
pub mod seeds;

/// The computation, as the product has it.
pub use lampwright_pipeline as pipeline;
pub use libfuzzer_sys;

use pipeline::formats::record::RawRay;
use pipeline::vocabulary::limits::Limits;
use pipeline::{
    Content, Declared, Error, Input, LengthUnit, Options, Quantity, NoProgress, header, inspect, peek, run, unpack,
};
use std::sync::{Arc, Once};

/// What the bytes of a target are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Tm25,
    ZemaxBinary,
    ZemaxText,
    LightToolsBinary,
    LightToolsText,
    Speos,
    Asap,
    ProSourceText,
    Columns,
    Container,
    SpectrumFile,
    Upload,
}

impl Kind {
    /// All, with the names of their targets.
    pub const ALL: [(Kind, &str); 12] = [
        (Kind::Tm25, "tm25"),
        (Kind::ZemaxBinary, "zemax_binary"),
        (Kind::ZemaxText, "zemax_text"),
        (Kind::LightToolsBinary, "lighttools_binary"),
        (Kind::LightToolsText, "lighttools_text"),
        (Kind::Speos, "speos"),
        (Kind::Asap, "asap"),
        (Kind::ProSourceText, "prosource_text"),
        (Kind::Columns, "columns"),
        (Kind::Container, "container"),
        (Kind::SpectrumFile, "spectrum_file"),
        (Kind::Upload, "upload"),
    ];
}

/// A target of its kind: runs it, and mutates with [`repair::mutate`].
#[macro_export]
macro_rules! target {
    ($kind:ident) => {
        $crate::libfuzzer_sys::fuzz_target!(|data: &[u8]| $crate::check($crate::Kind::$kind, data));
        $crate::libfuzzer_sys::fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
            $crate::repair::mutate($crate::Kind::$kind, data, size, max_size, seed)
        });
    };
}

/// Small enough that no accepted input takes a second.
fn limits() -> Limits {
    Limits {
        max_rays: 4096,
        max_tables: 64,
        max_table_points: 4096,
        max_text_bytes: 1 << 16,
        max_lattice_cells: 1 << 16,
        max_tally_values: 1 << 20,
        max_expanded_bytes: 1 << 22,
        max_members: 16,
        ..Limits::default()
    }
}

fn input(data: &[u8], declared: Declared) -> Input {
    Input { name: "fuzz".into(), sha256: "0".repeat(64), bytes: Arc::new(data.to_vec()), declared, notices: Vec::new() }
}

/// What a user says where files do not.
fn said() -> Declared {
    Declared { length_unit: Some(LengthUnit::Millimetre), quantity: Some(Quantity::Radiant), ..Declared::default() }
}

/// Everything on this thread: the same bytes always take the same way.
fn one_thread() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global();
        pool.expect("the first pool of the process");
    });
}

/// The bytes of one execution.
///
/// # Panics
/// When something does not hold: a finding.
pub fn check(kind: Kind, data: &[u8]) {
    one_thread();
    match kind {
        Kind::Container => packed(data),
        Kind::SpectrumFile => spectrum(data),
        Kind::Upload => upload(data),
        _ => {
            file(&input(data, Declared::default()));
            file(&input(data, said()));
        }
    }
}

/// Reading from memory cannot fail: only an answer about the bytes is one.
fn about_the_bytes<T>(answer: Result<T, Error>) -> Option<T> {
    match answer {
        Ok(value) => Some(value),
        Err(Error::Malformed(fault) | Error::Refused(fault) | Error::Unusable(fault)) => {
            assert!(fault.code.contains('.') && !fault.found.is_empty() && !fault.remedy.is_empty(), "{fault:?}");
            None
        }
        Err(error) => panic!("not an answer about the bytes: {error}"),
    }
}

/// First bytes, header, all rays.
fn file(input: &Input) {
    let limits = limits();
    let mut data = vec![0; input.bytes.len() as usize];
    input.bytes.read_at(0, &mut data).expect("bytes in memory");
    for (prefix, length) in [(data.len() / 2, None), (data.len(), None), (data.len(), Some(data.len() as u64))] {
        about_the_bytes(peek(&data[..prefix], length, &limits));
    }
    let Some(header) = about_the_bytes(header(input, &limits)) else { return };
    assert!(header.ray_count <= limits.max_rays, "{} rays passed the limit", header.ray_count);
    // What opens must have passed its first bytes too, or an upload would have been refused in error.
    let early = peek(&data, Some(data.len() as u64), &limits);
    assert!(early.is_ok(), "opens, and was refused at its first bytes: {early:?}");
    random_access(input, header.ray_count);
    let Some(inspection) = about_the_bytes(inspect(input, &limits, &NoProgress)) else { return };
    let all = inspection.rays_used + inspection.rays_refused + inspection.rays_dropped;
    assert_eq!(all, header.ray_count, "every ray has one fate");
    let flux = [inspection.flux.radiant_w, inspection.flux.luminous_lm];
    assert!(flux.into_iter().flatten().all(|flux| flux.is_finite() && flux >= 0.0), "{flux:?}");
    assert!(inspection.notices.iter().all(|notice| notice.first_ray.is_none_or(|ray| ray < header.ray_count)));
    serde_json::to_string(&inspection).expect("an inspection is JSON");
}

/// Any range of the records is what it is in the whole.
fn random_access(input: &Input, ray_count: u64) {
    let Ok(set) = pipeline::rays::declared::open(Arc::clone(&input.bytes), &input.declared, &limits()) else { return };
    let (mut whole, mut half) = (Vec::new(), Vec::new());
    if set.records.read(0, ray_count as usize, &mut whole).is_err() {
        return;
    }
    let first = ray_count / 2;
    let read = set.records.read(first, (ray_count - first) as usize, &mut half);
    assert!(read.is_ok(), "a part of readable rays cannot be read");
    assert_eq!(whole.len() as u64, ray_count);
    assert!(
        whole[first as usize..].iter().map(bits).eq(half.iter().map(bits)),
        "a part is not what it is in the whole"
    );
}

/// A ray's numbers as bits: NaN is not equal to itself.
fn bits(ray: &RawRay) -> [u64; 12] {
    let RawRay { origin_mm: [x, y, z], direction: [l, m, n], radiant, luminous, wavelength_nm, table, xz } = *ray;
    [x, y, z, l, m, n, radiant, luminous, wavelength_nm, f64::from(table), xz[0], xz[1]].map(f64::to_bits)
}

/// Coarse results, which are quick, but for one file length in four (counted in words): there everything is chosen from the rays.
fn options(length: usize) -> Options {
    let mut options = Options::default();
    if !(length / 4).is_multiple_of(4) {
        options.hull.resolution = Some(12);
        options.goniogram.zones = Some(pipeline::options::Zones { columns: 2, rows: 1 });
        options.goniogram.gamma_step_deg = Some(15.0);
        options.goniogram.c_step_deg = Some(30.0);
    }
    options
}

/// An upload all the way: artifacts whose light balances, or an answer about the bytes.
fn upload(data: &[u8]) {
    file(&input(data, Declared::default()));
    let limits = limits();
    let options = options(data.len());
    let Some(outcome) = about_the_bytes(run(&[input(data, said())], &options, &limits, &NoProgress)) else { return };
    let balance = &outcome.model.surface.balance;
    assert!(balance.every_ray_once() && balance.error() < 1e-6, "{balance:?}");
    assert_eq!(outcome.model.hull.check(), [], "the surface is broken");
    for artifact in &outcome.artifacts {
        assert!(!artifact.bytes.is_empty(), "{} is empty", artifact.name);
        if artifact.name.ends_with(".json") {
            let read: Result<serde_json::Value, _> = serde_json::from_slice(&artifact.bytes);
            assert!(read.is_ok(), "{}: {read:?}", artifact.name);
        }
    }
    pipeline::artifacts::zip(&outcome.artifacts).expect("a zip in memory");
}

/// Packed files: what comes out of them is bounded, and read like any other file.
fn packed(data: &[u8]) {
    let limits = limits();
    let bytes = data.to_vec();
    let mut files: Vec<Vec<u8>> = Vec::new();
    let unpacked = unpack(&bytes, "fuzz", &limits, |name, content| -> Result<(), Error> {
        assert!(!name.chars().any(char::is_control), "{name:?}");
        let Content::Open(mut member) = content else { return Ok(()) };
        let (mut whole, mut block) = (Vec::new(), [0; 4096]);
        loop {
            match member.read(&mut block)? {
                0 => break,
                count => whole.extend(&block[..count]),
            }
        }
        files.push(whole);
        Ok(())
    });
    about_the_bytes(unpacked);
    let out: usize = files.iter().map(Vec::len).sum();
    assert!(out as u64 <= limits.max_expanded_bytes, "{out} bytes came out");
    files.iter().take(2).for_each(|bytes| file(&input(bytes, Declared::default())));
}

/// A file that holds the spectrum of a channel.
fn spectrum(data: &[u8]) {
    let Some(read) = about_the_bytes(pipeline::spectrum(data)) else { return };
    let (low, high) = read.table.range_nm();
    assert!(low > 0.0 && low <= high && high.is_finite(), "{low} to {high} nm");
    assert!(read.table.lm_per_w() >= 0.0 && read.table.lm_per_w() <= 684.0, "{} lm/W", read.table.lm_per_w());
}
