//! Whether the stores work.

use super::problem::Problem;
use crate::storage::Storage;
use crate::storage::together::Together;
use futures::FutureExt;
use std::collections::HashMap;

/// What the stores are asked as, all of them together.
pub const STORES: &str = "stores";

/// Checks whether the stores work, with one trial for all requests at the same time: a trial writes, and the requests need no key.
pub type Readiness = Together<Result<(), Problem>>;

/// Tries these stores.
pub fn readiness(storage: Storage) -> Readiness {
    Together::new(move |_| {
        let storage = storage.clone();
        async move {
            let checked = storage.check().await.map_err(|error| Problem::from(error).not_ready());
            Ok(HashMap::from([(STORES.to_owned(), checked)]))
        }
        .boxed()
    })
}
