//! What a policy asked for on top of the command: waiting, or a displacement and back.

use super::flight::{Flight, FlightError, Mode, Task};
use crate::geometry::Vec2;
use crate::navigation::{Motion, Strafe};

/// The stretch of time since visibility last fell below the threshold without having come back.
#[derive(Debug, Clone, Copy)]
pub(super) struct Episode {
    pub since_tick: u64,
    pub waited_ticks: u64,
    pub displacements: u32,
    /// The odometer when the last displacement was back on the route.
    pub displaced_at_m: f64,
}

/// In progress on top of the task.
#[derive(Debug, Clone)]
pub(super) enum Reaction {
    None,
    Wait {
        until_tick: u64,
    },
    /// Braking, before the displacement begins.
    Brake {
        displacement: Vec2,
        stay_ticks: u64,
    },
    Out {
        strafe: Strafe,
        stay_ticks: u64,
        home: Vec2,
    },
    Stay {
        until_tick: u64,
        home: Vec2,
    },
    Back {
        strafe: Strafe,
    },
}

impl Flight {
    /// Brakes and stays until `seconds` from now, then looks again.
    pub fn wait(&mut self, seconds: f64) {
        let until_tick = self.tick + self.ticks(seconds).max(1);
        self.mode = Mode::Wait;
        self.reaction = Reaction::Wait { until_tick };
    }

    /// Brakes, moves aside without turning, stays, and comes back to where it came to rest. The displacement is cut
    /// where it would leave the mesh.
    pub fn displace(&mut self, displacement: Vec2, stay_s: f64) {
        self.mode = Mode::Displace;
        self.reaction = Reaction::Brake { displacement, stay_ticks: self.ticks(stay_s) };
        if let Some(episode) = &mut self.episode {
            episode.displacements += 1;
        }
    }

    /// One step of the reaction in progress; false when there is none and the task goes on.
    pub(super) fn step_reaction(&mut self, dt_s: f64) -> Result<bool, FlightError> {
        let reaction = std::mem::replace(&mut self.reaction, Reaction::None);
        self.reaction = match reaction {
            Reaction::None => return Ok(false),
            Reaction::Wait { until_tick } => {
                self.brake(dt_s);
                self.waited_ticks += 1;
                if let Some(episode) = &mut self.episode {
                    episode.waited_ticks += 1;
                }
                if self.tick + 1 >= until_tick {
                    self.look_again();
                    Reaction::None
                } else {
                    Reaction::Wait { until_tick }
                }
            }
            Reaction::Brake { displacement, stay_ticks } => {
                self.brake(dt_s);
                if self.speed_mps > 0.0 {
                    Reaction::Brake { displacement, stay_ticks }
                } else {
                    let home = self.position;
                    let strafe = self.strafe(self.reachable(displacement))?;
                    Reaction::Out { strafe, stay_ticks, home }
                }
            }
            Reaction::Out { mut strafe, stay_ticks, home } => {
                strafe.step(dt_s);
                self.take_pose(&strafe);
                if strafe.arrived() {
                    // The capture that the displacement was for.
                    self.capture_now();
                    Reaction::Stay { until_tick: self.tick + 1 + stay_ticks, home }
                } else {
                    Reaction::Out { strafe, stay_ticks, home }
                }
            }
            Reaction::Stay { until_tick, home } => {
                if self.tick + 1 >= until_tick {
                    Reaction::Back { strafe: self.strafe(home)? }
                } else {
                    Reaction::Stay { until_tick, home }
                }
            }
            Reaction::Back { mut strafe } => {
                strafe.step(dt_s);
                self.take_pose(&strafe);
                if strafe.arrived() {
                    self.end_displacement();
                    Reaction::None
                } else {
                    Reaction::Back { strafe }
                }
            }
        };
        Ok(true)
    }

    fn end_displacement(&mut self) {
        let odometer_m = self.distance_m;
        if let Some(episode) = &mut self.episode {
            episode.displaced_at_m = odometer_m;
        }
    }

    fn brake(&mut self, dt_s: f64) {
        if let Task::Rail(follower) = &mut self.task {
            follower.brake();
            follower.step(dt_s);
            self.position = follower.position();
            self.yaw_rad = follower.yaw_rad();
            self.speed_mps = follower.speed_mps();
        }
    }

    /// The end of a displacement from here, cut short where it would leave the mesh.
    fn reachable(&self, displacement: Vec2) -> Vec2 {
        let shares = (1..=10).rev().map(|tenth| f64::from(tenth) / 10.0);
        let mut ends = shares.map(|share| self.position + displacement * share);
        ends.find(|end| self.ground.mesh.segment_inside(self.position, *end)).unwrap_or(self.position)
    }

    fn strafe(&self, to: Vec2) -> Result<Strafe, FlightError> {
        Ok(Strafe::new(&self.ground.mesh, self.position, to, self.yaw_rad, &self.settings.inspect)?)
    }
}
