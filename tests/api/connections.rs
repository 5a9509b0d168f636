use service::accounts::access::Scope;
use service::accounts::quota::Quota;
use service::connections::Bounds;
use service::ray_sets::pace::Slowest;
use service::storage::records::statement::sql;
use service::{Config, Service};
use std::net::SocketAddr;
use std::time::{Duration, Instant};
use support::runners::prompt;
use support::site::Site;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

pub const HEALTH: &str = "GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
pub use support::site::PATIENCE;

/// A service that answers on a real socket.
pub struct Listening {
    address: SocketAddr,
    stop: oneshot::Sender<()>,
    serving: JoinHandle<std::io::Result<()>>,
}

impl Listening {
    pub fn on(site: &mut Site) -> Listening {
        let service: Service = site.service.take().unwrap();
        let address = service.address();
        let (stop, stopped) = oneshot::channel::<()>();
        let serving = tokio::spawn(service.run_until(async { drop(stopped.await) }));
        Listening { address, stop, serving }
    }

    pub async fn open(&self, bytes: &[u8]) -> TcpStream {
        let mut stream = TcpStream::connect(self.address).await.unwrap();
        stream.write_all(bytes).await.unwrap();
        stream
    }

    pub fn address(&self) -> SocketAddr {
        self.address
    }

    pub async fn ask(&self, request: &str) -> String {
        ended(&mut self.open(request.as_bytes()).await).await
    }

    pub async fn stop(self) {
        drop(self.stop);
        self.serving.await.unwrap().unwrap();
    }
}

/// All that comes until the other end closes, or resets.
pub async fn ended(stream: &mut TcpStream) -> String {
    let mut bytes = Vec::new();
    let _ = tokio::time::timeout(PATIENCE, stream.read_to_end(&mut bytes)).await.unwrap();
    String::from_utf8_lossy(&bytes).into_owned()
}

pub fn bounded(bounds: Bounds) -> impl Fn(Config) -> Config {
    move |config| Config { bounds, ..config }
}

pub const ROOMY: Bounds =
    Bounds { connections: 512, per_address: 256, bounds_loopback: false, head: PATIENCE, unread: PATIENCE };

