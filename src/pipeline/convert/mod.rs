//! Ray files as another one: every usable ray, in its order, in W or lm by the rule of totals of the format it came in and by what
//! was declared; several files of one source one after another; on request a random part of the rays, or all in random order.
//!
//! What the target cannot hold is one of two things. Where two different rays would become the same (a spectrum per ray in a
//! Zemax file), the answer is no. Where something beside the rays is lost that users keep elsewhere (one spectrum for all
//! rays, the second of two fluxes), it is a notice.

/// Where a file is written.
mod place;
/// Numbers that look like chance and follow from a seed.
mod chance;
/// What the rays of all channels carry together.
mod light;
/// What stands before the rays of a TM-25 file.
mod tm25;
/// What stands before the rays of a Zemax file.
mod zemax;
/// What stands before the rays of a LightTools file.
mod lighttools;
/// A random part of the rays.
mod selection;
/// Rows in random order, in bounded memory.
mod shuffle;
#[cfg(test)]
mod tests;

pub use place::Place;
pub use selection::Take;

use crate::error::Error;
use crate::formats::record::{CHUNK_RAYS, Format, RawRay};
use crate::formats::writer::{Encode, Writer};
use crate::formats::{lighttools::writer as to_lighttools, tm25::writer as to_tm25, zemax::writer as to_zemax};
use crate::options::RaysOptions;
use crate::rays::{Input, chunks};
use crate::source::{Channel, Source};
use crate::vocabulary::declaration::Total;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::{Notice, Notices};
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::StageWatch;
use light::Light;
use selection::{Chooser, Sums};
use shuffle::{PART_BYTES, Shuffle};
use std::io;

/// Formats we write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// IES TM-25-13.
    Tm25,
    /// Zemax / OpticStudio binary.
    ZemaxBinary,
    /// LightTools binary, version 2.
    LightToolsBinary,
}

/// What to write.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// The format.
    pub target: Target,
    /// Total of which every channel has a share.
    pub total: Option<Total>,
    /// A random part of the rays instead of all.
    pub take: Option<Take>,
    /// Random order, by this seed, instead of their own.
    pub shuffle: Option<u64>,
}

impl Wanted {
    /// All rays in their order.
    pub fn all(target: Target) -> Wanted {
        Wanted { target, total: None, take: None, shuffle: None }
    }
}

/// What became of the files.
#[derive(Clone, Debug, PartialEq)]
pub struct Converted {
    /// The formats they were in.
    pub formats: Vec<Format>,
    /// Rays they held.
    pub rays_read: u64,
    /// Rays that can be used.
    pub rays_used: u64,
    /// Rays written: the usable ones, or the part of them that was wanted.
    pub rays_written: u64,
    /// Flux of the usable rays, by the rule of totals.
    pub flux_in: Flux,
    /// Sum of the numbers written; `None` for a quantity the rows do not hold.
    pub flux_out: Flux,
    /// What was odd about the files, and what the target does not hold.
    pub notices: Vec<Notice>,
}

/// Why there is no file.
#[derive(Debug)]
pub enum Failed {
    /// The input, or that the target cannot hold it.
    Read(Error),
    /// What the stream answered.
    Write(io::Error),
}

impl From<Error> for Failed {
    fn from(error: Error) -> Failed {
        Failed::Read(error)
    }
}

impl From<io::Error> for Failed {
    fn from(error: io::Error) -> Failed {
        Failed::Write(error)
    }
}

