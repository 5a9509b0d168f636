//! The binary as an operator meets it: real sockets, kill -9, SIGTERM, and a disk that stays.

#[cfg(test)]
mod server;
/// The data folder, and what is none.
#[cfg(test)]
mod disk;
/// What people are told to do.
#[cfg(test)]
mod remedies;
/// How it stops.
#[cfg(test)]
mod stopping;
/// What means harm.
#[cfg(test)]
mod hostile;
/// What a person meets at a terminal.
#[cfg(test)]
mod manners;
/// What a verb writes, where, and what is left when it is stopped.
#[cfg(test)]
mod outputs;
/// What an operator writes.
#[cfg(test)]
mod operator;

use serde_json::{Value, json};
use server::{Server, lampwright};
use std::process::Stdio;
use support::http::ask;
use support::{packing, rays};

/// A job long enough to be killed in its middle.
const LONG_JOB_RAYS: &str = "1000000";

#[test]
fn an_empty_folder_begins_with_a_model_to_look_at() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), &[]);
    let jobs = server.get("/v1/jobs").json();
    let sample = jobs["jobs"][0]["id"].as_str().unwrap_or_else(|| panic!("no job: {jobs}")).to_owned();
    server.until(&sample, |job| job["state"] == "succeeded");
    let zip = server.get(&format!("/v1/jobs/{sample}/model.zip"));
    assert_eq!((zip.status, &zip.body[..4]), (200, b"PK\x03\x04".as_slice()));
    assert_eq!(zip.header("content-type"), Some("application/zip"));
    assert_eq!(server.get("/docs/").status, 200);
    assert_eq!(server.get("/openapi.json").body, lampwright(&["openapi"]).stdout);
    assert!(lampwright(&["health", &format!("http://{}/healthz", server.address)]).status.success());
    let address = server.address.clone();
    assert!(server.terminate().success());
    assert_eq!(lampwright(&["health", &format!("http://{address}/healthz")]).status.code(), Some(1));

    let server = Server::start(folder.path(), &[]);
    assert_eq!(server.get("/v1/jobs").json()["jobs"].as_array().map(Vec::len), Some(1), "the sample is not made twice");
}

#[test]
fn a_job_outlives_kill_9_and_is_published_once() {
    let folder = tempfile::tempdir().unwrap();
    let rays = folder.path().join("chips.tm25ray");
    let written = lampwright(&["sample", "four-chips", "--rays", LONG_JOB_RAYS, "-o", rays.to_str().unwrap()]);
    assert!(written.status.success(), "{written:?}");
    let data = folder.path().join("data");
    let server = Server::start(&data, &["--no-sample"]);
    let job = server.job_of("chips.tm25ray", &std::fs::read(&rays).unwrap());
    let caught = server.until(&job, |job| job["state"] == "running" && job["progress"].as_f64() > Some(0.0));
    assert_eq!(caught["attempt"], 1);
    server.kill();

    let server = Server::start(&data, &["--no-sample"]);
    let done = server.until(&job, |job| job["state"] == "succeeded");
    assert_eq!((&done["attempt"], &done["problem"]), (&json!(2), &Value::Null));
    assert_eq!(server.get("/v1/jobs").json()["jobs"].as_array().map(Vec::len), Some(1));
    let listed = server.get(&format!("/v1/jobs/{job}/artifacts")).json();
    let artifacts = listed["artifacts"].as_array().unwrap_or_else(|| panic!("{listed}"));
    let mut names: Vec<&str> = artifacts.iter().filter_map(|artifact| artifact["name"].as_str()).collect();
    let all = names.len();
    names.dedup();
    assert!(names.contains(&"emitter.glb") && names.contains(&"ies/total.ies"), "{names:?}");
    assert_eq!(names.len(), all, "an artifact is listed twice: {names:?}");
    let blobs = server::files_under(&data.join("blobs").join("artifacts"));
    assert_eq!((blobs, listed["zip"]["name"].as_str()), (all + 1, Some("model.zip")), "a killed attempt's files stay");
}

