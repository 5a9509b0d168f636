//! What requests and the finishing of uploads tell each other.

use crate::ray_sets::rows::LeftOut;
use serde::{Deserialize, Serialize};
use tokio::sync::Notify;

/// What an upload has become, as its row has it.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct UploadResult {
    /// Ids of its ray sets.
    pub ray_sets: Vec<String>,
    /// What else was in a packed file.
    pub left_out: Vec<LeftOut>,
}

/// What a process's requests and its finishing tell each other.
#[derive(Default)]
pub struct UploadSignals {
    /// To the finishing: all bytes of an upload are there.
    pub come: Notify,
    /// To the requests that wait: an upload may have ended.
    pub gone: Notify,
}
