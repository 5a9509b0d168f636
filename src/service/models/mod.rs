//! Models of jobs, read back from their stored files and kept for the next request; the new rays that are drawn from them, evaluations,
//! combinations, and what renderers open.

/// Places, and tenants' shares of them.
mod places;
/// Models changed, and several as one.
pub mod combination;
/// Models as renderers open them.
mod adapter;
/// What is remembered of files that are made when they are asked for.
mod remembered;

use crate::jobs::evaluating::of_stored;
use crate::jobs::query::StoredArtifact;
use crate::priority::compute;
use crate::storage::blobs::Blobs;
use bytes::Bytes;
use futures::Stream;
use futures::stream::poll_fn;
use pipeline::{
    Artifact, Error, EvaluationForm, EvaluationRequest, Failed, LightKind, Limits, NewRays, RayFile, RayRequest, Stage,
    StoredModel, Watch,
};
use places::{Place, Places};
use remembered::Remembered;
use std::collections::HashMap;
use std::io;
use std::io::Write;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc as blocking;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{Mutex as Turns, OwnedMutexGuard, mpsc, oneshot};
use tokio_util::sync::CancellationToken;

/// Models that are kept, and most bytes of the files they were read from.
const KEPT: usize = 8;
const KEPT_BYTES: u64 = 256 << 20;
/// Bytes of the files of a model that is read only to see whether it can answer: less than a second of work.
const SOON_READ_BYTES: u64 = 16 << 20;
/// Bytes that are drawn at once, and pieces of them that may wait to be sent.
const BLOCK_BYTES: u64 = 2 << 20;
const PIECES: usize = 2;
/// Longest evaluation: its answer is to begin before the request is given up.
const LONGEST: Duration = Duration::from_secs(20);

/// Reads models, draws rays from them, and evaluates them.
#[derive(Clone)]
pub struct Models {
    kept: Arc<Mutex<Vec<Kept>>>,
    /// Models that are being read: whoever wants one of them waits for it.
    reading: Arc<Mutex<Reading>>,
    places: Places,
    /// What files of new rays say, by the digests of their models.
    ray_files: Remembered<RayFile>,
    /// Lengths of the files of renderers, by entity tag.
    pub lengths: Remembered<u64>,
    /// The service stops: rays and evaluations end.
    stopping: CancellationToken,
}

/// By the digests of its files, who may read a model.
type Reading = HashMap<[String; 2], Arc<Turns<()>>>;

struct Kept {
    digests: [String; 2],
    byte_count: u64,
    model: Arc<StoredModel>,
}

/// A file of new rays whose length is known, and which is drawn on a thread of its own.
pub struct Drawing {
    /// Bytes of the whole file.
    pub byte_count: u64,
    range: blocking::Sender<Range<u64>>,
    pieces: mpsc::Receiver<io::Result<Bytes>>,
}

impl Drawing {
    /// These bytes of the file. Dropped, the drawing ends.
    pub fn stream(self, range: Range<u64>) -> impl Stream<Item = io::Result<Bytes>> + Send + 'static {
        // A thread that is gone has left its piece or none: the stream then ends too early, which the client sees by the length.
        let _ = self.range.send(range);
        let mut pieces = self.pieces;
        poll_fn(move |context| pieces.poll_recv(context))
    }
}

impl Models {
    /// None are kept yet.
    pub fn new(stopping: CancellationToken) -> Models {
        Models {
            kept: Arc::default(),
            reading: Arc::default(),
            places: Places::default(),
            ray_files: Remembered::default(),
            lengths: Remembered::default(),
            stopping,
        }
    }

    /// Prepares new rays of the model in `files`; `None` where `tenant` has as many places as it may.
    ///
    /// # Errors
    /// The store does not have the files, they are no model's, or the rays do not fit the format.
    pub async fn draw(
        &self,
        tenant: &str,
        blobs: &Blobs,
        files: &[StoredArtifact; 2],
        request: RayRequest,
    ) -> Result<Option<Drawing>, Error> {
        let Some(place) = self.places.take(tenant) else { return Ok(None) };
        let (model, place) = self.model(blobs, files, place).await?;
        let (begun, beginning) = oneshot::channel();
        let (range, wanted) = blocking::channel();
        let (sender, pieces) = mpsc::channel(PIECES);
        let stopping = self.stopping.clone();
        let work = move || {
            let _place = place;
            let rays = match NewRays::new(&*model, &model.name, request) {
                Ok(rays) => rays,
                Err(error) => return drop(begun.send(Err(error))),
            };
            // Nobody may be there any more, and then no range comes.
            let _ = begun.send(Ok((rays.byte_count(), rays.file().clone())));
            if let Ok(range) = wanted.recv() {
                send(&rays, range, &sender, &Stopping(stopping));
            }
        };
        tokio::spawn(compute("rays", work));
        let begun = beginning.await.map_err(|_| Error::Internal("the drawing of rays ended".to_owned()))?;
        let (byte_count, file) = begun?;
        self.ray_files.keep(&both(files), file);
        Ok(Some(Drawing { byte_count, range, pieces }))
    }

