//! What becomes of an upload that is resumed: ray sets, a refusal, or nothing.

use crate::resume::{append, begin, metadata, offset, send};
use crate::uploads::nothing_left;
use axum::body::Body;
use axum::http::{Method, StatusCode};
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use serde_json::{Value, json};
use service::Config;
use service::accounts::quota::Quota;
use service::storage::parts::PART_BYTES;
use service::storage::records::statement::sql;
use service::upkeep::backup::backup;
use sha2::{Digest, Sha256};
use std::fs;
use std::fs::OpenOptions;
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};
use support::packing::zip;
use support::rays;
use support::runners::{prompt, sha256};
use support::site::Site;

/// Asks for an upload until it is as `done` says.
async fn until(site: &Site, at: &str, done: impl Fn(&Value) -> bool) -> Value {
    let start = Instant::now();
    loop {
        let upload = site.get(at).await.json();
        if done(&upload) {
            return upload;
        }
        assert!(start.elapsed() < support::site::PATIENCE, "still {upload}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

pub fn id(at: &str) -> &str {
    at.rsplit('/').next().unwrap()
}

/// The last part of an upload, of which nobody gets a byte as long as this lives: a named pipe is in its place. Then whoever
/// waits for it finds nothing.
pub struct Stuck {
    path: PathBuf,
    away: PathBuf,
}

impl Stuck {
    /// `None` where parts are no files.
    pub async fn new(site: &Site, at: &str) -> Option<Stuck> {
        if site.config.local_folders().is_empty() {
            println!("LEFT OUT: no local disk to wait for");
            return None;
        }
        let last = "SELECT blob FROM upload_parts WHERE upload_id = $1 ORDER BY number DESC LIMIT 1";
        let blob = site.rows(sql(last).bind(id(at))).await[0].text("blob").unwrap();
        let stuck = Stuck { path: site.config.data.join("blobs").join(blob), away: site.folder.path().join("away") };
        fs::rename(&stuck.path, &stuck.away).unwrap();
        assert!(Command::new("mkfifo").arg(&stuck.path).status().unwrap().success());
        Some(stuck)
    }
}

impl Drop for Stuck {
    fn drop(&mut self) {
        // Opened for both it waits for nobody, and nobody waits for it any more.
        let both = OpenOptions::new().read(true).write(true).open(&self.path);
        let _ = fs::rename(&self.away, &self.path);
        drop(both);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wrong_file_is_refused_at_its_beginning_however_small_its_pieces() {
    let site = Site::start(prompt()).await;
    let at = begin(&site, 1_000_000, &[]).await;
    let noise = vec![0x55; 20_000];
    for sent in [0, 20_000, 40_000] {
        assert_eq!(append(&site, &at, sent, noise.clone(), &[]).await.status, StatusCode::NO_CONTENT);
    }
    let refused = append(&site, &at, 60_000, noise.clone(), &[]).await;
    assert!(refused.status == 400 || refused.status == 422, "{refused:?}");
    nothing_left(&site).await;
    let told = site.get(&at).await.json();
    assert_eq!((&told["state"], &told["ray_sets"]), (&json!("refused"), &json!([])));
    assert_eq!(told["problem"], refused.json());
    assert!(told["problem"]["remedy"].is_string());
    // Said again to whoever goes on; there is nothing to resume.
    assert_eq!(append(&site, &at, 60_000, noise, &[]).await.json(), refused.json());
    let head = site.ask(Method::HEAD, &at, &[("tus-resumable", "1.0.0")], Body::empty()).await;
    assert_eq!((head.status, head.headers.get("upload-offset")), (StatusCode::GONE, None));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_whole_file_is_judged_at_its_end() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(20);
    // A count that the length disproves is found at once where a length was announced, and here where it was not.
    let mut liar = file.clone();
    liar[4..8].copy_from_slice(&21_u32.to_le_bytes());
    let begun = [("tus-resumable", "1.0.0"), ("upload-defer-length", "1")];
    let at = site.ask(Method::POST, "/v1/uploads", &begun, Body::empty()).await.header("location").to_owned();
    append(&site, &at, 0, liar.clone(), &[]).await;
    let length = [("upload-length", &*liar.len().to_string()), ("content-length", "0")].map(|(k, v)| (k, v.to_owned()));
    let length = length.each_ref().map(|(name, value)| (*name, value.as_str()));
    let refused = append(&site, &at, liar.len(), Vec::new(), &length).await;
    assert!(refused.status == 400 || refused.status == 422, "{refused:?}");
    assert_eq!(site.get(&at).await.json()["problem"], refused.json());
    nothing_left(&site).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_digest_of_the_whole_is_verified_when_said() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(400_000);
    let header = |bytes: &[u8]| format!("sha-256=:{}:", BASE64.encode(Sha256::digest(bytes)));
    let hex = |bytes: &[u8]| metadata(&[("sha256", &sha256(bytes))]);
    for right in [("repr-digest", header(&file)), ("upload-metadata", hex(&file))] {
        let at = send(&site, &file, 9_000_000, &[(right.0, &right.1)]).await;
        assert_eq!(site.get(&at).await.json()["state"], "taken");
        site.delete(&format!("/v1/ray-sets/{}", id(&at))).await;
    }
    for wrong in [("repr-digest", header(b"other")), ("upload-metadata", hex(b"other"))] {
        let at = begin(&site, file.len(), &[(wrong.0, &wrong.1)]).await;
        append(&site, &at, 0, file.clone(), &[]).await.is_problem(400, "upload.digest_mismatch");
        assert_eq!(site.get(&at).await.json()["problem"]["code"], "upload.digest_mismatch");
        nothing_left(&site).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_packed_upload_is_the_ray_sets_in_it() {
    let site = Site::start(prompt()).await;
    let (blue, red) = (rays::zemax(50_000), rays::zemax(6));
    let lamp = zip(&[("blue.dat", &blue), ("read me.txt", b"A letter."), ("red.dat", &red)]);
    let at = send(&site, &lamp, 70_000, &[("upload-metadata", &metadata(&[("filename", "lamp.zip")]))]).await;
    let upload = site.get(&at).await.json();
    assert_eq!((&upload["state"], &upload["left_out"][0]["code"]), (&json!("taken"), &json!("detect.not_rays")));
    let mut found = Vec::new();
    for link in upload["links"]["ray_sets"].as_array().unwrap() {
        let ray_set = site.get(link.as_str().unwrap()).await.json();
        let packed = json!({"name": "lamp.zip", "sha256": sha256(&lamp), "left_out": upload["left_out"]});
        assert_eq!(ray_set["packed"], packed);
        found.push(ray_set["sha256"].clone());
    }
    assert_eq!(found, [json!(sha256(&blue)), json!(sha256(&red))]);
    // The packed bytes are gone.
    site.until_blobs(|blobs| blobs.len() == 2).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_comes_out_of_a_packed_file_needs_room_as_it_does() {
    let file = rays::zemax(20_000);
    let lamp = zip(&[("a.dat", &file), ("b.dat", &file), ("c.dat", &file)]);
    let mut damaged = zip(&[("a.dat", &file), ("b.dat", &file), ("c.dat", &file), ("d.dat", &rays::zemax(99))]);
    let middle_of_the_last = lamp.len() - 100;
    damaged[middle_of_the_last] ^= 0x10;
    let size = file.len() as u64;
    assert!((lamp.len() as u64) < size / 2);
    let quota = |stored_bytes| move |config| Config { quota: Quota { stored_bytes, ..Quota::default() }, ..config };
    // Room for two and a half: it is refused when the third comes out, not when all have; what comes after is not looked at.
    let site = Site::start_as(quota(5 * size), prompt()).await;
    site.upload(damaged.clone()).await.is_problem(400, "container.damaged");
    let site = Site::start_as(quota(2 * size + size / 2), prompt()).await;
    site.upload(damaged).await.is_problem(413, "quota.stored_bytes");
    site.upload(lamp.clone()).await.is_problem(413, "quota.stored_bytes");
    nothing_left(&site).await;
    let at = begin(&site, lamp.len(), &[]).await;
    append(&site, &at, 0, lamp.clone(), &[]).await.is_problem(413, "quota.stored_bytes");
    assert_eq!(site.get(&at).await.json()["problem"]["code"], "quota.stored_bytes");
    nothing_left(&site).await;
    // Just enough: the packed bytes, which go, are not in the way.
    let site = Site::start_as(quota(3 * size), prompt()).await;
    let at = send(&site, &lamp, 1 << 20, &[]).await;
    assert_eq!(site.get(&at).await.json()["ray_sets"].as_array().unwrap().len(), 3);
}

/// An upload whose bytes are all there, as a process leaves it that was killed before it knew what they are.
async fn left_behind(site: &Site, file: &[u8]) -> String {
    let begun = [("tus-resumable", "1.0.0"), ("upload-defer-length", "1")];
    let at = site.ask(Method::POST, "/v1/uploads", &begun, Body::empty()).await.header("location").to_owned();
    append(site, &at, 0, file.to_vec(), &[]).await;
    assert_eq!(offset(site, &at).await, file.len());
    at
}

/// Nothing more is to come of it.
async fn complete(site: &Site, at: &str) {
    let complete = sql("UPDATE uploads SET byte_count = offset_bytes, state = 'finishing' WHERE id = $1");
    site.write(complete.bind(id(at))).await;
}

/// Waits until a process finishes it.
async fn until_leased(site: &Site, at: &str) {
    let leased = "SELECT id FROM uploads WHERE id = $1 AND lease_until_ms > {now}";
    let start = Instant::now();
    while site.rows(sql(leased).bind(id(at))).await.is_empty() {
        assert!(start.elapsed() < support::site::PATIENCE, "nobody finishes it");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

/// Waits until it was begun to be finished more often than what may kill its process.
async fn until_tried_often(site: &Site, at: &str) {
    let tried = "SELECT fence FROM uploads WHERE id = $1 AND fence > $2";
    let start = Instant::now();
    while site.rows(sql(tried).bind(id(at)).bind(i64::from(site.config.max_attempts))).await.is_empty() {
        assert_eq!(site.get(at).await.json()["state"], "finishing");
        assert!(start.elapsed() < support::site::PATIENCE, "it is not tried again");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_killed_process_left_is_finished_when_its_lease_ends() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(20);
    let at = left_behind(&site, &file).await;
    let complete = "UPDATE uploads SET byte_count = offset_bytes, state = 'finishing', fence = 1, attempt = 1, \
                    lease_until_ms = {now} + 600000 WHERE id = $1";
    site.write(sql(complete).bind(id(&at))).await;
    // Another's: a few looks pass, and it stays so.
    tokio::time::sleep(5 * site.config.poll).await;
    assert_eq!(site.get(&at).await.json()["state"], "finishing");
    site.write(sql("UPDATE uploads SET lease_until_ms = {now} WHERE id = $1").bind(id(&at))).await;
    until(&site, &at, |upload| upload["state"] == "taken").await;
    let ray_set = site.get(&format!("/v1/ray-sets/{}", id(&at))).await.json();
    assert_eq!(ray_set["sha256"], sha256(&file));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_kills_every_process_that_finishes_it_is_refused() {
    let site = Site::start(prompt()).await;
    let at = left_behind(&site, &rays::zemax(20)).await;
    let poison = "UPDATE uploads SET byte_count = offset_bytes, state = 'finishing', attempt = $1 WHERE id = $2";
    site.write(sql(poison).bind(i64::from(site.config.max_attempts)).bind(id(&at))).await;
    let refused = until(&site, &at, |upload| upload["state"] == "refused").await;
    assert_eq!(refused["problem"]["code"], "upload.finishing_lost", "{refused}");
    // Its bytes were accepted: they stay for whoever wants to know why, until its time is over or it is deleted.
    assert_eq!((site.rows(sql("SELECT blob FROM upload_parts")).await.len(), site.blobs().len()), (1, 1));
    assert_eq!(site.delete(&at).await.status, StatusCode::NO_CONTENT);
    nothing_left(&site).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_store_that_does_not_answer_makes_it_later_not_refused() {
    let site = Site::start(prompt()).await;
    if site.config.local_folders().is_empty() {
        println!("LEFT OUT: no local disk to take away");
        return;
    }
    let file = rays::zemax(20);
    let at = left_behind(&site, &file).await;
    let folder = site.config.data.join("blobs/ray-sets").join(id(&at));
    let away = folder.with_extension("away");
    fs::rename(&folder, &away).unwrap();
    complete(&site, &at).await;
    until_tried_often(&site, &at).await;
    fs::rename(&away, &folder).unwrap();
    until(&site, &at, |upload| upload["state"] == "taken").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_disk_makes_it_later_not_refused() {
    let mut site = Site::start(prompt()).await;
    if site.config.local_folders().is_empty() {
        println!("LEFT OUT: no local disk to be full");
        return;
    }
    let at = left_behind(&site, &zip(&[("a.dat", &rays::zemax(99)), ("b.dat", &rays::zemax(98))])).await;
    site.kill().await;
    site.config.keep_free = u64::MAX;
    site.restart(prompt()).await;
    complete(&site, &at).await;
    until_tried_often(&site, &at).await;
    site.kill().await;
    site.config.keep_free = 0;
    site.restart(prompt()).await;
    let taken = until(&site, &at, |upload| upload["state"] == "taken").await;
    assert_eq!(taken["ray_sets"].as_array().unwrap().len(), 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_is_not_at_fault_when_the_service_stops() {
    let mut site = Site::start(prompt()).await;
    let at = left_behind(&site, &rays::zemax(20)).await;
    let Some(stuck) = Stuck::new(&site, &at).await else { return };
    complete(&site, &at).await;
    for _ in 0..=site.config.max_attempts {
        until_leased(&site, &at).await;
        site.service.take().unwrap().run_until(async {}).await.unwrap();
        let left = "SELECT attempt FROM uploads WHERE state = 'finishing' AND lease_until_ms <= {now}";
        let left = site.rows(sql(left)).await;
        assert_eq!(left.first().map(|row| row.number("attempt").unwrap()), Some(0));
        site.restart(prompt()).await;
    }
    drop(stuck);
    until(&site, &at, |upload| upload["state"] == "taken").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn one_that_takes_long_stops_nothing_else() {
    let site = Site::start(prompt()).await;
    let (long, short) = (left_behind(&site, &rays::zemax(20)).await, left_behind(&site, &rays::zemax(20)).await);
    let Some(stuck) = Stuck::new(&site, &long).await else { return };
    let unfinished = begin(&site, 1000, &[]).await;
    complete(&site, &long).await;
    until_leased(&site, &long).await;
    complete(&site, &short).await;
    until(&site, &short, |upload| upload["state"] == "taken").await;
    site.write(sql("UPDATE uploads SET expires_ms = {now} WHERE id = $1").bind(id(&unfinished))).await;
    until(&site, &unfinished, |upload| upload["code"] == "upload.not_found").await;
    assert_eq!(site.get(&long).await.json()["state"], "finishing");
    drop(stuck);
    until(&site, &long, |upload| upload["state"] == "taken").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_nobody_goes_on_with_is_forgotten_and_what_it_became_is_not() {
    let expiry = Duration::from_hours(2);
    let site = Site::start_as(|config| Config { upload_expiry: expiry, ..config }, prompt()).await;
    let file = rays::zemax(50_000);
    let taken = send(&site, &file, 9_000_000, &[]).await;
    let unfinished = begin(&site, file.len(), &[]).await;
    append(&site, &unfinished, 0, file[..90_000].to_vec(), &[]).await;
    // An hour later both are there, after the second they are not.
    let later = "UPDATE uploads SET expires_ms = expires_ms - 3600000";
    site.write(sql(later)).await;
    tokio::time::sleep(5 * site.config.poll).await;
    for kept in [&taken, &unfinished] {
        assert_eq!(site.get(kept).await.status, StatusCode::OK);
    }
    site.write(sql(later)).await;
    let start = Instant::now();
    while site.blobs().len() > 1 || !site.rows(sql("SELECT id FROM uploads")).await.is_empty() {
        assert!(start.elapsed() < support::site::PATIENCE, "{:?}", site.blobs());
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    for gone in [&taken, &unfinished] {
        site.get(gone).await.is_problem(404, "upload.not_found");
    }
    let ray_set = site.get(&format!("/v1/ray-sets/{}", id(&taken))).await.json();
    assert_eq!(ray_set["sha256"], sha256(&file));
    assert_eq!(site.blobs().len(), 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn deleting_ends_an_upload_and_keeps_what_it_became() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(50_000);
    let unfinished = begin(&site, file.len(), &[]).await;
    append(&site, &unfinished, 0, file[..90_000].to_vec(), &[]).await;
    assert_eq!(site.delete(&unfinished).await.status, StatusCode::NO_CONTENT);
    append(&site, &unfinished, 90_000, file[90_000..].to_vec(), &[]).await.is_problem(404, "upload.not_found");
    nothing_left(&site).await;
    let taken = send(&site, &file, 9_000_000, &[]).await;
    assert_eq!(site.delete(&taken).await.status, StatusCode::NO_CONTENT);
    site.get(&taken).await.is_problem(404, "upload.not_found");
    let job = site.job(id(&taken)).await;
    site.until_state(&job, "succeeded").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_announced_is_taken_though_the_quota_has_filled_meanwhile() {
    let site = Site::start(prompt()).await;
    let file = rays::zemax(400);
    let at = begin(&site, file.len(), &[]).await;
    append(&site, &at, 0, file[..5000].to_vec(), &[]).await;
    let full = "INSERT INTO tenants (id, stored_bytes) VALUES ('default', 1) \
                ON CONFLICT (id) DO UPDATE SET stored_bytes = excluded.stored_bytes";
    site.write(sql(full)).await;
    append(&site, &at, 5000, file[5000..].to_vec(), &[]).await;
    assert_eq!(site.get(&format!("/v1/ray-sets/{}", id(&at))).await.json()["sha256"], sha256(&file));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_backup_of_half_an_upload_goes_on() {
    let mut site = Site::start(prompt()).await;
    if !site.config.is_alone() {
        return;
    }
    let file = rays::zemax(400_000);
    let at = begin(&site, file.len(), &[]).await;
    append(&site, &at, 0, file[..9_000_000].to_vec(), &[]).await;
    let to = site.folder.path().join("copy");
    let parts = 9_000_000_usize.div_ceil(PART_BYTES) as u64;
    assert_eq!(backup(&site.config, &to).await.unwrap().blobs, parts);
    site.kill().await;
    site.config.data = to;
    site.restart(prompt()).await;
    assert_eq!(offset(&site, &at).await, 9_000_000);
    append(&site, &at, 9_000_000, file[9_000_000..].to_vec(), &[]).await;
    let ray_set = site.get(&format!("/v1/ray-sets/{}", id(&at))).await.json();
    assert_eq!(ray_set["sha256"], sha256(&file));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_backup_has_an_upload_whose_end_is_written_meanwhile() {
    let mut site = Site::start(prompt()).await;
    if !site.config.is_alone() {
        return;
    }
    // Blobs that are copied before it.
    for _ in 0..30 {
        site.ray_set().await;
    }
    let file = rays::zemax(50_000);
    let at = begin(&site, file.len(), &[]).await;
    append(&site, &at, 0, file[..1000].to_vec(), &[]).await;
    let to = site.folder.path().join("copy");
    let sending = async {
        for sent in (1000..).step_by(10) {
            append(&site, &at, sent, file[sent..sent + 10].to_vec(), &[]).await;
        }
    };
    let copied = tokio::select! {
        copied = backup(&site.config, &to) => copied.unwrap(),
        () = sending => panic!("it never ends"),
    };
    assert_eq!((copied.deleted, copied.blobs), (0, 31));
    site.kill().await;
    site.config.data = to;
    site.restart(prompt()).await;
    let came = offset(&site, &at).await;
    assert!(came > 1000, "it was written to meanwhile");
    append(&site, &at, came, file[came..].to_vec(), &[]).await;
    let ray_set = site.get(&format!("/v1/ray-sets/{}", id(&at))).await.json();
    assert_eq!(ray_set["sha256"], sha256(&file));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_backup_has_an_upload_that_ends_meanwhile() {
    let mut site = Site::start(prompt()).await;
    if !site.config.is_alone() {
        return;
    }
    // Blobs that are copied before it.
    for _ in 0..30 {
        site.ray_set().await;
    }
    // Its bytes go when what is in it is kept.
    let packed = zip(&[("one.dat", &rays::zemax(200)), ("two.dat", &rays::zemax(300))]);
    let last = packed.len() - 10;
    let at = begin(&site, packed.len(), &[]).await;
    append(&site, &at, 0, packed[..last].to_vec(), &[]).await;
    let to = site.folder.path().join("copy");
    let (copied, _) = tokio::join!(backup(&site.config, &to), append(&site, &at, last, packed[last..].to_vec(), &[]));
    assert_eq!(copied.unwrap().deleted, 0);
    site.kill().await;
    site.config.data = to;
    site.restart(prompt()).await;
    if offset(&site, &at).await == last {
        append(&site, &at, last, packed[last..].to_vec(), &[]).await;
    }
    let upload = until(&site, &at, |upload| upload["state"] == "taken").await;
    assert_eq!(upload["ray_sets"].as_array().map(Vec::len), Some(2), "{upload}");
}
