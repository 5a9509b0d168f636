//! Mutations that know a little of the formats. Most random bytes fail a reader's first question (magic, count = length); what
//! is repaired here gets past it, so that the rest is tried as well. Some are left as they came: the first question is code too.
//! Corpora stay plain files of their formats.

use crate::Kind;
use libfuzzer_sys::fuzzer_mutate;

/// Bytes before the spectral tables of a TM-25 file, and of its header and flags alone.
const TM25_PREAMBLE: usize = 36_288;
const TM25_HEADER: usize = 288;

/// One mutation of `data[..size]`; the new size.
pub fn mutate(kind: Kind, data: &mut [u8], size: usize, max_size: usize, seed: u32) -> usize {
    let kind = if kind == Kind::Upload { told_by(&data[..size]) } else { kind };
    let size = match (kind, seed % 4) {
        // 36 000 bytes of texts would take nearly all mutations.
        (Kind::Tm25, 0 | 1) if size > TM25_PREAMBLE => {
            fuzzer_mutate(&mut data[..TM25_HEADER], TM25_HEADER, TM25_HEADER);
            size
        }
        (Kind::Tm25, 2) if size > TM25_PREAMBLE => {
            let (tail, most) = (size - TM25_PREAMBLE, max_size - TM25_PREAMBLE);
            TM25_PREAMBLE + fuzzer_mutate(&mut data[TM25_PREAMBLE..], tail, most)
        }
        _ => fuzzer_mutate(data, size, max_size),
    };
    if seed / 4 % 8 == 0 { size } else { repair(kind, data, size, max_size, seed / 4 % 8 > 2) }
}

fn told_by(data: &[u8]) -> Kind {
    match data {
        [b'T', b'M', b'2', b'5', ..] => Kind::Tm25,
        [b'L', b'T', b'R', b'F', ..] => Kind::LightToolsBinary,
        _ if matches!(i32_at(data, 0), 1010 | 8_675_309) => Kind::ZemaxBinary,
        _ if i32_at(data, 0) == 7415 => Kind::Asap,
        _ if (1..6).all(|k| f32_at(data, 4 * k) == 2.0) => Kind::Speos,
        _ => Kind::Columns,
    }
}

fn word_at(data: &[u8], at: usize) -> [u8; 4] {
    data.get(at..at + 4).map_or([0; 4], |word| [word[0], word[1], word[2], word[3]])
}

fn i32_at(data: &[u8], at: usize) -> i32 {
    i32::from_le_bytes(word_at(data, at))
}

fn f32_at(data: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(word_at(data, at))
}

fn put(data: &mut [u8], at: usize, bytes: &[u8]) {
    if let Some(place) = data.get_mut(at..at + bytes.len()) {
        place.copy_from_slice(bytes);
    }
}

/// Makes counts and lengths agree; with `rays`, directions have length 1 and fluxes are not negative.
fn repair(kind: Kind, data: &mut [u8], size: usize, max_size: usize, rays: bool) -> usize {
    let Some((start, record, trailer)) = layout(kind, data, size) else { return prefix(kind, data, size, max_size) };
    if start + trailer > size {
        return size;
    }
    let count = (size - start - trailer) / record;
    let end = start + count * record;
    match kind {
        Kind::Tm25 => put(data, 20, &(count as u64).to_le_bytes()),
        Kind::ZemaxBinary => put(data, 4, &(count as u32).to_le_bytes()),
        Kind::Asap => put(data, 108, &(-(count as i32)).to_le_bytes()),
        Kind::LightToolsBinary => put(data, end, b"LTRFEND"),
        _ => {}
    }
    if rays {
        data[start..end].chunks_exact_mut(record).for_each(|ray| light(ray, if kind == Kind::Speos { 28 } else { 24 }));
    }
    end + trailer
}

