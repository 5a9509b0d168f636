//! Rows in random order, in bounded memory: as they come, each is put into one of so many parts of the file at random; at the end each
//! part is read back, shuffled in memory and put in its place. Every order is as likely as any other (Rao 1961, Sandelius 1962).
//!
//! Which part a row goes to follows from its number and the seed, so that the lengths of the parts are known before the first row.

use super::chance::Chance;
use super::place::Place;
use std::io;
use std::io::SeekFrom;

/// Bytes of a part, about: held in memory once, when it is shuffled.
pub const PART_BYTES: u64 = 64 << 20;
/// Bytes that are collected for a part before they are written to it.
const BUFFER_BYTES: usize = 64 << 10;

/// A file whose rows come in any order and stand in random order.
pub struct Shuffle<'o> {
    out: &'o mut dyn Place,
    row_bytes: usize,
    chance: Chance,
    parts: Vec<Part>,
    /// Rows seen.
    rows: u64,
}

/// A part of the file.
#[derive(Default)]
struct Part {
    /// Offset of its first row.
    start: u64,
    /// Rows that it will have.
    rows: u64,
    /// Offset of the next row.
    at: u64,
    /// Rows that are not yet written.
    buffer: Vec<u8>,
}

impl<'o> Shuffle<'o> {
    /// `rows` rows of `row_bytes` bytes from where `out` stands, in parts of about `part_bytes`.
    ///
    /// # Errors
    /// What `out` answers.
    pub fn start(
        out: &'o mut dyn Place,
        rows: u64,
        row_bytes: usize,
        seed: u64,
        part_bytes: u64,
    ) -> io::Result<Shuffle<'o>> {
        let start = out.stream_position()?;
        let part_count = (rows * row_bytes as u64).div_ceil(part_bytes).max(1);
        let mut parts: Vec<Part> = (0..part_count).map(|_| Part::default()).collect();
        let chance = Chance::new(seed);
        for row in 0..rows {
            if let Some(part) = parts.get_mut(chance.below(part_count, row) as usize) {
                part.rows += 1;
            }
        }
        let mut at = start;
        for part in &mut parts {
            (part.start, part.at) = (at, at);
            at += part.rows * row_bytes as u64;
        }
        Ok(Shuffle { out, row_bytes, chance, parts, rows: 0 })
    }

    /// The next rows.
    ///
    /// # Errors
    /// What the stream answers.
    pub fn write(&mut self, rows: &[u8]) -> io::Result<()> {
        let part_count = self.parts.len() as u64;
        for row in rows.chunks_exact(self.row_bytes) {
            let part = self.parts.get_mut(self.chance.below(part_count, self.rows) as usize);
            self.rows += 1;
            let Some(part) = part else { continue };
            part.buffer.extend_from_slice(row);
            if part.buffer.len() + self.row_bytes > BUFFER_BYTES {
                part.flush(self.out)?;
            }
        }
        Ok(())
    }

    /// Shuffles the parts and puts `end` behind them.
    ///
    /// # Errors
    /// What the stream answers.
    pub fn finish(mut self, end: &[u8]) -> io::Result<()> {
        let mut block = Vec::new();
        for (number, part) in (0..).zip(&mut self.parts) {
            part.flush(self.out)?;
            block.resize((part.at - part.start) as usize, 0);
            self.out.seek(SeekFrom::Start(part.start))?;
            self.out.read_exact(&mut block)?;
            shuffle(&mut block, self.row_bytes, self.chance.part(number));
            self.out.seek(SeekFrom::Start(part.start))?;
            self.out.write_all(&block)?;
        }
        self.out.write_all(end)?;
        self.out.flush()
    }
}

impl Part {
    fn flush(&mut self, out: &mut dyn Place) -> io::Result<()> {
        if !self.buffer.is_empty() {
            out.seek(SeekFrom::Start(self.at))?;
            out.write_all(&self.buffer)?;
            self.at += self.buffer.len() as u64;
            self.buffer.clear();
        }
        Ok(())
    }
}

/// R. A. Fisher and F. Yates 1938, in the form of R. Durstenfeld 1964.
fn shuffle(rows: &mut [u8], row_bytes: usize, chance: Chance) {
    let count = rows.len() / row_bytes;
    for last in (1..count).rev() {
        let other = chance.below(last as u64 + 1, last as u64) as usize;
        if other < last {
            let (before, from_last) = rows.split_at_mut(last * row_bytes);
            let (chosen, _) = before.split_at_mut((other + 1) * row_bytes);
            let (_, chosen) = chosen.split_at_mut(other * row_bytes);
            let (moved, _) = from_last.split_at_mut(row_bytes);
            chosen.swap_with_slice(moved);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;
    use std::io::{Cursor, Seek, Write};

    fn shuffled(rows: u32, seed: u64, part_bytes: u64) -> Vec<u32> {
        let mut out = Cursor::new(Vec::new());
        out.write_all(b"head").unwrap();
        let mut shuffle = Shuffle::start(&mut out, rows.into(), 4, seed, part_bytes).unwrap();
        let bytes: Vec<u8> = (0..rows).flat_map(u32::to_le_bytes).collect();
        bytes.chunks(400).for_each(|some| shuffle.write(some).unwrap());
        shuffle.finish(b"end").unwrap();
        assert_eq!(out.stream_position().unwrap(), u64::from(rows) * 4 + 7);
        let all = out.into_inner();
        assert!(all.starts_with(b"head") && all.ends_with(b"end"));
        all[4..all.len() - 3].chunks_exact(4).map(|row| u32::from_le_bytes(row.try_into().unwrap())).collect()
    }

    #[test]
    fn every_row_is_there_once_and_the_seed_decides_where() {
        for part_bytes in [1 << 20, 40_000, 1000] {
            let one = shuffled(50_000, 7, part_bytes);
            assert_eq!(one, shuffled(50_000, 7, part_bytes));
            assert_ne!(one, shuffled(50_000, 8, part_bytes));
            let mut sorted = one.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, (0..50_000).collect::<Vec<_>>());
        }
        assert_eq!(shuffled(0, 1, 100), Vec::<u32>::new());
        assert_eq!(shuffled(1, 1, 100), vec![0]);
    }

    /// Chi-squared of the 24 orders of four rows over 24 000 seeds, in one part and in about four: 23 degrees of freedom, mean 23,
    /// standard deviation 6.8; 58 is exceeded with probability 8e-5.
    #[test]
    fn every_order_is_as_likely_as_any_other() {
        for part_bytes in [1000, 4] {
            let mut orders: HashMap<Vec<u32>, f64> = HashMap::new();
            for seed in 0..24_000 {
                *orders.entry(shuffled(4, seed, part_bytes)).or_default() += 1.0;
            }
            assert_eq!(orders.len(), 24);
            let chi2: f64 = orders.values().map(|count| (count - 1000.0) * (count - 1000.0) / 1000.0).sum();
            assert!(chi2 < 58.0, "{chi2}");
        }
    }
}
