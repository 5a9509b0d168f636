//! Files cut anywhere: every prefix of every fixture is refused, or read with a notice. Never a panic, never read in silence.
//! Speos files and plain columns are judged by themselves: they have neither count nor end, and their first rays are a file of
//! their own.

use pipeline::formats::record::Bytes;
use pipeline::{Declared, Error, Input, LengthUnit, Limits, NoProgress, Quantity, Verdict, inspect, peek};
use std::io;
use std::sync::Arc;
use support::formats::{with_count_or_end, without_count_or_end};

/// The first bytes of a file.
struct Cut {
    whole: Arc<Vec<u8>>,
    length: usize,
}

impl Bytes for Cut {
    fn len(&self) -> u64 {
        self.length as u64
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        if offset.saturating_add(into.len() as u64) > self.len() {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        self.whole.read_at(offset, into)
    }
}

/// Rays in every fixture.
const RAYS: u32 = 5;

/// Codes of the notices of a file that was read, and what is wrong with it.
fn inspected(whole: &Arc<Vec<u8>>, length: usize) -> Result<Vec<String>, Error> {
    let bytes = Arc::new(Cut { whole: Arc::clone(whole), length });
    let declared = Declared {
        length_unit: Some(LengthUnit::Millimetre),
        quantity: Some(Quantity::Radiant),
        ..Declared::default()
    };
    let input = Input { name: "cut".into(), sha256: String::new(), bytes, declared, notices: Vec::new() };
    let inspection = inspect(&input, &Limits::default(), &NoProgress)?;
    let wrong =
        inspection.checks.iter().filter(|check| check.verdict == Verdict::Wrong).map(|check| check.check.to_owned());
    Ok(inspection.notices.iter().map(|notice| notice.code.clone().into_owned()).chain(wrong).collect())
}

/// What a cut file is told; `None` where it is read as if nothing were missing.
fn told(name: &str, whole: &Arc<Vec<u8>>, of_whole: &[String], length: usize) -> Option<()> {
    match inspected(whole, length) {
        // Cut off is a finding of its own: what the whole file is told anyway does not count.
        Ok(codes) => codes.iter().any(|code| !of_whole.contains(code)).then_some(()),
        Err(Error::Malformed(fault) | Error::Refused(fault) | Error::Unusable(fault)) => {
            assert!(fault.at.is_some(), "{name}, {length} bytes: {fault:?} has no place");
            Some(())
        }
        Err(other) => panic!("{name}, {length} bytes: {other}"),
    }
}

#[test]
fn every_prefix_is_refused_or_read_with_a_notice() {
    for (name, bytes, spare) in with_count_or_end(RAYS) {
        let whole = Arc::new(bytes);
        let of_whole = inspected(&whole, whole.len()).unwrap_or_else(|error| panic!("{name} itself: {error}"));
        for length in 0..whole.len() - spare {
            assert!(told(name, &whole, &of_whole, length).is_some(), "{name}, {length} bytes: in silence");
        }
    }
}

#[test]
fn rows_without_a_count_are_read_in_silence_up_to_whole_rows_only() {
    for (name, bytes, ends) in without_count_or_end(RAYS) {
        let whole = Arc::new(bytes);
        let of_whole = inspected(&whole, whole.len()).unwrap_or_else(|error| panic!("{name} itself: {error}"));
        let silent: Vec<usize> =
            (0..whole.len()).filter(|length| told(name, &whole, &of_whole, *length).is_none()).collect();
        assert!(silent.iter().all(|length| ends.contains(length)), "{name}: read in silence up to {silent:?}");
    }
}

/// An upload is judged by its first bytes: a good file's prefix is never refused while the rest may still come.
#[test]
fn no_prefix_of_an_upload_is_refused_while_the_rest_may_come() {
    for (name, bytes, _) in with_count_or_end(RAYS) {
        for length in 0..bytes.len() {
            let verdict = peek(&bytes[..length], Some(bytes.len() as u64), &Limits::default());
            assert!(verdict.is_ok(), "{name}, {length} bytes: {verdict:?}");
        }
    }
}
