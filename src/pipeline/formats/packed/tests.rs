//! Packed files that other programs wrote, and what their enemies would make of them.

use super::gauge::MAX_NAME_CHARS;
use super::*;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;

/// What is in most of the files below, and the stored file in the zip.
const BLUE: &[u8] = b"0 0 0  0 0 1  1\n0 0 0  0 0 1  1\n0 0 0  0 0 1  1\n0 0 0  0 0 1  1\n";
const RED: &[u8] = b"0 0 0  0 0 1  2\n";

/// Python's gzip, which writes the file's name.
const PYTHON_GZIP: &[u8] =
    b"\x1f\x8b\x08\x08\0\0\0\0\x02\xfflamp.ray\x003P0\0B0a\xa8\xa0`\xc8e@\x22\x1f\0\x8d\xf9\xd9 @\0\0\0";

/// `printf ... | gzip -9c`: no name.
const GNU_GZIP: &[u8] = b"\x1f\x8b\x08\0\0\0\0\0\x02\x033P0\0B0a\xa8\xa0`\xc8e@\x22\x1f\0\x8d\xf9\xd9 @\0\0\0";

/// `zstd -c`, with a checksum.
const ZSTD: &[u8] = b"(\xb5/\xfd\x04X\xa5\0\0X0 0 0 1  1\n\x02\0\xcd\x0c\x8d\xb6\x14\x01(\x18\xd7\xf9";

/// `pzstd`: a frame to be skipped, then one with content.
const PZSTD: &[u8] =
    b"P*M\x18\x04\0\0\0!\0\0\0(\xb5/\xfd\x04X\xa5\0\0X0 0 0 1  1\n\x02\0\xcd\x0c\x8d\xb6\x14\x01(\x18\xd7\
    \xf9";

/// Python's zipfile: a folder, a deflated file, a stored one, and what macOS adds.
const PYTHON_ZIP: &[u8] =
    b"PK\x03\x04\x14\0\0\0\0\0\0\0!\0\0\0\0\0\0\0\0\0\0\0\0\0\x05\0\0\0lamp/PK\x03\x04\x14\0\0\0\x08\0\0\0\
    !\0\x8d\xf9\xd9 \x10\0\0\0@\0\0\0\x0d\0\0\0lamp/blue.txt3P0\0B0a\xa8\xa0`\xc8e@\x22\x1f\0PK\x03\x04\
    \x14\0\0\0\0\0\0\0!\0\x0dB5!\x10\0\0\0\x10\0\0\0\x0c\0\0\0lamp/red.txt0 0 0  0 0 1  2\nPK\x03\x04\
    \x14\0\0\0\0\0\0\0!\0\x83\x16\xdc\x8c\x01\0\0\0\x01\0\0\0\x17\0\0\0__MACOSX/lamp/._red.txtxPK\x01\
    \x02\x14\x03\x14\0\0\0\0\0\0\0!\0\0\0\0\0\0\0\0\0\0\0\0\0\x05\0\0\0\0\0\0\0\0\0\0\0\x80\x01\0\0\0\0l\
    amp/PK\x01\x02\x14\x03\x14\0\0\0\x08\0\0\0!\0\x8d\xf9\xd9 \x10\0\0\0@\0\0\0\x0d\0\0\0\0\0\0\0\0\0\0\
    \0\x80\x01#\0\0\0lamp/blue.txtPK\x01\x02\x14\x03\x14\0\0\0\0\0\0\0!\0\x0dB5!\x10\0\0\0\x10\0\0\0\x0c\
    \0\0\0\0\0\0\0\0\0\0\0\x80\x01^\0\0\0lamp/red.txtPK\x01\x02\x14\x03\x14\0\0\0\0\0\0\0!\0\x83\x16\xdc\
    \x8c\x01\0\0\0\x01\0\0\0\x17\0\0\0\0\0\0\0\0\0\0\0\x80\x01\x98\0\0\0__MACOSX/lamp/._red.txtPK\x05\
    \x06\0\0\0\0\x04\0\x04\0\xed\0\0\0\xce\0\0\0\0\0";

