use crate::runners::prompt;
use crate::site::Site;
use lampwright::service::connections::Bounds;
use lampwright::service::pace::Slowest;
use lampwright::service::storage::records::sql;
use lampwright::service::{Config, Service};
use std::net::SocketAddr;
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

const HEALTH: &str = "GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
/// Longest wait for what should come at once, on a machine busy with others.
pub const PATIENCE: Duration = Duration::from_secs(30);

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

    async fn ask(&self, request: &str) -> String {
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

fn bounded(bounds: Bounds) -> impl Fn(Config) -> Config {
    move |config| Config { bounds, ..config }
}

const ROOMY: Bounds = Bounds { connections: 512, head: PATIENCE, unread: PATIENCE };

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
    let slowest = Slowest { interval: Duration::from_millis(500), bytes: 1000 };
    let mut site = Site::start_as(|config| Config { slowest, bounds: ROOMY, ..config }, prompt()).await;
    let service = Listening::on(&mut site);
    let bytes = crate::rays::zemax(100);
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
    assert!(site.rows(sql("SELECT id FROM ray_sets")).await.is_empty() && site.blobs().is_empty());

    // Longer than the interval in all, and enough in each.
    let begun = Instant::now();
    let mut slow = service.open(head(bytes.len()).as_bytes()).await;
    for piece in bytes.chunks(bytes.len() / 6) {
        slow.write_all(piece).await.unwrap();
        tokio::time::sleep(Duration::from_millis(150)).await;
    }
    let answer = ended(&mut slow).await;
    assert!(begun.elapsed() > slowest.interval && bytes.len() / 6 > 500);
    assert!(answer.starts_with("HTTP/1.1 201"), "{answer}");
    service.stop().await;
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
