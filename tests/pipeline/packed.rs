//! Ray files packed by other writers: what comes out is the file, bit for bit, and so is the model.

use pipeline::formats::bytes::digest;
use pipeline::{Content, Declared, Error, Input, Limits, header, known_sources, unpack};
use std::sync::Arc;
use support::packing::{gzip, zip, zstd};

fn ray_file() -> Vec<u8> {
    let mut bytes = Vec::new();
    known_sources::write_tm25(&known_sources::by_name("four-chips").unwrap(), 2_000, 1, &mut bytes).unwrap();
    bytes
}

fn unpacked(packed: Vec<u8>) -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    unpack(&packed, "four-chips.tm25ray", &Limits::default(), |name, content| {
        let Content::Open(mut member) = content else { unreachable!("{name} stays closed") };
        let (mut bytes, mut block) = (Vec::new(), vec![0; 10_007]);
        loop {
            match member.read(&mut block)? {
                0 => break,
                count => bytes.extend_from_slice(&block[..count]),
            }
        }
        files.push((name.to_owned(), bytes));
        Ok::<(), Error>(())
    })
    .unwrap();
    files
}

#[test]
fn a_packed_ray_file_is_the_ray_file() {
    let file = ray_file();
    let expected = [("four-chips.tm25ray".to_owned(), file.clone())];
    for packed in [gzip(&file), zstd(&file), zip(&[("four-chips.tm25ray", &file)]), gzip(&zstd(&file))] {
        assert!(packed.len() < file.len(), "{}", packed.len());
        let found = unpacked(packed);
        assert!(found == expected, "{:?}", found.iter().map(|(name, bytes)| (name, bytes.len())).collect::<Vec<_>>());
    }
    let input = |bytes: Vec<u8>| Input {
        name: "four-chips".into(),
        sha256: digest(&bytes).unwrap(),
        bytes: Arc::new(bytes),
        declared: Declared::default(),
        notices: Vec::new(),
    };
    let (_, out) = unpacked(zstd(&file)).remove(0);
    let of = |bytes| header(&input(bytes), &Limits::default()).unwrap();
    assert_eq!(of(out), of(file));
}

#[test]
fn a_zip_gives_its_files_in_order() {
    let file = ray_file();
    let found = unpacked(zip(&[("b/1.ray", &file), ("b/", b""), ("a.ray.gz", &gzip(&file)), ("c", b"?")]));
    let expected = [("b/1.ray", file.clone()), ("a.ray", file), ("c", b"?".to_vec())];
    assert!(found == expected.map(|(name, bytes)| (name.to_owned(), bytes)));
}

/// Bytes cut off, at 60 places of each: never a panic, never taken for the whole.
#[test]
fn what_is_cut_off_is_missed() {
    let file = ray_file();
    for packed in [gzip(&file), zstd(&file), zip(&[("a", &file)])] {
        for cut in (4..packed.len()).step_by(packed.len() / 60) {
            let seen = unpack(&packed[..cut].to_vec(), "x", &Limits::default(), |_, content| {
                if let Content::Open(mut member) = content {
                    while member.read(&mut [0; 50_000])? > 0 {}
                }
                Ok::<(), Error>(())
            });
            let error = seen.unwrap_err();
            assert_eq!(error.code(), "container.truncated", "{cut} of {}: {error}", packed.len());
        }
    }
}
