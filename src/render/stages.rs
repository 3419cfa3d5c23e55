//! Where the time of a view goes.

use std::time::Instant;

/// The parts of finding out what a view sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Finding the clusters that may show.
    Cull,
    /// Projecting their vertices.
    Transform,
    /// Filling pixels, which are cleared first.
    Raster,
    /// From pixels to bits.
    Scan,
    /// Looking for faces that own no pixel.
    Confirm,
}

impl Stage {
    pub const ALL: [Self; 5] = [Self::Cull, Self::Transform, Self::Raster, Self::Scan, Self::Confirm];

    pub fn name(self) -> &'static str {
        match self {
            Self::Cull => "cull",
            Self::Transform => "transform",
            Self::Raster => "raster",
            Self::Scan => "scan",
            Self::Confirm => "confirm",
        }
    }
}

/// Told when part of a stage is over.
pub trait Clock {
    fn lap(&mut self, stage: Stage);
}

/// No clock: costs nothing.
pub struct Untimed;

impl Clock for Untimed {
    #[inline(always)]
    fn lap(&mut self, _: Stage) {}
}

/// Adds up the seconds of each stage.
#[derive(Debug)]
pub struct Stopwatch {
    last: Instant,
    seconds: [f64; Stage::ALL.len()],
}

impl Default for Stopwatch {
    fn default() -> Self {
        Self { last: Instant::now(), seconds: [0.0; Stage::ALL.len()] }
    }
}

impl Stopwatch {
    /// What went by since the last lap counts for none.
    pub fn restart(&mut self) {
        self.last = Instant::now();
    }

    /// The stages and their seconds.
    pub fn seconds(&self) -> impl Iterator<Item = (Stage, f64)> + '_ {
        Stage::ALL.into_iter().zip(self.seconds)
    }
}

impl Clock for Stopwatch {
    #[inline]
    fn lap(&mut self, stage: Stage) {
        let now = Instant::now();
        self.seconds[stage as usize] += (now - self.last).as_secs_f64();
        self.last = now;
    }
}
