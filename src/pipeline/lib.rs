//! Rays in, model and artifacts out. Pure: no disk, no clock, no network, no async; bytes come from a reader it is
//! handed, randomness from a seed, parallelism from rayon's ambient pool. `README.md` has the conventions.
//!
//! Reading order is the order of the flow; each module may name only those above it (`tests/architecture`).

/// What can go wrong, in three kinds: malformed, refused, asked for wrongly.
mod error;
/// Words that at least two stages speak.
pub mod vocabulary;
/// Everything a caller may choose: ranges, defaults, and how a choice is echoed in the report.
pub mod options;
/// How a file is written: numbers, JSON, drawings.
mod writing;
/// Ray files as vendors write them, each read into the same stored rays.
pub mod formats;
/// 1. Files to rays.
pub mod rays;
/// Known sources with closed-form answers.
pub mod known_sources;
/// What can be said of a file before a model is made of it.
pub mod inspection;
/// Several ray sets become one source; the only way to its rays.
pub mod source;
/// One ray file as another.
pub mod convert;
/// 2. Rays to a surface.
pub mod hull;
/// Smoothing as far as the rays do not support what was counted.
mod smoothing;
/// 3. Rays onto the surface.
pub mod flux;
/// 4. Flux to angles.
pub mod goniogram;
/// Light that starts in a volume.
pub mod volume;
/// 5. What a renderer needs: the radiance of a point and a direction.
pub mod model;
/// Where the light is put, by rays held out.
pub mod candidates;
/// 6. Results to files.
pub mod artifacts;
/// Models changed, and several as one, without their rays.
pub mod combination;
/// As many new rays of a model as are wanted.
pub mod new_rays;
/// A model evaluated without noise: intensity, irradiance, radiance.
pub mod evaluation;
/// A model as a renderer opens it.
pub mod adapters;
/// What a run needs of the machine.
pub mod memory;

pub use adapters::{Adapted, Renderer, adapt};
pub use artifacts::read::{FILES as MODEL_FILES, StoredModel, check_size as check_model_size, read as read_model};
pub use combination::{Change, Component, MOST_MODELS, Strength, Turn};
pub use convert::{Failed, Target};
pub use error::{Error, Fault, Place};
pub use evaluation::{
    Camera, Form as EvaluationForm, Kind as LightKind, MOST_NUMBERS, Plane, Request as EvaluationRequest, TOLERANCE,
    Vector, View, Width,
};
pub use formats::packed::{Content, Member, Packing, left_out, no_ray_file, packing, unpack};
pub use formats::record::{Bytes, Format};
pub use formats::spectrum_file::{MAX_BYTES as MAX_SPECTRUM_BYTES, SpectrumFile};
pub use formats::{MODEL as MODEL_GIVEN, model as model_given};
pub use inspection::drawings::NAMES as DRAWINGS;
pub use inspection::findings::{Check, Header, Inspection, Verdict};
pub use known_sources::{SAMPLE, write_sample};
pub use memory::MemoryNeed;
pub use new_rays::{MOST_RAYS as MOST_NEW_RAYS, NewRays, RayFile, Request as RayRequest};
pub use options::{Emission, IesEdition, Options, Spectra};
pub use rays::Input;
pub use source::channels::Claims;
pub use vocabulary::declaration::{Column, Declared, FluxOverride, Total};
pub use vocabulary::limits::Limits;
pub use vocabulary::notice::Notice;
pub use vocabulary::number::count;
pub use vocabulary::space::Axis;
pub use vocabulary::spectrum::Table;
pub use vocabulary::units::{LengthUnit, Quantity};
pub use vocabulary::watch::{NoProgress, Stage, Watch};
pub use writing::Artifact;

use source::Source;
use std::io::Write;
use std::ops::Range;
use vocabulary::watch::StageWatch;

/// Part of the hull's progress that the choice of its surface is.
const CHOICE: f64 = 0.8;

/// What a run gives back.
#[derive(Debug)]
pub struct Outcome {
    /// The model itself.
    pub model: model::Model,
    /// The files, in the order of the zip; the zip itself is [`artifacts::zip`]'s.
    pub artifacts: Vec<Artifact>,
    /// Everything a user should be told, those of writing the files included.
    pub notices: Vec<Notice>,
}

/// The whole flow. `inputs` are the ray sets of one source, in one frame.
///
/// # Errors
/// [`Error`]: malformed or refused input, unusable options, cancelled by the watcher, or unreadable bytes.
pub fn run(inputs: &[Input], options: &Options, limits: &Limits, watch: &dyn Watch) -> Result<Outcome, Error> {
    options.validate()?;
    let source = Source::read(inputs, &options.rays, limits, StageWatch::enter(watch, Stage::Rays)?)?;
    let hull_stage = StageWatch::enter(watch, Stage::Hull)?;
    let chosen = candidates::choose(&source, options, limits, hull_stage.part(0.0, CHOICE))?;
    let cloud = hull::Cloud::new(&source, chosen.carrier);
    let sample = chosen.sample.whole(&source);
    // Of few lines that are repeated very often, none may be in the sample.
    let pilot = (!sample.rays.is_empty()).then(|| hull::Cloud::sampled(&source, &sample, chosen.carrier));
    let model = model::Model::build(&cloud, pilot.as_ref(), options, limits, |stage| match stage {
        Stage::Hull => Ok(hull_stage.part(CHOICE, 1.0)),
        stage => StageWatch::enter(watch, stage),
    })?;
    written(model.with_study(chosen.study), options, watch)
}

