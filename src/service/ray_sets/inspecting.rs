//! Inspects ray files: reads a file to its end once, while it arrives or afterwards.
//!
//! While it comes: only a file that comes by itself and says how long it is, and only where none of [`ARRIVALS`] others is. The
//! inspection waits for bytes that have not arrived; if the client is too slow, the inspection stops, and the file is read after
//! its upload, like every other file.

use super::announcement::Announcement;
use super::arriving::Arriving;
use super::declaration::FileDeclaration;
use super::error::{Error, in_query};
use super::inspections::{Drawing, Inspection};
use crate::hex::hex;
use crate::priority;
use crate::priority::Lost;
use crate::storage::blobs::Blobs;
use crate::storage::parts::Part;
use bytes::Bytes;
use pipeline::{Artifact, Input, Limits, Stage, Watch};
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use sha2::{Digest, Sha256};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::runtime::Handle;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::task::JoinHandle;
use tokio_util::sync::{CancellationToken, DropGuard};

/// Files read to their end at once after they have come: each holds the blocks that its threads read.
const INSPECTIONS: usize = 2;
/// Files inspected at once while they come. Where several come at once the processors are busy anyway, and each would need its
/// memory. A place of its own: a long upload keeps it as long as it comes, and others must not wait for that.
const ARRIVALS: usize = 1;

/// Places for files that are read to their end. Cheap to clone.
#[derive(Clone)]
pub struct Places {
    stored: Kind,
    arriving: Kind,
}

/// Places of one kind.
#[derive(Clone)]
struct Kind {
    free: Arc<Semaphore>,
    /// The threads of free places, one per processor and place: no file waits for another one's sender or store. They are kept,
    /// because the allocator keeps for every thread what it once needed.
    threads: Arc<Mutex<Vec<ThreadPool>>>,
}

/// A place for the inspection of one file; free again when dropped.
struct InspectionPlace {
    kind: Kind,
    threads: Option<ThreadPool>,
    _taken: OwnedSemaphorePermit,
}

impl Places {
    /// All of them free.
    ///
    /// # Errors
    /// The system has no threads to give.
    pub fn new() -> Result<Places, ThreadPoolBuildError> {
        Ok(Places { stored: Kind::new("inspect", INSPECTIONS)?, arriving: Kind::new("arrival", ARRIVALS)? })
    }
}

impl Kind {
    fn new(name: &str, places: usize) -> Result<Kind, ThreadPoolBuildError> {
        let threads = |place: usize| {
            let name = name.to_owned();
            let pool = ThreadPoolBuilder::new().thread_name(move |thread| format!("{name}-{place}-{thread}"));
            pool.start_handler(|_| priority::lower()).build()
        };
        let threads = (0..places).map(threads).collect::<Result<_, _>>()?;
        Ok(Kind { free: Arc::new(Semaphore::new(places)), threads: Arc::new(Mutex::new(threads)) })
    }

    /// A place that is free now.
    fn free(&self) -> Option<InspectionPlace> {
        Some(self.place(Arc::clone(&self.free).try_acquire_owned().ok()?))
    }

    /// A place, as soon as one is free.
    async fn wait(&self) -> Option<InspectionPlace> {
        Some(self.place(Arc::clone(&self.free).acquire_owned().await.ok()?))
    }

    fn place(&self, taken: OwnedSemaphorePermit) -> InspectionPlace {
        InspectionPlace { kind: self.clone(), threads: self.idle().pop(), _taken: taken }
    }

    fn idle(&self) -> MutexGuard<'_, Vec<ThreadPool>> {
        self.threads.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl InspectionPlace {
    /// Does `work` wholly on the threads of this place.
    fn run<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.threads {
            Some(threads) => threads.install(work),
            // There are as many as there are places.
            None => work(),
        }
    }
}

impl Drop for InspectionPlace {
    fn drop(&mut self) {
        self.kind.idle().extend(self.threads.take());
    }
}

/// The result of an inspection of a whole file.
pub struct Described {
    /// The header of the file, as JSON.
    pub header: String,
    /// The inspection of its rays.
    pub inspection: Inspection,
}

/// What an inspection needs to know of a file that is still arriving.
pub struct ExpectedFile {
    name: String,
    declared: FileDeclaration,
    gone: CancellationToken,
}

