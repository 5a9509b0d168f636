//! Claims jobs of the queue and computes them: the only caller of [`pipeline::run`], on threads of its own.

use super::ZIP;
use super::evaluating::Evaluation;
use super::query;
use super::query::StoredArtifact;
use super::queue::{Claim, Lease, Queue};
use super::request::{Channel, TotalFlux};
use crate::cause::Cause;
use crate::failure::{Failure, StoredNotice};
use crate::hex::hex;
use crate::metrics::Metrics;
use crate::priority::Lost;
use crate::ray_sets::rows;
use crate::ray_sets::rows::RaySet;
use crate::storage::Storage;
use crate::storage::parts::{Part, Parts};
use crate::{crash, priority, spectra, storage};
use pipeline::Options;
use pipeline::{Artifact, Input, Limits, Notice, Stage, Watch};
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use sha2::{Digest, Sha256};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;
use tokio::runtime::Handle;
use tokio::task::JoinSet;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep};
use tokio_util::sync::CancellationToken;
use tracing::Instrument;

/// The result of a computed job.
#[derive(Debug, Default)]
pub struct Product {
    /// The artifacts of the job, [`ZIP`] last; of an evaluation the one file.
    pub artifacts: Vec<Artifact>,
    /// Notices about data that was repaired, dropped or unusual.
    pub notices: Vec<Notice>,
}

/// Computes a job. Blocks; called on a rayon pool.
pub type Runner =
    Arc<dyn Fn(&[Input], &Options, &Limits, &dyn Watch) -> Result<Product, pipeline::Error> + Send + Sync>;

/// The runner of every real service: [`pipeline::run`], and the zip of what it gave.
pub fn pipeline_runner() -> Runner {
    Arc::new(|inputs, options, limits, watch| {
        let outcome = pipeline::run(inputs, options, limits, watch)?;
        let mut artifacts = outcome.artifacts;
        let zip = pipeline::artifacts::zip(&artifacts)?;
        artifacts.push(Artifact { name: ZIP.into(), media_type: "application/zip", bytes: zip });
        Ok(Product { artifacts, notices: outcome.notices })
    })
}

/// A worker: claims jobs of the queue, computes them and stores their artifacts. Cheap to clone.
#[derive(Clone)]
pub struct Worker {
    /// The database and the object store.
    pub storage: Storage,
    /// The queue that jobs are claimed from.
    pub queue: Queue,
    /// The function that computes a job.
    pub runner: Runner,
    /// Limits for ray files on this machine.
    pub limits: Limits,
    /// How often an idle worker looks for a job.
    pub poll: Duration,
    /// How often a busy worker renews the lease of its job.
    pub renew_every: Duration,
    /// How long a computed job waits for free space in the object store.
    pub patience: Duration,
    /// The metrics of this process.
    pub metrics: Metrics,
    /// Once cancelled, the worker claims no more jobs.
    pub stop: CancellationToken,
    /// Once cancelled, the worker puts its running jobs back into the queue.
    pub release: CancellationToken,
}

/// What a channel of a job names.
struct Stored {
    ray_set: RaySet,
    /// Where the bytes of the ray set are.
    parts: Vec<Part>,
    /// The points of the uploaded spectrum, where one is named.
    points: Option<Vec<(f64, f64)>>,
    /// What was noticed of the file and of the spectrum when they were taken in.
    notices: Vec<Notice>,
}

/// How a computation ended.
enum Ending {
    Published(Vec<StoredArtifact>, Vec<StoredNotice>),
    Failed(Failure),
    /// The database or the object store did not answer: the job is not at fault, and another attempt may succeed.
    StoreFailed(Failure),
    /// The computation stopped because it was told to.
    Stopped,
}

/// Why a worker stopped the computation of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StopReason {
    /// A client cancelled the job.
    Cancelled,
    /// The service stops: another process goes on with the job.
    Released,
    /// The lease belongs to another worker.
    LeaseLost,
    /// The attempt took too long, and was in this stage.
    TimedOut(Option<Stage>),
}

