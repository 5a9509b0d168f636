//! What a disk is trusted with: backups go where they harm nothing, the collector deletes only what the service wrote, files
//! are the service's own, and a store's errors say nothing of the server to a client.

use axum::http::StatusCode;
use serde_json::{Value, json};
use service::storage::error::Unusable;
use service::storage::records::statement::sql;
use service::storage::{Storage, database_url};
use service::upkeep::backup::backup;
use service::{Config, Service, StartError, storage};
use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Component, Path, PathBuf};
use std::time::Duration;
use support::runners::{failing, prompt};
use support::site::Site;

/// Every path below `folder`, links not followed, in order.
fn tree(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        found.push(entry.path());
        if entry.file_type().unwrap().is_dir() {
            found.extend(tree(&entry.path()));
        }
    }
    found.sort();
    found
}

/// The same without what SQLite makes and deletes as databases are opened and closed.
fn kept(folder: &Path) -> Vec<PathBuf> {
    let passing = |path: &PathBuf| path.to_str().is_some_and(|path| path.ends_with("-wal") || path.ends_with("-shm"));
    tree(folder).into_iter().filter(|path| !passing(path)).collect()
}

/// `path` as it is called from the folder that this process is in.
fn relative(path: &Path) -> PathBuf {
    let here = std::env::current_dir().unwrap();
    let up = here.components().filter(|part| matches!(part, Component::Normal(_))).map(|_| "..");
    up.collect::<PathBuf>().join(path.strip_prefix("/").unwrap())
}

