//! A model that goes into a combination: read back from its files, its change made.

use super::change::Change;
use super::sight::Sight;
use crate::artifacts::read::{details, read};
use crate::error::{Error, Place};
use crate::flux::Amounts;
use crate::formats::bytes::digest;
use crate::goniogram::{Goniogram, Lattice, Mixture, SphereGrid, Zone};
use crate::hull::Hull;
use crate::model::ancestor::Ancestor;
use crate::model::channel::Origin;
use crate::model::evaluation::{Evaluator, Quantity};
use crate::source::{Columns, Spectral};
use crate::vocabulary::declaration::Declared;
use crate::vocabulary::limits::Limits;
use crate::vocabulary::space::Bounds;
use crate::vocabulary::units::{Flux, LengthUnit};
use crate::volume::Volume;
use glam::{DMat3, DVec3};

/// What the inputs of a combination are, in the place of the format of ray files.
const FORMAT: &str = "Lampwright model";

/// Positions are known within this part of a model's size.
const LEAST_DIGITS: f64 = 1e-3;
/// Part of a model's flux that no digit of its files shows.
const UNSEEN: f64 = 1e-12;

/// The two files of a model, and what is changed of it.
#[derive(Clone, Debug, Default)]
pub struct Component {
    /// What it is called; `None`: as its files say.
    pub name: Option<String>,
    /// The bytes of its `emitter.glb`.
    pub emitter: Vec<u8>,
    /// The bytes of its `goniograms.json`.
    pub goniograms: Vec<u8>,
    /// What is changed of it.
    pub change: Change,
}

/// The error of a combination of no models.
pub fn nothing() -> Error {
    let (found, remedy) = ("There is no model to combine.", "Name one model at least.");
    Error::invalid_declaration("combination.models", Place::Asked("models"), found, remedy)
}

/// A component as it goes in.
pub struct Changed {
    pub origin: Origin,
    pub ancestor: Ancestor,
    pub hull: Hull,
    pub vertices: Amounts,
    pub triangles: Amounts,
    pub mixtures: Vec<Mixture>,
    pub sight: Sight,
    pub grid: SphereGrid,
    pub spectral_grid: SphereGrid,
    pub zones: Vec<Zone>,
    pub total: Goniogram,
    pub lattice: Option<Lattice>,
    pub volume: Option<Volume>,
    pub spectral: Spectral,
    /// The model knows its W; its lm.
    pub knows: [bool; 2],
}

impl Changed {
    /// Reads a model, turns and moves it.
    ///
    /// # Errors
    /// As [`read`] and [`details::of`]; [`Error::Unusable`] for a change that cannot be made, [`Error::Refused`] for a volume that is turned.
    pub fn new(component: &Component, limits: &Limits) -> Result<Changed, Error> {
        let Component { name, emitter, goniograms, change } = component;
        let model = read(emitter, goniograms, limits)?;
        let details = details::of(emitter, goniograms, &model)?;
        let knows = [Quantity::Radiant, Quantity::Luminous].map(|quantity| Evaluator::new(&model, quantity).is_some());
        let (turn, shift_mm) = (change.rotation()?, change.shift_mm()?);
        if model.volume.is_some() && turn != DMat3::IDENTITY {
            let found = "The model is a volume, whose lattice cannot be turned.";
            let remedy = "Turn the other models instead, or build the model with --emission origins.";
            return Err(Error::refused("combination.volume", found, remedy));
        }
        let ancestor = Ancestor {
            name: name.clone().unwrap_or(model.name),
            emitter_sha256: digest(emitter)?,
            goniograms_sha256: digest(goniograms)?,
            spectrum: change.spectrum.clone(),
            factor: 1.0,
            turn,
            move_mm: shift_mm,
            provenance: details.provenance,
        };
        let put = |point_mm: DVec3| turn * point_mm + shift_mm;
        let vertices_mm: Vec<DVec3> = model.vertices_mm.into_iter().map(put).collect();
        check_digits(&vertices_mm)?;
        let sight = Sight::turned(model.frame, turn);
        let mut changed = Changed {
            origin: origin(&ancestor, emitter.len(), details.rays, &model.spectral),
            ancestor,
            hull: Hull::given(vertices_mm, model.triangles, details.labels),
            vertices: model.vertices,
            triangles: details.triangles,
            mixtures: model.mixtures,
            lattice: details.lattice.filter(|_| sight.turn == DMat3::IDENTITY).map(|own| moved(own, &sight, shift_mm)),
            sight,
            grid: model.grid,
            spectral_grid: model.spectral_grid,
            zones: details.zones,
            total: details.total,
            volume: model.volume,
            spectral: model.spectral,
            knows,
        };
        for zone in &mut changed.zones {
            zone.centroid_mm = put(zone.centroid_mm);
            zone.bounds_mm = Bounds::of(corners_mm(&zone.bounds_mm).map(put));
        }
        if let Some(volume) = &mut changed.volume {
            volume.lattice.min_mm += shift_mm;
        }
        Ok(changed)
    }

    /// How many places hold its light: vertices, and nodes of its volume.
    pub fn sites(&self) -> usize {
        self.vertices.len() + self.volume.as_ref().map_or(0, |volume| volume.nodes.len())
    }

