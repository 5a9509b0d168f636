//! Tus clients that insist: they send a file in pieces, one after the other or as partial uploads, to whichever node answers, and
//! go on where an upload is.

use crate::ledger::told_to_come_back;
use support::http::ask;

const VERSION: (&str, &str) = ("Tus-Resumable", "1.0.0");

/// One upload, as its client sees it.
pub struct Resumed {
    bytes: Vec<u8>,
    /// It is a piece of a file.
    is_partial: bool,
    /// Bytes in a piece.
    size: usize,
    /// Where it is, once it has begun.
    at: Option<String>,
    /// What was answered to be there: never less may be.
    acknowledged: usize,
    /// Where it goes on; unknown after an answer that did not come.
    next: Option<usize>,
}

impl Resumed {
    pub fn new(bytes: Vec<u8>, size: usize) -> Resumed {
        Resumed { bytes, is_partial: false, size, at: None, acknowledged: 0, next: Some(0) }
    }

    fn is_sent(&self) -> bool {
        self.at.is_some() && self.next == Some(self.bytes.len())
    }

    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// One request; the ray set, when the upload has become one.
    pub fn step(&mut self, address: &str) -> Option<String> {
        let Some(at) = self.at.clone() else {
            self.begin(address);
            return None;
        };
        match self.next {
            None => self.look(address, &at),
            Some(next) if next < self.bytes.len() => self.send(address, &at, next),
            Some(_) => return became(address, &at),
        }
        None
    }

    fn begin(&mut self, address: &str) {
        let length = self.bytes.len().to_string();
        let mut headers = vec![VERSION, ("Upload-Length", length.as_str())];
        headers.extend(self.is_partial.then_some(("Upload-Concat", "partial")));
        let Ok(answer) = ask(address, "POST", "/v1/uploads", &headers, b"") else { return };
        assert!(answer.status == 201 || told_to_come_back(&answer), "{answer:?}");
        self.at = answer.header("location").map(str::to_owned);
    }

    fn look(&mut self, address: &str, at: &str) {
        let Some(answer) = ask(address, "HEAD", at, &[VERSION], b"").ok().filter(|answer| answer.status != 503) else {
            return;
        };
        assert_eq!(answer.status, 200, "{answer:?}");
        let offset = answer.header("upload-offset").unwrap().parse().unwrap();
        assert!(offset >= self.acknowledged, "{} bytes were there, and now {offset}", self.acknowledged);
        (self.acknowledged, self.next) = (offset, Some(offset));
    }

    fn send(&mut self, address: &str, at: &str, next: usize) {
        let end = self.bytes.len().min(next + self.size);
        let offset = next.to_string();
        let kind = ("Content-Type", "application/offset+octet-stream");
        let headers = [VERSION, kind, ("Upload-Offset", offset.as_str())];
        self.next = None;
        let Ok(answer) = ask(address, "PATCH", at, &headers, &self.bytes[next..end]) else { return };
        if answer.status == 204 {
            assert_eq!(answer.header("upload-offset"), Some(&*end.to_string()), "{answer:?}");
            (self.acknowledged, self.next) = (end, Some(end));
        } else {
            // An earlier request of ours may have come further than we heard.
            assert!(answer.status == 409 || told_to_come_back(&answer), "{answer:?}");
        }
    }
}

/// A file that is sent as partial uploads.
pub struct Joined {
    pieces: Vec<Resumed>,
    /// Where the upload is that they are, once it has begun.
    whole: Option<String>,
}

impl Joined {
    /// `bytes` in so many pieces.
    pub fn new(bytes: &[u8], pieces: usize) -> Joined {
        let size = bytes.len().div_ceil(pieces);
        let piece = |bytes: &[u8]| Resumed { is_partial: true, ..Resumed::new(bytes.to_vec(), size.div_ceil(2)) };
        Joined { pieces: bytes.chunks(size).map(piece).collect(), whole: None }
    }

    /// One request; the ray set, when the upload of all pieces has become one.
    pub fn step(&mut self, address: &str) -> Option<String> {
        if let Some(whole) = &self.whole {
            return became(address, whole);
        }
        match self.pieces.iter_mut().find(|piece| !piece.is_sent()) {
            Some(piece) => assert_eq!(piece.step(address), None),
            None => self.join(address),
        }
        None
    }

    /// Asks for the upload that all pieces are, as often as it takes: who lost the answer is told the same again.
    fn join(&mut self, address: &str) {
        let list: Vec<&str> = self.pieces.iter().filter_map(|piece| piece.at.as_deref()).collect();
        let concat = format!("final;{}", list.join(" "));
        let Ok(answer) = ask(address, "POST", "/v1/uploads", &[VERSION, ("Upload-Concat", &concat)], b"") else {
            return;
        };
        assert!(answer.status == 201 || told_to_come_back(&answer), "{answer:?}");
        self.whole = answer.header("location").map(str::to_owned);
    }
}

fn became(address: &str, at: &str) -> Option<String> {
    let upload = ask(address, "GET", at, &[], b"").ok().filter(|answer| answer.status != 503)?.json();
    assert!(upload["state"] != "refused" && upload["state"] != "receiving", "{upload}");
    upload["ray_sets"][0].as_str().map(str::to_owned)
}
