//! When deliveries are due and how they end, without a socket.

use super::*;
use crate::webhooks::endpoints::{EndpointSettings, change};
use crate::webhooks::{Event, endpoints};

const LONGEST: Duration = Duration::from_secs(15);

async fn records() -> (tempfile::TempDir, Records) {
    let folder = tempfile::tempdir().unwrap();
    let url = format!("sqlite:{}?mode=rwc", folder.path().join("service.db").display());
    let records = Records::open(&url).await.unwrap();
    (folder, records)
}

fn settings(url: &str) -> EndpointSettings {
    EndpointSettings { url: url.into(), events: Event::ALL.to_vec(), description: String::new() }
}

async fn endpoint(records: &Records, tenant: &str, waiting: usize) -> String {
    let id = endpoints::create(records, tenant, settings("https://receiver.example/")).await.unwrap().unwrap().0.id;
    for k in 0..waiting {
        let insert = "INSERT INTO deliveries (id, webhook_id, event, body, state, attempt, fence, due_ms, created_ms) \
                      VALUES ($1, $2, 'job.failed', '{}', 'waiting', 0, 0, 0, {now})";
        let insert = sql(insert).bind(format!("{id}.{k}")).bind(id.as_str());
        records.write(insert).await.unwrap();
    }
    id
}

async fn refused(records: &Records, sending: &DueDelivery, policy: &Policy) -> bool {
    let how = Attempted { status: Some(500), ..Attempted::default() };
    end(records, sending, &how, policy).await.unwrap()
}

async fn failing_and_disabled(records: &Records, tenant: &str, id: &str) -> (bool, bool) {
    let endpoint = endpoints::get(records, tenant, id).await.unwrap().unwrap();
    (endpoint.failing_since_ms.is_some(), endpoint.disabled_why.is_some())
}