#[test]
fn sigterm_gives_a_running_job_back_and_the_next_process_ends_it() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), &["--grace", "4"]);
    let sample = server.get("/v1/jobs").json()["jobs"][0]["id"].as_str().unwrap().to_owned();
    server.until(&sample, |job| job["state"] != "queued");
    assert!(server.terminate().success(), "SIGTERM is a clean end");
    let server = Server::start(folder.path(), &[]);
    let done = server.until(&sample, |job| job["state"] == "succeeded");
    assert_eq!(done["attempt"], 1, "an attempt that the operator ended does not count");
}

#[test]
fn a_cancelled_job_stops_long_before_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let rays = folder.path().join("chips.tm25ray");
    assert!(
        lampwright(&["sample", "four-chips", "--rays", LONG_JOB_RAYS, "-o", rays.to_str().unwrap()]).status.success()
    );
    let server = Server::start(&folder.path().join("data"), &["--no-sample"]);
    let job = server.job_of("chips", &std::fs::read(&rays).unwrap());
    server.until(&job, |job| job["state"] == "running" && job["progress"].as_f64() > Some(0.0));
    let asked = std::time::Instant::now();
    assert_eq!(server.post(&format!("/v1/jobs/{job}/cancel"), "application/json", b"").status, 202);
    server.until(&job, |job| job["state"] == "cancelled");
    // The job would take minutes.
    println!("cancelled after {:?}; without other work on the machine that is below 2 s", asked.elapsed());
    assert!(asked.elapsed().as_secs_f64() < 20.0, "{:?}", asked.elapsed());
    assert_eq!(server.get(&format!("/v1/jobs/{job}/model.zip")).status, 404);
}

/// Totals of the headers: the OSRAM sheet's 337 lm, LightTools' 1 lm.
#[test]
fn real_files_go_through_http_to_a_zip() {
    for (name, lumen) in
        [("mu_rayfile_LERTDUW_S2WP_green_100k_20161013_IES_TM25.TM25RAY", 337.0), ("mu_Cyl10k.1.tm25ray", 1.0)]
    {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/rays").join(name);
        let Ok(bytes) = std::fs::read(&path) else {
            println!("LEFT OUT: {} is not here", path.display());
            continue;
        };
        let folder = tempfile::tempdir().unwrap();
        let server = Server::start(folder.path(), &["--no-sample"]);
        let job = server.job_of(name, &bytes);
        server.until(&job, |job| job["state"] == "succeeded");
        assert_eq!(&server.get(&format!("/v1/jobs/{job}/model.zip")).body[..4], b"PK\x03\x04");
        let report = server.get(&format!("/v1/jobs/{job}/artifacts/report.json")).json();
        let balance = &report["balance"];
        for sum in ["on_triangles", "on_vertices", "after_smoothing"] {
            let lm = balance[sum]["luminous_lm"].as_f64().unwrap();
            assert!((lm / lumen - 1.0).abs() < 1e-6, "{name}: {lm} lm {sum}");
        }
        let rays = |fate: &str| balance[fate]["rays"].as_u64().unwrap();
        assert_eq!(rays("hit") + rays("snapped") + rays("rejected"), rays("incoming"), "{balance}");
        assert!(balance["rejected"]["flux"]["luminous_lm"].as_f64() < Some(0.005 * lumen), "{balance}");
        assert_eq!(report["hull"]["broken_rules"], json!([]), "{name}");
    }
}

#[test]
fn a_wrong_file_is_refused_with_a_problem() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start(folder.path(), &["--no-sample"]);
    let answer = server.post("/v1/ray-sets?name=x", "application/octet-stream", b"This is a letter, not a ray file.");
    let problem = answer.json();
    assert_eq!(answer.header("content-type"), Some("application/problem+json"));
    assert!((400..500).contains(&answer.status), "{answer:?}");
    assert!(problem["code"].as_str().is_some_and(|code| code.contains('.')), "{problem}");
    assert_eq!(server.get("/v1/ray-sets").json()["ray_sets"], json!([]), "nothing of it is kept");
}