    /// Bytes of the whole file, where rays of the model in `files` were drawn before: no model is read for it.
    ///
    /// # Errors
    /// The rays do not fit the format.
    pub fn ray_bytes(&self, files: &[StoredArtifact; 2], request: RayRequest) -> Result<Option<u64>, Error> {
        self.ray_files.of(&both(files)).map(|file| file.byte_count(request)).transpose()
    }

    /// Evaluates the model in `files`. Dropped before it is done, the evaluation ends.
    ///
    /// # Errors
    /// The store does not have the files, they are no model's, or the request cannot be answered.
    pub async fn evaluate(
        &self,
        tenant: &str,
        blobs: &Blobs,
        files: &[StoredArtifact; 2],
        request: EvaluationRequest,
        form: EvaluationForm,
    ) -> Result<Evaluated, Error> {
        let Some(place) = self.places.take(tenant) else { return Ok(Evaluated::Busy) };
        let (model, place) = self.model(blobs, files, place).await?;
        let gone = CancellationToken::new();
        let _here = gone.clone().drop_guard();
        let watch = self.watch(gone);
        let work = move || {
            let _place = place;
            let evaluated = pipeline::evaluate(&model, &request, form, &watch);
            (evaluated, watch.is_late.into_inner())
        };
        match compute("evaluation", work).await.map_err(Error::from)? {
            (Err(Error::Cancelled), true) => Ok(Evaluated::TooLong),
            (Err(Error::Cancelled), false) => Ok(Evaluated::Stopping),
            (evaluated, _) => evaluated.map(Evaluated::File),
        }
    }

    /// Refuses what the model in `files` cannot answer, where it is kept, or soon read and `tenant` has a place; which light it is evaluated in.
    /// `None`: nothing is known of it now.
    ///
    /// # Errors
    /// The model cannot answer the request.
    pub async fn check(
        &self,
        tenant: &str,
        blobs: &Blobs,
        files: &[StoredArtifact; 2],
        request: &EvaluationRequest,
        form: EvaluationForm,
    ) -> Result<Option<LightKind>, Error> {
        let byte_count: u64 = files.iter().map(|file| file.byte_count).sum();
        // What a kept model knows costs nothing: equal evaluations are then found to be equal also by who has all places taken.
        let model = match self.find(&files.each_ref().map(|file| file.sha256.clone())) {
            Some(model) => model,
            None if byte_count > SOON_READ_BYTES => return Ok(None),
            None => {
                let Some(place) = self.places.take(tenant) else { return Ok(None) };
                // A store that does not answer now, or a model that cannot be read, is the job's to tell, which waits or tries again.
                let Ok((model, _place)) = self.model(blobs, files, place).await else { return Ok(None) };
                model
            }
        };
        let request = request.clone();
        let work = move || pipeline::check_evaluation_of(&model, &request, form).map(Some);
        compute("evaluation", work).await.map_err(Error::from)?
    }

    /// The model of `files`, kept or read; once, whoever else wants it at the same time.
    async fn model(
        &self,
        blobs: &Blobs,
        files: &[StoredArtifact; 2],
        place: Place,
    ) -> Result<(Arc<StoredModel>, Place), Error> {
        let digests = [files[0].sha256.clone(), files[1].sha256.clone()];
        if let Some(model) = self.find(&digests) {
            return Ok((model, place));
        }
        let turn = self.turn(&digests).await;
        if let Some(model) = self.find(&digests) {
            return Ok((model, place));
        }
        let bytes = [file(blobs, &files[0]).await?, file(blobs, &files[1]).await?];
        let byte_count = files.iter().map(|file| file.byte_count).sum();
        let models = self.clone();
        // Place and turn go with the work, which goes on, and keeps the model, when the client has left.
        let read = move || {
            let _turn = turn;
            let [emitter, goniograms] = &bytes;
            let model = pipeline::read_model(emitter, goniograms, &Limits::default()).map_err(of_stored)?;
            let model = Arc::new(model);
            models.keep(Kept { digests, byte_count, model: Arc::clone(&model) });
            Ok((model, place))
        };
        compute("model", read).await.map_err(Error::from)?
    }

