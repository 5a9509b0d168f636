//! Several ray sets become one source; the only way to its rays.
//!
//! A source is a list of channels even while the list has one entry: vendors ship one white LED as a blue and a yellow
//! file (`pipeline/README.md` 1). A channel scales its rays' stored values to W and lm and gives each ray its spectral column.

/// What several files must satisfy to be one source.
pub mod channels;

use crate::error::Error;
use crate::formats::record::CHUNK_RAYS;
use crate::formats::record::{Facts, RawRay, RaySet, SpectralData};
use crate::inspection;
use crate::inspection::sample::hash;
use crate::options::RaysOptions;
use crate::rays::bands::ChannelSpectrum;
use crate::rays::check::Checked;
use crate::rays::conversion::Conversion;
use crate::rays::declared::open;
use crate::rays::survey::{Reading, Survey};
use crate::rays::{Input, bands, check, chunks, totals};
use crate::vocabulary::declaration::{Declared, Total};
use crate::vocabulary::limits::Limits;
use crate::vocabulary::notice::Notices;
use crate::vocabulary::spectrum::Bands;
use crate::vocabulary::spectrum::wider;
use crate::vocabulary::units::Flux;
use crate::vocabulary::watch::StageWatch;
use channels::Candidate;
use glam::DVec3;
use std::sync::Arc;

/// A checked ray in the source frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start, mm.
    pub origin_mm: DVec3,
    /// Unit direction.
    pub direction: DVec3,
    /// Radiant flux, W; 0 where the source's is unknown.
    pub radiant_w: f64,
    /// Luminous flux, lm; 0 where the source's is unknown.
    pub luminous_lm: f64,
    /// Spectral column of its radiant flux; meaningless where the source has no columns.
    pub column: u32,
    /// Tristimulus X and Z, lm (Y is the luminous flux); 0 elsewhere.
    pub xz_lm: [f64; 2],
}

impl Ray {
    /// What weights rays where one number is wanted: radiant flux where known, else luminous.
    pub fn weight(&self) -> f64 {
        if self.radiant_w > 0.0 { self.radiant_w } else { self.luminous_lm }
    }

    /// A number that looks like chance and follows from the line and the column of the ray, not from its place in the file: a shuffled
    /// file is sampled alike, and one whose numbers are written with the digits of an f32.
    pub fn hash(&self) -> u64 {
        let line = self.origin_mm.to_array().into_iter().chain(self.direction.to_array());
        let bits = line.map(|number| u64::from((number as f32).to_bits())).chain([u64::from(self.column)]);
        bits.fold(0, |hashed, bits| hash(hashed ^ bits))
    }
}

/// How the source's spectrum is carried through the pipeline: rays deposit into columns, columns become bands at the end.
/// A column is a basis spectrum, so a spectral table shared by all rays costs one column and not 40 bands.
#[derive(Clone, Debug, PartialEq)]
pub enum Columns {
    /// No spectrum is known.
    None,
    /// A wavelength per ray: one column per band, and a last one for what lies outside the bands.
    Bands,
    /// One column per spectral table. `shares[table][band]`: share of the table's radiant flux in the band.
    Tables {
        /// Share of each table's radiant flux in each band; a row sums to 1 less what lies outside the bands.
        shares: Vec<Vec<f64>>,
    },
    /// Three columns, tristimulus X, Y, Z in lm.
    Tristimulus,
}

/// The spectral side of a source.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectral {
    /// The bands of every spectral result.
    pub bands: Bands,
    /// What rays deposit into.
    pub columns: Columns,
}

impl Spectral {
    /// Most spectral numbers of a site, as counted or as written.
    pub fn numbers(&self) -> usize {
        if self.has_bands() { self.bands.len().max(self.column_count()) } else { self.column_count() }
    }