impl Worker {
    /// Starts `concurrency` slots, each of which computes one job at a time on `threads` threads, until [`Worker::stop`] is
    /// cancelled.
    ///
    /// # Errors
    /// The threads cannot be had.
    pub fn spawn(self, concurrency: usize, threads: usize) -> Result<JoinSet<()>, ThreadPoolBuildError> {
        let mut slots = JoinSet::new();
        for slot in 0..concurrency.max(1) {
            let name = move |thread: usize| format!("pipeline-{slot}-{thread}");
            // A pool per job: on a shared one, a long job would keep every thread and starve the other.
            let pool = ThreadPoolBuilder::new().num_threads(threads.max(1)).thread_name(name);
            let pool = Arc::new(pool.start_handler(|_| priority::lower()).build()?);
            slots.spawn(Worker { queue: self.queue.of_slot(slot), ..self.clone() }.slot(pool));
        }
        Ok(slots)
    }

    async fn slot(self, pool: Arc<ThreadPool>) {
        while !self.stop.is_cancelled() {
            match self.queue.claim().await {
                Ok(Some(claim)) => {
                    let span = tracing::info_span!("job", id = claim.id, attempt = claim.attempt);
                    self.attempt(&claim, Arc::clone(&pool)).instrument(span).await;
                    drop(claim);
                    // What it held may be what another slot waits for.
                    self.queue.nudge();
                    continue;
                }
                Ok(None) => {}
                Err(error) => tracing::error!(%error, "cannot claim a job; trying again"),
            }
            tokio::select! {
                () = self.queue.woken() => {}
                () = sleep(self.poll) => {}
                () = self.stop.cancelled() => {}
            }
        }
    }

    /// One attempt at a job, from claim to the row that ends it.
    async fn attempt(&self, claim: &Claim, pool: Arc<ThreadPool>) {
        tracing::info!(job = claim.id, attempt = claim.attempt, "job started");
        let begun = Instant::now();
        let progress = Arc::new(Progress::default());
        // Dropped with this future, when the service is: a thread cannot be stopped, only told.
        let _stop_when_dropped = StopOnDrop(Arc::clone(&progress));
        let work = self.work(claim, pool, Arc::clone(&progress));
        let (ending, stopped) = self.supervise(claim, &progress, work).await;
        let word = match (&ending, stopped) {
            (_, Some(StopReason::LeaseLost)) => "lost",
            (_, Some(StopReason::Cancelled)) => {
                self.retry_until_answered("stop", || self.queue.stop(claim)).await;
                "cancelled"
            }
            (Ending::Stopped, Some(StopReason::Released)) => {
                self.retry_until_answered("release", || self.queue.release(claim)).await;
                "released"
            }
            (Ending::Stopped, Some(StopReason::TimedOut(stage))) => {
                let failure = Failure::timed_out(claim.timeout, stage);
                self.retry_until_answered("fail", || self.queue.fail(claim, &failure)).await;
                "timed out"
            }
            (Ending::Published(artifacts, notices), _) => self.finish(claim, artifacts, notices).await,
            (Ending::Failed(failure), _) => {
                self.retry_until_answered("fail", || self.queue.fail(claim, failure)).await;
                "failed"
            }
            (Ending::StoreFailed(failure), _) => self.retry(claim, failure).await,
            (Ending::Stopped, None) => {
                let failure = Failure::stopped();
                self.retry_until_answered("fail", || self.queue.fail(claim, &failure)).await;
                "failed"
            }
        };
        if !matches!(word, "succeeded") {
            self.delete_blobs(claim).await;
        }
        self.metrics.attempted(word, begun.elapsed());
        tracing::info!(job = claim.id, attempt = claim.attempt, ending = word, "job ended");
    }