impl ExpectedFile {
    /// The expected file of an announcement.
    pub fn of(announcement: &Announcement) -> ExpectedFile {
        let Announcement { name, declared, gone, .. } = announcement.clone();
        ExpectedFile { name, declared, gone }
    }
}

/// The inspection of an arriving file; it ends when this is dropped.
pub struct Inspecting {
    arriving: Arc<Arriving>,
    described: JoinHandle<Result<Result<Described, pipeline::Error>, Lost>>,
    _stop: DropGuard,
}

impl Inspecting {
    /// The next bytes of the file have come; they are not stored yet.
    pub fn has_come(&self, bytes: Bytes) {
        self.arriving.has_come(bytes);
    }

    /// The first of the bytes that were not stored yet are.
    pub fn is_stored(&self, part: Part) {
        self.arriving.is_stored(part);
    }

    /// What the file turned out to be, all of it being there; `None` where that could not be found out while it came.
    pub async fn described(mut self) -> Option<Result<Described, Error>> {
        use pipeline::Error::{Cancelled, Unreadable};
        match (&mut self.described).await {
            Ok(Ok(Err(Cancelled | Unreadable(_))) | Err(_)) | Err(_) => None,
            Ok(Ok(described)) => Some(described.map_err(|error| in_query(error).into())),
        }
    }
}

impl Drop for Inspecting {
    fn drop(&mut self) {
        self.arriving.stop();
    }
}

impl Places {
    /// Begins to inspect a file of `byte_count` bytes of which nothing has come, and which will lie in `blobs`; `None` where it is
    /// to be inspected afterwards.
    pub fn inspect_as_it_comes(
        &self,
        expected: ExpectedFile,
        blobs: Blobs,
        byte_count: u64,
        limits: Limits,
    ) -> Option<Inspecting> {
        let place = self.arriving.free()?;
        let ExpectedFile { name, declared, gone } = expected;
        let arriving = Arc::new(Arriving::new(blobs, byte_count, Handle::current()));
        let bytes = Arc::clone(&arriving);
        // Its digest is not known yet; what is found does not depend on it.
        let input =
            Input { name, sha256: String::new(), bytes, declared: declared.resolve().ok()?, notices: Vec::new() };
        let stopped = gone.child_token();
        let _stop = stopped.clone().drop_guard();
        let work = move || place.run(|| describe(&input, &limits, &Until(stopped)));
        let described = tokio::spawn(priority::compute("arrival", work));
        Some(Inspecting { arriving, described, _stop })
    }

    /// What a stored file turns out to be, as soon as there is a place for it and until its client is `gone`.
    ///
    /// # Errors
    /// The client closed the connection, or there was no thread for the inspection; the inner error is the file's.
    pub async fn inspect(
        &self,
        input: Input,
        limits: Limits,
        gone: CancellationToken,
    ) -> Result<Result<Described, pipeline::Error>, pipeline::Error> {
        let place = tokio::select! {
            place = self.stored.wait() => place,
            () = gone.cancelled() => None,
        };
        let place = place.ok_or(pipeline::Error::Cancelled)?;
        let work = move || place.run(|| describe(&input, &limits, &Until(gone)).map_err(in_query));
        priority::compute("inspect", work).await.map_err(pipeline::Error::from)
    }
}

/// Inspects a file and draws what was found.
pub fn describe(input: &Input, limits: &Limits, watch: &dyn Watch) -> Result<Described, pipeline::Error> {
    let found = pipeline::inspect(input, limits, watch)?;
    let unwritable = |error: serde_json::Error| pipeline::Error::Internal(error.to_string());
    let mut header = found.header.clone();
    header.texts.clear();
    let drawing = |drawing: Artifact| Drawing {
        sha256: hex(&Sha256::digest(&drawing.bytes)),
        svg: String::from_utf8_lossy(&drawing.bytes).into_owned(),
        name: drawing.name,
    };
    Ok(Described {
        header: serde_json::to_string(&header).map_err(unwritable)?,
        inspection: Inspection {
            json: serde_json::to_string(&found).map_err(unwritable)?,
            drawings: pipeline::drawings(&found, &input.name).into_iter().map(drawing).collect(),
        },
    })
}

/// Watches an inspection on behalf of a client that may go away.
struct Until(CancellationToken);

impl Watch for Until {
    fn progress(&self, _stage: Stage, _fraction: f64) {}

    fn cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}
