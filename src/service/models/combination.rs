//! Models of jobs changed, and several as one, while a client waits.

use super::{Models, file};
use crate::jobs::evaluating::of_stored;
use crate::jobs::query::StoredArtifact;
use crate::priority::compute;
use crate::storage::blobs::Blobs;
use pipeline::{Change, Component, Error, Limits, Options};
use std::sync::atomic::AtomicBool;
use tokio_util::sync::CancellationToken;

/// Most bytes of the files of all models together.
const MOST_BYTES: u64 = 64 << 20;

/// Most spectral numbers of all models together: 64 MB.
const MOST_NUMBERS: usize = 1 << 23;

/// A model that goes in.
pub struct Wanted {
    /// `emitter.glb` and `goniograms.json`.
    pub files: [StoredArtifact; 2],
    /// What it is called; `None`: as its files say.
    pub name: Option<String>,
    /// What is changed of it.
    pub change: Change,
}

/// What became of a combination.
pub enum Made {
    /// It is done: the zip of all its files.
    Done(Vec<u8>),
    /// The tenant has as many places as it may.
    Busy,
    /// It would take longer than an answer may.
    TooLong,
    /// The service stops.
    Stopping,
}

impl Models {
    /// Combines models. Dropped before it is done, the work ends.
    ///
    /// # Errors
    /// The store does not have the files, they are too large together, or the models cannot be one.
    pub async fn combine(&self, tenant: &str, blobs: &Blobs, wanted: Vec<Wanted>) -> Result<Made, Error> {
        let Some(place) = self.places.take(tenant) else { return Ok(Made::Busy) };
        let bytes: u64 = wanted.iter().flat_map(|model| &model.files).map(|file| file.byte_count).sum();
        if bytes > MOST_BYTES {
            let found =
                format!("The files of the models have {bytes} bytes together; here at most {MOST_BYTES} are combined.");
            let remedy = "Combine fewer models, or use the command lampwright combine.";
            return Err(Error::refused("combination.too_large", found, remedy));
        }
        let mut components = Vec::with_capacity(wanted.len());
        for Wanted { files: [emitter, goniograms], name, change } in wanted {
            let (emitter, goniograms) = (file(blobs, &emitter).await?, file(blobs, &goniograms).await?);
            components.push(Component { name, emitter, goniograms, change });
        }
        let gone = CancellationToken::new();
        let _here = gone.clone().drop_guard();
        let watch = self.watch(gone);
        let work = move || {
            let _place = place;
            let limits = Limits { max_tally_values: MOST_NUMBERS, ..Limits::default() };
            let made = pipeline::combine(&components, &Options::default(), &limits, &watch);
            let zip = made.and_then(|outcome| pipeline::artifacts::zip(&outcome.artifacts));
            (zip, AtomicBool::into_inner(watch.is_late))
        };
        match compute("combination", work).await.map_err(Error::from)? {
            (Err(Error::Cancelled), true) => Ok(Made::TooLong),
            (Err(Error::Cancelled), false) => Ok(Made::Stopping),
            (zip, _) => zip.map(Made::Done).map_err(of_stored),
        }
    }
}