#[tokio::test(flavor = "multi_thread")]
async fn no_backup_goes_into_what_it_copies_or_around_it() {
    let mut site = Site::start(prompt()).await;
    if !site.config.is_alone() {
        return;
    }
    site.ray_set().await;
    let (base, data) = (site.folder.path().to_owned(), site.config.data.clone());
    // The same stores, each in a folder of its own; nothing else is in the data folder.
    let (rows, blobs) = (base.join("rows"), base.join("files"));
    fs::create_dir_all(&rows).unwrap();
    site.write(sql("VACUUM INTO $1").bind(rows.join("kept.db").to_str())).await;
    site.kill().await;
    fs::create_dir_all(base.join("spread")).unwrap();
    fs::rename(data.join("blobs"), &blobs).unwrap();
    let spread = Config {
        data: base.join("spread"),
        database_url: Some(format!("sqlite:{}?mode=rwc", rows.join("kept.db").display())),
        storage_url: Some(format!("file:{}", blobs.display())),
        ..site.config.clone()
    };
    let usual = Config { storage_url: Some(format!("file:{}", blobs.display())), ..site.config.clone() };
    symlink(&blobs, base.join("link")).unwrap();
    symlink(data.join("fresh"), base.join("dangling")).unwrap();
    fs::create_dir_all(base.join("aside")).unwrap();
    let before = kept(&base);
    for (config, to) in [
        (&usual, data.clone()),
        (&usual, data.join("copy")),
        (&usual, data.join("a/b/c")),
        (&usual, data.join("../aside/../data/copy")),
        (&usual, base.join("fresh/../data/copy")),
        (&usual, relative(&data.join("copy"))),
        (&usual, blobs.clone()),
        (&usual, blobs.join("copy")),
        (&usual, base.join("link/copy")),
        (&usual, base.join("link/ray-sets/../new")),
        (&usual, base.join("dangling")),
        (&usual, base.join("dangling/copy")),
        (&usual, base.clone()),
        (&usual, base.join("aside/..")),
        (&usual, PathBuf::from("/")),
        (&spread, rows.clone()),
        (&spread, rows.join("copy")),
        (&spread, base.join("spread")),
        (&spread, base.join("spread/copy")),
        (&spread, blobs.join("ray-sets/copy")),
    ] {
        let done = backup(config, &to).await;
        assert!(done.is_err(), "a backup went into {}", to.display());
        assert_eq!(kept(&base), before, "{} was touched: {done:?}", to.display());
    }
    for (config, to) in [(&usual, base.join("copy")), (&spread, base.join("aside/copy"))] {
        assert_eq!(backup(config, &to).await.unwrap().blobs, 1);
    }
    assert_eq!(backup(&usual, &relative(&base.join("copy"))).await.unwrap().fresh, 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_backup_takes_an_empty_folder_or_an_earlier_backup_and_no_other() {
    let mut site = Site::start(prompt()).await;
    if !site.config.is_alone() {
        return;
    }
    let ray_set = site.ray_set().await;
    let base = site.folder.path().to_owned();
    // A folder of somebody's, another service's data folder, files that merely have our names.
    let other = Config { data: base.join("other"), ..site.config.clone() };
    drop(Service::start_with(other.clone(), prompt()).await.unwrap());
    for (folder, file) in [("letters", "letter.txt"), ("rows", "service.db"), ("locked", "lock"), ("deep", "blobs/x/y")]
    {
        let file = base.join(folder).join(file);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, "somebody's").unwrap();
    }
    fs::write(base.join("file"), "somebody's").unwrap();
    // What was a backup, and then had something else put into it, or was begun to be served.
    for folder in ["mixed", "served"] {
        backup(&site.config, &base.join(folder)).await.unwrap();
    }
    fs::write(base.join("mixed/letter.txt"), "somebody's").unwrap();
    let served = Config { data: base.join("served"), ..site.config.clone() };
    drop(Service::start_with(served, prompt()).await.unwrap());
    tokio::time::sleep(Duration::from_millis(50)).await;
    for folder in ["letters", "rows", "locked", "deep", "file", "other", "mixed", "served"] {
        let to = base.join(folder);
        let before = fs::metadata(&to).unwrap().is_dir().then(|| kept(&to));
        let done = backup(&site.config, &to).await;
        assert!(done.is_err(), "a backup went into {folder}");
        assert_eq!(fs::metadata(&to).unwrap().is_dir().then(|| kept(&to)), before, "{folder}: {done:?}");
    }
    assert_eq!(fs::read_to_string(base.join("locked/lock")).unwrap(), "somebody's");
    fs::create_dir(base.join("empty")).unwrap();
    assert_eq!(backup(&site.config, &base.join("empty")).await.unwrap().fresh, 1);
    assert_eq!(backup(&site.config, &base.join("empty")).await.unwrap().fresh, 0);
    site.kill().await;
    site.config.data = base.join("empty");
    site.restart(prompt()).await;
    assert_eq!(site.get(&format!("/v1/ray-sets/{ray_set}")).await.status, StatusCode::OK);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_collector_deletes_what_the_service_wrote_and_nothing_else() {
    let mut site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let named = site.blobs();
    site.kill().await;
    site.config.garbage_age = Duration::from_millis(1);
    let storage = Storage::open(&site.config.database_url(), &site.config.storage_url()).await.unwrap();
    let (gone, job) = ("01890000-0000-7000-8000-000000000000", "01890000-0000-7000-8000-000000000001");
    let ours = [
        format!("ray-sets/{gone}/000000"),
        format!("ray-sets/{gone}/1234567"),
        format!("ray-sets/{gone}/000001.01890000-0000-7000-8000-000000000002"),
        format!("artifacts/{job}/12/0000"),
        format!("probes/{gone}"),
    ];
    let strange = [
        "backup/service.db".to_owned(),
        format!("backup/blobs/ray-sets/{gone}/000000"),
        "letter.txt".to_owned(),
        format!("ray-sets/{gone}/letter.txt"),
        format!("ray-sets/{gone}/more/000000"),
        format!("ray-sets/{ray_set}/000001.txt"),
        "ray-sets/lamps/000000".to_owned(),
        format!("artifacts/{job}/0000"),
        format!("artifacts/{job}/last/0000"),
        format!("artifacts/{job}/1/0000.bak"),
        "probes/x".to_owned(),
        format!("{gone}/000000"),
    ];
    for key in ours.iter().chain(&strange) {
        storage.blobs.put(key, "bytes".into()).await.unwrap();
    }
    let local = site.config.storage_url().strip_prefix("file:").map(PathBuf::from);
    let on_disk = |names: &[String]| names.iter().filter(|name| local.as_ref().unwrap().join(name).exists()).count();
    let half = [format!("ray-sets/{ray_set}/000001#1"), format!("artifacts/{job}/12/0001#27")];
    let odd = ["notes#1".to_owned(), "backup/a#b".into(), format!("ray-sets/{gone}/x#1"), "back\\slash\u{1}".into()];
    if let Some(folder) = &local {
        for name in half.iter().chain(&odd) {
            fs::write(folder.join(name), "bytes").unwrap();
        }
    }
    tokio::time::sleep(Duration::from_millis(20)).await;
    site.restart(prompt()).await;
    let mut stay: Vec<String> = strange.iter().chain(&named).cloned().collect();
    stay.sort();
    let start = std::time::Instant::now();
    let left = async || {
        let mut left = Vec::new();
        for key in ours.iter().chain(&stay) {
            if storage.blobs.whole(key).await.unwrap().is_some() {
                left.push(key.clone());
            }
        }
        left
    };
    // Without a lock, a second later.
    while left().await != stay {
        assert!(start.elapsed() < Duration::from_secs(10), "{:?} and not {stay:?}", left().await);
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    if local.is_some() {
        assert_eq!((on_disk(&half), on_disk(&odd)), (0, odd.len()));
    }
}

/// As with a misspelt path of the database, or with its disk not mounted.
#[tokio::test(flavor = "multi_thread")]
async fn blobs_of_another_database_are_not_taken_for_garbage() {
    let mut site = Site::start(prompt()).await;
    let part = format!("ray-sets/{}/000000", site.ray_set().await);
    site.kill().await;
    let right = site.config.clone();
    let blobs = Storage::open(&right.database_url(), &right.storage_url()).await.unwrap().blobs;
    let elsewhere = database_url::url(&site.folder.path().join("elsewhere/service.db"));
    let wrong = Config { database_url: Some(elsewhere), storage_url: Some(right.storage_url()), ..right };
    for is_marked in [true, false] {
        if !is_marked {
            // As older versions leave it.
            blobs.delete("database").await.unwrap();
        }
        let refused = Service::start_with(wrong.clone(), prompt()).await.err().unwrap();
        let is_told = matches!(refused, StartError::Storage(storage::Error::Unusable(Unusable::OtherBlobs)));
        assert!(is_told, "{is_marked}: {refused}");
        assert!(blobs.whole(&part).await.unwrap().is_some(), "{is_marked}");
    }
    site.restart(prompt()).await;
    assert!(blobs.whole("database").await.unwrap().is_some(), "its own database marks it again");
    assert!(blobs.whole(&part).await.unwrap().is_some());
}

/// What would be written now would be on another disk, and the store would not seem away any more.
#[tokio::test(flavor = "multi_thread")]
async fn a_store_that_is_not_mounted_is_not_marked() {
    let mut site = Site::start(prompt()).await;
    if !site.config.is_alone() {
        return;
    }
    site.ray_set().await;
    site.kill().await;
    let (blobs, mounted) = (site.config.data.join("blobs"), site.config.data.join("mounted"));
    fs::rename(&blobs, &mounted).unwrap();
    fs::create_dir(&blobs).unwrap();
    site.restart(prompt()).await;
    assert_eq!(tree(&blobs), Vec::<PathBuf>::new());
}

/// Nothing of the server's inside, wherever it stands in an answer.
fn reveals_nothing(answer: &Value) {
    let text = answer.to_string();
    for word in ["/tmp", "data/", "blobs", "Object at", "NotFound", "No such file", "s3://", "127.0.0.1", "os error"] {
        assert!(!text.contains(word), "{word}: {text}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_whose_blob_is_gone_fails_once_and_says_whose_it_was() {
    let site = Site::start(prompt()).await;
    let (ray_set, _other) = (site.ray_set().await, site.ray_set().await);
    let storage = Storage::open(&site.config.database_url(), &site.config.storage_url()).await.unwrap();
    storage.blobs.delete(&format!("ray-sets/{ray_set}/000000")).await.unwrap();
    let job = site.job(&ray_set).await;
    let failed = site.until_state(&job, "failed").await;
    assert_eq!((&failed["problem"]["code"], &failed["attempt"]), (&json!("storage.blob_missing"), &json!(1)));
    assert!(failed["problem"]["detail"].as_str().unwrap().contains(&ray_set), "{failed}");
    reveals_nothing(&failed["problem"]);
}

/// As where its disk is not mounted: jobs that were accepted wait for it.
#[tokio::test(flavor = "multi_thread")]
async fn a_store_that_is_empty_is_away_and_not_damaged() {
    if support::engines::are_shared() {
        return;
    }
    let site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let blobs = site.config.data.join("blobs");
    fs::rename(&blobs, site.config.data.join("elsewhere")).unwrap();
    fs::create_dir(&blobs).unwrap();
    let job = site.job(&ray_set).await;
    site.until(&job, |job| job["attempt"] != 0 && job["state"] == "queued").await;
    fs::remove_dir_all(&blobs).unwrap();
    fs::rename(site.config.data.join("elsewhere"), &blobs).unwrap();
    site.until_state(&job, "succeeded").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_whose_blob_was_cut_short_fails_once() {
    let site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let storage = Storage::open(&site.config.database_url(), &site.config.storage_url()).await.unwrap();
    for left in [0, 100] {
        let bytes = support::rays::zemax(10)[..left].to_vec();
        storage.blobs.put(&format!("ray-sets/{ray_set}/000000"), bytes.into()).await.unwrap();
        let job = site.job(&ray_set).await;
        let failed = site.until_state(&job, "failed").await;
        assert_eq!((&failed["problem"]["code"], &failed["attempt"]), (&json!("storage.blob_damaged"), &json!(1)));
        reveals_nothing(&failed["problem"]);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_artifact_whose_blob_is_gone_is_said_to_be_lost() {
    let site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until_state(&job, "succeeded").await;
    let storage = Storage::open(&site.config.database_url(), &site.config.storage_url()).await.unwrap();
    storage.blobs.delete_all(&format!("artifacts/{job}")).await.unwrap();
    for path in ["model.zip", "artifacts/read.txt"] {
        let reply = site.get(&format!("/v1/jobs/{job}/{path}")).await;
        reply.is_problem(500, "storage.blob_missing");
        reveals_nothing(&reply.json());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_number_that_cannot_be_written_fails_its_job_once() {
    // What the pipeline says of a model with a NaN in it: tests/pipeline and src/pipeline/artifacts.
    let fault = || pipeline::Error::Internal("an array of the model holds a number that is not finite".into());
    let site = Site::start(failing(fault)).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    let failed = site.until_state(&job, "failed").await;
    assert_eq!((&failed["problem"]["code"], &failed["attempt"]), (&json!("run.internal"), &json!(1)));
    assert!(!failed.to_string().contains("array of the model"), "{failed}");
    assert!(failed["problem"]["remedy"].as_str().unwrap().contains("Report this"), "{failed}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stored_job_that_cannot_be_read_is_a_fault_and_no_store_that_is_away() {
    let mut site = Site::start(prompt()).await;
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until_state(&job, "succeeded").await;
    site.write(sql("UPDATE jobs SET notices = 'SELECT /etc/x' WHERE id = $1").bind(job.as_str())).await;
    // One that remembers the job does not read it again.
    site.kill().await;
    site.restart(prompt()).await;
    let reply = site.get(&format!("/v1/jobs/{job}")).await;
    reply.is_problem(500, "service.internal");
    assert!(!reply.json().to_string().contains("expected"), "{}", reply.json());
}

/// The mode of everything in a folder, and the folder's own.
fn modes(folder: &Path) -> Vec<(PathBuf, bool, u32)> {
    let paths = tree(folder).into_iter().chain([folder.to_owned()]);
    let mode = |path: PathBuf| {
        let found = fs::symlink_metadata(&path).unwrap();
        (path, found.is_dir(), found.permissions().mode() & 0o777)
    };
    paths.map(mode).collect()
}

#[track_caller]
fn assert_private(folder: &Path) {
    let found = modes(folder);
    let wider = |(_, is_folder, mode): &&(PathBuf, bool, u32)| *mode != if *is_folder { 0o700 } else { 0o600 };
    let wider: Vec<_> = found.iter().filter(wider).collect();
    assert!(found.len() > 3 && wider.is_empty(), "{wider:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_the_service_writes_is_its_own_also_what_was_wider() {
    let mut site = Site::start(prompt()).await;
    if !site.config.is_alone() {
        return;
    }
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until_state(&job, "succeeded").await;
    let data = site.config.data.clone();
    assert_private(&data);
    site.kill().await;
    for (path, is_folder, _) in modes(&data) {
        fs::set_permissions(path, fs::Permissions::from_mode(if is_folder { 0o755 } else { 0o664 })).unwrap();
    }
    // What is not ours is left as it is.
    fs::write(data.join("letter.txt"), "somebody's").unwrap();
    fs::write(data.join("blobs/letter.txt"), "somebody's").unwrap();
    for letter in ["letter.txt", "blobs/letter.txt"] {
        fs::set_permissions(data.join(letter), fs::Permissions::from_mode(0o644)).unwrap();
    }
    site.restart(prompt()).await;
    for letter in ["letter.txt", "blobs/letter.txt"] {
        assert_eq!(fs::metadata(data.join(letter)).unwrap().permissions().mode() & 0o777, 0o644, "{letter}");
        fs::remove_file(data.join(letter)).unwrap();
    }
    assert_private(&data);
    let copy = site.folder.path().join("copy");
    backup(&site.config, &copy).await.unwrap();
    assert_private(&copy);
}