/// Info-ZIP into a pipe, whose lengths stand behind the data and in the directory.
const STREAMED_ZIP: &[u8] =
    b"PK\x03\x04-\0\x08\0\x08\0t\x22v]\0\0\0\0\xff\xff\xff\xff\xff\xff\xff\xff\x01\0\x14\0-\x01\0\x10\0\0\
    \0\0\0\0\0\0\0\0\0\0\0\0\0\0\x003P0\0B0a\xa8\xa0`\xc8e@\x22\x1f\0PK\x07\x08\x8d\xf9\xd9 \x10\0\0\0\0\0\
    \0\0@\0\0\0\0\0\0\0PK\x01\x02\x1e\x03-\0\x08\0\x08\0t\x22v]\x8d\xf9\xd9 \x10\0\0\0@\0\0\0\x01\0\0\0\
    \0\0\0\0\x01\0\0\0\x80\x11\0\0\0\0-PK\x05\x06\0\0\0\0\x01\0\x01\0/\0\0\0[\0\0\0\0\0";

/// `zip -P secret`.
const ENCRYPTED_ZIP: &[u8] =
    b"PK\x03\x04\x14\0\x09\0\x08\0t\x22v]\x8d\xf9\xd9 \x1c\0\0\0@\0\0\0\x05\0\0\0l.txt\xbc\x8co\xf2}5w\xe1\
    &x\xa6r\x83\xcd\xfa\x07\xd8\x12\xc4g\xe1<\xba?\xe5\xaa_3PK\x07\x08\x8d\xf9\xd9 \x1c\0\0\0@\0\0\0PK\
    \x01\x02\x1e\x03\x14\0\x09\0\x08\0t\x22v]\x8d\xf9\xd9 \x1c\0\0\0@\0\0\0\x05\0\0\0\0\0\0\0\x01\0\0\0\
    \xa4\x81\0\0\0\0l.txtPK\x05\x06\0\0\0\0\x01\0\x01\x003\0\0\0O\0\0\0\0\0";

/// Python's zipfile with bzip2.
const BZIP2_ZIP: &[u8] =
    b"PK\x03\x04.\0\0\0\x0c\0\0\0!\0\x0dB5!1\0\0\0\x10\0\0\0\x05\0\0\0x.txtBZh91AY&SY\xaa~ F\0\0\x05\xd8\0\
    \0\x10@\0p\0 \x000\xcd\0\x94\xf5\x1e\xa5\xd2H\xe4\x87\x8b\xb9\x22\x9c(HU?\x10#\0PK\x01\x02.\x03.\0\0\0\
    \x0c\0\0\0!\0\x0dB5!1\0\0\0\x10\0\0\0\x05\0\0\0\0\0\0\0\0\0\0\0\x80\x01\0\0\0\0x.txtPK\x05\x06\0\0\0\
    \0\x01\0\x01\x003\0\0\0T\0\0\0\0\0";