#[test]
fn one_folder_has_one_process() {
    let folder = tempfile::tempdir().unwrap();
    let _server = Server::start(folder.path(), &["--no-sample"]);
    let second = lampwright(&["--listen", "127.0.0.1:0", "--data", folder.path().to_str().unwrap()]);
    assert_eq!(second.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&second.stderr).contains("error serve.locked"), "{second:?}");
}

#[test]
fn build_writes_what_the_service_would_and_says_where_the_light_went() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (rays, one, two) = (path("chip.tm25ray"), path("one"), path("two"));
    assert!(lampwright(&["sample", "flat-chip", "--rays", "20000", "-o", &rays]).status.success());
    let built = lampwright(&["build", &rays, "-o", &one, "--threads", "1"]);
    assert!(built.status.success(), "{built:?}");
    let told = String::from_utf8(built.stdout).unwrap();
    for word in ["read 20 000", "rejected", "projected", "sound", "rays/s"] {
        assert!(told.contains(word), "{word}: {told}");
    }
    assert!(lampwright(&["build", &rays, "-o", &two, "--threads", "3"]).status.success());
    let zip = |folder: &str| std::fs::read(format!("{folder}/model.zip")).unwrap();
    assert!(zip(&one) == zip(&two), "the same bytes on any number of threads");
    assert_eq!(lampwright(&["build", &rays, "-o", &one]).status.code(), Some(2), "a folder that is not empty");

    std::fs::write(&rays, "no rays").unwrap();
    let refused = lampwright(&["inspect", &rays]);
    assert_eq!(refused.status.code(), Some(1));
    let told = String::from_utf8(refused.stderr).unwrap();
    for line in ["error detect.not_rays", "what", "where  chip.tm25ray", "do"] {
        assert!(told.contains(line), "{line}: {told}");
    }
}

/// What was left out of a packed file, what was repaired in a spectrum and what an inspection warns of: in the table and in the
/// files, as a job has it in its notices.
#[test]
fn build_tells_what_a_user_must_know_before_the_model_is_trusted() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let lamp = packing::zip(&[("led.dat", &rays::zemax(3000)), ("other half.txt", b"Measured elsewhere.")]);
    std::fs::write(path("lamp.zip"), lamp).unwrap();
    std::fs::write(path("led.txt"), "0.54 0\n0.55 1\n0.56 0\n").unwrap();
    let said = format!("{},spectrum={}", path("lamp.zip"), path("led.txt"));
    let built = lampwright(&["build", &said, "-o", &path("out")]);
    assert!(built.status.success(), "{built:?}");
    let table = String::from_utf8(built.stdout).unwrap();
    let report: Value = serde_json::from_slice(&std::fs::read(path("out/report.json")).unwrap()).unwrap();
    let page = std::fs::read_to_string(path("out/README.txt")).unwrap();
    // All rays go along +Z, and 3000 are few.
    for code in ["container.left_out", "spectrum.micrometres", "rays.focus", "rays.noise"] {
        let told = report["notices"].as_array().unwrap().iter().filter(|notice| notice["code"] == code).count();
        assert_eq!((told, page.contains(code), table.matches(code).count()), (1, true, 1), "{code}: {table}");
    }
    assert!(table.contains("other half.txt"), "{table}");
}

#[test]
fn who_stops_reading_is_no_failure_and_a_full_disk_is_one() {
    for verb in [["openapi"].as_slice(), &["sample", "--list"]] {
        let mut child = server::command(verb).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success() && output.stderr.is_empty(), "{verb:?}: {output:?}");
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let output = server::command(verb).stdout(full).stderr(Stdio::piped()).output().unwrap();
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && told.contains("output.unwritable"), "{verb:?}: {output:?}");
    }
}