#[tokio::test(flavor = "multi_thread")]
async fn silent_endpoints_of_one_tenant_keep_those_of_another_waiting_for_nothing() {
    let (_folder, records) = records().await;
    let mut silent = Vec::new();
    for _ in 0..6 {
        silent.push(endpoint(&records, "a", 10).await);
    }
    let other = endpoint(&records, "b", 1).await;
    // What is due longest is begun first: all of tenant a's, as many as a tenant may have.
    let mut begun = Vec::new();
    while let Some(sending) = claim(&records, LONGEST).await.unwrap() {
        begun.push(sending);
    }
    let of = |webhook: &str| begun.iter().filter(|sending| sending.webhook == webhook).count();
    assert!(silent.iter().all(|id| of(id) <= 4));
    assert_eq!((silent.iter().map(|id| of(id)).sum::<usize>(), of(&other)), (16, 1));
    // One that has just failed is tried with one at a time.
    let failed = begun.iter().find(|sending| of(&sending.webhook) == 4).unwrap();
    let same: Vec<_> = begun.iter().filter(|sending| sending.webhook == failed.webhook).collect();
    for sending in &same {
        assert!(refused(&records, sending, &Policy::default()).await);
    }
    let mut again = Vec::new();
    while let Some(sending) = claim(&records, LONGEST).await.unwrap() {
        again.push(sending);
    }
    assert!(again.iter().filter(|sending| sending.webhook == failed.webhook).count() <= 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_attempt_that_was_asked_for_again_meanwhile_says_nothing_any_more() {
    let (_folder, records) = records().await;
    let id = endpoint(&records, "a", 1).await;
    let first = claim(&records, LONGEST).await.unwrap().unwrap();
    assert!(claim(&records, LONGEST).await.unwrap().is_none(), "it is being told");
    assert!(!redeliver(&records, "b", &id, &first.id).await.unwrap(), "another's");
    assert!(redeliver(&records, "a", &id, &first.id).await.unwrap());
    assert!(!refused(&records, &first, &Policy::default()).await, "its fence is another's");
    assert_eq!(failing_and_disabled(&records, "a", &id).await, (false, false));
    let second = claim(&records, LONGEST).await.unwrap().unwrap();
    assert_eq!((second.id.as_str(), second.attempt), (first.id.as_str(), 1));
    assert!(refused(&records, &second, &Policy::default()).await);
    assert_eq!(failing_and_disabled(&records, "a", &id).await, (true, false));
}

#[tokio::test(flavor = "multi_thread")]
async fn only_what_failed_to_the_last_disables_an_endpoint_and_a_ping_says_nothing() {
    let (_folder, records) = records().await;
    let policy = Policy { give_up: Duration::ZERO, waits: vec![Duration::ZERO], ..Policy::default() };
    let id = endpoint(&records, "a", 0).await;
    let first = ping(&records, "a", &id).await.unwrap().unwrap();
    assert_eq!(ping(&records, "a", &id).await.unwrap().unwrap().id, first.id, "one at a time");
    let sending = claim(&records, LONGEST).await.unwrap().unwrap();
    assert_eq!(sending.event, PING);
    assert!(refused(&records, &sending, &policy).await);
    assert_eq!(failing_and_disabled(&records, "a", &id).await, (false, false));

    let insert = "INSERT INTO deliveries (id, webhook_id, event, body, state, attempt, fence, due_ms, created_ms) \
                  VALUES ('d', $1, 'job.failed', '{}', 'waiting', 0, 0, 0, {now})";
    records.write(sql(insert).bind(id.as_str())).await.unwrap();
    let first = claim(&records, LONGEST).await.unwrap().unwrap();
    assert!(refused(&records, &first, &policy).await);
    assert_eq!(failing_and_disabled(&records, "a", &id).await, (true, false), "there is another attempt");
    // Somewhere else it may be well.
    assert!(change(&records, "a", &id, settings("https://receiver.example/")).await.unwrap());
    assert_eq!(failing_and_disabled(&records, "a", &id).await, (true, false));
    assert!(change(&records, "a", &id, settings("https://elsewhere.example/")).await.unwrap());
    assert_eq!(failing_and_disabled(&records, "a", &id).await, (false, false));
    let last = claim(&records, LONGEST).await.unwrap().unwrap();
    assert_eq!(last.attempt, 2);
    assert!(refused(&records, &last, &policy).await);
    // The first failure of the new address is also this delivery's last: nothing taken for as long as is waited.
    let (failing, _) = failing_and_disabled(&records, "a", &id).await;
    assert!(failing);
    records
        .write(sql("UPDATE deliveries SET state = 'waiting', attempt = 1, due_ms = 0 WHERE id = 'd'"))
        .await
        .unwrap();
    let last = claim(&records, LONGEST).await.unwrap().unwrap();
    assert!(refused(&records, &last, &policy).await);
    assert_eq!(failing_and_disabled(&records, "a", &id).await, (true, true));
    assert!(!redeliver(&records, "a", &id, "d").await.unwrap(), "nobody would be told");
}

fn sending(attempt: i64, event: &str) -> DueDelivery {
    // The random part is 500 of 1000: half of the jitter.
    let id = "0190b5a0-0000-7000-8000-0000000001f4".to_owned();
    let (webhook, body, url) = (String::new(), String::new(), String::new());
    DueDelivery { id, webhook, fence: 1, attempt, event: event.into(), body, url, secrets: Vec::new(), timestamp_s: 0 }
}

#[test]
fn attempts_come_ever_later_and_end_and_the_endpoint_is_heard() {
    let policy = Policy::default();
    let waited = |attempt, how: &Attempted| wait(&sending(attempt, "job.failed"), how, &policy);
    let refused = Attempted { status: Some(500), ..Attempted::default() };
    // 5 s and a tenth, 5 min and a tenth, .. 24 h and a tenth, and no more.
    assert_eq!(waited(1, &refused), Some(Duration::from_millis(5500)));
    assert_eq!(waited(2, &refused), Some(Duration::from_secs(330)));
    assert_eq!(waited(9, &refused), Some(Duration::from_secs(24 * 3960)));
    assert_eq!(waited(10, &refused), None);
    let later =
        |status, s| Attempted { status: Some(status), retry_after: Some(Duration::from_secs(s)), ..refused.clone() };
    assert_eq!(waited(1, &later(503, 120)), Some(Duration::from_secs(120)));
    assert_eq!(waited(1, &later(429, 1)), Some(Duration::from_millis(5500)));
    assert_eq!(waited(1, &later(500, 120)), Some(Duration::from_millis(5500)), "only where it means that");
    assert_eq!(waited(1, &later(503, u64::MAX)), Some(Duration::from_hours(24)), "but not for ever");
    assert_eq!(wait(&sending(1, PING), &refused, &policy), None);
}
