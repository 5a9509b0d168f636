//! Spectra of their own, and what a client says of each channel: kept, handed to the computation, judged before anything waits.

use axum::body::Body;
use axum::http::{Method, StatusCode};
use pipeline::{Column, Declared, FluxOverride, LengthUnit, Quantity, Table, Total};
use serde_json::{Value, json};
use service::jobs::worker::{Product, Runner};
use service::storage::records::statement::sql;
use std::sync::{Arc, Mutex};
use support::rays::zemax;
use support::runners::{Gate, held, prompt, sha256};
use support::site::Site;

/// 1 W/nm at 550, falling to 0 at 540 and 560 nm.
const TRIANGLE: &str = "wavelength [nm]; value\r\n540; 0\r\n550; 1,0\r\n560; 0\r\n";

/// A Zemax file without a wavelength in its header; in lm where `luminous`.
fn plain(rays: u32, luminous: bool) -> Vec<u8> {
    let mut file = zemax(rays);
    file[116..120].copy_from_slice(&0_f32.to_le_bytes());
    file[196..200].copy_from_slice(&i32::from(luminous).to_le_bytes());
    file
}

async fn spectrum(site: &Site, text: &str) -> String {
    let reply = site.ask(Method::POST, "/v1/spectra?name=led.txt", &[], text.to_owned()).await;
    assert_eq!(reply.status, StatusCode::CREATED, "{reply:?}");
    reply.id()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_spectrum_is_taken_in_told_and_deleted() {
    let site = Site::start(prompt()).await;
    let taken = site.ask(Method::POST, "/v1/spectra?name=led.txt", &[], TRIANGLE).await;
    assert_eq!(taken.status, StatusCode::CREATED);
    let told = taken.json();
    assert_eq!(taken.header("location"), format!("/v1/spectra/{}", taken.id()));
    assert_eq!(
        (&told["name"], &told["format"], &told["points"]),
        (&json!("led.txt"), &json!("two columns"), &json!(3))
    );
    assert_eq!((&told["sha256"], &told["range_nm"]), (&json!(sha256(TRIANGLE.as_bytes())), &json!([540.0, 560.0])));
    assert_eq!(told["nm_value"], json!([[540.0, 0.0], [550.0, 1.0], [560.0, 0.0]]));
    // CIE 1924 V(λ) at 540, 550, 560 nm: 0.954, 0.99495, 0.995; a symmetric triangle sees almost its middle.
    assert!((told["lm_per_w"].as_f64().unwrap() / (683.0 * 0.99) - 1.0).abs() < 0.01, "{told}");
    assert_eq!(site.get(taken.header("location")).await.json(), told);
    let listed = site.get("/v1/spectra").await.json();
    assert_eq!((&listed["spectra"][0]["id"], &listed["spectra"][0]["nm_value"]), (&told["id"], &Value::Null));
    assert_eq!(site.delete(taken.header("location")).await.status, StatusCode::NO_CONTENT);
    site.get(taken.header("location")).await.is_problem(404, "spectrum.not_found");
    // Nameless, in µm, and told so.
    let um = site.ask(Method::POST, "/v1/spectra", &[], "0.54 0\n0.55 1\n").await.json();
    assert_eq!((&um["name"], &um["notices"][0]["code"]), (&json!("spectrum"), &json!("spectrum.micrometres")));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_no_spectrum_is_refused_and_not_kept() {
    let site = Site::start(prompt()).await;
    let post = async |headers: &[(&str, &str)], body: Vec<u8>| {
        site.ask(Method::POST, "/v1/spectra", headers, Body::from(body)).await
    };
    let wrong = post(&[], b"400 1\n410 x\n".to_vec()).await;
    wrong.is_problem(400, "spectrum.row");
    assert_eq!(wrong.json()["at"], "byte 6");
    post(&[], b"400 1\n410 -1\n".to_vec()).await.is_problem(422, "spectrum.negative");
    post(&[], Vec::new()).await.is_problem(400, "upload.empty");
    post(&[], vec![b' '; (1 << 20) + 1]).await.is_problem(413, "request.body_too_large");
    post(&[("content-type", "multipart/form-data; boundary=x")], b"400 1".to_vec())
        .await
        .is_problem(415, "request.media_type");
    let digest = [("repr-digest", "sha-256=:RK/0qy18MlBSVnWgjwz6lZEWjP/lF5HF9bvEF8FabDg=:")];
    post(&digest, b"400 1\n410 2\n".to_vec()).await.is_problem(400, "upload.digest_mismatch");
    assert!(site.rows(sql("SELECT id FROM spectra")).await.is_empty());
}

/// What the computation was handed.
type Seen = Arc<Mutex<Vec<(Vec<Declared>, Option<Total>)>>>;

fn watched(seen: &Seen) -> Runner {
    let seen = Arc::clone(seen);
    Arc::new(move |inputs, options, _, _| {
        let declared = inputs.iter().map(|input| input.declared.clone()).collect();
        seen.lock().unwrap().push((declared, options.rays.total));
        Ok(Product::default())
    })
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_said_of_channels_reaches_the_computation() {
    let seen = Seen::default();
    let site = Site::start(watched(&seen)).await;
    let (watts, lumens) = (site.upload(plain(3, false)).await.id(), site.upload(plain(4, true)).await.id());
    let uploaded = spectrum(&site, TRIANGLE).await;
    let channels = json!([
        {"ray_set": watts, "name": "blue", "length_unit": "in", "quantity": "luminous",
         "spectrum": {"nm_value": [[440.0, 0.0], [450.0, 1.0]]}, "flux": {"radiant_share": 0.25}},
        {"ray_set": lumens, "spectrum": {"id": uploaded}, "flux": {"radiant_share": 0.75}},
    ]);
    let accepted = site.post("/v1/jobs", &json!({"channels": channels, "total": {"radiant_w": 8.5}})).await;
    assert_eq!(accepted.status, StatusCode::ACCEPTED, "{accepted:?}");
    let job = site.until_state(&accepted.id(), "succeeded").await;
    assert_eq!((&job["channels"], &job["total"]), (&channels, &json!({"radiant_w": 8.5})));
    let blue = Declared {
        name: Some("blue".into()),
        length_unit: Some(LengthUnit::Inch),
        quantity: Some(Quantity::Luminous),
        spectrum: Table::new(&[(440.0, 0.0), (450.0, 1.0)]),
        flux: Some(FluxOverride::RadiantShare(0.25)),
        columns: None,
    };
    let green = Declared {
        spectrum: Table::new(&[(540.0, 0.0), (550.0, 1.0), (560.0, 0.0)]),
        flux: Some(FluxOverride::RadiantShare(0.75)),
        ..Declared::default()
    };
    assert_eq!(*seen.lock().unwrap(), [(vec![blue, green], Some(Total::RadiantW(8.5)))]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_spectrum_in_use_cannot_be_deleted() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let (ray_set, spectrum) = (site.ray_set().await, spectrum(&site, TRIANGLE).await);
    let channels = json!([{"ray_set": ray_set, "spectrum": {"id": spectrum}}]);
    let job = site.post("/v1/jobs", &json!({ "channels": channels })).await.id();
    let path = format!("/v1/spectra/{spectrum}");
    site.delete(&path).await.is_problem(409, "spectrum.in_use");
    gate.open();
    site.until_state(&job, "succeeded").await;
    assert_eq!(site.delete(&path).await.status, StatusCode::NO_CONTENT);
    // An ended job still says what it was made of; a new one cannot be made of it.
    assert_eq!(site.get(&format!("/v1/jobs/{job}")).await.json()["channels"], channels);
    site.post("/v1/jobs", &json!({ "channels": channels })).await.is_problem(404, "spectrum.not_found");
}

#[tokio::test(flavor = "multi_thread")]
async fn channels_that_cannot_be_one_source_are_refused_at_the_field() {
    let site = Site::start(prompt()).await;
    let (watts, lumens) = (site.upload(plain(3, false)).await.id(), site.upload(plain(4, true)).await.id());
    let bare = |id: &str| json!({ "ray_set": id });
    let with = |id: &str, field: &str, value: Value| json!({"ray_set": id, field: value});
    let share = |id: &str, share: f64| with(id, "flux", json!({ "radiant_share": share }));
    let watt = json!({"radiant_w": 2});
    let cases = [
        (json!([bare(&watts), bare(&lumens)]), json!(null), "rays.no_common_quantity", "channels[1].spectrum"),
        (json!([bare(&watts), bare(&watts)]), json!(null), "rays.twice", "channels[0].flux"),
        (json!([share(&watts, 0.5), share(&lumens, 0.5)]), json!(null), "rays.share_without_total", "channels[0].flux"),
        (json!([share(&watts, 0.5), share(&lumens, 0.4)]), watt.clone(), "rays.share_sum", "total"),
        (json!([share(&watts, 1.0), bare(&lumens)]), watt.clone(), "rays.share_missing", "channels[1].flux"),
        (json!([share(&watts, 1.0)]), json!({"luminous_lm": 2}), "rays.share_quantity", "channels[0].flux"),
        (json!([bare(&watts)]), watt.clone(), "rays.total_unused", "total"),
        (json!([share(&watts, 1.0)]), json!({"radiant_w": 0}), "rays.flux_impossible", "total"),
        (
            json!([with(&watts, "flux", json!({"luminous_lm": -1}))]),
            json!(null),
            "rays.flux_impossible",
            "channels[0].flux",
        ),
        (json!([with(&watts, "columns", json!(["x"]))]), json!(null), "rays.columns_not_text", "channels[0].columns"),
        (json!([with(&watts, "columns", json!(["u"]))]), json!(null), "rays.column_unknown", "channels[0].columns"),
        (
            json!([bare(&lumens), with(&watts, "spectrum", json!({"nm_value": [[500, 1], [400, 1]]}))]),
            json!(null),
            "rays.spectrum_points",
            "channels[1].spectrum",
        ),
        (json!([with(&watts, "name", json!(""))]), json!(null), "request.out_of_range", "channels[0].name"),
    ];
    for (channels, total, code, at) in cases {
        let reply = site.post("/v1/jobs", &json!({"channels": channels, "total": total})).await;
        reply.is_problem(422, code);
        assert_eq!(reply.json()["at"], at, "{}", reply.json());
    }
    let nowhere = with(&watts, "spectrum", json!({"id": "x"}));
    site.post("/v1/jobs", &json!({ "channels": [nowhere] })).await.is_problem(404, "spectrum.not_found");
    assert!(site.rows(sql("SELECT id FROM jobs")).await.is_empty());
    // With the spectrum that the first refusal asks for, it is a source; the same rays twice are one, each with its flux.
    let line = json!({"nm_value": [[555.0, 1.0]]});
    for channels in [
        json!([bare(&watts), with(&lumens, "spectrum", line)]),
        json!([with(&watts, "flux", json!({"radiant_w": 1})), with(&watts, "flux", json!({"radiant_w": 2}))]),
    ] {
        assert_eq!(site.post("/v1/jobs", &json!({ "channels": channels })).await.status, StatusCode::ACCEPTED);
    }
}

/// Headers stored before formats without a unit were read say nothing of units; what a text in columns is, is said with the job.
#[tokio::test(flavor = "multi_thread")]
async fn stored_headers_decide_units_and_quantities() {
    let site = Site::start(prompt()).await;
    let id = site.upload(plain(3, false)).await.id();
    let header = |change: &dyn Fn(&mut Value)| {
        let mut header = json!({"format": "text columns", "flux": {"radiant_w": null, "luminous_lm": null},
            "total_rule": "ray_sum", "has_radiant": true, "has_luminous": false, "spectrum": "none", "length_unit": null,
            "quantity_unknown": true});
        change(&mut header);
        header.to_string()
    };
    let store = async |text: String| site.write(sql("UPDATE ray_sets SET header = $1").bind(text)).await;
    let post = async |declared: Value| {
        let mut channel = json!({ "ray_set": id });
        channel.as_object_mut().unwrap().extend(declared.as_object().unwrap().clone());
        let reply = site.post("/v1/jobs", &json!({ "channels": [channel] })).await.json();
        (reply["code"].as_str().unwrap_or("accepted").to_owned(), reply["at"].as_str().unwrap_or_default().to_owned())
    };
    let is = |code: &str, at: &str| (code.to_owned(), at.to_owned());
    store(header(&|_| {})).await;
    assert_eq!(post(json!({})).await, is("rays.unit_unknown", "channels[0].length_unit"));
    assert_eq!(post(json!({"length_unit": "mm"})).await, is("rays.quantity_unknown", "channels[0].quantity"));
    for answer in [
        json!({"quantity": "luminous"}),
        json!({"flux": {"luminous_lm": 5}}),
        json!({"columns": ["x", "y", "z", "l", "m", "n", "luminous_flux"]}),
    ] {
        let mut declared = answer.clone();
        declared["length_unit"] = json!("mm");
        assert_eq!(post(declared).await, is("accepted", ""), "{answer}");
    }
    let unclear = json!({"length_unit": "mm", "columns": ["x", "y", "z", "l", "m", "n", Column::Flux.name()]});
    assert_eq!(post(unclear).await, is("rays.quantity_unknown", "channels[0].quantity"));
    store(header(&|header| {
        header.as_object_mut().unwrap().retain(|name, _| name != "length_unit" && name != "quantity_unknown");
    }))
    .await;
    assert_eq!(post(json!({})).await, is("accepted", ""));
}

/// A client learns before the computation that channels can hardly belong together: by a dry run, and in the answer to the job.
#[tokio::test(flavor = "multi_thread")]
async fn channels_that_can_hardly_belong_together_are_told_before_the_job() {
    let gate = Gate::new();
    let site = Site::start(held(&gate)).await;
    let mut in_cm = plain(1001, false);
    in_cm[136..140].copy_from_slice(&2_i32.to_le_bytes());
    let [mm, cm] = [site.upload(plain(1000, false)).await.id(), site.upload(in_cm).await.id()];
    let post = async |address: &str, other: Value| {
        let reply = site.post(address, &json!({"channels": [{"ray_set": mm}, other]})).await.json();
        let told = |notice: &Value| notice["code"].as_str().unwrap().to_owned();
        (reply["notices"].as_array().unwrap().iter().map(told).collect::<Vec<_>>(), reply)
    };
    for address in ["/v1/jobs?dry_run=true", "/v1/jobs"] {
        let (told, reply) = post(address, json!({"ray_set": cm})).await;
        assert_eq!(told, ["rays.channel_sizes"], "{reply}");
        assert!(reply["notices"][0]["message"].as_str().unwrap().contains("mm and cm"), "{reply}");
        // With the unit that was meant there is nothing to tell.
        let (told, reply) = post(address, json!({"ray_set": cm, "length_unit": "mm"})).await;
        assert_eq!(told, Vec::<String>::new(), "{reply}");
    }
    gate.open();
}