#[test]
fn keys_are_made_rotated_and_revoked_next_to_a_running_service() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().to_str().unwrap().to_owned();
    let server = Server::start(folder.path(), &["--auth", "on"]);
    let keys = |arguments: &[&str]| {
        let done = lampwright(&[&["keys"], arguments, &["--data", &data]].concat());
        assert!(done.status.success(), "{arguments:?}: {done:?}");
        String::from_utf8(done.stdout).unwrap().trim().to_owned()
    };
    let status = |key: &str| {
        let authorization = format!("Bearer {key}");
        ask(&server.address, "GET", "/v1/jobs", &[("Authorization", &authorization)], b"").unwrap().status
    };
    let answer = server.get("/v1/jobs");
    assert_eq!((answer.status, answer.header("www-authenticate")), (401, Some("Bearer realm=\"lampwright\"")));
    let first = keys(&["create", "--tenant", "lab", "--name", "robot"]);
    assert_eq!(status(&first), 200);
    let id = |key: &str| key.split('_').nth(1).unwrap().to_owned();
    let second = keys(&["rotate", &id(&first), "--overlap", "1"]);
    assert_eq!((status(&first), status(&second)), (200, 200));
    let third = keys(&["rotate", &id(&second), "--overlap", "0"]);
    assert_eq!((status(&first), status(&second), status(&third)), (200, 401, 200));
    keys(&["revoke", &id(&first)]);
    assert_eq!(status(&first), 401);
    let listed = keys(&["list", "--tenant", "lab"]);
    for told in ["lab", "robot", "revoked", "until revoked", "uploads:write", &id(&first)] {
        assert!(listed.contains(told), "{told}: {listed}");
    }
    assert!(!listed.contains(first.rsplit('_').next().unwrap()), "a secret is listed");
    // What a key is for is said, and only that is done.
    let reader = keys(&["create", "--tenant", "lab", "--scope", "uploads:read"]);
    assert_eq!(status(&reader), 403);
    for wrong in [["create", "--scope", "everything"], ["create", "--tenant", "Not plain"]] {
        assert_eq!(
            lampwright(&[&["keys"], &wrong[..], &["--data", &data]].concat()).status.code(),
            Some(2),
            "{wrong:?}"
        );
    }
    let missing = lampwright(&["keys", "revoke", "0000000000000000", "--data", &data]);
    assert_eq!(missing.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&missing.stderr).contains("error keys.missing"));

    let set = lampwright(&["tenants", "set", "lab", "--stored-bytes", "0", "--data", &data]);
    assert!(set.status.success(), "{set:?}");
    let authorization = format!("Bearer {third}");
    let upload = ask(&server.address, "POST", "/v1/ray-sets", &[("Authorization", &authorization)], b"rays").unwrap();
    assert_eq!((upload.status, upload.json()["code"].as_str()), (413, Some("quota.stored_bytes")));
    let listed = String::from_utf8(lampwright(&["tenants", "list", "--data", &data]).stdout).unwrap();
    assert!(listed.contains("0 of 0 bytes") && listed.contains("0 of default jobs waiting"), "{listed}");
    // A probe needs no key.
    assert!(lampwright(&["health", &format!("http://{}/healthz", server.address)]).status.success());
}

#[test]
fn others_are_not_let_in_without_keys() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().to_str().unwrap();
    let refused = lampwright(&["serve", "--listen", "0.0.0.0:0", "--data", data]);
    assert_eq!(refused.status.code(), Some(1));
    let told = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(told.contains("error serve.no_keys") && told.contains("lampwright keys create"), "{told}");
}

#[test]
fn a_backup_taken_while_it_serves_is_a_data_folder() {
    let folder = tempfile::tempdir().unwrap();
    let (data, copy) = (folder.path().join("data"), folder.path().join("copy"));
    let server = Server::start(&data, &[]);
    let sample = server.get("/v1/jobs").json()["jobs"][0]["id"].as_str().unwrap().to_owned();
    server.until(&sample, |job| job["state"] == "succeeded");
    let zip = format!("/v1/jobs/{sample}/model.zip");
    let before = server.get(&zip).body;
    let copied = lampwright(&["backup", "--data", data.to_str().unwrap(), "--to", copy.to_str().unwrap()]);
    assert!(copied.status.success(), "{copied:?}");
    server.kill();
    std::fs::remove_dir_all(&data).unwrap();
    let restored = Server::start(&copy, &[]);
    assert!(restored.get(&zip).body == before && !before.is_empty());
}