    /// How many columns rays deposit into.
    pub fn column_count(&self) -> usize {
        match &self.columns {
            Columns::None => 0,
            Columns::Bands => self.bands.len() + 1,
            Columns::Tables { shares } => shares.len(),
            Columns::Tristimulus => 3,
        }
    }

    /// Calls `add(column, amount)` for each of the ray's deposits; amounts in W, for tristimulus in lm.
    pub fn deposit(&self, ray: &Ray, mut add: impl FnMut(usize, f64)) {
        match self.columns {
            Columns::None => {}
            Columns::Bands | Columns::Tables { .. } => add(ray.column as usize, ray.radiant_w),
            Columns::Tristimulus => {
                add(0, ray.xz_lm[0]);
                add(1, ray.luminous_lm);
                add(2, ray.xz_lm[1]);
            }
        }
    }

    /// True where columns become W/nm in bands.
    pub fn has_bands(&self) -> bool {
        matches!(self.columns, Columns::Bands | Columns::Tables { .. })
    }

    /// Spectral density of `columns` (W each) in W/nm, one number per band; empty without bands.
    pub fn bands_w_per_nm(&self, columns: &[f64]) -> Vec<f64> {
        let widths = self.bands.widths_nm();
        match &self.columns {
            Columns::None | Columns::Tristimulus => Vec::new(),
            Columns::Bands => columns.iter().zip(widths).map(|(watt, width)| watt / width).collect(),
            Columns::Tables { shares } => (0..widths.len())
                .map(|band| {
                    columns.iter().zip(shares).map(|(watt, share)| watt * share[band]).sum::<f64>() / widths[band]
                })
                .collect(),
        }
    }

    /// Spectral results are the bands of models that a model was made of.
    pub const OF_MODELS: &str = "bands of the models";
    /// All that [`Spectral::basis`] may say, and [`Spectral::OF_MODELS`].
    pub const BASES: [&str; 5] =
        ["per-ray wavelength", "spectral tables", "tristimulus of the rays", "none", Spectral::OF_MODELS];

    /// What spectral results are made from; `spectral_basis` of the goniograms.
    pub fn basis(&self) -> &'static str {
        match self.columns {
            Columns::None => "none",
            Columns::Bands => "per-ray wavelength",
            Columns::Tables { .. } => "spectral tables",
            Columns::Tristimulus => "tristimulus of the rays",
        }
    }
}

/// One ray set within a source.
pub struct Channel {
    /// What the user calls it.
    pub name: String,
    /// Name of its file.
    pub file: String,
    /// SHA-256 of the file, lower-case hex.
    pub sha256: String,
    /// Length of the file in bytes.
    pub byte_count: u64,
    /// What was seen when every ray was read once.
    pub survey: Survey,
    /// Its own total flux.
    pub flux: Flux,
    /// What was declared of it.
    pub declared: Declared,
    /// What its declared flux came to.
    pub fixed: Option<Total>,
    /// The file.
    set: RaySet,
    /// From its stored values to W and lm.
    conversion: Conversion,
    /// Its first column among the source's.
    first_column: u32,
}

impl Channel {
    /// From the shortest to the longest wavelength of its rays and tables, nm; `None` without a spectrum.
    pub fn range_nm(&self) -> Option<(f64, f64)> {
        let tables =
            self.facts().spectral.tables().iter().fold(None, |range, table| wider(range, Some(table.range_nm())));
        wider(self.survey.wavelength_nm, tables)
    }

    /// What the file says of itself.
    pub fn facts(&self) -> &Facts {
        &self.set.facts
    }

    /// `each(index, stored, checked)` for the usable rays among the `count` records from `first`, in order, to be written again;
    /// `raws` is a buffer.
    ///
    /// # Errors
    /// [`Error::Unreadable`]; the first of `each`.
    pub fn usable(
        &self,
        first: u64,
        count: usize,
        raws: &mut Vec<RawRay>,
        mut each: impl FnMut(u64, &RawRay, &Checked) -> Result<(), Error>,
    ) -> Result<(), Error> {
        raws.clear();
        self.set.records.read(first, count, raws)?;
        let conversion = self.conversion.unless_rounding();
        for (index, raw) in (first..).zip(raws.iter()) {
            if let Ok(checked) = check::check(&self.set.facts, &conversion, raw) {
                each(index, raw, &checked)?;
            }
        }
        Ok(())
    }

