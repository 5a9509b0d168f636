//! What is known of a job before it is queued: whether its channels can be one source, what it will need, and what its
//! artifacts will follow from.

use super::error::Error;
use super::evaluation::{JobEvaluation, LightName, NewEvaluation};
use super::query::StoredArtifact;
use super::request::{Channel, NewJob, TotalFlux};
use crate::failure::StoredNotice;
use crate::hex::hex;
use crate::ray_sets::rows::LeftOut;
use crate::ray_sets::{inspections, rows};
use crate::storage::records::Records;
use crate::{spectra, storage};
use pipeline::{Claims, Declared, EvaluationRequest, MOST_NUMBERS};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// Names the computation that this build has: another one may give other bytes (`build.rs`).
pub const PIPELINE: &str = env!("LAMPWRIGHT_PIPELINE");

/// Memory of an evaluation: what a service has read anyway, for each byte of the model's files, and for each number with its bound and its text
/// (2 million bytes of files and 6.5 million numbers took 292 MiB as JSON and 720 MiB as CSV).
const BASE_BYTES: u64 = 64 << 20;
const BYTES_PER_MODEL_BYTE: u64 = 8;
const BYTES_PER_NUMBER: u64 = 128;
/// Bands of a model, which a request does not tell: an evaluation of more is refused when it would need more memory than was kept for it.
const BANDS: usize = 512;

/// What is known of a job before it is queued: its size, its need of memory and the digest of its content, from the headers of
/// its files.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JobPlan {
    /// Number of rays of all channels together.
    pub ray_count: u64,
    /// Length of the files of all channels together, bytes.
    pub byte_count: u64,
    /// Expected peak memory of the computation on [`JobPlan::memory_threads`] threads, bytes.
    pub memory_bytes: u64,
    /// Number of threads that [`JobPlan::memory_bytes`] is for.
    pub memory_threads: usize,
    /// Expected memory for each further thread, bytes.
    pub thread_bytes: u64,
    /// SHA-256 of everything its artifacts follow from, lower-case hex: equal for jobs that give the same bytes.
    pub content_sha256: Option<String>,
    /// What its channels are told of together before it is computed.
    pub notices: Vec<StoredNotice>,
}

/// Everything that artifacts follow from, in one form.
#[derive(Serialize)]
struct Content<'a> {
    pipeline: &'a str,
    channels: Vec<File<'a>>,
    /// Every choice, with the default in the place of what was left out.
    options: pipeline::Options,
    total: Option<pipeline::Total>,
}

/// A channel: the bytes of its file, the name that the artifacts tell, and what holds of it (the channel's word, else the
/// file's), the points of its spectrum included.
#[derive(Serialize)]
struct File<'a> {
    sha256: &'a str,
    name: &'a str,
    declared: &'a Declared,
    /// What was noticed of the file or its spectrum before: the artifacts tell it too.
    #[serde(skip_serializing_if = "Noticed::is_nothing")]
    noticed: Noticed<'a>,
}

#[derive(Serialize)]
struct Noticed<'a> {
    /// The packed file it came in, where something in it was left out.
    packed: Option<&'a str>,
    left_out: &'a [LeftOut],
    /// Of the uploaded spectrum, as its row has them.
    of_spectrum: Option<&'a str>,
}

impl Noticed<'_> {
    fn is_nothing(&self) -> bool {
        self.left_out.is_empty() && self.of_spectrum.is_none()
    }
}

struct ChannelSource {
    ray_set: rows::RaySet,
    claims: Claims,
    declared: Declared,
    /// Notices of the uploaded spectrum, where it has any.
    of_spectrum: Option<String>,
}

impl ChannelSource {
    fn noticed(&self) -> Noticed<'_> {
        let packed = self.ray_set.packed.as_ref().filter(|packed| !packed.left_out.is_empty());
        Noticed {
            packed: packed.map(|packed| packed.name.as_str()),
            left_out: packed.map_or(&[], |packed| &packed.left_out),
            of_spectrum: self.of_spectrum.as_deref(),
        }
    }
}

/// Checks a job that `tenant` requests and estimates it for a computation on `threads` threads.
///
/// # Errors
/// [`Error::MissingRaySet`], [`Error::MissingSpectrum`], [`Error::Unfit`], [`Error::Storage`].
pub async fn plan(records: &Records, tenant: &str, new: &NewJob, threads: usize) -> Result<JobPlan, Error> {
    let mut options = new.options.clone();
    options.validate()?;
    options.rays.total = new.total.map(TotalFlux::total);
    let mut known = Vec::new();
    for (index, channel) in new.channels.iter().enumerate() {
        known.push(look_up(records, tenant, index, channel, new.channels.len() > 1).await?);
    }
    let name = |known: &ChannelSource| known.declared.name.clone().unwrap_or_else(|| known.ray_set.name.clone());
    let names: Vec<String> = known.iter().map(name).collect();
    let files: Vec<_> = known
        .iter()
        .zip(&names)
        .map(|(known, name)| (name.as_str(), known.ray_set.sha256.as_str(), &known.claims, &known.declared))
        .collect();
    let notices = pipeline::judge(&files, options.rays.total)?;
    let claims: Vec<(&Claims, &Declared)> = known.iter().map(|known| (&known.claims, &known.declared)).collect();
    let memory = pipeline::memory(&claims, &options, threads);
    Ok(JobPlan {
        ray_count: claims.iter().map(|(claims, _)| claims.ray_count).sum(),
        byte_count: known.iter().map(|known| known.ray_set.byte_count).sum(),
        memory_bytes: memory.bytes,
        memory_threads: threads,
        thread_bytes: memory.thread_bytes,
        content_sha256: Some(digest(&known, &options)?),
        notices: notices.iter().map(StoredNotice::from).collect(),
    })
}

