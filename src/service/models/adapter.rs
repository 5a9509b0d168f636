//! Models as renderers open them, while a client waits.

use super::Models;
use crate::jobs::query::StoredArtifact;
use crate::priority::compute;
use crate::storage::blobs::Blobs;
use pipeline::{Error, LightKind, Renderer};

impl Models {
    /// A zip of what `renderer` opens of the model in `files`; `None` where `tenant` has as many places as it may. It takes about as long as
    /// the model takes to be read, and goes on when the client has left.
    ///
    /// # Errors
    /// The store does not have the files, they are no model's, or the model does not know this light.
    pub async fn adapt(
        &self,
        tenant: &str,
        blobs: &Blobs,
        files: &[StoredArtifact; 2],
        renderer: Renderer,
        light: Option<LightKind>,
    ) -> Result<Option<Vec<u8>>, Error> {
        let Some(place) = self.places.take(tenant) else { return Ok(None) };
        let (model, place) = self.model(blobs, files, place).await?;
        let work = move || {
            let _place = place;
            let adapted = pipeline::adapt(&model, renderer, light)?;
            pipeline::artifacts::zip(&adapted.files).map(Some)
        };
        compute("adapter", work).await.map_err(Error::from)?
    }
}