    /// The ray of a record that passed its check.
    fn ray(&self, spectral: &Spectral, raw: &RawRay, checked: &Checked) -> Ray {
        let column = match self.set.facts.spectral {
            SpectralData::Wavelength => spectral.bands.band(raw.wavelength_nm).unwrap_or(spectral.bands.len()) as u32,
            SpectralData::Tables(_) => self.first_column.saturating_add(raw.table),
            _ => self.first_column,
        };
        Ray {
            origin_mm: DVec3::from_array(raw.origin_mm),
            direction: checked.direction,
            radiant_w: checked.flux[0],
            luminous_lm: checked.flux[1],
            column,
            xz_lm: checked.xz_lm,
        }
    }
}

/// A light source: checked, scaled rays in one frame.
pub struct Source {
    /// Its ray sets.
    pub channels: Vec<Channel>,
    /// Total flux of the usable rays.
    pub flux: Flux,
    /// Its spectral side.
    pub spectral: Spectral,
    /// All channels' surveys together.
    pub survey: Survey,
    /// All notices of reading.
    pub notices: Notices,
    /// What the checks of an inspection find in its channels.
    pub findings: Notices,
}

impl Source {
    /// Opens the ray sets of one source and surveys every ray once.
    ///
    /// # Errors
    /// As [`open`]; [`Error::Refused`] when no usable ray is left or too many had to be refused; [`Error::Cancelled`].
    pub fn read(
        inputs: &[Input],
        options: &RaysOptions,
        limits: &Limits,
        watch: StageWatch<'_>,
    ) -> Result<Source, Error> {
        let declared: Vec<&Declared> = inputs.iter().map(|input| &input.declared).collect();
        let fluxes = channels::fluxes(&declared, options.total)?;
        let sets = open_all(inputs, limits)?;
        let known = channels::judge(&candidates(inputs, &sets))?;
        let asked = bands::asked(options)?;
        let all: u64 = sets.iter().map(|set| set.facts.ray_count).sum();
        let (mut notices, mut findings) = (Notices::default(), Notices::default());
        let (mut channels, mut first_index) = (Vec::new(), 0);
        let mut outside = Vec::new();
        for (index, ((input, set), flux)) in inputs.iter().zip(sets).zip(fluxes).enumerate() {
            let end = first_index + set.facts.ray_count;
            let done = |ray: u64| ray as f64 / all.max(1) as f64;
            let part = watch.part(done(first_index), done(end));
            let (reading, evidence) = inspection::observed(&set, known.radiant, asked.bands(), part)?;
            reading.judge(limits)?;
            outside.push(reading.outside);
            let found = inspection::findings(&set.facts, input.bytes.len(), known.radiant, &reading, evidence)?;
            findings.merge_of_channel(index, input.channel_name(), found.iter());
            let channel = Channel::new(input, set, reading, flux, known.radiant);
            let (channel, told) = channel.map_err(|error| error.of_channel(index))?;
            notices.merge_of_channel(index, &channel.name, input.notices.iter().chain(told.iter()));
            channels.push(channel);
            first_index = end;
        }
        let boxes: Vec<_> = channels.iter().map(|channel| (channel.name.as_str(), channel.survey.bounds_mm)).collect();
        channels::tell_unlike(&boxes, &mut notices);
        let mut whole = Survey::empty();
        channels.iter().for_each(|channel| whole.merge(&channel.survey));
        if notices.count_of(totals::UNLIKELY_SIZE) == 0 {
            totals::notice_size(&whole, &mut notices);
        }
        let bands = asked.settle(&spectra_of(&channels, &outside), &mut notices);
        let spectral = Spectral::of(&mut channels, bands, known.radiant, &mut notices);
        let flux = known.sum(channels.iter().map(|channel| channel.flux));
        Ok(Source { channels, flux, spectral, survey: whole, notices, findings })
    }

