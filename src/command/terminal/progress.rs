//! Who watches a run from a terminal: a bar where there is a terminal, and the clock of every stage.

use indicatif::{ProgressBar, ProgressStyle};
use pipeline::{Stage, Watch};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Steps of the bar per stage.
const STEPS: u64 = 1000;

/// A bar on stderr (drawn on a terminal only) and the moments at which stages were entered.
pub struct Progress {
    bar: ProgressBar,
    /// The stage that the bar begins with.
    first: Stage,
    entered: Mutex<Vec<(Stage, Instant)>>,
}

impl Progress {
    /// Starts the bar of a whole run.
    pub fn start() -> Progress {
        Progress::over(Stage::ALL.len() as u64, Stage::Rays)
    }

    /// Starts the bar of work that ends with the rays.
    pub fn start_reading() -> Progress {
        Progress::over(1, Stage::Rays)
    }

    /// Starts the bar of the evaluation of a model.
    pub fn start_evaluating() -> Progress {
        Progress::over(1, Stage::Model)
    }

    fn over(stages: u64, first: Stage) -> Progress {
        let style = ProgressStyle::with_template("{msg:9} {wide_bar} {percent:>3} % {elapsed}");
        let bar = ProgressBar::new(STEPS * stages);
        Progress { bar: style.map_or(bar.clone(), |style| bar.with_style(style)), first, entered: Mutex::default() }
    }

    /// Takes the bar away; how long each stage took, up to now.
    pub fn finish(self) -> Vec<(Stage, Duration)> {
        self.bar.finish_and_clear();
        let entered = self.entered.into_inner().unwrap_or_else(PoisonError::into_inner);
        let ends = entered.iter().skip(1).map(|(_, at)| *at).chain([Instant::now()]);
        entered.iter().zip(ends).map(|((stage, from), to)| (*stage, to - *from)).collect()
    }
}

impl Watch for Progress {
    fn progress(&self, stage: Stage, fraction: f64) {
        let mut entered = self.entered.lock().unwrap_or_else(PoisonError::into_inner);
        if entered.last().is_none_or(|(last, _)| *last < stage) {
            entered.push((stage, Instant::now()));
            self.bar.set_message(stage.name());
        }
        let before = Stage::ALL.iter().filter(|other| (self.first..stage).contains(other)).count();
        self.bar.set_position(((before as f64 + fraction) * STEPS as f64) as u64);
    }

    fn cancelled(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stage_is_timed_once_in_order() {
        let progress = Progress::start();
        for stage in Stage::ALL {
            progress.progress(stage, 0.0);
            progress.progress(stage, 0.5);
        }
        progress.progress(Stage::Rays, 1.0); // a straggler of an earlier stage opens nothing
        let stages: Vec<Stage> = progress.finish().into_iter().map(|(stage, _)| stage).collect();
        assert_eq!(stages, Stage::ALL);
    }
}
