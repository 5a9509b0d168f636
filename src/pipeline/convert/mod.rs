//! One ray file as another: every usable ray, in its order, in W or lm by the rule of totals of the format it came in.
//!
//! What the target cannot hold is one of two things. Where two different rays would become the same (a spectrum per ray in a
//! Zemax file), the answer is no. Where something beside the rays is lost that users keep elsewhere (one spectrum for all
//! rays, the second of two fluxes), it is a notice.

/// What stands before the rays of a TM-25 file.
mod tm25;
/// What stands before the rays of a Zemax file.
mod zemax;
#[cfg(test)]
mod tests;
/// Texts and totals that a converted file takes from its source, whatever its format.
mod labels;

use crate::error::Error;
use crate::formats::record::{CHUNK_RAYS, Format, RawRay};
use crate::formats::writer::{Encode, Writer};
use crate::options::RaysOptions;
use crate::rays::check::Checked;
use crate::rays::{Input, chunks};
use crate::source::{Channel, Source};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::{Notice, Notices};
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::StageWatch;
use std::io;
use std::io::Write;

/// Formats we write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// IES TM-25-13.
    Tm25,
    /// Zemax / OpticStudio binary.
    ZemaxBinary,
}

/// What became of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Converted {
    /// The format it was in.
    pub format: Format,
    /// Rays it held.
    pub rays_read: u64,
    /// Rays written: all but those that cannot be used.
    pub rays_written: u64,
    /// Flux of the usable rays, by the rule of totals.
    pub flux_in: Flux,
    /// Sum of the numbers written; `None` for a quantity the rows do not hold.
    pub flux_out: Flux,
    /// What was odd about the file, and what the target does not hold.
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

/// Writes `input` to `out` as a file of format `target`. Reads the rays twice: the count and the totals stand before them.
///
/// # Errors
/// As [`crate::source::Source::read`]; `convert.number_too_large`, `convert.table_too_fine`, `zemax.color_per_ray`, `zemax.too_many_rays`;
/// what `out` answers. `out` then holds a part of a
/// file, or nothing.
pub fn convert(
    input: &Input,
    target: Target,
    limits: &Limits,
    out: &mut dyn Write,
    watch: StageWatch<'_>,
) -> Result<Converted, Failed> {
    let source = Source::read(std::slice::from_ref(input), &RaysOptions::default(), limits, watch.part(0.0, 0.4))?;
    let mut notices = Notices::default();
    notices.merge(&source.notices);
    let Some(channel) = source.channels.first() else {
        return Err(Error::unusable("rays.no_input", "inputs", "No ray file was given.", "Name one.").into());
    };
    let watch = watch.part(0.4, 1.0);
    let flux_out = match target {
        Target::Tm25 => {
            let preamble = tm25::preamble(input, channel, &mut notices)?;
            let sums = copy(channel, Writer::<crate::formats::tm25::writer::Rows>::start(out, &preamble)?, watch)?;
            let flags = preamble.header.flags;
            Flux { radiant_w: flags.radiant.then_some(sums[0]), luminous_lm: flags.luminous.then_some(sums[1]) }
        }
        Target::ZemaxBinary => {
            let header = zemax::header(input, channel, &mut notices)?;
            let sums = copy(channel, Writer::<crate::formats::zemax::writer::Rows>::start(out, &header)?, watch)?;
            let luminous = header.rows == crate::formats::zemax::writer::Rows::Luminous;
            Flux { radiant_w: (!luminous).then_some(sums[0]), luminous_lm: luminous.then_some(sums[1]) }
        }
    };
    Ok(Converted {
        format: channel.facts().format,
        rays_read: source.survey.rays_read,
        rays_written: source.survey.rays_used,
        flux_in: source.flux,
        flux_out,
        notices: notices.to_vec(),
    })
}

/// All usable rays of `channel`, in order; the sums of the W and of the lm, as rounded for the file.
fn copy<R: Encode + Copy>(channel: &Channel, writer: Writer<'_, R>, watch: StageWatch<'_>) -> Result<[f64; 2], Failed> {
    let rows = writer.rows();
    let chunk_rays = CHUNK_RAYS as u64;
    let ray_count = channel.facts().ray_count;
    let mut unwritten = None;
    let copied = chunks::in_order(
        ray_count.div_ceil(chunk_rays),
        watch,
        (writer, [0.0; 2]),
        Vec::new,
        |raws: &mut Vec<RawRay>, chunk| {
            let first = chunk * chunk_rays;
            let count = chunk_rays.min(ray_count - first) as usize;
            let mut encoded = Vec::with_capacity(count * rows.row_bytes());
            let mut sums = [0.0; 2];
            channel.usable(first, count, raws, |index, raw, checked| {
                let ray = scaled(raw, checked);
                held(&ray).then_some(()).ok_or_else(|| too_large(index))?;
                sums[0] += f64::from(ray.radiant as f32);
                sums[1] += f64::from(ray.luminous as f32);
                rows.encode_ray(&ray, &mut encoded);
                Ok(())
            })?;
            Ok((encoded, sums))
        },
        |(writer, whole), (encoded, part)| {
            whole.iter_mut().zip(part).for_each(|(sum, more)| *sum += more);
            // Whatever stops the work: the stream's own answer is the one told.
            writer.write(&encoded).map_err(|error| {
                unwritten = Some(error);
                Error::Cancelled
            })
        },
    );
    if let Some(error) = unwritten {
        return Err(Failed::Write(error));
    }
    let (writer, sums) = copied?;
    writer.finish()?;
    Ok(sums)
}

/// The ray in W and lm. A direction that is a unit vector but for rounding stays as it was stored.
fn scaled(raw: &RawRay, checked: &Checked) -> RawRay {
    RawRay {
        direction: if checked.normalized { checked.direction.to_array() } else { raw.direction },
        radiant: checked.flux[0],
        luminous: checked.flux[1],
        xz: checked.xz_lm,
        ..*raw
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