#[tokio::test(flavor = "multi_thread")]
async fn a_head_that_does_not_end_gives_up_its_place() {
    let head = Duration::from_millis(300);
    let mut site = Site::start_as(bounded(Bounds { connections: 4, head, ..ROOMY }), prompt()).await;
    let service = Listening::on(&mut site);
    // Every place is held by half a head, and one byte more now and then is no way to keep it.
    let mut slow = Vec::new();
    for _ in 0..4 {
        slow.push(service.open(b"GET /healthz HTTP/1.1\r\nHost: lo").await);
    }
    let asked = Instant::now();
    let dripping = async {
        loop {
            for stream in &mut slow {
                let _ = stream.write_all(b"x").await;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    let answer = tokio::select! {
        () = dripping => unreachable!(),
        answer = service.ask(HEALTH) => answer,
    };
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    println!("four slow heads on four places: answered after {:?}", asked.elapsed());
    // A connection that says nothing at all, and one that rests after an answer, are given up too.
    let mut silent = service.open(b"").await;
    assert_eq!(ended(&mut silent).await, "");
    let mut resting = service.open(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").await;
    assert!(ended(&mut resting).await.starts_with("HTTP/1.1 200"));
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_head_that_is_too_large_is_refused_and_the_service_stays() {
    let mut site = Site::start_as(bounded(ROOMY), prompt()).await;
    let service = Listening::on(&mut site);
    let long = "x".repeat(64 << 10);
    let many: String = (0..500).map(|k| format!("X-{k}: 1\r\n")).collect();
    for (name, head, status) in [
        ("a long header", format!("GET /healthz HTTP/1.1\r\nHost: localhost\r\nX: {long}\r\n\r\n"), "431"),
        ("many headers", format!("GET /healthz HTTP/1.1\r\nHost: localhost\r\n{many}\r\n"), "431"),
        ("a long address", format!("GET /{long} HTTP/1.1\r\nHost: localhost\r\n\r\n"), "4"),
        ("no HTTP", "\u{16}\u{3}\u{1} hello\r\n\r\n".to_owned(), "400"),
    ] {
        let mut stream = TcpStream::connect(service.address).await.unwrap();
        // The other end may have closed before all is sent.
        let _ = stream.write_all(head.as_bytes()).await;
        let answer = ended(&mut stream).await;
        assert!(answer.is_empty() || answer.starts_with(&format!("HTTP/1.1 {status}")), "{name}: {answer}");
    }
    assert!(service.ask(HEALTH).await.starts_with("HTTP/1.1 200"));
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_that_only_drips_gives_up_its_place_and_one_that_is_merely_slow_does_not() {
    // A client that the machine keeps waiting for two seconds is still fast enough.
    let slowest = Slowest { interval: Duration::from_secs(3), bytes: 1000 };
    let mut site = Site::start_as(|config| Config { slowest, bounds: ROOMY, ..config }, prompt()).await;
    let service = Listening::on(&mut site);
    let bytes = support::rays::zemax(100);
    let head = |length| {
        format!(
            "POST /v1/ray-sets HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
        )
    };
    let mut dripping = service.open(head(bytes.len()).as_bytes()).await;
    let (mut from, mut into) = dripping.split();
    let drip = async {
        for byte in &bytes {
            if into.write_all(&[*byte]).await.is_err() {
                break;
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        std::future::pending::<()>().await;
    };
    let mut answer = vec![0; 4096];
    let count = tokio::select! {
        () = drip => unreachable!(),
        read = tokio::time::timeout(PATIENCE, from.read(&mut answer)) => read.unwrap().unwrap(),
    };
    let answer = String::from_utf8_lossy(&answer[..count]);
    assert!(answer.starts_with("HTTP/1.1 408") && answer.contains("upload."), "{answer}");
    assert!(site.rows(sql("SELECT id FROM ray_sets")).await.is_empty());
    site.until_blobs(<[String]>::is_empty).await;

    // Longer than the interval in all, and enough in each.
    let begun = Instant::now();
    let mut slow = service.open(head(bytes.len()).as_bytes()).await;
    for piece in bytes.chunks(bytes.len() / 8) {
        slow.write_all(piece).await.unwrap();
        tokio::time::sleep(Duration::from_millis(450)).await;
    }
    let answer = ended(&mut slow).await;
    assert!(begun.elapsed() > slowest.interval);
    assert!(answer.starts_with("HTTP/1.1 201"), "{answer}");
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn who_sends_on_after_a_refusal_can_read_it() {
    let mut site = Site::start_as(bounded(ROOMY), prompt()).await;
    let service = Listening::on(&mut site);
    let bytes = vec![b' '; 8 << 20];
    let head = format!(
        "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\r\n",
        bytes.len()
    );
    let mut stream = service.open(head.as_bytes()).await;
    // Long after the answer, which most clients read only when they have sent all.
    tokio::time::sleep(Duration::from_millis(300)).await;
    for piece in bytes.chunks(1 << 20) {
        stream.write_all(piece).await.unwrap();
    }
    let answer = ended(&mut stream).await;
    assert!(answer.starts_with("HTTP/1.1 413"), "{answer}");
    drop(stream);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_body_is_asked_for_only_when_it_is_wanted() {
    // RFC 9110, section 10.1.1: a final status, at once, or 100 first.
    let change = |config: Config| Config {
        auth: true,
        bounds: ROOMY,
        max_upload_bytes: 10_000,
        quota: Quota { stored_bytes: 5000, ..Quota::default() },
        ..config
    };
    let mut site = Site::start_as(change, prompt()).await;
    let (writer, reader) = (site.key_of("lab", &[Scope::UploadsWrite]).await, site.key_of("lab", &[]).await);
    let service = Listening::on(&mut site);
    let bytes = support::rays::zemax(10);
    let head = |key: &str, length: usize, more: &str| {
        format!(
            "POST /v1/ray-sets HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {key}\r\nConnection: close\r\n\
             Expect: 100-continue\r\nContent-Length: {length}\r\n{more}\r\n"
        )
    };
    let form = "Content-Type: multipart/form-data; boundary=x\r\n";
    for (head, status, code) in [
        (head(&writer, 10_001, ""), "413", "upload.too_large"),
        (head(&writer, 5001, ""), "413", "quota.stored_bytes"),
        (head(&writer, 100, form), "415", "request.media_type"),
        (head(&reader, 100, ""), "403", "access.scope_missing"),
        (head("lw_x_y", 100, ""), "401", "access.key_malformed"),
    ] {
        let answer = service.ask(&head).await;
        assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")) && answer.contains(code), "{code}: {answer}");
    }
    let mut wanted = service.open(head(&writer, bytes.len(), "").as_bytes()).await;
    let mut first = [0; 25];
    tokio::time::timeout(PATIENCE, wanted.read_exact(&mut first)).await.unwrap().unwrap();
    assert_eq!(&first, b"HTTP/1.1 100 Continue\r\n\r\n");
    wanted.write_all(&bytes).await.unwrap();
    assert!(ended(&mut wanted).await.starts_with("HTTP/1.1 201"));
    service.stop().await;
    if !site.config.local_folders().is_empty() {
        site.config.keep_free = u64::MAX;
        site.restart(prompt()).await;
        let service = Listening::on(&mut site);
        let answer = service.ask(&head(&writer, 100, "")).await;
        assert!(answer.starts_with("HTTP/1.1 507 ") && answer.contains("storage.low_space"), "{answer}");
        // Space would not help this one.
        let answer = service.ask(&head(&writer, 10_001, "")).await;
        assert!(answer.starts_with("HTTP/1.1 413 ") && answer.contains("upload.too_large"), "{answer}");
        service.stop().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_that_stops_keeps_what_came_of_an_upload_in_pieces() {
    let slowest = Slowest { interval: PATIENCE, bytes: 1 };
    let mut site =
        Site::start_as(|config| Config { slowest, grace: PATIENCE, bounds: ROOMY, ..config }, prompt()).await;
    let file = support::rays::zemax(50_000);
    let at = crate::resume::begin(&site, file.len(), &[]).await;
    let service = Listening::on(&mut site);
    let head = format!(
        "PATCH {at} HTTP/1.1\r\nHost: localhost\r\nTus-Resumable: 1.0.0\r\nUpload-Offset: 0\r\nContent-Length: {}\r\n\
         Content-Type: application/offset+octet-stream\r\n\r\n",
        file.len()
    );
    let mut open = service.open(head.as_bytes()).await;
    open.write_all(&file[..300_000]).await.unwrap();
    let start = Instant::now();
    while !String::from_utf8(site.get("/metrics").await.body).unwrap().contains("upload_bytes_total 300000\n") {
        assert!(start.elapsed() < PATIENCE, "the bytes do not come");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    // It does not wait for the rest, and who sends on all the same can read why.
    let rest = file[300_000..].to_vec();
    let sending = async {
        for piece in rest.chunks(200_000) {
            open.write_all(piece).await.unwrap();
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        ended(&mut open).await
    };
    let (answer, ()) = tokio::join!(sending, service.stop());
    assert!(answer.starts_with("HTTP/1.1 503") && answer.contains("service.stopping"), "{answer}");
    site.restart(prompt()).await;
    let came = crate::resume::offset(&site, &at).await;
    assert!((300_000..file.len()).contains(&came), "{came}");
    crate::resume::append(&site, &at, came, file[came..].to_vec(), &[]).await;
    assert_eq!(crate::resume::ended(&site, &at).await["state"], "taken");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_answer_that_nobody_reads_gives_up_its_place() {
    let unread = Duration::from_millis(300);
    let mut site = Site::start_as(bounded(Bounds { connections: 1, unread, ..ROOMY }), prompt()).await;
    let service = Listening::on(&mut site);
    // So many answers that no buffer between the two holds them; and nobody takes them.
    let mut silent = TcpStream::connect(service.address).await.unwrap();
    let asking = async {
        let page = b"GET /docs/swagger-ui-bundle.js HTTP/1.1\r\nHost: localhost\r\n\r\n".repeat(40);
        let _ = silent.write_all(&page).await;
        std::future::pending::<()>().await;
    };
    tokio::select! {
        () = asking => unreachable!(),
        answer = service.ask(HEALTH) => assert!(answer.starts_with("HTTP/1.1 200"), "{answer}"),
    }
    service.stop().await;
}