    async fn finish(&self, claim: &Claim, artifacts: &[StoredArtifact], notices: &[StoredNotice]) -> &'static str {
        if self.retry_until_answered("finish", || self.queue.finish(claim, artifacts, notices)).await {
            return "succeeded";
        }
        // Cancelled since the last renewal of the lease, or taken over by another worker.
        if self.retry_until_answered("stop", || self.queue.stop(claim)).await { "cancelled" } else { "lost" }
    }

    /// Puts the job back for a later attempt, or fails it when this was its last.
    async fn retry(&self, claim: &Claim, failure: &Failure) -> &'static str {
        if self.retry_until_answered("retry", || self.queue.retry(claim)).await {
            return "put back";
        }
        if self.retry_until_answered("fail", || self.queue.fail(claim, failure)).await { "failed" } else { "lost" }
    }

    /// Runs `work` to its end while the lease is renewed; stops it when a client cancels the job, the service stops, the lease is
    /// lost or the time is over.
    async fn supervise(
        &self,
        claim: &Claim,
        progress: &Progress,
        work: impl Future<Output = Ending>,
    ) -> (Ending, Option<StopReason>) {
        let (mut stop_reason, begun) = (None, Instant::now());
        let mut ticker = interval(self.renew_every);
        ticker.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut work = std::pin::pin!(work);
        loop {
            tokio::select! {
                ending = &mut work => return (ending, stop_reason),
                () = sleep(claim.timeout.saturating_sub(begun.elapsed())), if stop_reason.is_none() => {
                    stop_reason = Some(StopReason::TimedOut(progress.read().0));
                }
                () = self.release.cancelled(), if stop_reason.is_none() => stop_reason = Some(StopReason::Released),
                _ = ticker.tick() => {
                    let (stage, fraction) = progress.read();
                    match self.queue.renew_lease(claim, stage.map(Stage::name), fraction).await {
                        Ok(Lease::Held) => {}
                        Ok(Lease::CancelRequested) => stop_reason = Some(StopReason::Cancelled),
                        Ok(Lease::Lost) => stop_reason = Some(StopReason::LeaseLost),
                        Err(error) => tracing::warn!(job = claim.id, %error, "cannot renew the lease of a job; trying again"),
                    }
                }
            }
            if stop_reason.is_some() {
                progress.stop();
            }
        }
    }

    /// Computes and stores; nothing of it is visible until the queue says so.
    async fn work(&self, claim: &Claim, pool: Arc<ThreadPool>, progress: Arc<Progress>) -> Ending {
        if let Some(stored) = &claim.evaluation {
            let evaluation = match Evaluation::load(&self.storage, claim, stored).await {
                Ok(evaluation) => evaluation,
                Err(error) => return failed(claim, &error),
            };
            let (limits, watch) = (self.limits, Arc::clone(&progress));
            let run = move || {
                let artifact = pool.install(|| evaluation.run(&limits, watch.as_ref()))?;
                Ok(Product { artifacts: vec![artifact], notices: Vec::new() })
            };
            return self.compute(claim, run, &progress).await;
        }
        let mut options: Options = match serde_json::from_str(&claim.options) {
            Ok(options) => options,
            Err(error) => {
                tracing::error!(job = claim.id, %error, "cannot read a stored job");
                return Ending::Failed(Failure::unreadable_job());
            }
        };
        if let Err(error) = options.validate() {
            return failed(claim, &error);
        }
        let inputs = match self.inputs(claim, &mut options).await {
            Ok(inputs) => inputs,
            Err(error) => return failed(claim, &error),
        };
        let (runner, limits, watch) = (Arc::clone(&self.runner), self.limits, Arc::clone(&progress));
        let run = move || pool.install(|| runner(&inputs, &options, &limits, watch.as_ref()));
        self.compute(claim, run, &progress).await
    }

    /// Runs a computation on a thread of its own, and stores what it gives.
    async fn compute(
        &self,
        claim: &Claim,
        run: impl FnOnce() -> Result<Product, pipeline::Error> + Send + 'static,
        progress: &Progress,
    ) -> Ending {
        let digested = move || {
            let product = run()?;
            let digests = product.artifacts.iter().map(|artifact| hex(&Sha256::digest(&artifact.bytes))).collect();
            Ok((product, digests))
        };
        match priority::compute("pipeline", digested).await {
            Ok(Ok((product, digests))) => self.publish(claim, product, digests, progress).await,
            Ok(Err(error)) => failed(claim, &error),
            Err(Lost::Panicked(message)) => {
                tracing::error!(job = claim.id, panic = message, "a computation panicked");
                Ending::Failed(Failure::panicked())
            }
            Err(lost @ Lost::NoThread(_)) => failed(claim, &lost.into()),
        }
    }

    /// The channels of a job as the pipeline's inputs, and the total they have shares of.
    async fn inputs(&self, claim: &Claim, options: &mut Options) -> Result<Vec<Input>, pipeline::Error> {
        let store_failed = |error: storage::Error| pipeline::Error::Unreadable(std::io::Error::other(error));
        let total = query::total(&self.storage.records, &claim.id).await.map_err(store_failed)?;
        options.rays.total = total.map(TotalFlux::total);
        let mut inputs = Vec::new();
        for channel in query::channels(&self.storage.records, &claim.id).await.map_err(store_failed)? {
            let Stored { ray_set, parts, points, notices } =
                self.stored(claim, &channel).await.map_err(store_failed)?;
            let bytes = Arc::new(Parts::new(self.storage.blobs.clone(), parts, Handle::current()));
            let declared = channel.or(&ray_set.declared).resolve(inputs.len(), points.as_deref())?;
            inputs.push(Input { name: ray_set.name, sha256: ray_set.sha256, bytes, declared, notices });
        }
        Ok(inputs)
    }

    /// What a channel names.
    async fn stored(&self, claim: &Claim, channel: &Channel) -> Result<Stored, storage::Error> {
        let (records, tenant) = (&self.storage.records, claim.tenant.as_str());
        let missing = |what: &str, id: &str| storage::Error::fault(format!("{what} {id} is gone"));
        let id = &channel.ray_set;
        let ray_set = rows::get(records, tenant, id).await?.ok_or_else(|| missing("ray set", id))?;
        let parts = rows::parts(records, id).await?;
        let notices = ray_set.packed.as_ref().map_or(Vec::new(), |packed| {
            let files = packed.left_out.iter().map(|file| (file.name.as_str(), file.code.as_str()));
            pipeline::left_out(&packed.name, files)
        });
        let mut stored = Stored { ray_set, parts, points: None, notices };
        if let Some(id) = channel.spectrum_id() {
            let spectrum = spectra::get(records, tenant, id).await?.ok_or_else(|| missing("spectrum", id))?;
            stored.points = Some(spectrum.points()?);
            let noticed: Vec<StoredNotice> = spectrum.noticed()?;
            stored.notices.extend(noticed.into_iter().map(Notice::from));
        }
        Ok(stored)
    }

    /// Stores the files of this attempt under its own fence. All of them are in memory: room in the store is not waited for
    /// without end.
    async fn publish(&self, claim: &Claim, product: Product, digests: Vec<String>, progress: &Progress) -> Ending {
        let notices = product.notices.iter().map(StoredNotice::from).collect();
        let mut stored = Vec::new();
        let mut full_since: Option<Instant> = None;
        for (artifact, sha256) in product.artifacts.into_iter().zip(digests) {
            let blob = format!("{}/{:04}", claim.folder(), stored.len());
            let byte_count = artifact.bytes.len() as u64;
            let bytes = bytes::Bytes::from(artifact.bytes);
            while let Err(error) = self.storage.blobs.put(&blob, bytes.clone()).await {
                tracing::error!(job = claim.id, blob, %error, "cannot store an artifact; trying again");
                if progress.cancelled() {
                    return Ending::Stopped;
                }
                let full = matches!(error, storage::Error::Full);
                if full && full_since.get_or_insert_with(Instant::now).elapsed() >= self.patience {
                    return Ending::Failed(Failure::store_full());
                }
                sleep(self.renew_every).await;
            }
            crash::point("publish.blob_stored");
            let media_type = artifact.media_type.to_owned();
            stored.push(StoredArtifact { name: artifact.name, media_type, byte_count, sha256, blob });
        }
        Ending::Published(stored, notices)
    }

    /// Repeats a statement until the database answers, because the result of a whole computation would be lost otherwise.
    async fn retry_until_answered<F: Future<Output = Result<bool, storage::Error>>>(
        &self,
        what: &str,
        ask: impl Fn() -> F,
    ) -> bool {
        loop {
            match ask().await {
                Ok(done) => return done,
                Err(error) if Cause::from(&error) == Cause::Ours => {
                    tracing::error!(what, %error, "the database refused a statement; the job stays until its lease ends");
                    return false;
                }
                Err(error) => tracing::error!(what, %error, "the database does not answer; trying again"),
            }
            sleep(self.renew_every).await;
        }
    }

    async fn delete_blobs(&self, claim: &Claim) {
        if let Err(error) = self.storage.blobs.delete_all(&claim.folder()).await {
            tracing::warn!(job = claim.id, %error, "cannot delete the blobs of an unfinished attempt; the garbage collection will");
        }
    }
}