    /// Multiplies its flux.
    pub fn scale(&mut self, factor: f64) {
        self.ancestor.factor = factor;
        let nodes = self.volume.as_mut().map(|volume| &mut volume.nodes);
        for amounts in [&mut self.vertices, &mut self.triangles].into_iter().chain(nodes) {
            scale(amounts, factor);
        }
        self.goniograms_mut().for_each(|goniogram| scale_goniogram(goniogram, factor));
        self.origin.flux = self.total.flux;
    }

    /// A zone without any intensity sends what smoothing gave to its vertices as the whole model does. Beside other models the whole is another,
    /// so such a zone gets the directions of its own, with a flux that no digit shows.
    pub fn light_dark_zones(&mut self) {
        let mut own = self.total.clone();
        scale_goniogram(&mut own, UNSEEN);
        for zone in &mut self.zones {
            let is_dark = |nodes: &Option<Vec<f64>>| nodes.iter().flatten().all(|intensity| *intensity <= 0.0);
            if is_dark(&zone.goniogram.radiant_w_per_sr) && is_dark(&zone.goniogram.luminous_cd) {
                zone.goniogram = Goniogram { rays: zone.goniogram.rays, ..own.clone() };
            }
        }
    }

    /// Some of its goniograms have spectra that change with the direction.
    pub fn has_spectral(&self) -> bool {
        let totals = self.zones.iter().map(|zone| &zone.goniogram).chain([&self.total]);
        totals.into_iter().any(|goniogram| !goniogram.spectral_w_per_sr_nm.is_empty())
    }

    /// Every goniogram: those of the zones, then that of the whole.
    pub fn goniograms_mut(&mut self) -> impl Iterator<Item = &mut Goniogram> {
        self.zones.iter_mut().map(|zone| &mut zone.goniogram).chain([&mut self.total])
    }
}

/// Files hold positions with the digits of binary32: far from the origin a small model would fall apart.
fn check_digits(vertices_mm: &[DVec3]) -> Result<(), Error> {
    let bounds = Bounds::of(vertices_mm.iter().copied());
    let step_mm = bounds.min.abs().max(bounds.max.abs()).max_element() * f64::from(f32::EPSILON);
    let size_mm = bounds.size().length();
    if step_mm <= LEAST_DIGITS * size_mm || vertices_mm.is_empty() {
        return Ok(());
    }
    let found = format!(
        "The model, {size_mm:.3} mm large, would stand so far from the origin that its positions are known within {step_mm:.3} mm."
    );
    let remedy = "Move it less far, and move the whole in the scene instead.";
    Err(Error::invalid_declaration("combination.change", Place::Asked("move_mm"), found, remedy))
}

fn origin(ancestor: &Ancestor, bytes: usize, rays: [u64; 2], spectral: &Spectral) -> Origin {
    let [ray_count, rays_used] = rays;
    Origin {
        name: ancestor.name.clone(),
        channel: ancestor.name.clone(),
        sha256: ancestor.emitter_sha256.clone(),
        byte_count: bytes as u64,
        format: FORMAT,
        ray_count,
        rays_used,
        flux: Flux::default(),
        fixed: None,
        declared: Declared::default(),
        length_unit: Some(LengthUnit::Millimetre),
        spectrum: match spectral.columns {
            Columns::Bands | Columns::Tables { .. } => "table",
            Columns::Tristimulus => "tristimulus",
            Columns::None => "none",
        },
        header_flux: Flux::default(),
        ray_sum: Flux::default(),
        header_over_sum: None,
        texts: Vec::new(),
    }
}

fn corners_mm(bounds: &Bounds) -> [DVec3; 8] {
    std::array::from_fn(|corner| {
        let at = |bit: usize| if corner >> bit & 1 == 1 { bounds.max } else { bounds.min };
        DVec3::new(at(0).x, at(1).y, at(2).z)
    })
}

/// The lattice of a model that was turned by quarters, in its turned frame, moved.
fn moved(lattice: Lattice, sight: &Sight, shift_mm: DVec3) -> Lattice {
    let along = [shift_mm.dot(sight.frame.x()), shift_mm.dot(sight.frame.y())];
    let add = |corner: [f64; 2]| [corner[0] + along[0], corner[1] + along[1]];
    Lattice { frame: sight.frame, min_mm: add(lattice.min_mm), max_mm: add(lattice.max_mm), ..lattice }
}

fn multiply<'v>(values: impl IntoIterator<Item = &'v mut f64>, factor: f64) {
    values.into_iter().for_each(|value| *value *= factor);
}

fn scale(amounts: &mut Amounts, factor: f64) {
    multiply(amounts.radiant_w.iter_mut().flatten(), factor);
    multiply(amounts.luminous_lm.iter_mut().flatten(), factor);
    multiply(&mut amounts.columns, factor);
}

fn scale_goniogram(goniogram: &mut Goniogram, factor: f64) {
    multiply(goniogram.flux.radiant_w.iter_mut().chain(&mut goniogram.flux.luminous_lm), factor);
    multiply(goniogram.luminous_cd.iter_mut().flatten(), factor);
    multiply(goniogram.radiant_w_per_sr.iter_mut().flatten(), factor);
    multiply(&mut goniogram.spectral_w_per_sr_nm, factor);
    multiply(&mut goniogram.spectral_flux_w_per_nm, factor);
}
