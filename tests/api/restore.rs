use serde_json::{Value, json};
use service::Config;
use service::accounts::access::Scope;
use std::path::Path;
use std::process::Command;
use support::runners::prompt;
use support::site::Site;

/// Copies what lies under one prefix of the bucket to another, by another program than ours.
const COPY: &str = "
import os, sys, boto3
bucket, source, target = sys.argv[1:]
s3 = boto3.client('s3', endpoint_url=os.environ['AWS_ENDPOINT_URL'], region_name=os.environ['AWS_REGION'])
pages = s3.get_paginator('list_objects_v2').paginate(Bucket=bucket, Prefix=source + '/')
keys = [found['Key'] for page in pages for found in page['Contents']]
for key in keys:
    s3.copy_object(Bucket=bucket, CopySource={'Bucket': bucket, 'Key': key}, Key=target + key[len(source):])
";

fn run(program: &str, arguments: &[&str]) {
    let done = Command::new(program).args(arguments).output();
    let done = done.unwrap_or_else(|error| panic!("{program}: {error}; tests/engines/postgres install brings it"));
    assert!(done.status.success(), "{program} {arguments:?}: {done:?}");
}

/// What a client sees of these.
async fn told(site: &Site, ray_set: &str, job: &str) -> Vec<Value> {
    let mut told = Vec::new();
    for path in [format!("/v1/ray-sets/{ray_set}"), format!("/v1/jobs/{job}"), format!("/v1/jobs/{job}/artifacts")] {
        told.push(site.get(&path).await.json());
    }
    let zip = site.get(&format!("/v1/jobs/{job}/model.zip")).await;
    assert_eq!(json!(support::runners::sha256(&zip.body)), told[2]["zip"]["sha256"]);
    told
}

#[tokio::test(flavor = "multi_thread")]
async fn a_dump_and_then_a_copy_of_the_bucket_are_a_backup() {
    let mut site = Site::start_as(|config| Config { auth: true, ..config }, prompt()).await;
    if site.config.is_alone() {
        return;
    }
    site.key = Some(site.key_of("lab", &Scope::OF_A_TENANT).await);
    let ray_set = site.ray_set().await;
    let job = site.job(&ray_set).await;
    site.until_state(&job, "succeeded").await;
    let before = told(&site, &ray_set, &job).await;

    // The service works on: first the rows, then what they name and what came meanwhile.
    let url = site.config.database_url();
    let (server, options) = url.split_once('?').unwrap();
    let schema = options.split_once("options[search_path]=").unwrap().1;
    let dump = site.folder.path().join("rows.dump");
    let dump = Path::to_str(&dump).unwrap();
    run("pg_dump", &["--dbname", server, "--schema", schema, "--format", "custom", "--file", dump]);
    let late = site.ray_set().await;
    let (bucket, prefix) =
        site.config.storage_url.as_deref().unwrap().trim_start_matches("s3://").split_once('/').unwrap();
    let (copy, restored) = (format!("{prefix}-copy"), format!("{schema}_restored"));
    let python = concat!(env!("CARGO_MANIFEST_DIR"), "/target/judges/venv/bin/python");
    run(python, &["-c", COPY, bucket, prefix, &copy]);
    let storage_url = format!("s3://{bucket}/{copy}");
    site.kill().await;

    // Another database, another place for bytes.
    run("createdb", &["--maintenance-db", server, &restored]);
    let server = format!("{}/{restored}", server.rsplit_once('/').unwrap().0);
    run("pg_restore", &["--dbname", &server, "--exit-on-error", dump]);
    let database_url = format!("{server}?options[search_path]={schema}");
    site.config = Config { database_url: Some(database_url), storage_url: Some(storage_url), ..site.config.clone() };
    site.restart(prompt()).await;
    assert_eq!(told(&site, &ray_set, &job).await, before);
    site.get(&format!("/v1/ray-sets/{late}")).await.is_problem(404, "ray_set.not_found");
    // Its bytes are there too: a job reads them.
    let again = site.job(&ray_set).await;
    site.until_state(&again, "succeeded").await;
}
