//! Runners that stand in for the pipeline: prompt, held, uncancellable, panicking, failing.

use pipeline::known_sources::{by_name, write_tm25};
use pipeline::{Artifact, Declared, Error, Input, Limits, MODEL_FILES, NoProgress, Options, Stage};
use service::jobs::ZIP;
use service::jobs::worker::{Product, Runner};
use sha2::{Digest, Sha256};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, LazyLock};
use std::thread::sleep;
use std::time::Duration;

/// What the runners' clients see of them.
#[derive(Default)]
pub struct Gate {
    open: AtomicBool,
    begun: AtomicU32,
    stopped: AtomicU32,
}

impl Gate {
    pub fn new() -> Arc<Gate> {
        Arc::default()
    }

    pub fn open(&self) {
        self.open.store(true, Ordering::SeqCst);
    }

    /// How often a runner began.
    pub fn begun(&self) -> u32 {
        self.begun.load(Ordering::SeqCst)
    }

    /// How often a runner saw that nobody wants its result.
    pub fn stopped(&self) -> u32 {
        self.stopped.load(Ordering::SeqCst)
    }
}

/// Bytes that a client can check: 100 000 of them, none like its neighbour.
pub fn pattern() -> Vec<u8> {
    (0..100_000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect()
}

/// SHA-256 in hex.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Reads all inputs the way the pipeline does, in odd pieces, and gives four files.
fn product(inputs: &[Input]) -> Result<Product, Error> {
    let mut digests = String::new();
    for input in inputs {
        let (mut hasher, mut offset) = (Sha256::new(), 0);
        while offset < input.bytes.len() {
            let mut piece = vec![0; 1_000_003.min(input.bytes.len() - offset) as usize];
            input.bytes.read_at(offset, &mut piece)?;
            offset += piece.len() as u64;
            hasher.update(&piece);
        }
        let digest: String = hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        digests += &format!("{} {} {digest}\n", input.name, input.sha256);
    }
    let file = |name: &str, media_type, bytes: Vec<u8>| Artifact { name: name.into(), media_type, bytes };
    let artifacts = vec![
        file("read.txt", "text/plain", digests.into_bytes()),
        file("ies/total \"ü\".ies", "text/plain", pattern()),
        file("empty.csv", "text/csv", Vec::new()),
        file(ZIP, "application/zip", b"PK of everything".to_vec()),
    ];
    Ok(Product { artifacts, notices: Vec::new() })
}

/// Gives its files at once.
pub fn prompt() -> Runner {
    Arc::new(|inputs, _, _, watch| {
        for stage in Stage::ALL {
            watch.progress(stage, 1.0);
        }
        product(inputs)
    })
}

/// As [`prompt`], with the two files of a small model that new rays can be drawn from.
pub fn prompt_with_a_model() -> Runner {
    let prompt = prompt();
    Arc::new(move |inputs, options, limits, watch| {
        let mut product = prompt(inputs, options, limits, watch)?;
        let zip = product.artifacts.pop();
        for (name, bytes) in MODEL_FILES.into_iter().zip(model_files()) {
            let media_type = "application/octet-stream";
            product.artifacts.push(Artifact { name: name.into(), media_type, bytes: bytes.clone() });
        }
        product.artifacts.extend(zip);
        Ok(product)
    })
}

/// `emitter.glb` and `goniograms.json` of a known source of few rays.
pub fn model_files() -> &'static [Vec<u8>; 2] {
    static FILES: LazyLock<[Vec<u8>; 2]> = LazyLock::new(|| {
        let mut bytes = Vec::new();
        write_tm25(&by_name("flat-chip").unwrap(), 5_000, 1, &mut bytes).unwrap();
        let (name, sha256) = ("chip.tm25ray".into(), sha256(&bytes));
        let input = Input { name, sha256, bytes: Arc::new(bytes), declared: Declared::default(), notices: Vec::new() };
        let outcome = pipeline::run(&[input], &Options::default(), &Limits::default(), &NoProgress).unwrap();
        let file = |name: &str| outcome.artifacts.iter().find(|artifact| artifact.name == name).unwrap().bytes.clone();
        MODEL_FILES.map(file)
    });
    &FILES
}

/// Stands half through the stage "flux" until its gate opens or nobody wants it.
pub fn held(gate: &Arc<Gate>) -> Runner {
    let gate = Arc::clone(gate);
    Arc::new(move |inputs, _, _, watch| {
        gate.begun.fetch_add(1, Ordering::SeqCst);
        watch.progress(Stage::Flux, 0.5);
        while !gate.open.load(Ordering::SeqCst) {
            if watch.cancelled() {
                gate.stopped.fetch_add(1, Ordering::SeqCst);
                return Err(Error::Cancelled);
            }
            sleep(Duration::from_millis(5));
        }
        product(inputs)
    })
}

/// As [`held`], but does not look whether anybody wants it.
pub fn uncancellable(gate: &Arc<Gate>) -> Runner {
    let gate = Arc::clone(gate);
    Arc::new(move |inputs, _, _, _| {
        gate.begun.fetch_add(1, Ordering::SeqCst);
        while !gate.open.load(Ordering::SeqCst) {
            sleep(Duration::from_millis(5));
        }
        product(inputs)
    })
}

/// Keeps its thread busy until its gate opens or nobody wants it.
pub fn burning(gate: &Arc<Gate>) -> Runner {
    let gate = Arc::clone(gate);
    Arc::new(move |inputs, _, _, watch| {
        gate.begun.fetch_add(1, Ordering::SeqCst);
        rayon::broadcast(|_| {
            let mut x = 1_u64;
            while !gate.open.load(Ordering::Relaxed) && !watch.cancelled() {
                for _ in 0..100_000 {
                    x = std::hint::black_box(x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1));
                }
            }
        });
        product(inputs)
    })
}

/// Fails with what `error` makes.
pub fn failing(error: impl Fn() -> Error + Send + Sync + 'static) -> Runner {
    Arc::new(move |_, _, _, _| Err(error()))
}

/// Panics.
pub fn panicking(message: &'static str) -> Runner {
    Arc::new(move |_, _, _, _| panic!("{message}"))
}