/// What is known of an evaluation before it is queued: `asked` of the two files of the model, and what that is to the computation.
///
/// # Errors
/// Never in practice: what was read can be written.
pub fn plan_evaluation(
    asked: &JobEvaluation,
    request: &EvaluationRequest,
    files: &[StoredArtifact; 2],
) -> Result<JobPlan, Error> {
    let byte_count: u64 = files.iter().map(|file| file.byte_count).sum();
    let digests = files.each_ref().map(|file| file.sha256.as_str());
    // The computation's own words, in which what was left out has its default; they are compared within one build only.
    let words = format!("{request:?}");
    let content = ("evaluation", PIPELINE, digests, &asked.job, asked.evaluation.format, words);
    let content = serde_json::to_vec(&content).map_err(unreadable)?;
    Ok(JobPlan {
        byte_count,
        memory_bytes: BASE_BYTES + BYTES_PER_MODEL_BYTE * byte_count + BYTES_PER_NUMBER * request.most_numbers as u64,
        memory_threads: 1,
        content_sha256: Some(hex(&Sha256::digest(content))),
        ..JobPlan::default()
    })
}

/// What a job computes for `asked`, of as many numbers as its memory is kept for.
///
/// # Errors
/// [`pipeline::Error`] for a request that no model could answer, and of more cells than [`MOST_NUMBERS`].
pub fn planned(asked: &NewEvaluation) -> Result<EvaluationRequest, pipeline::Error> {
    let request = asked.clone().request(MOST_NUMBERS, usize::MAX)?;
    pipeline::check_evaluation(&request, asked.format.form())?;
    let [columns, rows] = request.view.shape()?;
    let cells = columns.saturating_mul(rows);
    if cells > MOST_NUMBERS {
        let found = format!("The answer would have {cells} cells; a job computes at most {MOST_NUMBERS} numbers.");
        return Err(pipeline::Error::refused("evaluation.too_large", found, "Ask for fewer cells."));
    }
    let channels = match asked.light {
        Some(LightName::Spectrum) => BANDS,
        Some(LightName::Color) => 5,
        Some(LightName::Luminous | LightName::Radiant) | None => 1,
    };
    Ok(EvaluationRequest { most_numbers: cells.saturating_mul(channels).min(MOST_NUMBERS), ..request })
}

/// `several`: the channel is compared with others.
async fn look_up(
    records: &Records,
    tenant: &str,
    index: usize,
    channel: &Channel,
    several: bool,
) -> Result<ChannelSource, Error> {
    let ray_set = rows::get(records, tenant, &channel.ray_set).await?;
    let ray_set = ray_set.ok_or_else(|| Error::MissingRaySet(channel.ray_set.clone()))?;
    let spectrum = match channel.spectrum_id() {
        Some(id) => {
            let spectrum = spectra::get(records, tenant, id).await?;
            Some(spectrum.ok_or_else(|| Error::MissingSpectrum(id.to_owned()))?)
        }
        None => None,
    };
    let points = spectrum.as_ref().map(spectra::Spectrum::points).transpose()?;
    let of_spectrum = spectrum.map(|spectrum| spectrum.notices).filter(|notices| notices != "[]");
    let declared = channel.clone().or(&ray_set.declared).resolve(index, points.as_deref())?;
    let mut claims: Claims = serde_json::from_str(&ray_set.header).map_err(unreadable)?;
    // Other columns than it was looked at with have other numbers.
    let as_looked_at = channel.columns.as_ref().is_none_or(|own| Some(own) == ray_set.declared.columns.as_ref());
    if as_looked_at && (several || claims.by_ray(&declared)) {
        let found = found(records, &ray_set.id).await?;
        claims.wavelength_nm = found.wavelength_nm.filter(|_| claims.by_ray(&declared));
        claims.origins_mm = found.origins_mm.map(|extent| (extent.min, extent.max));
    }
    Ok(ChannelSource { ray_set, claims, declared, of_spectrum })
}

/// What the inspection of a ray set found in its rays, as far as that matters here.
#[derive(Default, Deserialize)]
struct Found {
    wavelength_nm: Option<(f64, f64)>,
    origins_mm: Option<Extent>,
}

/// A box, mm.
#[derive(Deserialize)]
struct Extent {
    min: [f64; 3],
    max: [f64; 3],
}

async fn found(records: &Records, ray_set: &str) -> Result<Found, storage::Error> {
    let inspection = inspections::get(records, ray_set).await?;
    inspection.map_or(Ok(Found::default()), |json| serde_json::from_str(&json).map_err(unreadable))
}

fn digest<'a>(known: &'a [ChannelSource], options: &'a pipeline::Options) -> Result<String, storage::Error> {
    let channel = |known: &'a ChannelSource| {
        let ChannelSource { ray_set, declared, .. } = known;
        File { sha256: &ray_set.sha256, name: &ray_set.name, declared, noticed: known.noticed() }
    };
    let channels = known.iter().map(channel).collect();
    let content = Content { pipeline: PIPELINE, channels, options: options.with_defaults(), total: options.rays.total };
    Ok(hex(&Sha256::digest(serde_json::to_vec(&content).map_err(unreadable)?)))
}

fn unreadable(error: serde_json::Error) -> storage::Error {
    storage::Error::fault(error)
}
