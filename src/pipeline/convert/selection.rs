//! A random part of the rays: exactly so many, any of them as likely as any other, in their order.

use super::chance::Chance;
use super::light::Light;
use crate::error::Error;

/// How many rays to take, and which of all such parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Take {
    /// Rays to be written.
    pub rays: u64,
    /// The same number gives the same rays.
    pub seed: u64,
}

/// Chooses one ray after another: the next of m that are left is taken with the chance n/m, where n are still wanted (algorithm S of
/// Knuth, The Art of Computer Programming 2, 3.4.2). Nothing is kept but the two numbers.
#[derive(Clone, Copy, Debug)]
pub struct Chooser {
    chance: Chance,
    left: u64,
    wanted: u64,
}

impl Chooser {
    /// Of `rays` in all.
    pub fn new(take: Take, rays: u64) -> Chooser {
        Chooser { chance: Chance::new(take.seed), left: rays, wanted: take.rays }
    }

    /// Whether the next ray is taken.
    pub fn next(&mut self) -> bool {
        let taken = self.chance.below(self.left, self.left) < self.wanted;
        self.left = self.left.saturating_sub(1);
        self.wanted -= u64::from(taken);
        taken
    }
}

/// What the flux of the rays of each channel is multiplied by, so that its totals stay: W and lm each by its own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sums {
    /// Of all usable rays.
    pub all: [f64; 2],
    /// Of those that were taken.
    pub taken: [f64; 2],
}

impl Sums {
    /// The factors.
    pub fn factors(&self) -> [f64; 2] {
        std::array::from_fn(|k| if self.taken[k] > 0.0 { self.all[k] / self.taken[k] } else { 1.0 })
    }
}

/// Refuses what cannot be taken.
///
/// # Errors
/// `convert.take_too_many`.
pub fn judge(take: Take, light: &Light<'_>) -> Result<(), Error> {
    if take.rays <= light.ray_count {
        return Ok(());
    }
    let found = format!("{} rays are to be taken, and there are {}.", take.rays, light.ray_count);
    Err(Error::refused("convert.take_too_many", found, "Take fewer, or all: leave --take out."))
}

/// Refuses a part without a ray of some channel: its light would be lost.
///
/// # Errors
/// `convert.take_too_few`.
pub fn judge_taken(light: &Light<'_>, sums: &[Sums]) -> Result<(), Error> {
    let dark = sums.iter().position(|sums| sums.taken.iter().all(|sum| *sum == 0.0));
    let Some(channel) = dark.and_then(|index| light.channels.get(index)) else { return Ok(()) };
    let found = format!("None of the rays that were taken is one of channel {:?}.", channel.name);
    Err(Error::refused("convert.take_too_few", found, "Take more rays (--take)."))
}
