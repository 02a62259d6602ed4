//! Occlusions: looks below the threshold, gathered into episodes.

use super::clock::Clock;
use super::event::OcclusionReport;
use crate::sensing::Visibility;

/// The stretch of time since visibility last fell below the threshold without having come back.
#[derive(Debug, Clone, Copy)]
struct Episode {
    since_tick: u64,
    waited_ticks: u64,
    displacements: u32,
    /// The odometer when the last displacement was back on the route.
    displaced_at_m: f64,
}

/// The episode in progress, and what all of them came to.
#[derive(Debug, Clone, Default)]
pub(super) struct Occlusions {
    episode: Option<Episode>,
    /// Episodes since the beginning of the mission.
    pub count: u32,
    /// Waited for a policy since the beginning of the mission.
    pub waited_ticks: u64,
}

impl Occlusions {
    /// A look below the threshold, which opens an episode or goes on with one.
    pub fn report(&mut self, look: &Visibility, clock: &Clock, odometer_m: f64) -> OcclusionReport {
        if self.episode.is_none() {
            self.count += 1;
        }
        let episode = *self.episode.get_or_insert(Episode {
            since_tick: clock.tick,
            waited_ticks: 0,
            displacements: 0,
            displaced_at_m: f64::NEG_INFINITY,
        });
        OcclusionReport {
            time_s: clock.time_s(),
            visibility: look.share,
            hidden_centroid: look.hidden_centroid,
            permanently_hidden: look.permanently_hidden(),
            since_s: clock.seconds(episode.since_tick),
            waited_s: clock.seconds(episode.waited_ticks),
            displacements: episode.displacements,
            since_displacement_m: odometer_m - episode.displaced_at_m,
        }
    }

    /// Visibility came back, or a new command began.
    pub fn end_episode(&mut self) {
        self.episode = None;
    }

    pub fn waited_a_step(&mut self) {
        self.waited_ticks += 1;
        if let Some(episode) = &mut self.episode {
            episode.waited_ticks += 1;
        }
    }

    pub fn begin_displacement(&mut self) {
        if let Some(episode) = &mut self.episode {
            episode.displacements += 1;
        }
    }

    pub fn end_displacement(&mut self, odometer_m: f64) {
        if let Some(episode) = &mut self.episode {
            episode.displaced_at_m = odometer_m;
        }
    }
}
