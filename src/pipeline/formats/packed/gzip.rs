//! Gzip (RFC 1952): one file in one or more members; their checksums and lengths are held by the decoder.

use super::gauge::{AGAIN, Gauge, shown};
use crate::error::Error;
use flate2::bufread::GzDecoder;
use std::io;
use std::io::{BufRead, Read};

/// The first byte of a member.
const FIRST: u8 = 0x1f;

/// The members of a gzip file as one.
pub struct Gzip<'a, R: BufRead> {
    gauge: &'a Gauge<'a>,
    /// The member being read; none after the last.
    member: Option<GzDecoder<R>>,
}

impl<'a, R: BufRead> Gzip<'a, R> {
    /// Reads the header of the first member.
    pub fn new(gauge: &'a Gauge<'a>, packed: R) -> Gzip<'a, R> {
        Gzip { gauge, member: Some(GzDecoder::new(packed)) }
    }

    /// The name of what was packed (FNAME, Latin-1), where the header has one.
    pub fn name(&self) -> Option<String> {
        let name = self.member.as_ref()?.header()?.filename()?;
        let name: String = name.iter().map(|byte| char::from(*byte)).collect();
        name.rsplit(['/', '\\']).next().filter(|last| !last.is_empty()).map(shown)
    }
}

impl<R: BufRead> Read for Gzip<'_, R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        while let Some(member) = &mut self.member {
            let count = member.read(into)?;
            if count > 0 || into.is_empty() {
                self.gauge.expand(count)?;
                return Ok(count);
            }
            let Some(mut rest) = self.member.take().map(GzDecoder::into_inner) else { break };
            match rest.fill_buf()?.first() {
                None => {}
                Some(&FIRST) => self.member = Some(GzDecoder::new(rest)),
                Some(_) => {
                    let found = "Something that is no gzip member follows the last one.";
                    return Err(self.gauge.stop(Error::malformed("container.trailing", found, AGAIN)));
                }
            }
        }
        Ok(0)
    }
}