/// A name and a content, or the code of why it stays closed.
type Found = (String, Result<Vec<u8>, &'static str>);

fn unpacked(bytes: &[u8], limits: &Limits) -> Result<Vec<Found>, Error> {
    let mut found = Vec::new();
    unpack(&bytes.to_vec(), "sent.ray.gz", limits, |name, content| {
        let content = match content {
            Content::Closed(error) => Err(error.code()),
            Content::Open(mut member) => {
                let (mut all, mut block) = (Vec::new(), [0; 7]);
                loop {
                    let count = member.read(&mut block)?;
                    if count == 0 {
                        break Ok(all);
                    }
                    all.extend_from_slice(&block[..count]);
                }
            }
        };
        found.push((name.to_owned(), content));
        Ok::<(), Error>(())
    })?;
    Ok(found)
}

fn all(bytes: &[u8]) -> Vec<Found> {
    unpacked(bytes, &Limits::default()).unwrap()
}

#[track_caller]
fn is(bytes: &[u8], expected: &[(&str, Result<&[u8], &'static str>)]) {
    let found = all(bytes);
    let found: Vec<_> =
        found.iter().map(|(name, content)| (name.as_str(), content.as_deref().map_err(|e| *e))).collect();
    assert_eq!(found, expected);
}

#[track_caller]
fn code(bytes: &[u8]) -> &'static str {
    unpacked(bytes, &Limits::default()).unwrap_err().code()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    packed.write_all(bytes).unwrap();
    packed.finish().unwrap()
}

/// A stored zip as APPNOTE 4.3 lays it out.
fn zip_of(files: &[(&str, &[u8])]) -> Vec<u8> {
    let (mut zip, mut directory) = (Vec::new(), Vec::new());
    for (name, content) in files {
        let mut crc = flate2::Crc::new();
        crc.update(content);
        let offset = zip.len() as u32;
        let mut shared = vec![20, 0, 0, 0, 0, 0, 0, 0, 0x21, 0];
        shared.extend(crc.sum().to_le_bytes());
        shared.extend([(content.len() as u32).to_le_bytes(); 2].concat());
        shared.extend([name.len() as u16, 0].map(u16::to_le_bytes).concat());
        zip.extend([b"PK\x03\x04", &shared[..], name.as_bytes(), content].concat());
        directory
            .extend([b"PK\x01\x02\x14\x03", &shared[..], &[0; 10], &offset.to_le_bytes(), name.as_bytes()].concat());
    }
    let (offset, length, count) = (zip.len() as u32, directory.len() as u32, files.len() as u16);
    zip.extend(directory);
    zip.extend(b"PK\x05\x06\0\0\0\0");
    zip.extend([count.to_le_bytes(); 2].concat());
    zip.extend([length.to_le_bytes(), offset.to_le_bytes()].concat());
    zip.extend([0, 0]);
    zip
}

/// Where `mark` first stands.
fn find(bytes: &[u8], mark: &[u8]) -> usize {
    bytes.windows(mark.len()).position(|window| window == mark).unwrap()
}

#[test]
fn what_other_programs_packed_comes_out() {
    is(PYTHON_GZIP, &[("lamp.ray", Ok(BLUE))]);
    is(GNU_GZIP, &[("sent.ray", Ok(BLUE))]);
    is(ZSTD, &[("sent.ray.gz", Ok(BLUE))]);
    is(PZSTD, &[("sent.ray.gz", Ok(BLUE))]);
    is(PYTHON_ZIP, &[("lamp/blue.txt", Ok(BLUE)), ("lamp/red.txt", Ok(RED))]);
    is(STREAMED_ZIP, &[("-", Ok(BLUE))]);
    is(BLUE, &[("sent.ray.gz", Ok(BLUE))]);
}

#[test]
fn members_and_frames_in_a_row_are_one_file() {
    is(&[PYTHON_GZIP, GNU_GZIP, &gzip(b""), GNU_GZIP].concat(), &[("lamp.ray", Ok(&[BLUE; 3].concat()))]);
    is(&[PZSTD, ZSTD, PZSTD].concat(), &[("sent.ray.gz", Ok(&[BLUE; 3].concat()))]);
    assert_eq!(code(&[GNU_GZIP, b"more"].concat()), "container.trailing");
    assert_eq!(code(&[ZSTD, b"more"].concat()), "container.damaged");
}

#[test]
fn one_packing_in_another_is_undone_and_no_more() {
    is(&gzip(PYTHON_GZIP), &[("lamp.ray", Ok(BLUE))]);
    is(&zip_of(&[("a/b.ray.gz", GNU_GZIP), ("c.zst", ZSTD)]), &[("a/b.ray", Ok(BLUE)), ("c", Ok(BLUE))]);
    let deep = ("sent.ray.gz", Err("container.nested"));
    is(&gzip(&gzip(&gzip(BLUE))), &[deep]);
    is(&gzip(PYTHON_ZIP), &[deep]);
    is(&zip_of(&[("in.zip", PYTHON_ZIP), ("r", RED)]), &[("in.zip", Err("container.nested")), ("r", Ok(RED))]);
}

#[test]
fn what_we_cannot_undo_stays_closed_under_its_name() {
    is(ENCRYPTED_ZIP, &[("l.txt", Err("container.encrypted"))]);
    is(BZIP2_ZIP, &[("x.txt", Err("container.method"))]);
}

#[test]
fn names_lead_nowhere() {
    is(&zip_of(&[("../..\\etc/\x07passwd", RED), ("/", RED), ("a\\.DS_Store", RED)]), &[("etc/passwd", Ok(RED))]);
    assert_eq!(shown(&"ä".repeat(300)).chars().count(), MAX_NAME_CHARS);
    assert_eq!(shown("..//./"), "rays");
}

/// APPNOTE 4.3.14, 4.3.15 and 4.5.3 by hand: every number that can be 64 bits wide is.
#[test]
fn a_zip64_is_a_zip() {
    let narrow = zip_of(&[("red", RED)]);
    let at = find(&narrow, b"PK\x01\x02");
    let (data, rest) = narrow.split_at(at);
    let mut entry = rest[..49].to_vec();
    for place in [20, 24, 42] {
        entry[place..place + 4].fill(0xff);
    }
    entry[30] = 4 + 24;
    let wide = [16_u64, 16, 0].map(u64::to_le_bytes).concat();
    let entry = [&entry[..], &[1, 0, 24, 0], &wide].concat();
    let mut record = [b"PK\x06\x06", &44_u64.to_le_bytes()[..], &[45, 0, 45, 0], &[0; 8]].concat();
    record.extend([1, 1, entry.len() as u64, at as u64].map(u64::to_le_bytes).concat());
    let record_at = (at + entry.len()) as u64;
    let locator = [b"PK\x06\x07", &[0; 4][..], &record_at.to_le_bytes(), &[1, 0, 0, 0]].concat();
    let end = [b"PK\x05\x06\0\0\0\0", &[0xff; 12][..], &[0, 0]].concat();
    is(&[data, &entry, &record, &locator, &end].concat(), &[("red", Ok(RED))]);
}

#[test]
fn damage_is_found() {
    // One bit of the checksum, the length, the data.
    for (file, at) in
        [(GNU_GZIP, GNU_GZIP.len() - 8), (GNU_GZIP, GNU_GZIP.len() - 1), (ZSTD, ZSTD.len() - 1), (ZSTD, 15)]
    {
        let mut broken = file.to_vec();
        broken[at] ^= 1;
        assert_eq!(code(&broken), "container.damaged", "{at}");
    }
    let zip = zip_of(&[("red", RED)]);
    let directory = find(&zip, b"PK\x01\x02");
    let patched = |at: usize, value: u8| {
        let mut zip = zip.clone();
        zip[at] = value;
        zip
    };
    assert_eq!(code(&patched(33, b'1')), "container.damaged");
    // The directory's length after unpacking: too short, too long.
    assert_eq!(code(&patched(directory + 24, 15)), "container.damaged");
    assert_eq!(code(&patched(directory + 24, 17)), "container.damaged");
    // Signatures, the number of entries, the directory's offset, the file's offset.
    assert_eq!(code(&patched(directory, b'x')), "container.malformed");
    assert_eq!(code(&patched(zip.len() - 12, 2)), "container.malformed");
    assert_eq!(code(&patched(zip.len() - 3, 1)), "container.malformed");
    assert_eq!(code(&patched(directory + 42, 1)), "container.malformed");
    // Packed data that would reach into the directory.
    assert_eq!(code(&patched(directory + 20, 200)), "container.overlap");
    let error = unpacked(&patched(33, b'1'), &Limits::default()).unwrap_err().to_string();
    assert!(error.contains("\"red\"") && error.contains("byte "), "{error}");
}

#[test]
fn no_prefix_is_taken_for_the_whole() {
    for file in [PYTHON_GZIP, GNU_GZIP, ZSTD, PYTHON_ZIP, STREAMED_ZIP, BZIP2_ZIP] {
        let whole = all(file);
        for end in 0..file.len() {
            if let Ok(found) = unpacked(&file[..end], &Limits::default()) {
                // Too short to be known for what it is.
                assert!(end < 4, "{end} bytes gave {found:?} like {whole:?}");
            }
        }
    }
}

#[test]
fn no_changed_byte_makes_it_panic_or_gives_other_bytes() {
    for file in [PYTHON_GZIP, ZSTD, PZSTD, PYTHON_ZIP, STREAMED_ZIP] {
        for at in 4..file.len() {
            for value in [0, 1, 0x7f, 0xff, file[at] ^ 1] {
                let mut changed = file.to_vec();
                changed[at] = value;
                for (name, content) in unpacked(&changed, &Limits::default()).unwrap_or_default() {
                    let known = |bytes: &Vec<u8>| bytes == BLUE || bytes == RED || bytes == b"x" || bytes.is_empty();
                    assert!(content.as_ref().map_or(true, known), "{name} at byte {at} = {value}: {content:?}");
                }
            }
        }
    }
}

#[test]
fn bombs_are_stopped_by_their_ratio_and_their_size() {
    let zeros = vec![0; 40 << 20];
    let bomb = gzip(&zeros);
    assert_eq!(code(&bomb), "container.ratio");
    assert_eq!(code(&zip_of(&[("inner.gz", &bomb)])), "container.ratio");
    // Twice packed: the outer layer counts although nothing comes out of the inner one.
    let skipped =
        [&0x184d_2a50_u32.to_le_bytes()[..], &(39_u32 << 20).to_le_bytes(), &zeros[..39 << 20], ZSTD].concat();
    assert_eq!(code(&gzip(&skipped)), "container.ratio");
    let small = Limits { max_expanded_bytes: 63, ..Limits::default() };
    for file in [GNU_GZIP, ZSTD, PYTHON_ZIP] {
        assert_eq!(unpacked(file, &small).unwrap_err().code(), "container.too_large");
    }
    let enough = Limits { max_expanded_bytes: 64, ..Limits::default() };
    assert!(unpacked(GNU_GZIP, &enough).is_ok());
}

#[test]
fn many_files_and_shared_bytes_are_refused_before_any_is_unpacked() {
    let two = Limits { max_members: 2, ..Limits::default() };
    let three = zip_of(&[("a", RED), ("b", RED), ("c", RED)]);
    assert_eq!(unpacked(&three, &two).unwrap_err().code(), "container.members");
    assert!(unpacked(&zip_of(&[("a", RED), ("b", RED)]), &two).is_ok());
    // Fifield's bomb in small: the second entry is the first once more.
    let mut shared = zip_of(&[("a", RED), ("b", RED)]);
    let second = shared.len() - 22 - 47 + 42;
    shared[second..second + 4].fill(0);
    assert_eq!(code(&shared), "container.overlap");
}

/// RFC 8878, 3.1.1.1.2: window descriptor 0x68 is 2^(10+13) = 8 MiB, 0x70 twice as much.
#[test]
fn a_window_larger_than_every_decoder_has_is_refused() {
    let frame = |window: u8| [0x28, 0xb5, 0x2f, 0xfd, 0, window, 1, 0, 0];
    is(&frame(0x68), &[("sent.ray.gz", Ok(b""))]);
    assert_eq!(code(&frame(0x70)), "container.window");
}

/// A medium that fails is no damage.
#[test]
fn what_the_medium_says_is_handed_on() {
    struct Broken;
    impl Bytes for Broken {
        fn len(&self) -> u64 {
            1 << 20
        }
        fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
            let start = GNU_GZIP.get(offset as usize..).and_then(|rest| rest.get(..into.len()));
            into.copy_from_slice(start.ok_or(io::ErrorKind::TimedOut)?);
            Ok(())
        }
    }
    let error = unpack(&Broken, "x", &Limits::default(), |_, _| Ok::<(), Error>(())).unwrap_err();
    assert!(matches!(error, Error::Unreadable(_)), "{error}");
}