/// Writes the light of `inputs`, the channels of one source, to `out` as a file of format `wanted.target`. Reads the rays twice: the
/// count and the totals stand before them; three times where a part of them is taken.
///
/// # Errors
/// As [`Source::read`]; `convert.spectra_differ`, `convert.number_too_large`, `convert.table_too_fine`, `convert.take_too_many`,
/// `convert.take_too_few`, `zemax.color_per_ray`, `zemax.too_many_rays`, `lighttools.color_per_ray`; what `out` answers. `out` then holds
/// a part of a file, or nothing.
pub fn convert(
    inputs: &[Input],
    wanted: &Wanted,
    limits: &Limits,
    out: &mut dyn Place,
    watch: StageWatch<'_>,
) -> Result<Converted, Failed> {
    let options = RaysOptions { total: wanted.total, ..RaysOptions::default() };
    let source = Source::read(inputs, &options, limits, watch.part(0.0, 0.4))?;
    let mut notices = Notices::default();
    notices.merge(&source.notices);
    let mut light = Light::of(inputs, &source)?;
    let part = wanted.take.map_or(Ok(None), |take| choose(&light, take, watch.part(0.4, 0.7)).map(Some))?;
    light.ray_count = wanted.take.map_or(light.ray_count, |take| take.rays);
    let order = Order { light: &light, part: part.as_ref(), shuffle: wanted.shuffle };
    let watch = watch.part(if part.is_some() { 0.7 } else { 0.4 }, 1.0);
    let flux_out = match wanted.target {
        Target::Tm25 => {
            let preamble = tm25::preamble(&light, &mut notices)?;
            let rows = to_tm25::Writer::start(out, &preamble)?.rows();
            let flags = preamble.header.flags;
            order.write(out, rows, watch)?.of(flags.radiant, flags.luminous)
        }
        Target::ZemaxBinary => {
            let header = zemax::header(&light, &mut notices)?;
            let rows = to_zemax::Writer::start(out, &header)?.rows();
            let luminous = rows == to_zemax::Rows::Luminous;
            order.write(out, rows, watch)?.of(!luminous, luminous)
        }
        Target::LightToolsBinary => {
            let header = lighttools::header(&light, &mut notices)?;
            let rows = to_lighttools::Writer::start(out, &header)?.rows();
            order.write(out, rows, watch)?.of(!rows.luminous, rows.luminous)
        }
    };
    Ok(Converted {
        formats: source.channels.iter().map(|channel| channel.facts().format).collect(),
        rays_read: source.survey.rays_read,
        rays_used: source.survey.rays_used,
        rays_written: light.ray_count,
        flux_in: source.flux,
        flux_out,
        notices: notices.to_vec(),
    })
}

/// A part of the rays that was chosen.
struct Part {
    /// What stands before each chunk of rays.
    before: Vec<Chooser>,
    /// Factors of W and lm, for each channel.
    factors: Vec<[f64; 2]>,
}

/// One pass in which nothing is kept but sums, and where the choice stands at each chunk.
fn choose(light: &Light<'_>, take: Take, watch: StageWatch<'_>) -> Result<Part, Error> {
    selection::judge(take, light)?;
    let chunks = Chunks(light.channels);
    let start = (Chooser::new(take, light.ray_count), Vec::new(), vec![Sums::default(); light.channels.len()]);
    let (_, before, sums) = chunks::in_order(
        chunks.count(),
        watch,
        start,
        Vec::new,
        |raws: &mut Vec<RawRay>, chunk| {
            let (index, channel, first, count) = chunks.at(chunk);
            let mut fluxes = Vec::with_capacity(count);
            channel.usable(first, count, raws, |_, _, checked| {
                fluxes.push(checked.flux);
                Ok(())
            })?;
            Ok((index, fluxes))
        },
        |(chooser, before, sums), (index, fluxes)| {
            before.push(*chooser);
            for flux in fluxes {
                let taken = f64::from(u8::from(chooser.next()));
                for (k, flux) in flux.into_iter().enumerate() {
                    sums[index].all[k] += flux;
                    sums[index].taken[k] += taken * flux;
                }
            }
            Ok(())
        },
    )?;
    selection::judge_taken(light, &sums)?;
    Ok(Part { before, factors: sums.iter().map(Sums::factors).collect() })
}

/// The chunks of all channels, one channel after another.
struct Chunks<'c>(&'c [Channel]);

impl<'c> Chunks<'c> {
    fn of(channel: &Channel) -> u64 {
        channel.facts().ray_count.div_ceil(CHUNK_RAYS as u64)
    }

    fn count(&self) -> u64 {
        self.0.iter().map(Chunks::of).sum()
    }

    /// The channel of chunk `chunk`, by its place too; its first record there, and how many.
    fn at(&self, mut chunk: u64) -> (usize, &'c Channel, u64, usize) {
        let mut index = 0;
        while index + 1 < self.0.len() && chunk >= Chunks::of(&self.0[index]) {
            chunk -= Chunks::of(&self.0[index]);
            index += 1;
        }
        let channel = &self.0[index];
        let first = chunk * CHUNK_RAYS as u64;
        (index, channel, first, (channel.facts().ray_count - first).min(CHUNK_RAYS as u64) as usize)
    }
}