/// The ending of an attempt that failed with this error. Errors that the input did not cause are logged here, because clients do
/// not see their details.
fn failed(claim: &Claim, error: &pipeline::Error) -> Ending {
    let (job, attempt, failure) = (&claim.id, claim.attempt, Failure::from(error));
    match Cause::from(error) {
        Cause::Input => Ending::Failed(failure),
        Cause::Stopped => Ending::Stopped,
        Cause::StoreAway => {
            tracing::warn!(job, attempt, %error, "the database or the object store did not answer; the job will be tried again");
            Ending::StoreFailed(failure)
        }
        Cause::StoreDamaged | Cause::Ours => {
            tracing::error!(job, attempt, code = failure.code, %error, "a job failed because of an internal error or damaged storage");
            Ending::Failed(failure)
        }
    }
}

/// Progress of a computation, and whether it is to stop: written by many threads, read when the lease is renewed.
#[derive(Default)]
struct Progress {
    /// Stage number from 1, then its fraction in 2⁻³², so that larger is later whichever thread reports last.
    reached: AtomicU64,
    stopped: AtomicBool,
}

impl Progress {
    fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    fn read(&self) -> (Option<Stage>, f64) {
        let reached = self.reached.load(Ordering::Relaxed);
        let stage = (reached >> 32).checked_sub(1).and_then(|number| Stage::ALL.get(number as usize).copied());
        (stage, (reached & u64::from(u32::MAX)) as f64 / f64::from(u32::MAX))
    }
}

impl Watch for Progress {
    fn progress(&self, stage: Stage, fraction: f64) {
        crash::stage(stage.name());
        let fraction = (fraction.clamp(0.0, 1.0) * f64::from(u32::MAX)) as u64;
        self.reached.fetch_max(((stage as u64 + 1) << 32) | fraction, Ordering::Relaxed);
    }

    fn cancelled(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}

struct StopOnDrop(Arc<Progress>);

impl Drop for StopOnDrop {
    fn drop(&mut self) {
        self.0.stop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_never_goes_back_and_reads_what_was_reported() {
        let progress = Progress::default();
        assert_eq!(progress.read(), (None, 0.0));
        progress.progress(Stage::Rays, 0.0);
        assert_eq!(progress.read(), (Some(Stage::Rays), 0.0));
        progress.progress(Stage::Flux, 0.75);
        progress.progress(Stage::Flux, 0.5);
        progress.progress(Stage::Hull, 1.0);
        let (stage, fraction) = progress.read();
        assert_eq!(stage, Some(Stage::Flux));
        assert!((fraction - 0.75).abs() < 1e-9);
        progress.progress(Stage::Artifacts, f64::NAN);
        assert_eq!(progress.read().0, Some(Stage::Artifacts));
    }
}
