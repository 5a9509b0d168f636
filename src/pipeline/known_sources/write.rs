//! Known sources as TM-25 files: a seed and a count make the same bytes everywhere.

use super::KnownSource;
use super::catalogue::by_name;
use crate::error::Error;
use crate::formats::record::{CHUNK_RAYS, RawRay};
use crate::formats::tm25::Preamble;
use crate::formats::tm25::additional::Additional;
use crate::formats::tm25::header::{Flags, Header, SpectralId};
use crate::formats::tm25::spectra::Spectra;
use crate::formats::tm25::writer::Writer;
use crate::formats::writer::Encode;
use crate::rays::chunks;
use crate::vocabulary::spectrum::wider;
use crate::vocabulary::watch::{NoProgress, Stage, StageWatch};
use std::io;
use std::io::Write;

/// Name of the known source that is shown to who has no ray file at hand.
pub const SAMPLE: &str = "four-chips";
/// Its rays, and their seed.
const SAMPLE_RAYS: u64 = 200_000;
const SAMPLE_SEED: u64 = 1;

/// Writes the sample: the same bytes each time, 6.4 MB.
///
/// # Errors
/// What `out` answers.
pub fn write_sample(out: &mut dyn Write) -> io::Result<()> {
    let source = by_name(SAMPLE).ok_or_else(|| io::Error::other("the sample is no known source"))?;
    write_tm25(&source, SAMPLE_RAYS, SAMPLE_SEED, out)
}

/// Writes `rays` rays of `source`: 28 bytes each with one spectral table where all parts have the same spectrum, 32 bytes
/// with a wavelength per ray otherwise. Memory does not grow with `rays`.
///
/// # Errors
/// What `out` answers.
pub fn write_tm25(source: &KnownSource, rays: u64, seed: u64, out: &mut dyn Write) -> io::Result<()> {
    let mut writer = Writer::start(out, &preamble(source, rays, seed))?;
    let rows = writer.rows();
    let chunk_rays = CHUNK_RAYS as u64;
    let written = StageWatch::enter(&NoProgress, Stage::Rays).and_then(|watch| {
        chunks::in_order(
            rays.div_ceil(chunk_rays),
            watch,
            &mut writer,
            Vec::new,
            |raws: &mut Vec<RawRay>, chunk| {
                let first = chunk * chunk_rays;
                let count = (rays - first).min(chunk_rays) as usize;
                raws.clear();
                source.rays(seed, rays, first, count, raws);
                let mut encoded = Vec::with_capacity(count * rows.row_bytes());
                raws.iter().for_each(|ray| rows.encode(ray, &[], &mut encoded));
                Ok(encoded)
            },
            |writer, encoded| Ok(writer.write(&encoded)?),
        )
        .map(|_| ())
    });
    match written {
        Ok(()) => writer.finish(),
        Err(Error::Unreadable(error)) => Err(error),
        Err(other) => Err(io::Error::other(other)),
    }
}

/// Bytes of the file that [`write_tm25`] writes.
///
/// # Errors
/// As [`write_tm25`].
pub fn tm25_bytes(source: &KnownSource, rays: u64) -> io::Result<u64> {
    let mut head = Vec::new();
    let row_bytes = Writer::start(&mut head, &preamble(source, rays, 1))?.rows().row_bytes() as u64;
    Ok(head.len() as u64 + rays.saturating_mul(row_bytes))
}

fn preamble(source: &KnownSource, ray_count: u64, seed: u64) -> Preamble {
    let tables: Vec<_> = source.parts().iter().map(|part| part.glow.points()).collect();
    let one = source.has_one_spectrum();
    let range = source.parts().iter().fold(None, |range, part| wider(range, Some(part.glow.table().range_nm())));
    let mut texts: [String; 9] = Default::default();
    texts[0] = source.name.to_owned();
    texts[4] = format!("lampwright {}", env!("CARGO_PKG_VERSION"));
    texts[7] = format!("{} Seed {seed}.", source.description);
    let header = Header {
        luminous_lm: Some(source.luminous_lm()),
        radiant_w: Some(source.radiant_w()),
        ray_count,
        spectral_id: if one { SpectralId::OneTable } else { SpectralId::PerRay },
        range_nm: [range.map(|range| range.0), range.map(|range| range.1)],
        flags: Flags { radiant: true, wavelength: !one, ..Flags::default() },
        texts,
        ..Header::default()
    };
    let single = |points: &[(f64, f64)]| points.iter().map(|(nm, weight)| (*nm as f32, *weight as f32)).collect();
    let spectra = if one { tables.first().map(|points| single(points)).into_iter().collect() } else { Vec::new() };
    Preamble::new(header, Spectra::new(spectra), Additional::default())
}
