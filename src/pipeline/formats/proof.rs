//! Proof by size and by directions that a file has the layout its header promises.

use super::bytes::f32_in;
use super::record::Bytes;
use crate::error::Error;
use crate::vocabulary::limits::Limits;
use glam::DVec3;

/// Largest error of a direction's length that is still rounding of a writer (`pipeline/formats/README.md` 7).
pub const LENGTH_TOLERANCE: f64 = 1e-3;
/// How many of the first rays are looked at to prove a layout that is not the standard's.
const PROOF_RAYS: u64 = 64;

/// Refuses a file with more rays than the limit.
///
/// # Errors
/// `rays.too_many`.
pub fn count(ray_count: u64, limits: &Limits) -> Result<(), Error> {
    if ray_count <= limits.max_rays {
        return Ok(());
    }
    let found = format!("The file holds {ray_count} rays; {} are allowed.", limits.max_rays);
    Err(Error::refused("rays.too_many", found, "Thin the file out, or raise the limit."))
}

/// Whether a direction has unit length, but for a writer's rounding.
pub fn is_unit(direction: [f64; 3]) -> bool {
    (DVec3::from_array(direction).length() - 1.0).abs() <= LENGTH_TOLERANCE
}

/// The three f32 from byte `at` of a record are a direction.
pub fn is_unit_at(record: &[u8], at: usize) -> bool {
    is_unit([0, 4, 8].map(|k| f64::from(f32_in(record, at + k))))
}

/// Most of the first directions are unit vectors when records of `record_bytes` start at byte `start` with a position and a
/// direction in f32. A file cut short can have the length of another layout by accident, but not its directions.
///
/// # Errors
/// [`Error::Unreadable`].
pub fn directions_hold(bytes: &dyn Bytes, start: u64, record_bytes: u64, ray_count: u64) -> Result<bool, Error> {
    let looked = ray_count.min(PROOF_RAYS) as usize;
    let mut block = vec![0; looked * record_bytes as usize];
    bytes.read_at(start, &mut block)?;
    let held = block.chunks_exact(record_bytes as usize).filter(|record| is_unit_at(record, 12)).count();
    Ok(looked > 0 && 10 * held >= 9 * looked)
}

/// Most bytes that a header is padded with beyond its layout.
const MOST_PADDING: u64 = 64 << 10;

/// Where `ray_count` records that end with the file begin, if a writer has padded the header beyond its layout: from byte `from` there
/// is nothing but zeros before them, and their directions hold. `least` is where they would begin without.
///
/// # Errors
/// [`Error::Unreadable`].
pub fn counted_back(
    bytes: &dyn Bytes,
    from: u64,
    least: u64,
    record_bytes: u64,
    ray_count: u64,
) -> Result<Option<u64>, Error> {
    let start = ray_count.checked_mul(record_bytes).and_then(|body| bytes.len().checked_sub(body));
    let Some(start) = start.filter(|start| *start > least && *start - from <= MOST_PADDING) else { return Ok(None) };
    let mut padding = vec![0; (start - from) as usize];
    bytes.read_at(from, &mut padding)?;
    let zeros = padding.iter().all(|byte| *byte == 0);
    Ok((zeros && directions_hold(bytes, start, record_bytes, ray_count)?).then_some(start))
}
