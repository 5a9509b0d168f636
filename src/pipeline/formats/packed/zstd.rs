//! Zstandard (RFC 8878): one file in one or more frames, with others between them that are to be skipped.

use super::gauge::Gauge;
use crate::error::Error;
use ruzstd::decoding::errors::{FrameDecoderError, ReadFrameHeaderError};
use ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder};
use std::io;
use std::io::{BufRead, Read};

/// Largest window, bytes: what a decoder should support (RFC 8878, 3.1.1.1.2), and all that levels up to 19 use. The window is
/// held in memory.
const MAX_WINDOW_BYTES: u64 = 8 << 20;

/// The frames of a zstd file as one.
pub struct Zstd<'a, R: BufRead> {
    gauge: &'a Gauge<'a>,
    packed: R,
    decoder: FrameDecoder,
    in_frame: bool,
}

impl<'a, R: BufRead> Zstd<'a, R> {
    /// Reads nothing yet.
    pub fn new(gauge: &'a Gauge<'a>, packed: R) -> Zstd<'a, R> {
        let mut decoder = FrameDecoder::new();
        decoder.set_max_window_size(MAX_WINDOW_BYTES);
        Zstd { gauge, packed, decoder, in_frame: false }
    }

    /// The next frame that has content; false when there is none.
    fn enter(&mut self) -> io::Result<bool> {
        while !self.packed.fill_buf()?.is_empty() {
            match self.decoder.init(&mut self.packed) {
                Ok(()) => {
                    self.in_frame = true;
                    return Ok(true);
                }
                Err(FrameDecoderError::ReadFrameHeaderError(ReadFrameHeaderError::SkipFrame { length, .. })) => {
                    let skipped = io::copy(&mut self.packed.by_ref().take(length.into()), &mut io::sink())?;
                    if skipped < u64::from(length) {
                        return Err(io::ErrorKind::UnexpectedEof.into());
                    }
                }
                Err(error) => return Err(self.broken(error)),
            }
        }
        Ok(false)
    }

    /// The next bytes of the frame; 0 at its end.
    fn read_frame(&mut self, into: &mut [u8]) -> io::Result<usize> {
        while self.decoder.can_collect() == 0 && !self.decoder.is_finished() {
            let decoded = self.decoder.decode_blocks(&mut self.packed, BlockDecodingStrategy::UptoBlocks(1));
            decoded.map_err(|error| self.broken(error))?;
        }
        let count = self.decoder.read(into)?;
        if count == 0 && !into.is_empty() {
            self.in_frame = false;
            let announced = self.decoder.get_checksum_from_data();
            if announced.is_some() && announced != self.decoder.get_calculated_checksum() {
                return Err(io::Error::new(io::ErrorKind::InvalidData, "the checksum of a frame does not match"));
            }
        }
        Ok(count)
    }

    fn broken(&self, error: FrameDecoderError) -> io::Error {
        match error {
            FrameDecoderError::WindowSizeTooBig { requested, .. } => {
                let found = format!("Its zstd window has {requested} bytes, more than {MAX_WINDOW_BYTES}.");
                let remedy = "Pack it without zstd's --long and --ultra, or send it unpacked.";
                self.gauge.stop(Error::refused("container.window", found, remedy))
            }
            FrameDecoderError::DictNotProvided { .. } => {
                let found = "It was packed with a zstd dictionary, which it does not hold.";
                self.gauge.stop(Error::refused("container.method", found, "Pack it without a dictionary."))
            }
            error => {
                let kind = if ended(&error) { io::ErrorKind::UnexpectedEof } else { io::ErrorKind::InvalidData };
                io::Error::new(kind, error.to_string())
            }
        }
    }
}

/// Whether the cause of `error` is that there were no more bytes.
fn ended(error: &FrameDecoderError) -> bool {
    let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(error);
    while let Some(inner) = cause {
        if inner.downcast_ref::<io::Error>().is_some_and(|error| error.kind() == io::ErrorKind::UnexpectedEof) {
            return true;
        }
        cause = inner.source();
    }
    false
}

impl<R: BufRead> Read for Zstd<'_, R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        while self.in_frame || self.enter()? {
            let count = self.read_frame(into)?;
            if count > 0 || into.is_empty() {
                self.gauge.expand(count)?;
                return Ok(count);
            }
        }
        Ok(0)
    }
}