/// Where the records begin, how long one is and what follows them, for formats of records; fixes what the header must have.
fn layout(kind: Kind, data: &mut [u8], size: usize) -> Option<(usize, usize, usize)> {
    match kind {
        Kind::Tm25 => tm25(&mut data[..size]),
        Kind::ZemaxBinary if size >= 208 => {
            put(data, 0, &1010_i32.to_le_bytes());
            put(data, 136, &i32_at(data, 136).rem_euclid(5).to_le_bytes());
            put(data, 192, &(i32_at(data, 192) & 2).to_le_bytes());
            put(data, 196, &(i32_at(data, 196) & 1).to_le_bytes());
            Some((208, if i32_at(data, 192) == 2 { 32 } else { 28 }, 0))
        }
        Kind::LightToolsBinary if size >= 44 => {
            put(data, 0, b"LTRF\x02\0\0\0\0\0\0\0");
            let record = match i32_at(data, 20).rem_euclid(3) {
                0 => 28,
                1 => 36,
                _ => 32,
            };
            Some((44, record, 7))
        }
        Kind::Speos if size >= 28 => {
            put(data, 4, &2.0_f32.to_le_bytes().repeat(5));
            Some((28, 32, 0))
        }
        Kind::Asap if size >= 140 => {
            put(data, 0, &7415_i32.to_le_bytes());
            Some((140, 28, 0))
        }
        _ => None,
    }
}

/// A TM-25 header whose flags, tables and texts fit into the file.
fn tm25(data: &mut [u8]) -> Option<(usize, usize, usize)> {
    if data.len() < TM25_PREAMBLE {
        return None;
    }
    put(data, 0, b"TM25");
    put(data, 256, &[1, 0, 0, 0, 1, 0, 0, 0]);
    for flag in (264..288).step_by(4) {
        put(data, flag, &(i32_at(data, flag) & 1).to_le_bytes());
    }
    put(data, 60, &i32_at(data, 60).rem_euclid(5).to_le_bytes());
    for count in [76, 80, 84] {
        put(data, count, &i32_at(data, count).clamp(0, 64).to_le_bytes());
    }
    let mut end = TM25_PREAMBLE;
    for _ in 0..i32_at(data, 76) {
        let points = i32_at(data, end).clamp(1, 8);
        put(data, end, &points.to_le_bytes());
        end += 4 + 8 * points as usize;
    }
    let flags: Vec<i32> = (264..288).step_by(4).map(|at| i32_at(data, at)).collect();
    let columns: i32 = flags.iter().zip([1, 1, 1, 6, 2, 1]).map(|(flag, width)| flag * width).sum();
    let start = end.next_multiple_of(32) + 512 * i32_at(data, 80) as usize + i32_at(data, 84) as usize;
    Some((start, 4 * (6 + columns + i32_at(data, 80)) as usize, 0))
}

/// A direction of length 1 at byte 12 of a record, and no negative flux at `flux`.
fn light(ray: &mut [u8], flux: usize) {
    let direction = [12, 16, 20].map(|at| f32_at(ray, at));
    let length = direction.iter().map(|value| value * value).sum::<f32>().sqrt();
    let unit = if length.is_normal() { direction.map(|value| value / length) } else { [0.0, 0.0, 1.0] };
    for (at, value) in [12, 16, 20].into_iter().zip(unit) {
        put(ray, at, &value.to_le_bytes());
    }
    put(ray, flux, &f32_at(ray, flux).abs().to_le_bytes());
}

/// The words by which content is known, put back at the start where a mutation took them away.
fn prefix(kind: Kind, data: &mut [u8], size: usize, max_size: usize) -> usize {
    let words: &[u8] = match kind {
        Kind::LightToolsText => b"lt_rdf_version: 2.0\n",
        Kind::ProSourceText => b"# NbrRays Requested: 3,  NbrRays Generated: 3\n",
        _ => return size,
    };
    if size + words.len() > max_size || data[..size].windows(words.len()).any(|found| found == words) {
        return size;
    }
    data.copy_within(..size, words.len());
    put(data, 0, words);
    size + words.len()
}
