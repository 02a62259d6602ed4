//! What a policy asked for on top of the command: waiting, or a displacement and back.

use super::error::FlightError;
use super::task::{Moving, Task};
use super::uav::UavState;
use crate::geometry::Vec2;
use crate::navigation::{Limits, Motion, NavMesh, Strafe};

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

/// What one time step of a reaction came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Progress {
    /// There is no reaction; the task goes on.
    Inactive,
    Waiting {
        is_over: bool,
    },
    Displacing,
    /// At the end of the displacement, where the capture is taken that it was for.
    Displaced,
    /// Back on the route.
    Returned,
}

impl Reaction {
    /// One time step. `next_tick` is the number of the step's end.
    pub fn step(
        &mut self,
        uav: &mut UavState,
        task: &mut Task,
        (mesh, limits): (&NavMesh, &Limits),
        next_tick: u64,
        dt_s: f64,
    ) -> Result<Progress, FlightError> {
        let (next, progress) = match std::mem::replace(self, Self::None) {
            Self::None => return Ok(Progress::Inactive),
            Self::Wait { until_tick } => {
                task.brake(uav, dt_s);
                let is_over = next_tick >= until_tick;
                let next = if is_over { Self::None } else { Self::Wait { until_tick } };
                (next, Progress::Waiting { is_over })
            }
            Self::Brake { displacement, stay_ticks } => {
                task.brake(uav, dt_s);
                let next = if uav.speed_mps > 0.0 {
                    Self::Brake { displacement, stay_ticks }
                } else {
                    let end = reachable(mesh, uav.position, displacement);
                    Self::Out { strafe: strafe(mesh, uav, end, limits)?, stay_ticks, home: uav.position }
                };
                (next, Progress::Displacing)
            }
            Self::Out { mut strafe, stay_ticks, home } => {
                strafe.step(dt_s);
                uav.take_pose(&strafe);
                if strafe.arrived() {
                    (Self::Stay { until_tick: next_tick + stay_ticks, home }, Progress::Displaced)
                } else {
                    (Self::Out { strafe, stay_ticks, home }, Progress::Displacing)
                }
            }
            Self::Stay { until_tick, home } => {
                let next = if next_tick >= until_tick {
                    Self::Back { strafe: strafe(mesh, uav, home, limits)? }
                } else {
                    Self::Stay { until_tick, home }
                };
                (next, Progress::Displacing)
            }
            Self::Back { mut strafe } => {
                strafe.step(dt_s);
                uav.take_pose(&strafe);
                if strafe.arrived() {
                    (Self::None, Progress::Returned)
                } else {
                    (Self::Back { strafe }, Progress::Displacing)
                }
            }
        };
        *self = next;
        Ok(progress)
    }

    pub fn is_none(&self) -> bool {
        matches!(self, Self::None)
    }

    /// When the wait that a policy asked for is over.
    pub fn waits_until(&self) -> Option<u64> {
        if let Self::Wait { until_tick } = self { Some(*until_tick) } else { None }
    }

    /// The displacement that a new command would have to cut short.
    pub fn moving(&self) -> Option<Moving> {
        self.strafe().map(|strafe| Moving::Strafe(strafe.clone()))
    }

    /// Over the ground; `None` when the reaction leaves that to the task.
    pub fn velocity_mps(&self) -> Option<Vec2> {
        self.strafe().map(Motion::velocity_mps)
    }

    fn strafe(&self) -> Option<&Strafe> {
        if let Self::Out { strafe, .. } | Self::Back { strafe } = self { Some(strafe) } else { None }
    }
}

/// The end of a displacement, cut short where it would leave the mesh.
fn reachable(mesh: &NavMesh, from: Vec2, displacement: Vec2) -> Vec2 {
    let shares = (1..=10).rev().map(|tenth| f64::from(tenth) / 10.0);
    let mut ends = shares.map(|share| from + displacement * share);
    ends.find(|end| mesh.segment_inside(from, *end)).unwrap_or(from)
}

fn strafe(mesh: &NavMesh, uav: &UavState, to: Vec2, limits: &Limits) -> Result<Strafe, FlightError> {
    Ok(Strafe::new(mesh, uav.position, to, uav.yaw_rad, limits)?)
}