    /// One pass over all usable rays. `work` sees each chunk (up to [`CHUNK_RAYS`] rays, in file order) on some
    /// thread of the ambient pool; `merge` folds the answers **in chunk order**, so the result does not depend on the
    /// number of threads. Memory: at most 64 chunks' answers wait for each other.
    ///
    /// # Errors
    /// [`Error::Cancelled`], [`Error::Unreadable`], whatever `work` answers.
    pub fn fold<T: Send, A>(
        &self,
        watch: StageWatch<'_>,
        start: A,
        work: impl Fn(&[Ray]) -> Result<T, Error> + Sync,
        mut merge: impl FnMut(&mut A, T),
    ) -> Result<A, Error> {
        let chunk_rays = CHUNK_RAYS as u64;
        let chunks_of = |channel: &Channel| channel.set.facts.ray_count.div_ceil(chunk_rays);
        let chunk_count = self.channels.iter().map(chunks_of).sum();
        chunks::in_order(
            chunk_count,
            watch,
            start,
            Scratch::default,
            |scratch, chunk| {
                let mut chunk = chunk;
                for channel in &self.channels {
                    if chunk < chunks_of(channel) {
                        return work(self.chunk(channel, chunk * chunk_rays, scratch)?);
                    }
                    chunk -= chunks_of(channel);
                }
                work(&[])
            },
            |answer, part| {
                merge(answer, part);
                Ok(())
            },
        )
    }

    /// The usable rays among the [`CHUNK_RAYS`] records of `channel` from `first`.
    fn chunk<'s>(&self, channel: &Channel, first: u64, scratch: &'s mut Scratch) -> Result<&'s [Ray], Error> {
        let facts = &channel.set.facts;
        let count = (facts.ray_count - first).min(CHUNK_RAYS as u64) as usize;
        scratch.raws.clear();
        scratch.rays.clear();
        channel.set.records.read(first, count, &mut scratch.raws)?;
        for raw in &scratch.raws {
            if let Ok(checked) = check::check(facts, &channel.conversion, raw) {
                let ray = channel.ray(&self.spectral, raw, &checked);
                scratch.rays.push(Ray {
                    radiant_w: if self.flux.radiant_w.is_some() { ray.radiant_w } else { 0.0 },
                    luminous_lm: if self.flux.luminous_lm.is_some() { ray.luminous_lm } else { 0.0 },
                    ..ray
                });
            }
        }
        Ok(&scratch.rays)
    }
}

/// One thread's buffers, used for chunk after chunk.
#[derive(Default)]
struct Scratch {
    raws: Vec<RawRay>,
    rays: Vec<Ray>,
}

/// What the spectral bands must hold; `outside`: of each channel, rays outside the bands that were asked for.
fn spectra_of<'a>(channels: &'a [Channel], outside: &[(u64, Option<u64>)]) -> Vec<ChannelSpectrum<'a>> {
    let spectrum = |(channel, outside): (&'a Channel, &(u64, Option<u64>))| ChannelSpectrum {
        range_nm: channel.range_nm(),
        tables: channel.facts().spectral.tables(),
        outside: *outside,
    };
    channels.iter().zip(outside).map(spectrum).collect()
}

fn open_all(inputs: &[Input], limits: &Limits) -> Result<Vec<RaySet>, Error> {
    if inputs.is_empty() {
        let found = "No ray file was given.";
        return Err(Error::unusable("rays.no_input", "inputs", found, "Name at least one."));
    }
    let opened = |(index, input): (usize, &Input)| {
        open(Arc::clone(&input.bytes), &input.declared, limits).map_err(|error| error.of_channel(index))
    };
    inputs.iter().enumerate().map(opened).collect()
}

