use crate::uploads::nothing_left;
use axum::http::{Method, StatusCode};
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use pipeline::Limits;
use serde_json::{Value, json};
use service::Config;
use service::storage::parts::PART_BYTES;
use service::storage::records::statement::sql;
use sha2::{Digest, Sha256};
use support::packing::{gzip, zip, zstd};
use support::rays;
use support::runners::{model_files, prompt, sha256};
use support::site::{Reply, Site};

async fn send(site: &Site, name: &str, bytes: Vec<u8>) -> Reply {
    site.ask(Method::POST, &format!("/v1/ray-sets?name={name}"), &[], bytes).await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_packed_ray_file_is_the_ray_set_it_holds() {
    let site = Site::start(prompt()).await;
    // Two parts, so that packed and unpacked parts do not fall together.
    let file = rays::zemax(400_000);
    let packed = [("a.dat.gz", gzip(&file)), ("a.dat.zst", zstd(&file)), ("a.zip", zip(&[("a.dat", &file)]))];
    let packed_gzip_in_zip = ("b.zip", zip(&[("a.dat.gz", &packed[0].1)]));
    for (number, (name, bytes)) in packed.into_iter().chain([packed_gzip_in_zip]).enumerate() {
        let digest = sha256(&bytes);
        let headers = [("repr-digest", format!("sha-256=:{}:", BASE64.encode(Sha256::digest(&bytes))))];
        let headers = headers.each_ref().map(|(name, value)| (*name, value.as_str()));
        let reply = site.ask(Method::POST, &format!("/v1/ray-sets?name={name}"), &headers, bytes).await;
        assert_eq!(reply.status, StatusCode::CREATED, "{name}: {reply:?}");
        let ray_set = reply.ray_set();
        assert_eq!((&ray_set["name"], &ray_set["byte_count"]), (&json!("a.dat"), &json!(file.len())));
        assert_eq!(ray_set["sha256"], sha256(&file));
        assert_eq!(ray_set["header"]["ray_count"], 400_000);
        assert_eq!(ray_set["packed"], json!({ "name": name, "sha256": digest, "left_out": [] }));
        assert_eq!(site.get(reply.header("location")).await.json(), ray_set);
        // The packed bytes are gone.
        assert_eq!(site.blobs().len(), file.len().div_ceil(PART_BYTES) * (number + 1));
    }
    let job = site.job(&site.upload(gzip(&file)).await.id()).await;
    site.until_state(&job, "succeeded").await;
    let read = site.get(&format!("/v1/jobs/{job}/artifacts/read.txt")).await;
    let digest = sha256(&file);
    assert_eq!(String::from_utf8(read.body).unwrap(), format!("led.dat {digest} {digest}\n"));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_comes_by_itself_was_not_packed() {
    let site = Site::start(prompt()).await;
    assert_eq!(site.upload(rays::zemax(3)).await.ray_set()["packed"], Value::Null);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_zip_of_several_ray_files_is_several_ray_sets() {
    let site = Site::start(prompt()).await;
    let (blue, red) = (rays::zemax(5), rays::zemax(6));
    let mut cut = rays::zemax(7);
    cut.pop();
    let lamp = zip(&[
        ("lamp/", b""),
        ("lamp/blue.dat", &blue),
        ("lamp/read me.txt", b"Measured in a goniometer."),
        ("lamp/red.dat.gz", &gzip(&red)),
        ("lamp/cut.dat", &cut),
        ("lamp/old.zip", &zip(&[("x", &blue)])),
        ("lamp/empty.dat", b""),
        ("__MACOSX/lamp/._blue.dat", b"x"),
        ("lamp/.DS_Store", b"x"),
    ]);
    let digest = sha256(&lamp);
    let reply = send(&site, "lamp.zip", lamp).await;
    assert_eq!((reply.status, reply.header("location")), (StatusCode::CREATED, "/v1/ray-sets"), "{reply:?}");
    let taken = reply.json();
    let found: Vec<_> = taken["ray_sets"].as_array().unwrap().iter().map(|r| (&r["name"], &r["sha256"])).collect();
    assert_eq!(
        found,
        [(&json!("lamp/blue.dat"), &json!(sha256(&blue))), (&json!("lamp/red.dat"), &json!(sha256(&red)))]
    );
    assert_eq!(
        taken["ray_sets"][1]["packed"],
        json!({ "name": "lamp.zip", "sha256": digest, "left_out": taken["left_out"] })
    );
    let left: Vec<_> = taken["left_out"].as_array().unwrap().iter().map(|l| (&l["name"], &l["code"])).collect();
    let expected = [
        ("lamp/read me.txt", "detect.not_rays"),
        ("lamp/cut.dat", "zemax.size"),
        ("lamp/old.zip", "container.nested"),
        ("lamp/empty.dat", "upload.empty"),
    ];
    let left: Vec<_> = left.iter().map(|(name, code)| (name.as_str().unwrap(), code.as_str().unwrap())).collect();
    assert_eq!(left, expected);
    assert_eq!(site.blobs().len(), 2);
    let list = site.get("/v1/ray-sets").await.json();
    assert_eq!(list["ray_sets"].as_array().unwrap().len(), 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_packed_file_without_a_ray_file_is_refused_with_what_is_in_it() {
    let site = Site::start(prompt()).await;
    let reply = send(&site, "x.zip", zip(&[("a.txt", b"A letter."), ("in.zip", &zip(&[]))])).await;
    reply.is_problem(422, "container.no_ray_file");
    let detail = reply.json()["detail"].as_str().unwrap().to_owned();
    for part in ["a.txt", "detect.not_rays", "in.zip", "container.nested"] {
        assert!(detail.contains(part), "{detail}");
    }
    send(&site, "x.gz", gzip(b"A letter.")).await.is_problem(422, "container.no_ray_file");
    send(&site, "x.zip", zip(&[])).await.is_problem(422, "container.no_ray_file");
    nothing_left(&site).await;
}

/// A model sent where rays are wanted, whole or a part of it, is told as one; many other files are named, without a sentence for each.
#[tokio::test(flavor = "multi_thread")]
async fn a_model_is_no_ray_file_and_says_so() {
    let site = Site::start(prompt()).await;
    let [emitter, goniograms] = model_files();
    let table = b"wavelength_nm,band_from_nm,band_to_nm,total_W_per_nm,zone_000_W_per_nm,zone_001_W_per_nm,zone_002_W_per_nm\n385,380,390,0,0,0,0\n";
    let model = zip(&[("emitter.glb", emitter), ("goniograms.json", goniograms), ("spectra.csv", table)]);
    for (name, bytes, what) in [
        ("model.zip", model, "a model"),
        ("emitter.glb", emitter.clone(), "the emitter.glb of a model"),
        ("goniograms.json", goniograms.clone(), "the goniograms.json of a model"),
        ("spectra.csv", table.to_vec(), "the spectra.csv of a model"),
    ] {
        let reply = send(&site, name, bytes).await;
        reply.is_problem(422, "detect.model");
        assert_eq!(reply.json()["detail"], format!("This is {what}, not a ray file."));
        assert!(reply.json()["remedy"].as_str().unwrap().contains("draw new rays"), "{}", reply.json());
    }
    let many: Vec<(String, &[u8])> = (0..40).map(|k| (format!("note {k}.txt"), b"A letter.".as_slice())).collect();
    let many: Vec<(&str, &[u8])> = many.iter().map(|(name, bytes)| (name.as_str(), *bytes)).collect();
    let reply = send(&site, "x.zip", zip(&many)).await;
    reply.is_problem(422, "container.no_ray_file");
    let detail = reply.json()["detail"].as_str().unwrap().to_owned();
    assert!(detail.len() < 400 && detail.contains("note 0.txt") && detail.contains("and 32 more"), "{detail}");
    nothing_left(&site).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_broken_packed_file_gives_nothing_at_all() {
    let site = Site::start(prompt()).await;
    let (good, long) = (rays::zemax(5), rays::zemax(400_000));
    let lamp = zip(&[("good.dat", &good), ("long.dat", &long)]);
    let mut damaged = lamp.clone();
    damaged[lamp.len() / 2] ^= 0x10;
    let reply = send(&site, "x.zip", damaged).await;
    reply.is_problem(400, "container.damaged");
    assert!(reply.json()["detail"].as_str().unwrap().contains("long.dat"), "{}", reply.json());
    nothing_left(&site).await;
    send(&site, "x.zip", lamp[..lamp.len() - 30].to_vec()).await.is_problem(400, "container.truncated");
    for packed in [gzip(&long), zstd(&long)] {
        send(&site, "x", packed[..packed.len() - 1].to_vec()).await.is_problem(400, "container.truncated");
    }
    nothing_left(&site).await;
    let wrong = [("repr-digest", "sha-256=:AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA=:")];
    site.ask(Method::POST, "/v1/ray-sets", &wrong, lamp).await.is_problem(400, "upload.digest_mismatch");
    nothing_left(&site).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn bombs_leave_nothing() {
    let limits = Limits { max_expanded_bytes: 100 << 20, max_members: 3, ..Limits::default() };
    let few = |config: Config| Config { limits, max_upload_bytes: 60 << 20, ..config };
    let site = Site::start_as(few, prompt()).await;
    // Begins like a ray file, so that it is unpacked at all.
    let mut dark = rays::zemax(1);
    dark.resize(40 << 20, 0);
    send(&site, "x.gz", gzip(&dark)).await.is_problem(422, "container.ratio");
    nothing_left(&site).await;
    send(&site, "x.zip", zip(&[("a", &rays::zemax(9)), ("b", &dark)])).await.is_problem(422, "container.ratio");
    nothing_left(&site).await;
    send(&site, "x.zip", zip(&[("a", b"1"), ("b", b"2"), ("c", b"3"), ("d", b"4")]))
        .await
        .is_problem(422, "container.members");
    nothing_left(&site).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_comes_out_is_limited_like_what_comes_in() {
    let file = rays::zemax(1000);
    let length = file.len() as u64;
    let at_most = |max_upload_bytes: u64, max_expanded_bytes: u64| {
        let change = move |config: Config| Config {
            max_upload_bytes,
            limits: Limits { max_expanded_bytes, ..config.limits },
            ..config
        };
        Site::start_as(change, prompt())
    };
    let packed = gzip(&file);
    assert!((packed.len() as u64) < length - 1);
    let site = at_most(length - 1, length).await;
    send(&site, "x.gz", packed.clone()).await.is_problem(413, "upload.too_large");
    nothing_left(&site).await;
    let site = at_most(length, length - 1).await;
    send(&site, "x.gz", packed.clone()).await.is_problem(422, "container.too_large");
    nothing_left(&site).await;
    assert_eq!(send(&at_most(length, length).await, "x.gz", packed).await.status, StatusCode::CREATED);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_ray_sets_of_a_zip_become_known_together_or_not_at_all() {
    // The trigger is SQLite's; the transaction that it breaks is the same code on every engine.
    if support::engines::are_shared() {
        return;
    }
    let site = Site::start(prompt()).await;
    let second = "CREATE TRIGGER fail BEFORE INSERT ON ray_sets WHEN (SELECT COUNT(*) FROM ray_sets) = 1 \
                  BEGIN SELECT RAISE(ABORT, 'disk I/O error'); END";
    site.write(sql(second)).await;
    let lamp = zip(&[("a.dat", &rays::zemax(5)), ("b.dat", &rays::zemax(6))]);
    send(&site, "lamp.zip", lamp).await.is_problem(503, "storage.unavailable");
    assert!(site.rows(sql("SELECT id FROM ray_sets")).await.is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_submitted_packed_is_a_job_for_each_ray_file() {
    let site = Site::start(prompt()).await;
    let lamp = zip(&[("a.dat", &rays::zemax(5)), ("b.dat", &rays::zemax(6))]);
    let submitted = site.service.as_ref().unwrap().submit("lamp.zip", lamp.as_slice()).await.unwrap();
    assert_eq!(submitted.len(), 2);
    for one in submitted {
        assert_eq!(site.until_state(&one.job, "succeeded").await["channels"][0]["ray_set"], one.ray_set);
    }
}