/// Which rays are written, and in which order.
struct Order<'a> {
    light: &'a Light<'a>,
    part: Option<&'a Part>,
    shuffle: Option<u64>,
}

/// Sums of W and lm, as rounded for the file.
struct Written([f64; 2]);

impl Written {
    fn of(&self, radiant: bool, luminous: bool) -> Flux {
        let Written([watt, lumen]) = *self;
        Flux { radiant_w: radiant.then_some(watt), luminous_lm: luminous.then_some(lumen) }
    }
}

impl Order<'_> {
    /// The rows of the rays to `out`, which has the header already.
    fn write<R: Encode + Copy>(&self, out: &mut dyn Place, rows: R, watch: StageWatch<'_>) -> Result<Written, Failed> {
        let ray_count = self.light.ray_count;
        match self.shuffle {
            None => {
                let mut writer = Writer::announced(out, rows, ray_count);
                let written = self.copy(rows, |encoded| writer.write(encoded), watch)?;
                writer.finish()?;
                Ok(written)
            }
            Some(seed) => {
                let mut shuffle = Shuffle::start(out, ray_count, rows.row_bytes(), seed, PART_BYTES)?;
                let written = self.copy(rows, |encoded| shuffle.write(encoded), watch)?;
                shuffle.finish(rows.end())?;
                Ok(written)
            }
        }
    }

    /// All rays that are wanted, in their order.
    fn copy<R: Encode + Copy>(
        &self,
        rows: R,
        mut put: impl FnMut(&[u8]) -> io::Result<()>,
        watch: StageWatch<'_>,
    ) -> Result<Written, Failed> {
        let chunks = Chunks(self.light.channels);
        let mut unwritten = None;
        let copied = chunks::in_order(
            chunks.count(),
            watch,
            [0.0; 2],
            Vec::new,
            |raws, chunk| self.encoded(&chunks, chunk, rows, raws),
            |whole, (encoded, part)| {
                whole.iter_mut().zip(part).for_each(|(sum, more)| *sum += more);
                // Whatever stops the work: the stream's own answer is the one told.
                put(&encoded).map_err(|error| {
                    unwritten = Some(error);
                    Error::Cancelled
                })
            },
        );
        match unwritten {
            Some(error) => Err(Failed::Write(error)),
            None => Ok(Written(copied?)),
        }
    }

    /// The rows of one chunk, and what they sum to.
    fn encoded<R: Encode>(
        &self,
        chunks: &Chunks<'_>,
        chunk: u64,
        rows: R,
        raws: &mut Vec<RawRay>,
    ) -> Result<(Vec<u8>, [f64; 2]), Error> {
        let (index, channel, first, count) = chunks.at(chunk);
        let mut chooser = self.part.and_then(|part| part.before.get(chunk as usize)).copied();
        let factors = self.part.and_then(|part| part.factors.get(index)).copied();
        let mut encoded = Vec::with_capacity(count * rows.row_bytes());
        let mut sums = [0.0; 2];
        channel.usable(first, count, raws, |record, raw, checked| {
            if chooser.as_mut().is_some_and(|chooser| !chooser.next()) {
                return Ok(());
            }
            let mut ray = self.light.ray(index, raw, checked);
            if let Some([radiant, luminous]) = factors {
                ray.radiant *= radiant;
                ray.luminous *= luminous;
                ray.xz = ray.xz.map(|value| value * luminous);
            }
            held(&ray).then_some(()).ok_or_else(|| too_large(record))?;
            sums[0] += f64::from(ray.radiant as f32);
            sums[1] += f64::from(ray.luminous as f32);
            rows.encode_ray(&ray, &mut encoded);
            Ok(())
        })?;
        Ok((encoded, sums))
    }
}

/// All its numbers are finite as binary32, which is what every target stores.
fn held(ray: &RawRay) -> bool {
    let [x, z] = ray.xz;
    let numbers = [ray.radiant, ray.luminous, ray.wavelength_nm, x, z];
    ray.origin_mm.into_iter().chain(numbers).all(|value| (value as f32).is_finite())
}

fn too_large(index: u64) -> Error {
    let found = "A position, flux or wavelength of a ray is too large for a 32-bit number.";
    Error::refused("convert.number_too_large", found, "Check the unit of the file.").at_ray(index)
}
