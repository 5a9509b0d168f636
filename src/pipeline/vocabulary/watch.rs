//! Progress out, cancellation in: the only channel between a computation and its caller.

use crate::error::Error;
use serde::Serialize;

/// The stages of a run, in order. The names are the folder names, the log field `stage` and the headings of reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Files to checked rays.
    Rays,
    /// Rays to a surface.
    Hull,
    /// Rays onto the surface.
    Flux,
    /// Flux to angles.
    Goniogram,
    /// Everything put together.
    Model,
    /// Results to files.
    Artifacts,
}

impl Stage {
    /// All, in order.
    pub const ALL: [Stage; 6] =
        [Stage::Rays, Stage::Hull, Stage::Flux, Stage::Goniogram, Stage::Model, Stage::Artifacts];

    /// "rays", "hull", …
    pub fn name(self) -> &'static str {
        match self {
            Stage::Rays => "rays",
            Stage::Hull => "hull",
            Stage::Flux => "flux",
            Stage::Goniogram => "goniogram",
            Stage::Model => "model",
            Stage::Artifacts => "artifacts",
        }
    }
}

/// Who watches a run. Called from many threads; must be cheap.
pub trait Watch: Send + Sync {
    /// `stage` is `fraction` (0..=1) done.
    fn progress(&self, stage: Stage, fraction: f64);
    /// True when nobody wants the result any more. Asked at least once per chunk of rays.
    fn cancelled(&self) -> bool;
}

/// Nobody watches.
pub struct NoProgress;

impl Watch for NoProgress {
    fn progress(&self, _stage: Stage, _fraction: f64) {}
    fn cancelled(&self) -> bool {
        false
    }
}

/// One stage's view of its watcher: what the stages are handed.
#[derive(Clone, Copy)]
pub struct StageWatch<'a> {
    watch: &'a dyn Watch,
    stage: Stage,
    from: f64,
    to: f64,
}

impl<'a> StageWatch<'a> {
    /// Enters `stage`: reports 0 and answers the handle, or [`Error::Cancelled`].
    pub fn enter(watch: &'a dyn Watch, stage: Stage) -> Result<StageWatch<'a>, Error> {
        let stage = StageWatch { watch, stage, from: 0.0, to: 1.0 };
        stage.step(0.0)?;
        Ok(stage)
    }

    /// The part `from..to` of this stage, for one of its passes.
    pub fn part(&self, from: f64, to: f64) -> StageWatch<'a> {
        let span = self.to - self.from;
        StageWatch { from: self.from + span * from, to: self.from + span * to, ..*self }
    }

    /// Reports `fraction` of this part; [`Error::Cancelled`] when nobody waits any more.
    pub fn step(&self, fraction: f64) -> Result<(), Error> {
        if self.watch.cancelled() {
            return Err(Error::Cancelled);
        }
        self.watch.progress(self.stage, self.from + (self.to - self.from) * fraction.clamp(0.0, 1.0));
        Ok(())
    }
}
