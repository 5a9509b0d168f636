//! Identifiers, and the keys of blobs in the object store.

use uuid::Uuid;

/// A new sortable identifier.
pub fn new_id() -> String {
    Uuid::now_v7().to_string()
}

/// The folders of the object store that the service writes to; all others belong to other programs.
pub const FOLDERS: [&str; 3] = ["ray-sets", "artifacts", "probes"];

/// Whether the service could have written a blob under this key: `ray-sets/<ray set>/<number>`, with `.<session>` behind it where
/// the upload can be resumed, `artifacts/<job>/<fence>/<number>` or `probes/<id>`. A new shape of keys is added here, or its garbage
/// is never collected.
pub fn is_key(key: &str) -> bool {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let is_id = |text: &str| Uuid::parse_str(text).is_ok_and(|id| id.to_string() == text);
    let is_part = |text: &str| match text.split_once('.') {
        Some((number, session)) => is_number(number) && is_id(session),
        None => is_number(text),
    };
    match *key.split('/').collect::<Vec<_>>() {
        ["ray-sets", id, part] => is_id(id) && is_part(part),
        ["artifacts", id, fence, number] => is_id(id) && is_number(fence) && is_number(number),
        ["probes", id] => is_id(id),
        _ => false,
    }
}

/// The folder of a ray set's blobs.
pub fn ray_set_folder(id: &str) -> String {
    format!("ray-sets/{id}")
}

/// The folder of a job's blobs; those of one attempt are in a folder named for its fence.
pub fn job_folder(id: &str) -> String {
    format!("artifacts/{id}")
}

/// Key of the blob that names the database.
pub const OWNER_KEY: &str = "database";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_keys_that_the_service_writes_are_its_own() {
        let (id, session) = (new_id(), new_id());
        for ours in [
            format!("{}/000000", ray_set_folder(&id)),
            format!("{}/1234567", ray_set_folder(&id)),
            format!("{}/000001.{session}", ray_set_folder(&id)),
            format!("{}/12/0003", job_folder(&id)),
            format!("probes/{id}"),
        ] {
            assert!(is_key(&ours), "{ours}");
        }
        let (upper, short) = (id.to_uppercase(), id.replace('-', ""));
        for strange in [
            String::new(),
            "ray-sets".into(),
            format!("ray-sets/{id}"),
            format!("ray-sets/{id}/"),
            format!("ray-sets/{id}/a"),
            format!("ray-sets/{id}/1.bak"),
            format!("ray-sets/{id}/-1"),
            format!("ray-sets/{id}/1/1"),
            format!("ray-sets/{upper}/1"),
            format!("ray-sets/{short}/1"),
            format!("ray-sets/{{{id}}}/1"),
            format!("backup/ray-sets/{id}/1"),
            format!("artifacts/{id}/1"),
            format!("artifacts/{id}/x/1"),
            format!("artifacts/{id}/1/1.{session}"),
            format!("probes/{id}/1"),
            format!("/probes/{id}"),
            "service.db".into(),
        ] {
            assert!(!is_key(&strange), "{strange}");
        }
    }
}