    /// Who watches what a client waits for: it ends when the service stops, when `gone` says that the client left, and when it takes too long.
    fn watch(&self, gone: CancellationToken) -> Evaluating {
        let (stopping, end) = (self.stopping.clone(), Instant::now() + LONGEST);
        Evaluating { stopping, gone, end, is_late: AtomicBool::new(false) }
    }

    /// Waits until nobody reads the model of these files.
    async fn turn(&self, digests: &[String; 2]) -> OwnedMutexGuard<()> {
        let turns = {
            let mut reading = self.reading.lock().unwrap_or_else(PoisonError::into_inner);
            // Those that nobody holds or waits for any more.
            reading.retain(|_, turns| Arc::strong_count(turns) > 1);
            Arc::clone(reading.entry(digests.clone()).or_default())
        };
        turns.lock_owned().await
    }

    /// A kept model, which is then the last to go.
    fn find(&self, digests: &[String; 2]) -> Option<Arc<StoredModel>> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let at = kept.iter().position(|kept| kept.digests == *digests)?;
        let found = kept.remove(at);
        let model = Arc::clone(&found.model);
        kept.push(found);
        Some(model)
    }

    fn keep(&self, new: Kept) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|kept| kept.digests != new.digests);
        kept.push(new);
        while kept.len() > KEPT || kept.iter().map(|kept| kept.byte_count).sum::<u64>() > KEPT_BYTES {
            kept.remove(0);
        }
    }
}

/// What a model is called by its files.
fn both([emitter, goniograms]: &[StoredArtifact; 2]) -> String {
    format!("{}-{}", emitter.sha256, goniograms.sha256)
}

/// The bytes of a file of a model.
async fn file(blobs: &Blobs, file: &StoredArtifact) -> Result<Vec<u8>, Error> {
    pipeline::check_model_size(&file.name, file.byte_count)?;
    let read = blobs.read(&file.blob, 0..file.byte_count).await;
    Ok(read.map_err(|error| Error::Unreadable(io::Error::other(error)))?.to_vec())
}

/// Draws and sends, block by block, until the client has all or is gone, or the service stops.
fn send(rays: &NewRays<'_>, range: Range<u64>, sender: &mpsc::Sender<io::Result<Bytes>>, watch: &Stopping) {
    let mut from = range.start;
    while from < range.end {
        let to = range.end.min(from + BLOCK_BYTES);
        match pipeline::write_new_rays(rays, from..to, &mut Pieces(sender), watch) {
            Ok(()) => from = to,
            // The client is gone.
            Err(Failed::Write(_)) => return,
            Err(Failed::Read(error)) => {
                let _ = sender.blocking_send(Err(io::Error::other(error.to_string())));
                return;
            }
        }
    }
}

/// Hands over what is written.
struct Pieces<'a>(&'a mpsc::Sender<io::Result<Bytes>>);

impl Write for Pieces<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let sent = self.0.blocking_send(Ok(Bytes::copy_from_slice(bytes)));
        sent.map(|()| bytes.len()).map_err(|_| io::ErrorKind::BrokenPipe.into())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// What became of an evaluation.
pub enum Evaluated {
    /// It is done.
    File(Artifact),
    /// The tenant has as many places as it may.
    Busy,
    /// It would take longer than an answer may.
    TooLong,
    /// The service stops.
    Stopping,
}

/// An evaluation ends when the service stops, when nobody waits for it, and when it takes too long.
struct Evaluating {
    stopping: CancellationToken,
    gone: CancellationToken,
    end: Instant,
    is_late: AtomicBool,
}

impl Watch for Evaluating {
    fn progress(&self, _: Stage, _: f64) {}

    fn cancelled(&self) -> bool {
        if Instant::now() >= self.end {
            self.is_late.store(true, Ordering::Relaxed);
        }
        self.is_late.load(Ordering::Relaxed) || self.stopping.is_cancelled() || self.gone.is_cancelled()
    }
}

/// Drawing reports no progress, and ends when the service stops.
struct Stopping(CancellationToken);

impl Watch for Stopping {
    fn progress(&self, _: Stage, _: f64) {}

    fn cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}