fn candidates<'a>(inputs: &'a [Input], sets: &'a [RaySet]) -> Vec<Candidate<'a>> {
    let candidate = |(input, set): (&'a Input, &'a RaySet)| Candidate {
        name: input.channel_name(),
        sha256: &input.sha256,
        facts: &set.facts,
        declared: &input.declared,
    };
    inputs.iter().zip(sets).map(candidate).collect()
}

impl Channel {
    /// The channel, and what was noticed as it was read.
    fn new(
        input: &Input,
        set: RaySet,
        reading: Reading,
        fixed: Option<Total>,
        radiant: bool,
    ) -> Result<(Channel, Notices), Error> {
        let (facts, sums) = (&set.facts, &reading.sums);
        let mut notices = facts.notices.clone();
        notices.merge(&reading.notices);
        let mut conversion = Conversion::of(facts).scaled(facts, sums);
        if let Some(total) = fixed {
            conversion = conversion.fixed(sums, total)?;
        }
        let flux = conversion.totals(sums);
        match fixed {
            None => totals::judge(facts, sums, &flux, &mut notices)?,
            Some(_) => totals::judge_declared(facts, sums, &flux, &mut notices)?,
        }
        totals::notice_size(&reading.survey, &mut notices);
        let mut survey = reading.survey;
        let scale = conversion.scale(radiant);
        survey.directions.flux.iter_mut().for_each(|flux| *flux *= scale);
        let channel = Channel {
            name: input.channel_name().to_owned(),
            file: input.name.clone(),
            sha256: input.sha256.clone(),
            byte_count: input.bytes.len(),
            survey,
            flux,
            declared: input.declared.clone(),
            fixed,
            set,
            conversion,
            first_column: 0,
        };
        Ok((channel, notices))
    }
}

impl Spectral {
    /// One basis for all channels: their wavelengths, their tables, or both, with each band as a table of its own. Channels
    /// without a spectrum beside others with one have no common basis.
    fn of(channels: &mut [Channel], bands: Bands, radiant: bool, notices: &mut Notices) -> Spectral {
        let all = |test: fn(&SpectralData) -> bool| channels.iter().all(|channel| test(&channel.set.facts.spectral));
        if all(|data| matches!(data, SpectralData::Tristimulus)) {
            return Spectral { bands, columns: Columns::Tristimulus };
        }
        let bare = |data: &SpectralData| matches!(data, SpectralData::None | SpectralData::Tristimulus);
        if !radiant || channels.iter().any(|channel| bare(&channel.set.facts.spectral)) {
            if !all(|data| matches!(data, SpectralData::None)) {
                let without = channels.iter().find(|channel| bare(&channel.set.facts.spectral));
                let told = format!(
                    "The channels have no spectral basis in common{}; the model is built without a spectrum.",
                    without.map_or(String::new(), |channel| format!(" ({:?} has none)", channel.name))
                );
                notices.add("rays.no_common_spectrum", told);
            }
            return Spectral { bands, columns: Columns::None };
        }
        if all(|data| matches!(data, SpectralData::Wavelength)) {
            return Spectral { bands, columns: Columns::Bands };
        }
        let mut shares: Vec<Vec<f64>> = Vec::new();
        if channels.iter().any(|channel| matches!(channel.set.facts.spectral, SpectralData::Wavelength)) {
            let one_band = |k: usize| (0..bands.len()).map(|band| f64::from(u8::from(band == k))).collect();
            shares.extend((0..=bands.len()).map(one_band));
        }
        for channel in channels {
            channel.first_column = shares.len() as u32;
            match &channel.set.facts.spectral {
                SpectralData::Table(table) => shares.push(table.shares(&bands)),
                SpectralData::Tables(tables) => shares.extend(tables.iter().map(|table| table.shares(&bands))),
                _ => {}
            }
        }
        Spectral { bands, columns: Columns::Tables { shares } }
    }
}