/// The model that others are together, each changed, and its files; without the rays that they were made of.
///
/// # Errors
/// As [`combination::combine`] and [`artifacts::write`].
pub fn combine(
    components: &[Component],
    options: &Options,
    limits: &Limits,
    watch: &dyn Watch,
) -> Result<Outcome, Error> {
    let model = combination::combine(components, limits, StageWatch::enter(watch, Stage::Model)?)?;
    written(model, options, watch)
}

/// A model with its files.
fn written(model: model::Model, options: &Options, watch: &dyn Watch) -> Result<Outcome, Error> {
    let artifacts = artifacts::write(&model, options, StageWatch::enter(watch, Stage::Artifacts)?)?;
    let notices = model.notices.iter().cloned().chain(artifacts::notices(&model).to_vec()).collect();
    Ok(Outcome { model, artifacts, notices })
}

/// Judges a file by its first bytes, so that an upload need not end to be refused. `length`: its full length, where known.
/// `Some`: so far a file of this format; `None`: too few bytes to tell.
///
/// # Errors
/// [`Error::Malformed`] or [`Error::Refused`] only where the bytes at hand prove it.
pub fn peek(prefix: &[u8], length: Option<u64>, limits: &Limits) -> Result<Option<Format>, Error> {
    formats::peek(prefix, length, limits)
}

/// What a file says of itself; reads no ray.
///
/// # Errors
/// [`Error::Malformed`], [`Error::Refused`], [`Error::Unreadable`].
pub fn header(input: &Input, limits: &Limits) -> Result<Header, Error> {
    inspection::header(input, limits)
}

/// Whether files can be one source, as their headers tell: what [`run`] would refuse before it reads a ray. Each file is its
/// name, its SHA-256, what its header claims and what was declared of it. The answer is what [`run`] would tell of them together.
///
/// # Errors
/// [`Error::Refused`], [`Error::Unusable`], at the channel and the field.
pub fn judge(files: &[(&str, &str, &Claims, &Declared)], total: Option<Total>) -> Result<Vec<Notice>, Error> {
    source::channels::judge_claims(files, total).map(|notices| notices.to_vec())
}

/// Most memory that [`run`] is expected to need on `threads` threads; the files by what their headers claim and what was
/// declared of them.
pub fn memory(files: &[(&Claims, &Declared)], options: &Options, threads: usize) -> MemoryNeed {
    memory::estimate(files, options, threads)
}

/// Reads a spectrum file.
///
/// # Errors
/// [`Error::Malformed`], [`Error::Refused`].
pub fn spectrum(bytes: &[u8]) -> Result<SpectrumFile, Error> {
    formats::spectrum(bytes)
}

/// Reads a file once and tells what is in it: what users want to know before they want the model.
///
/// # Errors
/// As [`header`]; [`Error::Cancelled`].
pub fn inspect(input: &Input, limits: &Limits, watch: &dyn Watch) -> Result<Inspection, Error> {
    inspection::inspect(input, limits, StageWatch::enter(watch, Stage::Rays)?)
}

/// Small drawings of what an inspection found, `origins.svg` and `far-field.svg`; none where no ray can be used. `name` is the
/// file's.
pub fn drawings(inspection: &Inspection, name: &str) -> Vec<Artifact> {
    inspection::drawings::artifacts(inspection, name)
}

/// Refuses a request that no model could answer, or whose answer has no such form.
///
/// # Errors
/// [`Error::Unusable`].
pub fn check_evaluation(request: &EvaluationRequest, form: EvaluationForm) -> Result<(), Error> {
    request.check()?;
    form.check(&request.view)
}

/// Refuses a request that `model` cannot answer; which light it is evaluated in.
///
/// # Errors
/// As [`evaluate`].
pub fn check_evaluation_of(
    model: &StoredModel,
    request: &EvaluationRequest,
    form: EvaluationForm,
) -> Result<LightKind, Error> {
    form.check(&request.view)?;
    evaluation::check(model, request)
}

/// Evaluates a model and writes the answer.
///
/// # Errors
/// [`Error::Unusable`] for a request that cannot be answered or written; [`Error::Refused`] for one that is too large; [`Error::Cancelled`].
pub fn evaluate(
    model: &StoredModel,
    request: &EvaluationRequest,
    form: EvaluationForm,
    watch: &dyn Watch,
) -> Result<Artifact, Error> {
    evaluation::evaluate(model, &model.name, request, StageWatch::enter(watch, Stage::Model)?)?.write(form)
}

/// Writes these bytes of a file of new rays: parts one after another are the whole.
///
/// # Errors
/// [`Error::Cancelled`]; what `out` answers.
pub fn write_new_rays(
    rays: &NewRays<'_>,
    bytes: Range<u64>,
    out: &mut dyn Write,
    watch: &dyn Watch,
) -> Result<(), Failed> {
    rays.write(bytes, out, StageWatch::enter(watch, Stage::Rays)?)
}
